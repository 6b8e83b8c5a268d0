"""Average precision of detections: one class, all-point interpolation.

Detections are matched to labelled boxes from the best score down: each takes the free box it overlaps most, if that
reaches the threshold. A detection that takes none but lies on an ignored box is neither right nor wrong. Rotated boxes
are matched likewise, by the overlap of the turned rectangles.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.multi import rows_by_frame
from tsuiseki.tracking.formats.rotated import RotatedBoxes, read_rotated_detections, read_rotated_labels
from tsuiseki.tracking.geometry import areas, intersections, iou_matrix, rotated_iou
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray
from tsuiseki.tracking.types.labels import GroundTruth


@dataclass(frozen=True)
class LabelledBoxes:
    """The ``(N, 4)`` boxes of one image, and on which ``(N,)`` of them a detection is neither right nor wrong."""

    boxes: FloatArray
    ignored: BoolArray


@dataclass(frozen=True)
class DetectionScores:
    """How good detections are.

    Attributes:
        average_precision: area under the precision envelope, in [0, 1].
        recall: ``(K,)`` after each counted detection from the best score down.
        precision: ``(K,)`` after each of them.
        scores: ``(K,)`` of the counted detections, falling.
        boxes: number of labelled boxes that count.
        best_f1: largest harmonic mean of recall and precision over all score thresholds.
        best_threshold: the score that reaches it.
    """

    average_precision: float
    recall: FloatArray
    precision: FloatArray
    scores: FloatArray
    boxes: int
    best_f1: float
    best_threshold: float


@dataclass(frozen=True)
class DetectionEvaluation:
    """Scores of detections.

    Attributes:
        sequences: on every sequence.
        combined: on the images of all of them.
        visible: on people visible to a share, all others ignored, such as ``visible 50-75 %``; where labels tell.
    """

    sequences: Mapping[str, DetectionScores]
    combined: DetectionScores
    visible: Mapping[str, DetectionScores] = field(default_factory=dict)


def labelled_boxes(truth: GroundTruth, frames: Sequence[int]) -> list[LabelledBoxes]:
    """The boxes of ``truth`` in each of the 0-based ``frames`` that count or are to be ignored."""
    relevant = truth.select(truth.evaluated | truth.ignored)
    rows = rows_by_frame(relevant.frames, frames)
    return [LabelledBoxes(relevant.boxes[of_frame], ~relevant.evaluated[of_frame]) for of_frame in rows]


def evaluate_detections(
    truth: Sequence[LabelledBoxes], detections: Sequence[Detections], iou_threshold: float = 0.5
) -> DetectionScores:
    """Average precision of ``detections`` against ``truth``, one entry an image each.

    A detection lies on an ignored box when that covers at least ``iou_threshold`` of it.

    Raises:
        RequestError: the numbers of images differ, no box counts, or some detections have no score.
    """
    if len(truth) != len(detections):
        raise RequestError(f"expected detections for {len(truth)} images, got {len(detections)}")
    count = sum(int((~image.ignored).sum()) for image in truth)
    if count == 0:
        raise RequestError("expected labelled boxes to evaluate against, got none that counts; check the frame range")
    return scores_of_matches(*match_detections(truth, _scored(detections), iou_threshold), count)


def evaluate_classes(
    boxes: Sequence[FloatArray],
    labels: Sequence[IntArray],
    detections: Sequence[Detections],
    names: Sequence[str],
    iou_threshold: float = 0.5,
) -> dict[str, DetectionScores]:
    """By name the scores of each class that is labelled; see `evaluate_detections`.

    Args:
        boxes: ``(N, 4)`` of each image.
        labels: ``(N,)`` of each, places from 1 among the names; -1 of boxes to ignore.
        detections: likewise, with classes, or without where there is one.
        names: of the classes.
        iou_threshold: overlap from which a detection is right.

    Raises:
        RequestError: see `evaluate_detections`; or none of the classes is labelled.
    """
    scores = {}
    for kind, name in enumerate(names, start=1):
        if len(names) == 1 or any((kinds == kind).any() for kinds in labels):
            scores[name] = evaluate_detections(*boxes_of_class(kind, boxes, labels, detections), iou_threshold)
    if not scores:
        raise RequestError(f"expected labelled boxes of {', '.join(names)} to evaluate against, got none that counts")
    return scores


def boxes_of_class(
    kind: int, boxes: Sequence[FloatArray], labels: Sequence[IntArray], detections: Sequence[Detections]
) -> tuple[list[LabelledBoxes], list[Detections]]:
    """Of each image the boxes labelled ``kind``, with those to ignore, and the detections of that class."""
    which = [(kinds == kind) | (kinds < 0) for kinds in labels]
    parts = zip(boxes, labels, which, strict=True)
    truth = [LabelledBoxes(image_boxes[w], kinds[w] < 0) for image_boxes, kinds, w in parts]
    return truth, [d if d.classes is None else d.select(d.classes == kind) for d in detections]


def _scored(detections: Sequence[Detections]) -> Sequence[Detections]:
    """The detections with a score each: 1 where none is known of any."""
    total, unknown = sum(map(len, detections)), sum(int(np.isnan(image.scores).sum()) for image in detections)
    if not unknown:
        return detections
    if unknown < total:
        raise RequestError(f"expected a score of each detection, got none of {unknown} of {total}")
    warnings.warn("no detection has a score; each counts with 1", InputWarning, stacklevel=3)
    return [replace(image, scores=np.ones(len(image))) for image in detections]


def scores_of_matches(right: BoolArray, scores: FloatArray, count: int) -> DetectionScores:
    """Average precision of detections of which ``(K,)`` are ``right``, with ``(K,)`` scores, for ``count`` boxes."""
    order = np.argsort(-scores, kind="stable")
    ranked = scores[order]
    hits = np.cumsum(right[order])
    recall = hits / count
    precision = hits / np.arange(1, len(hits) + 1)
    f1 = 2 * hits / (np.arange(1, len(hits) + 1) + count)
    best = int(np.argmax(f1)) if len(f1) else 0
    return DetectionScores(
        average_precision=average_precision(recall, precision),
        recall=recall,
        precision=precision,
        scores=ranked,
        boxes=count,
        best_f1=float(f1[best]) if len(f1) else 0.0,
        best_threshold=float(ranked[best]) if len(f1) else 0.0,
    )


def average_precision(recall: FloatArray, precision: FloatArray) -> float:
    """Area under the envelope of a precision-recall curve (``recall`` rising), all points.

    >>> average_precision(np.array([0.5, 0.5, 1.0]), np.array([1.0, 0.5, 2 / 3]))
    0.8333333333333333
    """
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.sum(np.diff(recall, prepend=0.0) * envelope))


def match_detections(
    truth: Sequence[LabelledBoxes], detections: Sequence[Detections], iou_threshold: float
) -> tuple[BoolArray, FloatArray]:
    """``(K,)`` which detections are right, and their scores, image by image from the best down; without excused."""
    right, scores = [np.empty(0, dtype=np.bool_)], [np.empty(0)]
    for labels, image in zip(truth, detections, strict=True):
        image = image.select(np.argsort(-image.scores, kind="stable"))
        hit = _taken(iou_matrix(image.boxes, labels.boxes[~labels.ignored]), image.scores, iou_threshold) >= 0
        shared = intersections(image.boxes[:, None], labels.boxes[None, labels.ignored])
        excused = ~hit & (shared >= iou_threshold * areas(image.boxes)[:, None]).any(axis=1)
        right.append(hit[~excused])
        scores.append(image.scores[~excused])
    return np.concatenate(right), np.concatenate(scores)


def _taken(overlaps: FloatArray, scores: FloatArray, iou_threshold: float) -> IntArray:
    """``(N,)`` the label that each detection takes, -1 for none, by ``(N, M)`` overlaps, from the best score down."""
    matches, overlaps = np.full(len(scores), -1, dtype=np.int64), overlaps.copy()
    order = np.argsort(-scores, kind="stable")
    for k in order[(overlaps[order] >= iou_threshold).any(axis=1)].tolist():
        best = int(overlaps[k].argmax())
        if overlaps[k, best] >= iou_threshold:
            overlaps[:, best] = -1.0
            matches[k] = best
    return matches


def evaluate_rotated_file(truth: Path, result: Path, iou: float = 0.5) -> DetectionEvaluation:
    """Average precision of the detections in a JSON file against labels of CEPDOF, MW-R or HABBOF."""
    scores = evaluate_rotated(read_rotated_labels(truth), read_rotated_detections(result), iou)
    return DetectionEvaluation({truth.stem: scores}, scores)


def evaluate_rotated(
    truth: Mapping[str, RotatedBoxes], detections: Mapping[str, RotatedBoxes], iou_threshold: float = 0.5
) -> DetectionScores:
    """Average precision over all images of ``truth``; detections of images that are not among them are refused.

    Detections are matched from the best score down, each to the free box that it overlaps most.

    Raises:
        RequestError: there is no labelled box, or detections belong to other images.
    """
    strangers = sorted(set(detections) - set(truth))
    if strangers:
        raise RequestError(f"expected detections of the labelled images, got some of {strangers[0]}")
    count = sum(len(image.boxes) for image in truth.values())
    if count == 0:
        raise RequestError("expected labelled boxes to evaluate against, got none")
    matches = [
        np.empty(0, np.int64),
        *(
            _taken(rotated_iou(image.boxes, truth[name].boxes), image.scores, iou_threshold)
            for name, image in detections.items()
        ),
    ]
    scores = [np.empty(0), *(image.scores for image in detections.values())]
    return scores_of_matches(np.concatenate(matches) >= 0, np.concatenate(scores), count)
