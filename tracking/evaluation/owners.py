"""Whose box it is: boxes of a video matched to the labels of their frames, one to one."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.evaluation.multi import MATCH_OVERLAP
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import FloatArray, IntArray
from tsuiseki.tracking.types.labels import GroundTruth

# Of a box on no label, and of one on a label that is neither right nor wrong.
NOBODY, IGNORED = -1, -2


def matched_labels(frames: IntArray, boxes: FloatArray, truth: GroundTruth, least: float = MATCH_OVERLAP) -> IntArray:
    """``(N,)`` row of the label that each box is matched to for the largest sum of overlaps, or `NOBODY`.

    Args:
        frames: ``(N,)``.
        boxes: ``(N, 4)`` pixels.
        truth: the labels.
        least: intersection over union from which a box and a label match.
    """
    label = np.full(len(frames), NOBODY, dtype=np.int64)
    orders = [np.argsort(numbers, kind="stable") for numbers in (frames, truth.frames)]
    sorted_frames = [numbers[order] for numbers, order in zip((frames, truth.frames), orders, strict=True)]
    for frame in np.intersect1d(frames, truth.frames).tolist():
        here, there = (
            order[slice(*np.searchsorted(numbers, [frame, frame + 1]))]
            for numbers, order in zip(sorted_frames, orders, strict=True)
        )
        rows, columns = assign_overlaps(iou_matrix(truth.boxes[there], boxes[here]), least)
        label[here[columns]] = there[rows]
    return label


def owners_of(frames: IntArray, boxes: FloatArray, truth: GroundTruth) -> IntArray:
    """``(N,)`` whose each box is: an id of the labels, `NOBODY` or `IGNORED`.

    Args:
        frames: ``(N,)``.
        boxes: ``(N, 4)`` pixels.
        truth: the labels; those that are neither evaluated nor ignored own nothing.
    """
    known = truth.select(truth.evaluated | truth.ignored)
    label = matched_labels(frames, boxes, known)
    # Index -1, a box on nobody, picks the appended one.
    return np.append(np.where(known.ignored, IGNORED, known.ids), NOBODY)[label]
