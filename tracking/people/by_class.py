"""A tracker of its own for every class."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.people.contract import PeopleTracker, skipped, updated
from tsuiseki.tracking.people.motion_compensated import inner_tracker
from tsuiseki.tracking.people.run_log import FirstDetections
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Targets, Track
from tsuiseki.tracking.types.class_choice import called

# Overlap (intersection over union) from which on two boxes show one thing.
_SAME_PLACE = 0.5
# Share of a track's detections that counts as nearly all of them.
_NEARLY_ALL = 0.8
# Latest ids that are remembered when the past is forgotten: more than ever live at a time.
KEPT = 10_000


def without_flicker(tracks: Sequence[Track]) -> list[Track]:
    """The tracks but for those that another class has only because a detector took one thing for another now and then.

    Nearly all detections of such a track lie on a track of another class with more detections, in frames in which that
    was not detected.
    """
    if len({track.class_id for track in tracks}) < 2:
        return list(tracks)
    owner = np.repeat(np.arange(len(tracks)), [track.frames[-1] - track.frames[0] + 1 for track in tracks])
    frames, boxes, detected = (np.concatenate(column) for column in zip(*map(_without_gaps, tracks), strict=True))
    classes = np.array([track.class_id for track in tracks])
    counts = np.bincount(owner[detected], minlength=len(tracks))
    shared = np.zeros((len(tracks), len(tracks)), dtype=np.int64)
    for frame in np.unique(frames[~detected]).tolist():
        there, filled = (np.flatnonzero((frames == frame) & (detected == flag)) for flag in (True, False))
        i, j = np.nonzero(iou_matrix(boxes[there], boxes[filled]) >= _SAME_PLACE)
        np.add.at(shared, (owner[there[i]], owner[filled[j]]), 1)
    shared *= (classes[:, None] != classes) & (counts[:, None] < counts)
    flickering = shared.max(axis=1) >= _NEARLY_ALL * counts
    return [track for track, flickers in zip(tracks, flickering, strict=True) if not flickers]


def _without_gaps(track: Track) -> tuple[IntArray, FloatArray, BoolArray]:
    """All frames from the first to the last, the boxes there, on straight lines in gaps, and where one was detected."""
    frames = np.arange(track.frames[0], track.frames[-1] + 1)
    boxes = np.column_stack([np.interp(frames, track.frames, side) for side in track.boxes.T])
    return frames, boxes, np.isin(frames, track.frames[track.observed])


class ByClass:
    """A tracker of its own for every class; ids are unique over all of them.

    Args:
        make: gives a fresh tracker for a class.
        classes: those to track, numbers or names in small letters. Detections of others are passed over.

    Attributes:
        trackers: by class.
        first: their first detections, by class.

    >>> from tsuiseki.tracking.people.sort import Sort
    >>> tracker = ByClass(Sort, [1, 2])
    >>> for _ in range(4):
    ...     people = tracker.update([[0, 0, 20, 50, 0.9, 1], [1, 0, 21, 50, 0.9, 2]])
    >>> people.classes, [track.class_id for track in tracker.tracks()]
    (array([1, 2]), [1, 2])
    """

    def __init__(self, make: Callable[[], PeopleTracker], classes: Sequence[int | str]) -> None:
        self.first = {number: FirstDetections() for number in classes}
        self.trackers = {number: make() for number in classes}
        self._ids: dict[tuple[int | str, int], int] = {}
        self._count = 0

    def update(self, detections: DetectionsLike, time: float | None = None) -> Targets | None:
        """Take the next frame; the targets of all classes, where every class has decided on the same frame."""
        detections = as_detections(detections)
        classes = detections.origin[:, 1]
        by_class = {n: detections.select(np.isin(classes, called(n, detections.names))) for n in self.trackers}
        for number, rows in by_class.items():
            self.first[number].add(rows)
        return self._joined([updated(tracker, by_class[number], time) for number, tracker in self.trackers.items()])

    def skip(self) -> Targets | None:
        """The detector does not run on the next frame."""
        return self._joined([skipped(tracker) for tracker in self.trackers.values()])

    def _joined(self, answers: Sequence[Targets | None]) -> Targets | None:
        numbered = zip(self.trackers, answers, strict=True)
        decided = [self._renumbered(number, answer) for number, answer in numbered if answer is not None]
        if len(decided) < len(answers) or len({answer.frame for answer in decided}) != 1:
            return None
        names = {number: name for answer in decided for number, name in answer.names.items()}
        ids, boxes, scores, status, origin = (
            np.concatenate([getattr(answer, name) for answer in decided])
            for name in ("ids", "boxes", "scores", "status", "origin")
        )
        return Targets(decided[0].frame, ids, boxes, scores, status, origin, names)

    def tracks(self) -> list[Track]:
        """The tracks of all classes, by id."""
        tracks = [
            replace(track, id=self._id(number, track.id))
            for number, tracker in self.trackers.items()
            for track in tracker.tracks()
        ]
        return sorted(without_flicker(tracks), key=lambda track: track.id)

    def forget(self) -> None:
        for tracker in self.trackers.values():
            inner_tracker(tracker).forget()  # type: ignore[attr-defined]
        if len(self._ids) > 2 * KEPT:
            self._ids = dict(list(self._ids.items())[-KEPT:])

    def _renumbered(self, number: int | str, targets: Targets) -> Targets:
        return replace(
            targets, ids=np.array([self._id(number, inner) for inner in targets.ids.tolist()], dtype=np.int64)
        )

    def _id(self, number: int | str, inner: int) -> int:
        """The id over all classes; what was reported once stays."""
        if (number, inner) not in self._ids:
            self._count += 1
            self._ids[number, inner] = self._count
        return self._ids[number, inner]
