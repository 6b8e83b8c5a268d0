"""A tracker of people under a camera that moves: it sees the boxes as if the camera stood still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tsuiseki.tracking.features.motion.camera_motion import undone
from tsuiseki.tracking.features.motion.camera_path import CameraPath, moved_boxes
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.people.tracker import PeopleTracker
from tsuiseki.tracking.types import FloatArray, Targets, Track


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

    def update(self, detections: DetectionsLike) -> Targets | None:
        """Take the detections of the next frame; what the tracker answers, in pixels of the frame it is about."""
        found = as_detections(detections)
        boxes = moved_boxes(found.boxes, self.path.transforms[self._frame])
        self._frame += 1
        targets = self.tracker.update(replace(found, boxes=boxes))
        if targets is None:
            return None
        return replace(targets, boxes=moved_boxes(targets.boxes, undone(self.path.transforms[targets.frame])))

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far, in pixels of their own frames."""
        return [replace(track, boxes=self._back(track)) for track in self.tracker.tracks()]

    def _back(self, track: Track) -> FloatArray:
        pairs = zip(track.frames.tolist(), track.boxes, strict=True)
        back = [moved_boxes(box[None], undone(self.path.transforms[frame])) for frame, box in pairs]
        return np.concatenate(back)
