"""Boxes that many anchors agree on: what suppression keeps lies where all the candidates for it lie on average.

Gidaris and Komodakis, *Object detection via a multi-region and semantic segmentation-aware CNN model*, ICCV 2015,
section 5.2 (bounding box voting).
"""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import FloatArray, IntArray


def voted_boxes(boxes: FloatArray, scores: FloatArray, kept: IntArray, iou_threshold: float) -> FloatArray:
    """``(K, 4)`` places of the ``kept`` boxes: means of all boxes about each, weighted by their scores.

    Args:
        boxes: ``(N, 4)`` pixels, all candidates.
        scores: ``(N,)`` positive.
        kept: ``(K,)`` which of them suppression has left.
        iou_threshold: in (0, 1]; boxes with at least this intersection over union with a kept one vote for its place.
    """
    votes = np.where(iou_matrix(boxes[kept], boxes) >= iou_threshold, scores[None], 0.0)
    # A box overlaps itself by 1, give or take rounding.
    votes[np.arange(len(kept)), kept] = scores[kept]
    return np.asarray(votes @ boxes / votes.sum(axis=1, keepdims=True))
