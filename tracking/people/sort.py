"""SORT: people followed online by where they are alone (Bewley et al., "Simple online and realtime tracking", 2016)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Unpack

from tsuiseki.tracking.association.assignment import assign
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.kalman import BoxMotion
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.people.lifecycle import LifecycleKeywords, LifecycleSettings, LifecycleTracker, adjusted
from tsuiseki.tracking.types import Targets


@dataclass(frozen=True)
class SortSettings:
    """Settings of SORT.

    Attributes:
        min_iou: least overlap of a prediction and a detection that may be the same person, in (0, 1].
        lifecycle: when tracks are confirmed and deleted.
        motion: noise of the Kalman filter.
    """

    min_iou: float = 0.3
    lifecycle: LifecycleSettings = field(default_factory=LifecycleSettings)
    motion: BoxMotion = field(default_factory=BoxMotion)

    def __post_init__(self) -> None:
        if not 0 < self.min_iou <= 1:
            raise RequestError(f"expected min_iou in (0, 1], got {self.min_iou}")


class SortKeywords(LifecycleKeywords, total=False):
    """What `Sort` takes by name; by default ``max_age`` is 10, ``min_hits`` 3 and ``start_score`` 0.5.

    Attributes:
        min_iou: least overlap of a prediction and a detection that may be the same person, 0.3 by default.
    """

    min_iou: float | None


class Sort(LifecycleTracker):
    """Each frame: predict every track, match predictions to detections by overlap, update what matched.

    The matching maximises the overlap (Hungarian method on 1 - IoU, gated). Beyond the paper, the boxes a track had
    before it was confirmed are in ``tracks()`` too once it is. It draws no random numbers.

    Args:
        settings: all of them; what is given by name goes before.
        seed: taken as by all trackers; nothing is drawn.
        given: see `SortKeywords`.

    >>> tracker = Sort()
    >>> for t in range(5):
    ...     people = tracker.update([[t, 0, t + 20, 50, 0.9]])
    >>> people.ids, people.status
    (array([1]), array(['tracking'], dtype='<U9'))
    >>> [track.frames.tolist() for track in tracker.tracks()]
    [[0, 1, 2, 3, 4]]
    """

    def __init__(self, settings: SortSettings | None = None, seed: int = 0, **given: Unpack[SortKeywords]) -> None:
        self.settings = adjusted(settings, SortSettings, given)
        super().__init__(self.settings, seed)

    def update(self, detections: DetectionsLike, time: float | None = None) -> Targets:
        """Take the detections of the next frame; its people."""
        found = as_detections(detections, counted=self.bad)
        predicted = self._lifecycle.predict(time)
        least = self._lifecycle.least(self.settings.min_iou)
        matched, detected = assign(1 - iou_matrix(predicted, found.boxes), 1 - least)
        self._lifecycle.advance(matched, detected, found)
        return self._lifecycle.targets
