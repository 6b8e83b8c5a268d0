"""Any tracker as if the camera stood still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tsuiseki.tracking.features.camera_motion import undone
from tsuiseki.tracking.features.camera_path import CameraPath, move_boxes
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.people.contract import PeopleTracker, skipped, updated
from tsuiseki.tracking.types import Targets, Track


class MotionCompensated:
    """Moves detections into the first frame's pixels for ``tracker``, and its tracks back.

    So overlaps, distances and filled gaps are those of a camera that stands still; where it does, nothing changes.

    Args:
        tracker: a fresh one.
        path: gets each frame before its detections come here.
    """

    def __init__(self, tracker: PeopleTracker, path: CameraPath) -> None:
        self.tracker, self.path = tracker, path
        self._frame = 0

    def update(self, detections: DetectionsLike, time: float | None = None) -> Targets | None:
        """Take the detections of the next frame; what the tracker answers, in pixels of the frame it is about."""
        detections = as_detections(detections)
        boxes = move_boxes(detections.boxes, self.path.transforms[self._frame])
        self._frame += 1
        return self._returned(updated(self.tracker, replace(detections, boxes=boxes), time))

    def skip(self) -> Targets | None:
        """The detector does not run on the next frame."""
        self._frame += 1
        return self._returned(skipped(self.tracker))

    def _returned(self, targets: Targets | None) -> Targets | None:
        if targets is None:
            return None
        return replace(targets, boxes=move_boxes(targets.boxes, undone(self.path.transforms[targets.frame])))

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far, in pixels of their own frames."""
        back = [undone(transform) for transform in self.path.transforms]
        tracks = self.tracker.tracks()
        return [replace(t, boxes=move_boxes(t.boxes, np.stack([back[n] for n in t.frames.tolist()]))) for t in tracks]


def inner_tracker(tracker: PeopleTracker) -> PeopleTracker:
    """What links, also where the movement of the camera is taken out before."""
    return tracker.tracker if isinstance(tracker, MotionCompensated) else tracker
