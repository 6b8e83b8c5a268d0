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
from tsuiseki.tracking.geometry import areas, intersections, iou_pairs, rotated_iou
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
    right, counted, scores = _match(truth, _scored(detections), iou_threshold)
    return scores_of_matches(right[counted], scores[counted], count)


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
        which = [(kinds == kind) | (kinds < 0) for kinds in labels]
        parts = zip(boxes, labels, which, strict=True)
        truth = [LabelledBoxes(image_boxes[w], kinds[w] < 0) for image_boxes, kinds, w in parts]
        if len(names) == 1 or any((kinds == kind).any() for kinds in labels):
            of_kind = [d if d.classes is None else d.select(d.classes == kind) for d in detections]
            scores[name] = evaluate_detections(truth, of_kind, iou_threshold)
    if not scores:
        raise RequestError(f"expected labelled boxes of {', '.join(names)} to evaluate against, got none that counts")
    return scores


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


def _match(
    truth: Sequence[LabelledBoxes], detections: Sequence[Detections], iou_threshold: float
) -> tuple[BoolArray, BoolArray, FloatArray]:
    """Right, counted and score of every detection, ``(images, most detections)`` arrays; padding is not counted.

    The loop runs over ranks, each step over all images at once.
    """
    images, longest = len(detections), max((len(d) for d in detections), default=0)
    boxes = np.zeros((images, longest, 4))
    scores = np.full((images, longest), -np.inf)
    for n, image in enumerate(detections):
        order = np.argsort(-image.scores, kind="stable")
        boxes[n, : len(image)], scores[n, : len(image)] = image.boxes[order], image.scores[order]
    labels, free, ignored = _padded(truth)
    overlaps = iou_pairs(boxes[:, :, None], labels[:, None])
    right = np.zeros((images, longest), dtype=np.bool_)
    everyone = np.arange(images)
    for rank in range(longest if labels.shape[1] else 0):
        candidates = np.where(free, overlaps[:, rank], -1.0)
        best = candidates.argmax(axis=1)
        right[:, rank] = candidates[everyone, best] >= iou_threshold
        free[everyone, best] &= ~right[:, rank]
    covered = intersections(boxes[:, :, None], labels[:, None]) >= iou_threshold * areas(boxes)[:, :, None]
    excused = ~right & (covered & ignored[:, None]).any(axis=2)
    return right, np.isfinite(scores) & ~excused, scores


def _padded(truth: Sequence[LabelledBoxes]) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Boxes ``(I, M, 4)``, and which of them ``(I, M)`` count and are to be ignored; padding is neither."""
    longest = max((len(image.boxes) for image in truth), default=0)
    boxes = np.zeros((len(truth), longest, 4))
    counting, ignored = (np.zeros((len(truth), longest), dtype=np.bool_) for _ in range(2))
    for n, image in enumerate(truth):
        boxes[n, : len(image.boxes)] = image.boxes
        counting[n, : len(image.boxes)] = ~image.ignored
        ignored[n, : len(image.boxes)] = image.ignored
    return boxes, counting, ignored


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
        *(_taken(image, truth[name].boxes, iou_threshold) for name, image in detections.items()),
    ]
    scores = [np.empty(0), *(image.scores for image in detections.values())]
    return scores_of_matches(np.concatenate(matches) >= 0, np.concatenate(scores), count)


def _taken(detections: RotatedBoxes, labels: FloatArray, iou_threshold: float) -> IntArray:
    """``(N,)`` the label that each detection takes, -1 for none."""
    matches = np.full(len(detections.boxes), -1, dtype=np.int64)
    if not len(labels):
        return matches
    overlaps = rotated_iou(detections.boxes, labels)
    for k in np.argsort(-detections.scores, kind="stable"):
        best = int(overlaps[k].argmax())
        if overlaps[k, best] >= iou_threshold:
            overlaps[:, best] = -1.0
            matches[k] = best
    return matches
