"""Where the frames of a video lie when the camera moves: the similarities from frame to frame, added up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tsuiseki.tracking.features.motion.frame_runs import FrameRuns
from tsuiseki.tracking.types import FloatArray, IntArray

STILL = np.eye(3)


@dataclass(frozen=True)
class CameraStep:
    """How a camera moved from one frame to the next.

    Attributes:
        similarity: ``(2, 3)`` where pixels of the frame before lie in this one.
        deviation: standard deviation in pixels of that place; 0 where there is no doubt, infinite where nothing tells.
    """

    similarity: FloatArray
    deviation: float = 0.0


class CameraTrajectory:
    """The steps of a camera, from boxes or from images, and how far each can be trusted.

    Boxes that are taken ``to_first`` lie where the first frame would show them, so that they can be compared as if
    the camera stood still.

    Args:
        source: what the steps are estimated from.

    Attributes:
        unknown: frames whose step too little told; where nothing did, the camera is taken to stand still.
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
        other = CameraTrajectory(self.source)
        other.unknown, other.lost = self.unknown.copy(), self.lost.copy()
        other._to_now, other._variance = [*self._to_now], [*self._variance]
        other._first = self._first
        return other

    def forget(self, before: int) -> None:
        """Drop where the frames before one lie; the newest frame stays. ``unknown`` is kept."""
        count = min(before, len(self) - 1) - self._first
        if count > 0:
            del self._to_now[:count], self._variance[:count]
            self._first += count

    def append(
        self, step: FloatArray | None, deviation: float = 0.0, *, known: bool = True, moving: bool = False
    ) -> None:
        """Add a frame.

        Args:
            step: ``(2, 3)`` similarity, where pixels of the frame before lie in this one; None where nothing tells.
            deviation: standard deviation of the place of a box after the step, in heights of the box.
            known: whether enough tells the step; never where it is None.
            moving: whether the camera moved until then.
        """
        before = self._to_now[-1] if self._to_now else STILL
        if (step is None or not known) and self._to_now:
            self.unknown.append(len(self))
            if moving:
                self.lost.append(len(self))
        still = step is None or np.array_equal(step, STILL[:2])
        self._to_now.append(before if step is None or still else np.vstack([step, STILL[2]]) @ before)
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
        # Boxes of a camera that never moved stay as they are, to the last bit.
        if (matrices == STILL).all():
            return boxes
        return move_boxes(boxes, (np.linalg.inv(matrices) if inverse else matrices)[which, :2])


def move_boxes(boxes: FloatArray, similarities: FloatArray) -> FloatArray:
    """``(N, 4)`` boxes with their centres taken through ``(N, 2, 3)`` similarities and their sizes scaled, not turned.

    >>> move_boxes(np.array([[0.0, 0, 2, 4]]), np.array([[[2.0, 0, 10], [0, 2, 0]]])).tolist()
    [[10.0, 0.0, 14.0, 8.0]]
    """
    centre = (boxes[:, :2] + boxes[:, 2:]) / 2
    moved = np.einsum("nij,nj->ni", similarities[:, :, :2], centre) + similarities[:, :, 2]
    half = (boxes[:, 2:] - boxes[:, :2]) / 2 * np.linalg.norm(similarities[:, :, 0], axis=1)[:, None]
    return np.concatenate([moved - half, moved + half], axis=1)


def said_of_camera(unknown: Sequence[Sequence[int]], source: Literal["boxes", "images"] = "images") -> str:
    """One line on the frames of which too little tells how the camera moved there.

    Args:
        unknown: first and last frame, counted from 1, of at least one run of them.
        source: of the estimate.

    >>> said_of_camera([[13, 13], [87, 95]])
    'how the camera moved into frames 13, 87-95 is not known; links over them reach further'
    """
    which = ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in unknown[:5])
    if more := sum(last - first + 1 for first, last in unknown[5:]):
        which += f" and {more} more"
    frames = "frame" if [*unknown[0]] == [unknown[-1][1]] * 2 else "frames"
    told = "is not known" if source == "images" else "is not known from the few boxes there"
    return f"how the camera moved into {frames} {which} {told}; links over them reach further"
