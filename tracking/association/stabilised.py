"""Boxes as a camera would have seen them had it not moved: the motion of a drone taken out of their places.

Every frame has a transformation from the first frame's pixels to its own. A box is taken through one by its centre, and
its size is scaled as the picture is there; boxes stay upright however the camera turns.
"""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import FloatArray, IntArray


class CameraPath:
    """The motion of the camera from frame to frame, added up."""

    def __init__(self) -> None:
        self._from_first: list[FloatArray] = []

    def __len__(self) -> int:
        return len(self._from_first)

    def append(self, motion: FloatArray | None) -> None:
        """Add a frame.

        Args:
            motion: ``(3, 3)`` where pixels of the frame before lie in this one, homogeneous; None for no motion.
        """
        before = self._from_first[-1] if self._from_first else np.eye(3)
        path = before if motion is None else motion @ before
        self._from_first.append(path / path[2, 2])

    def to_first(self, boxes: FloatArray, frames: IntArray) -> FloatArray:
        """``(N, 4)`` boxes of ``(N,)`` frames where the first frame would show them."""
        return self._moved(boxes, frames, inverse=True)

    def from_first(self, boxes: FloatArray, frames: IntArray) -> FloatArray:
        """The other way round."""
        return self._moved(boxes, frames, inverse=False)

    def _moved(self, boxes: FloatArray, frames: IntArray, *, inverse: bool) -> FloatArray:
        if len(boxes) == 0:
            return boxes
        chosen, which = np.unique(frames, return_inverse=True)
        matrices = np.stack([self._from_first[t] for t in chosen.tolist()])
        return move_boxes(boxes, (np.linalg.inv(matrices) if inverse else matrices)[which])


def move_boxes(boxes: FloatArray, matrices: FloatArray) -> FloatArray:
    """``(N, 4)`` boxes with their centres taken through ``(N, 3, 3)`` homographies and their sizes scaled likewise.

    >>> move_boxes(np.array([[0.0, 0, 2, 4]]), np.array([[[2.0, 0, 10], [0, 2, 0], [0, 0, 1]]])).tolist()
    [[10.0, 0.0, 14.0, 8.0]]
    """
    centre = (boxes[:, :2] + boxes[:, 2:]) / 2
    homogeneous = np.einsum("nij,nj->ni", matrices, np.column_stack([centre, np.ones(len(centre))]))
    depth = homogeneous[:, 2]
    moved = homogeneous[:, :2] / depth[:, None]
    # The area at a point grows by det(H) / depth^3.
    scale = np.sqrt(np.abs(np.linalg.det(matrices) / depth**3))
    half = (boxes[:, 2:] - boxes[:, :2]) / 2 * scale[:, None]
    return np.concatenate([moved - half, moved + half], axis=1)
