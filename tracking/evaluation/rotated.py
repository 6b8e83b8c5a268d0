"""Average precision of rotated boxes, by the overlap of the turned rectangles."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.detection import DetectionScores, scores_of_matches
from tsuiseki.tracking.evaluation.result_files import DetectionEvaluation
from tsuiseki.tracking.formats.rotated import RotatedBoxes, read_rotated_detections, read_rotated_labels
from tsuiseki.tracking.geometry import rotated_iou
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


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


def evaluate_rings(
    truth: Mapping[str, RotatedBoxes],
    found: Mapping[str, RotatedBoxes],
    ring_of: Callable[[str, FloatArray], IntArray],
    rings: int,
    iou_threshold: float = 0.5,
) -> list[DetectionScores | None]:
    """`evaluate_rotated` for each of several rings about the centre of the image.

    All are matched together. A detection that takes a labelled box counts in the ring of that box, another in its own.

    Args:
        truth: by image.
        found: by image.
        ring_of: the image and ``(N, 2)`` centres of boxes, pixels, to ``(N,)`` rings from 0 on.
        rings: their number.
        iou_threshold: least overlap of a match.

    Returns:
        The scores of each ring, None where it has no labelled box.
    """
    count = np.zeros(rings, dtype=np.int64)
    right: list[list[BoolArray]] = [[np.empty(0, np.bool_)] for _ in range(rings)]
    scores: list[list[FloatArray]] = [[np.empty(0)] for _ in range(rings)]
    for name, labels in truth.items():
        label_rings = ring_of(name, labels.boxes[:, :2])
        count += np.bincount(label_rings, minlength=rings)
        if name not in found:
            continue
        each = found[name]
        taken = _taken(each, labels.boxes, iou_threshold)
        where = ring_of(name, each.boxes[:, :2])
        where[taken >= 0] = label_rings[taken[taken >= 0]]
        for ring in range(rings):
            right[ring].append(taken[where == ring] >= 0)
            scores[ring].append(each.scores[where == ring])
    return [
        scores_of_matches(np.concatenate(right[k]), np.concatenate(scores[k]), int(count[k])) if count[k] else None
        for k in range(rings)
    ]


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
