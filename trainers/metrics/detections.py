"""Average precision of detections, over batches and processes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.detection import boxes_of_class, match_detections, scores_of_matches
from tsuiseki.tracking.interchange import as_detections
from tsuiseki.tracking.types import Detections, FloatArray, IntArray
from tsuiseki.trainers.metrics.states import EvaluationMetric, boxes_in, whole_numbers


class AveragePrecision(EvaluationMetric):
    """Average precision of detections at one overlap, all points of the curve; its mean over classes.

    ``compute`` gives ``ap50`` and ``f1_50``, the largest F1 over the score thresholds, each in [0, 1]; ``ap75`` and
    ``f1_75`` where ``iou`` is 0.75. With several ``class_names`` they are means over the labelled ones, and
    ``ap50_NAME`` is of each. They are NaN where no box was labelled, with a warning. Detections of equal score count in
    the order of updates.

    Args:
        iou: overlap from which a detection is right, in (0, 1].
        class_names: the names of the labels 1, 2, …; None takes all boxes as of one class.

    Raises:
        RequestError: ``iou`` lies elsewhere, or ``class_names`` has none, or one twice.

    >>> metric = AveragePrecision()
    >>> boxes = torch.tensor([[0.0, 0.0, 10.0, 20.0], [50.0, 0.0, 60.0, 20.0]])
    >>> metric.update([{"boxes": boxes, "scores": torch.tensor([0.9, 0.8])}], [{"boxes": boxes[:1]}])
    >>> metric.update([{"boxes": boxes[:1], "scores": torch.tensor([0.7])}], [{"boxes": boxes[:1]}])
    >>> round(metric.compute()["ap50"].item(), 4)
    0.8333
    """

    higher_is_better = True
    plot_lower_bound = 0.0
    plot_upper_bound = 1.0

    def __init__(self, iou: float = 0.5, class_names: Sequence[str] | None = None, **settings: Any) -> None:
        super().__init__(**settings)
        if not 0 < iou <= 1:
            raise RequestError(f"`iou`: expected a number in (0, 1], got {iou}")
        self.iou = iou
        self.class_names = None if class_names is None else tuple(class_names)
        names = ("",) if class_names is None else tuple(class_names)
        if len(set(names)) < max(1, len(names)):
            raise RequestError(f"`class_names`: expected different ones, got {', '.join(names) or 'none'}")
        # Metrics of a collection share the states that have one name and are equal at first.
        percent = f"{100 * iou:g}"
        self._percent = percent
        self._states = tuple(
            f"{state}_at_{percent.replace('.', '_')}" for state in ("scores", "right", "kinds", "boxes")
        )
        # Numbers of the only class, where none has a name.
        self._labels_so_far: set[int] = set()
        scores, right, kinds, boxes = self._states
        self.add_column(scores)
        self.add_column(right, torch.int64)
        self.add_column(kinds, torch.int64)
        self.add_sum(boxes, (len(names),))

    def update(self, preds: Sequence[Any], target: Sequence[Any]) -> None:
        """Add images.

        Args:
            preds: of each image the detections, as `as_detections` takes them: a dictionary with ``boxes`` ``(N, 4)``
                x1, y1, x2, y2 in pixels, ``scores`` ``(N,)`` and, with ``class_names``, ``labels`` ``(N,)`` from 1.
            target: of each image a dictionary or an object with ``boxes`` ``(M, 4)``, with ``class_names`` ``labels``
                ``(M,)`` from 1, and maybe ``ignored`` ``(M,)``: boxes on which a detection is neither right nor wrong.

        Raises:
            RequestError: the numbers of images differ, a box has no score, or a label is none of the classes.
        """
        if len(preds) != len(target):
            raise RequestError(f"expected `preds` and `target` of as many images, got {len(preds)} and {len(target)}")
        detections = [self._detections(image, f"preds[{number}]") for number, image in enumerate(preds)]
        truth = [self._labels(image, f"target[{number}]") for number, image in enumerate(target)]
        boxes, labels = [rows for rows, _ in truth], [kinds for _, kinds in truth]
        scores, right, kinds, counts = self._states
        count = np.zeros(len(self.class_names or ("",)), np.int64)
        for kind in range(1, len(count) + 1):
            hits, ranked = match_detections(*boxes_of_class(kind, boxes, labels, detections), self.iou)
            self.append({scores: ranked, right: hits, kinds: np.full(len(hits), kind)})
            count[kind - 1] = sum(int((of_image == kind).sum()) for of_image in labels)
        self.add({counts: count})

    def compute(self) -> dict[str, Tensor]:
        """The average precision and the largest F1, by name."""
        scores, right, kinds = (self.column(name) for name in self._states[:3])
        counts = self.sums(self._states[3])
        names = self.class_names or ("",)
        by_class = {
            name: scores_of_matches(right[kinds == kind] > 0, scores[kinds == kind], int(counts[kind - 1]))
            for kind, name in enumerate(names, start=1)
            if counts[kind - 1]
        }
        if not by_class:
            return self.unscored((f"ap{self._percent}", f"f1_{self._percent}"), "a labelled box that counts")
        means = [(of_class.average_precision, of_class.best_f1) for of_class in by_class.values()]
        precision, f1 = np.mean(means, axis=0).tolist()
        apart = {f"ap{self._percent}_{name}": of_class.average_precision for name, of_class in by_class.items()}
        means_by_name = {f"ap{self._percent}": precision, f"f1_{self._percent}": f1}
        return self.scored(means_by_name | (apart if len(names) > 1 else {}))

    def _detections(self, image: Any, name: str) -> Detections:
        detections = as_detections(image)
        if np.isnan(detections.scores).any():
            raise RequestError(f"`{name}`: expected a score of each detection, got none of some")
        classes = None if not len(detections) else self._classes(detections.classes, len(detections), name)
        return Detections(detections.boxes, detections.scores, classes=classes)

    def _labels(self, image: Any, name: str) -> tuple[FloatArray, IntArray]:
        """Boxes ``(M, 4)``, and ``(M,)`` their classes, -1 of those to ignore."""
        boxes, labels, ignored = (
            image.get(key) if isinstance(image, Mapping) else getattr(image, key, None)
            for key in ("boxes", "labels", "ignored")
        )
        if boxes is None:
            raise RequestError(f"`{name}`: expected a dictionary with `boxes` (M, 4), got {type(image).__name__}")
        rows = boxes_in(boxes, f"{name}.boxes")
        count = len(rows)
        skipped = np.zeros(count, np.bool_) if ignored is None else whole_numbers(ignored, f"{name}.ignored", count) > 0
        kinds = np.full(count, -1)
        numbers = None if labels is None else whole_numbers(labels, f"{name}.labels", count)[~skipped]
        kinds[~skipped] = self._classes(numbers, count - int(skipped.sum()), name)
        return rows, kinds

    def _classes(self, labels: IntArray | None, count: int, name: str) -> IntArray:
        """``(count,)`` places among the names, from 1."""
        names = self.class_names or ("",)
        if labels is None:
            if len(names) > 1 and count:
                raise RequestError(f"`{name}`: expected `labels` of 1 to {len(names)}, got none")
            return np.ones(count, np.int64)
        if self.class_names is None:
            several = {*self._labels_so_far, *labels.tolist()}
            if len(several) > 1:
                raise RequestError(
                    f"`{name}`: expected `class_names`, as labels are of classes {', '.join(map(str, sorted(several)))}"
                )
            self._labels_so_far = several
            return np.ones(count, np.int64)
        wrong = labels[(labels < 1) | (labels > len(names))]
        if len(wrong):
            raise RequestError(f"`{name}`: expected `labels` of 1 to {len(names)}, got {wrong[0]}")
        return labels
