"""Boxes, axis-aligned and turned: conversions, overlap, suppression."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Points across and down at which it is measured what several boxes share with one.
_GRID = (10, 20)


def corners_from_xywh(xywh: FloatArray) -> FloatArray:
    """``(N, 4)`` x, y, width, height to x1, y1, x2, y2."""
    xywh = np.asarray(xywh, dtype=np.float64)
    return np.concatenate([xywh[..., :2], xywh[..., :2] + xywh[..., 2:]], axis=-1)


def xywh_from_corners(boxes: FloatArray) -> FloatArray:
    """``(N, 4)`` x1, y1, x2, y2 to x, y, width, height."""
    boxes = np.asarray(boxes, dtype=np.float64)
    return np.concatenate([boxes[..., :2], boxes[..., 2:] - boxes[..., :2]], axis=-1)


def centres(boxes: FloatArray) -> FloatArray:
    """``(..., 2)`` centres of ``(..., 4)`` boxes."""
    return np.asarray((boxes[..., :2] + boxes[..., 2:]) / 2)


def areas(boxes: FloatArray) -> FloatArray:
    """``(...)`` areas of ``(..., 4)`` boxes, zero where a box is empty."""
    size: FloatArray = np.clip(boxes[..., 2:] - boxes[..., :2], 0, None)
    return np.asarray(size[..., 0] * size[..., 1])


def intersections(a: FloatArray, b: FloatArray) -> FloatArray:
    """Areas shared by ``(..., 4)`` boxes ``a`` and ``b``, broadcast against each other."""
    shared: FloatArray = np.clip(np.minimum(a[..., 2:], b[..., 2:]) - np.maximum(a[..., :2], b[..., :2]), 0, None)
    return np.asarray(shared[..., 0] * shared[..., 1])


def iou_pairs(a: FloatArray, b: FloatArray) -> FloatArray:
    """Intersection over union of ``(..., 4)`` boxes, broadcast against each other, in [0, 1].

    >>> float(iou_pairs(np.array([0, 0, 2, 1.0]), np.array([1, 0, 3, 1.0])))
    0.3333333333333333
    """
    shared = intersections(a, b)
    union = areas(a) + areas(b) - shared
    return np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)


def iou_matrix(a: FloatArray, b: FloatArray) -> FloatArray:
    """``(N, M)`` intersection over union of ``(N, 4)`` and ``(M, 4)`` boxes."""
    return iou_pairs(a[:, None, :], b[None, :, :])


def clip_boxes(boxes: FloatArray, width: int, height: int) -> FloatArray:
    """Boxes cut off at the image border; one that lies outside becomes empty."""
    return np.clip(boxes, 0, np.array([width, height, width, height], dtype=np.float64))


def grown(boxes: FloatArray, share: float) -> FloatArray:
    """Boxes ``(N, 4)`` about the same centres, ``1 + share`` times as wide and high.

    >>> grown(np.array([[0.0, 0.0, 4.0, 2.0]]), 0.5).tolist()
    [[-1.0, -0.5, 5.0, 2.5]]
    """
    half = (boxes[:, 2:] - boxes[:, :2]) * (share / 2)
    return np.concatenate([boxes[:, :2] - half, boxes[:, 2:] + half], axis=1)


def shared_with_all(boxes: FloatArray, others: FloatArray, which: BoolArray | None = None) -> FloatArray:
    """``(N,)`` share of each of ``(N, 4)`` boxes that lies on any of ``(M, 4)`` others.

    Of the others those count that are at ``which`` ``(N, M)``; None takes all.
    """
    if not len(boxes) or not len(others):
        return np.zeros(len(boxes))
    across, down = ((np.arange(count) + 0.5) / count for count in _GRID)
    x = boxes[:, 0, None] + (boxes[:, 2] - boxes[:, 0])[:, None] * across
    y = boxes[:, 1, None] + (boxes[:, 3] - boxes[:, 1])[:, None] * down
    wide = (x[:, None] >= others[None, :, 0, None]) & (x[:, None] < others[None, :, 2, None])
    high = (y[:, None] >= others[None, :, 1, None]) & (y[:, None] < others[None, :, 3, None])
    if which is not None:
        wide &= which[..., None]
    inside = (wide[:, :, None, :] & high[:, :, :, None]).any(axis=1)
    return np.asarray(inside.mean(axis=(1, 2)))


def straddling(boxes: FloatArray, scores: FloatArray, share: float, least: float = 0.1) -> BoolArray:
    """``(N,)`` which boxes two or more better ones cover together.

    Between two people side by side a detector also finds a third, half on either; it overlaps neither enough to be
    suppressed.

    Args:
        boxes: ``(N, 4)`` pixels.
        scores: ``(N,)``.
        share: of a box that the better ones must cover.
        least: intersection over union from which on one counts.
    """
    better = (scores[None] > scores[:, None]) & (iou_matrix(boxes, boxes) >= least)
    covered = shared_with_all(boxes, boxes, better) >= share
    return np.asarray(covered & (better.sum(axis=1) >= 2))


def suppress(boxes: FloatArray, scores: FloatArray, iou: float) -> IntArray:
    """Greedy non-maximum suppression: indices of the kept boxes, best score first.

    A box is dropped when it overlaps a better kept one by more than ``iou``.
    """
    if not len(boxes):
        return np.empty(0, dtype=np.int64)
    import cv2  # Here, so that trackers of given boxes run where OpenCV does not.

    # OpenCV wants scores from 0; only their order matters.
    positive = np.asarray(scores, dtype=np.float64) - np.min(scores) + 1
    chosen = cv2.dnn.NMSBoxes(xywh_from_corners(boxes).tolist(), positive.tolist(), 0.0, iou)
    return np.asarray(chosen, dtype=np.int64)


def set_apart(boxes: FloatArray, classes: IntArray | None) -> FloatArray:
    """``(N, 4)`` corners or ``(N, 5)`` rotated boxes, moved so that none of ``(N,)`` different classes overlap."""
    if classes is None or not len(boxes):
        return boxes
    reach = 2 * np.abs(boxes[:, :4]).max() + 1
    moved = boxes.copy()
    moved[:, : 4 if boxes.shape[1] == 4 else 2] += 2 * reach * (classes - classes.min())[:, None]
    return moved


def suppress_rotated(boxes: FloatArray, scores: FloatArray, iou: float) -> IntArray:
    """As `suppress`, of ``(N, 5)`` rotated boxes (centre, size, radians clockwise)."""
    chosen: list[int] = []
    # OpenCV's own, NMSBoxesRotated, drops boxes that hardly overlap.
    for k in np.argsort(-scores, kind="stable").tolist():
        if not chosen or rotated_iou(boxes[k : k + 1], boxes[chosen]).max() <= iou:
            chosen.append(k)
    return np.array(chosen, dtype=np.int64)


def about_rotated(boxes: FloatArray) -> FloatArray:
    """``(N, 4)`` upright boxes x1, y1, x2, y2 about the corners of ``(N, 5)`` rotated ones.

    >>> about_rotated(np.array([[10.0, 10.0, 2.0, 6.0, np.pi / 2]])).round(6).tolist()
    [[7.0, 9.0, 13.0, 11.0]]
    """
    cos, sin = np.abs(np.cos(boxes[:, 4:])), np.abs(np.sin(boxes[:, 4:]))
    half = (boxes[:, 2:4] * cos + boxes[:, [3, 2]] * sin) / 2
    return np.concatenate([boxes[:, :2] - half, boxes[:, :2] + half], axis=1)


def rotated_intersections(a: FloatArray, b: FloatArray) -> FloatArray:
    """``(N, M)`` areas shared by ``(N, 5)`` and ``(M, 5)`` rotated boxes (centre, size, radians clockwise)."""
    result = np.zeros((len(a), len(b)))
    reach = np.hypot(a[:, 2], a[:, 3])[:, None] + np.hypot(b[:, 2], b[:, 3])[None]
    near = 2 * np.linalg.norm(a[:, None, :2] - b[None, :, :2], axis=2) < reach
    for i, j in np.argwhere(near):
        result[i, j] = _shared(a[i], b[j])
    return result


def rotated_iou(a: FloatArray, b: FloatArray) -> FloatArray:
    """``(N, M)`` intersection over union of ``(N, 5)`` and ``(M, 5)`` rotated boxes (centre, size, radians clockwise).

    >>> square = np.array([[0.0, 0.0, 2.0, 2.0, 0.0]])
    >>> float(rotated_iou(square, square + np.array([0, 0, 0, 0, np.pi / 4]))[0, 0].round(4))
    0.7071
    """
    shared = rotated_intersections(a, b)
    return np.asarray(shared / ((a[:, 2] * a[:, 3])[:, None] + (b[:, 2] * b[:, 3])[None] - shared))


def _shared(a: FloatArray, b: FloatArray) -> float:
    import cv2  # as in `suppress`

    # Relative to one centre: OpenCV computes in single precision.
    first = ((0.0, 0.0), (float(a[2]), float(a[3])), float(np.degrees(a[4])))
    second = (
        (float(b[0] - a[0]), float(b[1] - a[1])), (float(b[2]), float(b[3])), float(np.degrees(b[4])),
    )  # fmt: skip
    kind, points = cv2.rotatedRectangleIntersection(first, second)
    if kind == cv2.INTERSECT_NONE or points is None:
        return 0.0
    return float(cv2.contourArea(cv2.convexHull(points)))


def on_level(position: FloatArray, directions: NDArray[np.floating[Any]], height: float = 0.0) -> FloatArray:
    """Where rays from ``position`` ``(3,)`` along ``directions`` ``(N, 3)`` meet the plane z = ``height``.

    Returns:
        ``(N, 3)``, NaN for rays that do not meet it.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (height - position[2]) / directions[:, 2]
    distance[~(distance > 0) | ~np.isfinite(distance)] = np.nan
    return np.asarray(position + distance[:, None] * directions)
