"""Boxes as a camera would have seen them had it not moved: the motion of a drone taken out of their places."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import FloatArray, IntArray


class SummedMotion:
    """The steps of a camera from frame to frame, added up."""

    def __init__(self) -> None:
        self._from_first: list[FloatArray] = []

    def __len__(self) -> int:
        return len(self._from_first)

    def append(self, step: FloatArray | None) -> None:
        """Add a frame.

        Args:
            step: ``(2, 3)`` similarity, where pixels of the frame before lie in this one; None for no motion.
        """
        before = self._from_first[-1] if self._from_first else np.eye(3)
        still = step is None or np.array_equal(step, np.eye(3)[:2])
        self._from_first.append(before if step is None or still else np.vstack([step, [0, 0, 1]]) @ before)

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
        matrices = np.stack([self._from_first[t] for t in chosen.tolist()])
        # Boxes of a camera that never moved stay as they are, to the last bit.
        if (matrices == np.eye(3)).all():
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
