"""SORT: people followed online by where they are alone (Bewley et al., "Simple online and realtime tracking", 2016)."""

from __future__ import annotations

from dataclasses import dataclass, field

from tsuiseki.tracking.association.assignment import assign
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.kalman import BoxMotion
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.people.lifecycle import LifecycleSettings, LifecycleTracker, ReportedBox, adjusted
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


class Sort(LifecycleTracker):
    """Each frame: predict every track, match predictions to detections by overlap, update what matched.

    The matching maximises the overlap (Hungarian method on 1 - IoU, gated). Beyond the paper, the boxes a track had
    before it was confirmed are in ``tracks()`` too once it is. It draws no random numbers.

    Args:
        min_iou: least overlap of a prediction and a detection that may be the same person, 0.3 by default.
        max_age: frames that a person is kept without a detection, 10 by default.
        min_hits: detections in a row from which on a person is shown, 3 by default; 1 shows everyone at once.
        start_score: lowest score of a detection that may start a track, 0.5 by default.
        boxes: ``filtered`` boxes of the Kalman filter, or those ``detected``; the former by default.
        settings: everything else; what is given by name goes before.
        seed: taken as by all trackers; nothing is drawn.

    >>> tracker = Sort()
    >>> for t in range(5):
    ...     people = tracker.update([[t, 0, t + 20, 50, 0.9]])
    >>> people.ids, people.status
    (array([1]), array(['tracking'], dtype='<U9'))
    >>> [track.frames.tolist() for track in tracker.tracks()]
    [[0, 1, 2, 3, 4]]
    """

    def __init__(
        self,
        settings: SortSettings | None = None,
        seed: int = 0,
        *,
        min_iou: float | None = None,
        max_age: int | None = None,
        min_hits: int | None = None,
        start_score: float | None = None,
        boxes: ReportedBox | None = None,
    ) -> None:
        life = {"max_age": max_age, "min_hits": min_hits, "start_score": start_score, "boxes": boxes}
        self.settings = adjusted(settings, SortSettings, min_iou=min_iou, **life)
        self.seed = seed
        super().__init__(self.settings.lifecycle, self.settings.motion)

    def update(self, detections: DetectionsLike, time: float | None = None) -> Targets:
        """Take the detections of the next frame; its people."""
        found = as_detections(detections, counted=self.bad)
        predicted = self._lifecycle.predict(time)
        least = self._lifecycle.least(self.settings.min_iou)
        seen, detected = assign(1 - iou_matrix(predicted, found.boxes), 1 - least)
        self._lifecycle.advance(seen, detected, found)
        return self._lifecycle.targets
