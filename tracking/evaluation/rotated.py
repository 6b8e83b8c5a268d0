"""Average precision of rotated boxes, by the overlap of the turned rectangles."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.detection import DetectionScores, scores_of_matches
from tsuiseki.tracking.evaluation.result_files import DetectionEvaluation
from tsuiseki.tracking.formats.rotated import RotatedBoxes, read_rotated_detections, read_rotated_labels
from tsuiseki.tracking.geometry import rotated_iou
from tsuiseki.tracking.types import FloatArray, IntArray


def evaluate_rotated_file(truth: Path, result: Path, iou: float = 0.5) -> DetectionEvaluation:
    """Average precision of the detections in a JSON file against labels of CEPDOF, MW-R or HABBOF.

    Raises:
        RequestError: see `read_rotated_labels`, `read_rotated_detections` and `evaluate_rotated`.
    """
    scores = evaluate_rotated(read_rotated_labels(truth), read_rotated_detections(result), iou)
    return DetectionEvaluation({truth.stem: scores}, scores)


def evaluate_rotated(
    truth: Mapping[str, RotatedBoxes], found: Mapping[str, RotatedBoxes], iou_threshold: float = 0.5
) -> DetectionScores:
    """Average precision over all images of ``truth``; detections of images that are not among them are refused.

    Detections are matched from the best score down, each to the free box that it overlaps most.

    Raises:
        RequestError: there is no labelled box, or detections belong to other images.
    """
    strangers = sorted(set(found) - set(truth))
    if strangers:
        raise RequestError(f"expected detections of the labelled images, got some of {strangers[0]}")
    count = sum(len(each.boxes) for each in truth.values())
    if count == 0:
        raise RequestError("expected labelled boxes to evaluate against, got none")
    taken = [np.empty(0, np.int64), *(_taken(each, truth[name].boxes, iou_threshold) for name, each in found.items())]
    scores = [np.empty(0), *(each.scores for each in found.values())]
    return scores_of_matches(np.concatenate(taken) >= 0, np.concatenate(scores), count)


def _taken(found: RotatedBoxes, labels: FloatArray, iou_threshold: float) -> IntArray:
    """``(N,)`` the label that each detection takes, -1 for none."""
    taken = np.full(len(found.boxes), -1, dtype=np.int64)
    if not len(labels):
        return taken
    overlaps = rotated_iou(found.boxes, labels)
    for k in np.argsort(-found.scores, kind="stable"):
        best = int(overlaps[k].argmax())
        if overlaps[k, best] >= iou_threshold:
            overlaps[:, best] = -1.0
            taken[k] = best
    return taken
