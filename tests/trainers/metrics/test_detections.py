"""Average precision over batches: that of `evaluate_detections` and of COCO's own rule, classes, and bad input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from torchmetrics import MetricCollection

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.detection import LabelledBoxes, evaluate_classes, evaluate_detections
from tsuiseki.tracking.types import Detections
from tsuiseki.trainers.metrics.detections import AveragePrecision

NAMES = ("person", "car", "dog")


def pictures(seed: int, count: int = 8) -> tuple[list[dict[str, torch.Tensor]], list[dict[str, torch.Tensor]]]:
    """Labelled boxes of two classes of three, some to ignore, and detections around most of them."""
    rng = np.random.default_rng(seed)
    preds, target = [], []
    for _ in range(count):
        corner = rng.uniform(0, 200, (rng.integers(0, 7), 2))
        boxes = np.column_stack([corner, corner + rng.uniform(10, 40, corner.shape)])
        labels = rng.integers(1, 3, len(boxes))
        columns = {"boxes": boxes, "labels": labels, "ignored": rng.random(len(boxes)) < 0.2}
        target.append({name: torch.from_numpy(column) for name, column in columns.items()})
        detected = rng.random(len(boxes)) < 0.8
        noisy = boxes[detected] + rng.normal(0, 3, boxes[detected].shape)
        others = rng.uniform(0, 200, (2, 2))
        noisy = np.concatenate([noisy, np.column_stack([others, others + 20])])
        kinds = np.concatenate([labels[detected], rng.integers(1, 4, 2)])
        columns = {"boxes": noisy, "scores": rng.random(len(noisy)), "labels": kinds}
        preds.append({name: torch.from_numpy(column) for name, column in columns.items()})
    return preds, target


def without_labels(images: list[dict[str, torch.Tensor]]) -> list[dict[str, torch.Tensor]]:
    return [{name: column for name, column in image.items() if name != "labels"} for image in images]


@pytest.mark.parametrize("iou", [0.5, 0.75, 0.555])
@pytest.mark.parametrize("batch", [1, 3, 8])
def test_one_class_scores_as_evaluate_detections_whatever_the_batch(iou: float, batch: int) -> None:
    preds, target = map(without_labels, pictures(1))
    metric = AveragePrecision(iou=iou)
    for first in range(0, len(preds), batch):
        metric.update(preds[first : first + batch], target[first : first + batch])
    expected = evaluate_detections(
        [LabelledBoxes(t["boxes"].numpy(), t["ignored"].numpy()) for t in target],
        [Detections(p["boxes"].numpy(), p["scores"].numpy()) for p in preds],
        iou,
    )
    assert 0 < expected.average_precision < 1
    assert metric.compute() == {f"ap{100 * iou:g}": expected.average_precision, f"f1_{100 * iou:g}": expected.best_f1}


def test_several_classes_score_as_evaluate_classes_and_their_mean() -> None:
    preds, target = pictures(2)
    metric = AveragePrecision(class_names=NAMES)
    metric.update(preds[:5], target[:5])
    metric.update(preds[5:], target[5:])
    by_class = evaluate_classes(
        [t["boxes"].numpy() for t in target],
        [np.where(t["ignored"].numpy(), -1, t["labels"].numpy()) for t in target],
        [Detections(p["boxes"].numpy(), p["scores"].numpy(), classes=p["labels"].numpy()) for p in preds],
        NAMES,
    )
    assert [*by_class] == ["person", "car"]
    precisions = {f"ap50_{name}": of_class.average_precision for name, of_class in by_class.items()}
    f1 = np.mean([of_class.best_f1 for of_class in by_class.values()])
    assert metric.compute() == {"ap50": np.mean([*precisions.values()]), "f1_50": f1, **precisions}


def test_two_overlaps_in_one_collection_stay_apart() -> None:
    box = torch.tensor([[0.0, 0.0, 10.0, 10.0]])
    metrics = MetricCollection({"loose": AveragePrecision(), "strict": AveragePrecision(iou=0.75)})
    metrics.update([{"boxes": box, "scores": torch.tensor([0.9])}], [{"boxes": box}])
    metrics.update([{"boxes": box + 2, "scores": torch.tensor([0.8])}], [{"boxes": box + 3.5}])
    metrics.update([{"boxes": box + 1, "scores": torch.tensor([0.7])}], [{"boxes": box + 2}])
    scores = metrics.compute()
    assert (scores["ap50"], scores["ap75"]) == (1, 1 / 3)


def test_detections_of_all_forms_are_taken() -> None:
    preds, target = map(without_labels, pictures(3))
    tables = [torch.cat([p["boxes"], p["scores"][:, None]], dim=1).requires_grad_() for p in preds]
    ours = [Detections(p["boxes"].numpy(), p["scores"].numpy()) for p in preds]
    truth = [LabelledBoxes(t["boxes"].numpy(), t["ignored"].numpy()) for t in target]
    scores = []
    for detections, labels in ((preds, target), (tables, target), (ours, truth)):
        metric = AveragePrecision()
        metric.update(detections, labels)
        scores.append(metric.compute())
    assert scores[0] == scores[1] == scores[2]


def test_labels_of_the_only_class_may_have_any_number() -> None:
    preds, target = pictures(1)
    expected, metric = AveragePrecision(), AveragePrecision()
    expected.update(without_labels(preds), without_labels(target))
    for images in (preds, target):
        for image in images:
            image["labels"] = torch.full_like(image["labels"], 7)
    metric.update(preds, target)
    assert metric.compute() == expected.compute()


@pytest.mark.parametrize("labels", [None, torch.ones(1)])
def test_nothing_labelled_is_nan_with_a_warning(labels: torch.Tensor | None) -> None:
    metric = AveragePrecision()
    box = torch.tensor([[0.0, 0.0, 10.0, 10.0]])
    ignored = {} if labels is None else {"ignored": labels}
    metric.update([{"boxes": box, "scores": [0.5]}], [{"boxes": box if ignored else torch.empty(0), **ignored}])
    with pytest.warns(InputWarning, match="expected a labelled box that counts"):
        assert all(value.isnan() for value in metric.compute().values())


def test_nothing_detected_is_zero() -> None:
    metric = AveragePrecision()
    metric.update([{"boxes": torch.empty(0), "scores": torch.empty(0)}], [{"boxes": [[0, 0, 10, 10]]}])
    assert metric.compute() == {"ap50": 0, "f1_50": 0}


BOX = [[0.0, 0.0, 10.0, 10.0]]
DETECTED = {"boxes": BOX, "scores": [0.5]}
WRONG: list[tuple[dict[str, Any], Any, Any, str]] = [
    ({}, [DETECTED] * 2, [{"boxes": BOX}], "`preds` and `target` of as many images, got 2 and 1"),
    ({}, [DETECTED], [{"labels": [1]}], r"`target\[0\]`: expected a dictionary with `boxes`"),
    ({}, [DETECTED], [{"boxes": [[0, 0, 0, 10]]}], r"`target\[0\].boxes`: expected finite boxes with x1 < x2"),
    ({}, [DETECTED | {"labels": [1]}], [{"boxes": BOX, "labels": [2]}], "expected `class_names`, .* classes 1, 2"),
    ({}, [Detections(np.array(BOX), np.array([np.nan]))], [{"boxes": BOX}], r"`preds\[0\]`: expected a score of each"),
    ({"class_names": NAMES}, [DETECTED | {"labels": [0]}], [{"boxes": BOX, "labels": [1]}],
     r"`preds\[0\]`: expected `labels` of 1 to 3, got 0"),
    ({"class_names": NAMES}, [DETECTED | {"labels": [1]}], [{"boxes": BOX, "labels": [4]}],
     r"`target\[0\]`: expected `labels` of 1 to 3, got 4"),
    ({"class_names": NAMES}, [DETECTED], [{"boxes": BOX, "labels": [1]}], r"`preds\[0\]`: .* `labels` .*none"),
    ({"class_names": NAMES}, [DETECTED | {"labels": [1]}], [{"boxes": BOX}], r"`target\[0\]`: .*`labels` .*none"),
]  # fmt: skip


@pytest.mark.parametrize(("settings", "preds", "target", "line"), WRONG)
def test_what_cannot_be_scored_is_refused_in_one_line(
    settings: dict[str, Any], preds: Any, target: Any, line: str
) -> None:
    with pytest.raises(RequestError, match=line) as refused:
        AveragePrecision(**settings).update(preds, target)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("settings", [{"iou": 0}, {"iou": 1.5}, {"iou": float("nan")}, {"class_names": ["a", "a"]},
                                      {"class_names": []}])  # fmt: skip
def test_settings_that_make_no_sense_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(RequestError, match=r"`(iou|class_names)`: expected"):
        AveragePrecision(**settings)
