"""Average precision of rotated boxes, by the overlap of the turned rectangles."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.detection import DetectionScores, scores_of_matches
from tsuiseki.tracking.evaluation.pairs import DetectionEvaluation
from tsuiseki.tracking.formats.space.rotated import RotatedBoxes, read_rotated_detections, read_rotated_labels
from tsuiseki.tracking.geometry import rotated_iou


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
    right: list[bool] = []
    scores: list[float] = []
    for name, each in found.items():
        overlaps = rotated_iou(each.boxes, truth[name].boxes)
        for k in np.argsort(-each.scores, kind="stable"):
            best = int(overlaps[k].argmax()) if overlaps.shape[1] else -1
            hit = best >= 0 and overlaps[k, best] >= iou_threshold
            if hit:
                overlaps[:, best] = -1.0
            right.append(bool(hit))
            scores.append(float(each.scores[k]))
    count = sum(len(each.boxes) for each in truth.values())
    if count == 0:
        raise RequestError("expected labelled boxes to evaluate against, got none")
    return scores_of_matches(np.array(right, dtype=np.bool_), np.array(scores, dtype=np.float64), count)
