"""Changes of the tracker's costs by a few numbers, shares of learnt ones, and learnt ones put together."""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from tsuiseki.tracking.association.evidence import DETECTION_FEATURES, LINK_FEATURES
from tsuiseki.tracking.association.learnt_costs import LARGEST, CostChanges
from tsuiseki.tracking.types import FloatArray

COST, SECONDS = (LINK_FEATURES.index(name) for name in ("cost", "seconds"))
LOGIT = DETECTION_FEATURES.index("logit")


@dataclass(frozen=True)
class Scalars:
    """Six numbers that change the tracker's costs; a `CostChanges`. All 0 is the tracker as it is.

    Attributes:
        link: the share that links cost more.
        waiting: cost of a second that a link passes over.
        worth: cost of using a detection.
        logit: of a unit of the logit of its probability.
        ends: of a start, and of an end.
        join: of a join of tracklets.
    """

    link: float = 0.0
    waiting: float = 0.0
    worth: float = 0.0
    logit: float = 0.0
    ends: float = 0.0
    join: float = 0.0

    def links(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of links."""
        return _within(self.link * rows[:, COST] + self.waiting * rows[:, SECONDS])

    def detections(self, rows: FloatArray) -> FloatArray:
        """``(N, 3)`` changes of the costs of detections, of a track's start and of its end there."""
        ends = np.full(len(rows), self.ends)
        return _within(np.stack([self.worth + self.logit * rows[:, LOGIT], ends, ends], axis=1))

    def joins(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of joins."""
        return np.full(len(rows), self.join)

    def stepped(self, place: int, step: float) -> Scalars:
        """The same with one number changed."""
        values = list(astuple(self))
        values[place] = round(values[place] + step, 6)
        return Scalars(*values)


@dataclass(frozen=True)
class Shrunk:
    """Shares of learnt changes; a `CostChanges`.

    Attributes:
        learnt: the changes.
        links_share: of those of links and joins.
        detections_share: of those of detections, starts and ends.
    """

    learnt: CostChanges
    links_share: float
    detections_share: float

    def links(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of links."""
        return self.links_share * self.learnt.links(rows)

    def detections(self, rows: FloatArray) -> FloatArray:
        """``(N, 3)`` changes of the costs of detections, of a track's start and of its end there."""
        return self.detections_share * self.learnt.detections(rows)

    def joins(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of joins."""
        return self.links_share * self.learnt.joins(rows)


@dataclass(frozen=True)
class Mixed:
    """Changes of links and joins that one learnt, of detections that another did; a `CostChanges`.

    Attributes:
        of_links: gives those of links and joins.
        of_detections: gives those of detections, starts and ends.
    """

    of_links: CostChanges
    of_detections: CostChanges

    def links(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of links."""
        return self.of_links.links(rows)

    def detections(self, rows: FloatArray) -> FloatArray:
        """``(N, 3)`` changes of the costs of detections, of a track's start and of its end there."""
        return self.of_detections.detections(rows)

    def joins(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of joins."""
        return self.of_links.joins(rows)


def _within(change: FloatArray) -> FloatArray:
    return np.asarray(np.clip(change, -LARGEST, LARGEST))
