"""Where the frames of a video lie when the camera moves: its steps from frame to frame, added up.

Boxes of a moving camera can then be compared as if it stood still. `CameraPath` takes the steps from images (see
`camera_motion`), `CameraTrajectory` from boxes or images, with how far each can be trusted.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from tsuiseki.tracking.features.camera_motion import (
    PATIENCE,
    STANDS_STILL,
    CameraFrame,
    CameraStep,
    frame_step,
)
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray


class FrameRuns:
    """Frames that come in increasing order.

    Args:
        frames: to begin with.

    Attributes:
        runs: first and last frame of each run of neighbours.

    >>> runs = FrameRuns([3, 7, 8, 9])
    >>> runs.runs, len(runs), 8 in runs, 5 in runs
    ([(3, 3), (7, 9)], 4, True, False)
    """

    def __init__(self, frames: Iterable[int] = ()) -> None:
        self.runs: list[tuple[int, int]] = []
        for frame in frames:
            self.append(frame)

    def append(self, frame: int) -> None:
        """Add a frame that comes after all others."""
        first, last = self.runs[-1] if self.runs else (frame, -1)
        if self.runs and frame <= last:
            raise ValueError(f"expected a frame after {last}, got {frame}")
        if self.runs and frame == last + 1:
            self.runs[-1] = first, frame
        else:
            self.runs.append((frame, frame))

    def copy(self) -> FrameRuns:
        """A copy that goes on by itself."""
        clone = FrameRuns()
        clone.runs = [*self.runs]
        return clone

    def from_one(self) -> list[list[int]]:
        """First and last frame of each run, counted from 1."""
        return [[first + 1, last + 1] for first, last in self.runs]

    def __len__(self) -> int:
        return sum(last - first + 1 for first, last in self.runs)

    def __iter__(self) -> Iterator[int]:
        return (frame for first, last in self.runs for frame in range(first, last + 1))

    def __contains__(self, frame: object) -> bool:
        if not isinstance(frame, int):
            return False
        place = bisect_right(self.runs, (frame, frame)) - 1
        return any(first <= frame <= last for first, last in self.runs[max(place, 0) : place + 2])


# The transform ``(3, 3)`` of a camera that did not move.
STILL = np.eye(3)


class CameraTrajectory:
    """The steps of a camera, from boxes or from images, and how far each can be trusted.

    Boxes that are taken ``to_first`` lie where the first frame would show them, so that they can be compared as if
    the camera stood still.

    Args:
        source: what the steps are estimated from.

    Attributes:
        unknown: frames with too little evidence of a step; without any, the camera is taken to stand still.
        lost: those of them that a moving camera came to.
    """

    def __init__(self, source: Literal["boxes", "images"] = "boxes") -> None:
        self.source = source
        self.unknown, self.lost = FrameRuns(), FrameRuns()
        self._first = 0
        self._to_now: list[FloatArray] = []
        self._variance: list[float] = []

    def __len__(self) -> int:
        return self._first + len(self._to_now)

    def copy(self) -> CameraTrajectory:
        """A copy that goes on by itself."""
        clone = CameraTrajectory(self.source)
        clone.unknown, clone.lost = self.unknown.copy(), self.lost.copy()
        clone._to_now, clone._variance = [*self._to_now], [*self._variance]
        clone._first = self._first
        return clone

    def forget(self, end: int) -> None:
        """Drop where the frames before ``end`` lie; the newest frame stays. ``unknown`` is kept."""
        count = min(end, len(self) - 1) - self._first
        if count > 0:
            del self._to_now[:count], self._variance[:count]
            self._first += count

    def append(
        self, step: FloatArray | None, deviation: float = 0.0, *, reliable: bool = True, moving: bool = False
    ) -> None:
        """Add a frame.

        Args:
            step: ``(2, 3)`` similarity, where pixels of the frame before lie in this one; None where nothing tells.
            deviation: standard deviation of the place of a box after the step, in heights of the box.
            reliable: whether enough tells the step; never where it is None.
            moving: whether the camera moved until then.
        """
        previous = self._to_now[-1] if self._to_now else STILL
        if (step is None or not reliable) and self._to_now:
            self.unknown.append(len(self))
            if moving:
                self.lost.append(len(self))
        still = step is None or np.array_equal(step, STILL[:2])
        self._to_now.append(previous if step is None or still else np.vstack([step, STILL[2]]) @ previous)
        self._variance.append((self._variance[-1] if self._variance else 0.0) + deviation**2)

    def variance(self, frames: IntArray) -> FloatArray:
        """``(N,)`` variance of the place of a box, in squared heights, that the steps up to ``frames`` add up to."""
        return np.asarray(self._variance)[frames - self._first]

    def to_first(self, boxes: FloatArray, frames: IntArray) -> FloatArray:
        """``(N, 4)`` boxes of ``(N,)`` frames where the first frame would show them; they stay upright."""
        return self._moved(boxes, frames, inverse=True)

    def from_first(self, boxes: FloatArray, frames: IntArray) -> FloatArray:
        """The other way round."""
        return self._moved(boxes, frames, inverse=False)

    def _moved(self, boxes: FloatArray, frames: IntArray, *, inverse: bool) -> FloatArray:
        if len(boxes) == 0:
            return boxes
        chosen, which = np.unique(frames, return_inverse=True)
        matrices = np.stack([self._to_now[t - self._first] for t in chosen.tolist()])
        return move_boxes(boxes, (np.linalg.inv(matrices) if inverse else matrices)[which, :2])


def move_boxes(boxes: FloatArray, similarities: FloatArray) -> FloatArray:
    """``(N, 4)`` boxes with their centres taken through similarities and their sizes scaled, not turned.

    Args:
        boxes: pixels.
        similarities: ``(N, 2, 3)``, or ``(2, 3)`` for all; what all of them leave in place stays to the last bit.

    >>> move_boxes(np.array([[0.0, 0, 2, 4]]), np.array([[2.0, 0, 10], [0, 2, 0]])).tolist()
    [[10.0, 0.0, 14.0, 8.0]]
    """
    if (similarities == STANDS_STILL).all():
        return boxes
    matrices = np.broadcast_to(similarities, (len(boxes), 2, 3))
    centre = (boxes[:, :2] + boxes[:, 2:]) / 2
    moved = np.einsum("nij,nj->ni", matrices[:, :, :2], centre) + matrices[:, :, 2]
    half = (boxes[:, 2:] - boxes[:, :2]) / 2 * np.linalg.norm(matrices[:, :, 0], axis=1)[:, None]
    return np.concatenate([moved - half, moved + half], axis=1)


def line_on_camera(unknown: Sequence[Sequence[int]], source: Literal["boxes", "images"] = "images") -> str:
    """One line on the frames of which too little tells how the camera moved there.

    Args:
        unknown: first and last frame, counted from 1, of at least one run of them.
        source: of the estimate.

    >>> line_on_camera([[13, 13], [87, 95]])
    'how the camera moved into frames 13, 87-95 is not known; links over them reach further'
    """
    which = ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in unknown[:5])
    if further := sum(last - first + 1 for first, last in unknown[5:]):
        which += f" and {further} more"
    frames = "frame" if [*unknown[0]] == [unknown[-1][1]] * 2 else "frames"
    reason = "is not known" if source == "images" else "is not known from the few boxes there"
    return f"how the camera moved into {frames} {which} {reason}; links over them reach further"


@dataclass(frozen=True)
class _Placed:
    """A frame that others are compared with, and the ``(2, 3)`` transform from its pixels to those of the first."""

    frame: int
    view: CameraFrame
    transform: FloatArray


@dataclass
class CameraPath:
    """Where the frames of a video lie, in pixels of the first.

    A frame is compared with the one before. Where that tells nothing, the next ones are compared with the last frame
    whose place is known, too, so that one smeared frame does not lose the way.

    Attributes:
        transforms: one ``(2, 3)`` similarity a frame that is not forgotten, from its pixels to those of the first.
        deviations: by frame, standard deviation in pixels of where the frame before lies in it, where that is in doubt.
        unknown: frames without evidence of movement; they lie where the frame before does.
    """

    transforms: list[FloatArray] = field(default_factory=list)
    deviations: dict[int, float] = field(default_factory=dict)
    unknown: FrameRuns = field(default_factory=FrameRuns)
    _reference: _Placed | None = None
    _lost_from: _Placed | None = None
    _forgotten: int = 0

    def __len__(self) -> int:
        """Frames so far, forgotten ones among them."""
        return self._forgotten + len(self.transforms)

    def forget(self, end: int) -> None:
        """Drop where the frames before ``end`` lie, but for what the step into it takes. ``unknown`` is kept."""
        count = min(end, len(self)) - 1 - self._forgotten
        if count > 0:
            del self.transforms[:count]
            self._forgotten += count
            self.deviations = {frame: value for frame, value in self.deviations.items() if frame >= self._forgotten}

    def add(self, image: ImageArray, people: FloatArray | None = None) -> FloatArray:
        """Take the next frame, in which ``people`` ``(N, 4)`` may move by themselves; returns its transform."""
        frame, reference = len(self), self._reference
        view = CameraFrame.of(image, None if people is None else np.asarray(people, dtype=np.float64))
        transform = STANDS_STILL if reference is None else self._transform(reference, view, frame)
        self.transforms.append(transform)
        still = reference is not None and transform is reference.transform and frame not in self.unknown
        if reference is None or not still or frame - reference.frame >= PATIENCE:
            self._reference = _Placed(frame, view, transform)
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
        """Where pixels of the frame before lie in a frame, of infinite deviation without evidence."""
        if frame == 0:
            return CameraStep(STANDS_STILL)
        earlier, now = (np.vstack([self.transforms[k - self._forgotten], [0, 0, 1]]) for k in (frame - 1, frame))
        # A camera that stood still differs from one that moved by less than rounding.
        same = np.array_equal(earlier, now)
        similarity = STANDS_STILL if same else np.asarray(np.linalg.solve(now, earlier)[:2])
        return CameraStep(similarity, np.inf if frame in self.unknown else self.deviations.get(frame, 0.0))

    def _transform(self, reference: _Placed, view: CameraFrame, frame: int) -> FloatArray:
        """Where the next frame lies."""
        lost_from = self._lost_from
        if lost_from is not None:
            over = frame_step(lost_from.view, view)
            if over is not None:
                # The way from the frame before, which lies somewhere, stays unknown.
                self.unknown.append(frame)
                self._lost_from = None
                return _moved_on(lost_from.transform, over)
            if frame - lost_from.frame >= PATIENCE:
                self._lost_from = None
        step = frame_step(reference.view, view)
        if step is None:
            self.unknown.append(frame)
            self._lost_from = lost_from or reference
            return reference.transform
        if step.deviation > 0:
            self.deviations[frame] = step.deviation
        return _moved_on(reference.transform, step)


def _moved_on(transform: FloatArray, step: CameraStep) -> FloatArray:
    """The transform of a frame that lies a ``step`` after one of the given transform."""
    if np.array_equal(step.similarity, STANDS_STILL):
        return transform
    matrix = np.vstack([transform, [0, 0, 1]]) @ np.linalg.inv(np.vstack([step.similarity, [0, 0, 1]]))
    return np.asarray(matrix[:2])
