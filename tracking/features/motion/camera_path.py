"""Where the frames of a video lie, from its images: steps of the camera added up (see `camera_motion`).

Boxes of a moving camera can then be compared as if it stood still.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tsuiseki.tracking.features.motion.camera_motion import STANDS_STILL, CameraMotionSettings, View, view_step
from tsuiseki.tracking.features.motion.camera_trajectory import CameraStep
from tsuiseki.tracking.features.motion.frame_runs import FrameRuns
from tsuiseki.tracking.types import FloatArray, ImageArray


@dataclass(frozen=True)
class _Placed:
    """A frame that others are compared with, and the ``(2, 3)`` transform from its pixels to those of the first."""

    frame: int
    view: View
    transform: FloatArray


@dataclass
class CameraPath:
    """Where the frames of a video lie, in pixels of the first.

    A frame is compared with the one before. Where that tells nothing, the next ones are compared with the last frame
    whose place is known, too, so that one smeared frame does not lose the way.

    Attributes:
        settings: of the estimate.
        transforms: one ``(2, 3)`` similarity a frame that is not forgotten, from its pixels to those of the first.
        deviations: by frame, standard deviation in pixels of where the frame before lies in it, where that is in doubt.
        unknown: frames whose movement nothing told; they lie where the frame before does.
    """

    settings: CameraMotionSettings = field(default_factory=CameraMotionSettings)
    transforms: list[FloatArray] = field(default_factory=list)
    deviations: dict[int, float] = field(default_factory=dict)
    unknown: FrameRuns = field(default_factory=FrameRuns)
    _before: _Placed | None = None
    _lost_from: _Placed | None = None
    _forgotten: int = 0

    def __len__(self) -> int:
        """Frames so far, forgotten ones among them."""
        return self._forgotten + len(self.transforms)

    def forget(self, before: int) -> None:
        """Drop where the frames before one lie, but for what the step into that one takes. ``unknown`` is kept."""
        count = min(before, len(self)) - 1 - self._forgotten
        if count > 0:
            del self.transforms[:count]
            self._forgotten += count
            self.deviations = {frame: value for frame, value in self.deviations.items() if frame >= self._forgotten}

    def add(self, image: ImageArray, people: FloatArray | None = None) -> FloatArray:
        """Take the next frame, in which ``people`` ``(N, 4)`` may move by themselves; returns its transform."""
        frame, before = len(self), self._before
        view = View.of(image, self.settings, None if people is None else np.asarray(people, dtype=np.float64))
        transform = STANDS_STILL if before is None else self._transform(before, view, frame)
        self.transforms.append(transform)
        still = before is not None and transform is before.transform and frame not in self.unknown
        if before is None or not still or frame - before.frame >= self.settings.patience:
            self._before = _Placed(frame, view, transform)
        return transform

    def follow(self, step: CameraStep) -> None:
        """Take a step that is known from elsewhere instead of the next frame."""
        frame = len(self)
        if frame and np.isinf(step.deviation):
            self.unknown.append(frame)
        elif frame and step.deviation > 0:
            self.deviations[frame] = step.deviation
        self.transforms.append(_moved_on(self.transforms[-1], step) if frame else STANDS_STILL)

    def step(self, frame: int) -> CameraStep:
        """Where pixels of the frame before lie in a frame, of infinite deviation where nothing told."""
        if frame == 0:
            return CameraStep(STANDS_STILL)
        earlier, now = (np.vstack([self.transforms[k - self._forgotten], [0, 0, 1]]) for k in (frame - 1, frame))
        # A camera that stood still is told from one that moved by less than rounding.
        same = np.array_equal(earlier, now)
        similarity = STANDS_STILL if same else np.asarray(np.linalg.solve(now, earlier)[:2])
        return CameraStep(similarity, np.inf if frame in self.unknown else self.deviations.get(frame, 0.0))

    def _transform(self, before: _Placed, view: View, frame: int) -> FloatArray:
        """Where the next frame lies."""
        lost_from = self._lost_from
        if lost_from is not None:
            over = view_step(lost_from.view, view)
            if over is not None:
                # The way from the frame before, which lies somewhere, stays unknown.
                self.unknown.append(frame)
                self._lost_from = None
                return _moved_on(lost_from.transform, over)
            if frame - lost_from.frame >= self.settings.patience:
                self._lost_from = None
        step = view_step(before.view, view)
        if step is None:
            self.unknown.append(frame)
            self._lost_from = lost_from or before
            return before.transform
        if step.deviation > 0:
            self.deviations[frame] = step.deviation
        return _moved_on(before.transform, step)


def _moved_on(transform: FloatArray, step: CameraStep) -> FloatArray:
    """The transform of a frame that lies a ``step`` after one of the given transform."""
    if np.array_equal(step.similarity, STANDS_STILL):
        return transform
    whole = np.vstack([transform, [0, 0, 1]]) @ np.linalg.inv(np.vstack([step.similarity, [0, 0, 1]]))
    return np.asarray(whole[:2])


def moved_boxes(boxes: FloatArray, transform: FloatArray) -> FloatArray:
    """``boxes`` ``(N, 4)`` after a similarity ``(2, 3)``: the middle goes along, the sides are scaled, not turned."""
    if (transform == np.eye(3)[:2]).all():
        return boxes
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2 @ transform[:, :2].T + transform[:, 2]
    half = (boxes[:, 2:] - boxes[:, :2]) / 2 * np.hypot(*transform[:, 0])
    return np.concatenate([middle - half, middle + half], axis=1)
