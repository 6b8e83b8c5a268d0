"""The modules of detector and appearance validate by these metrics, bit for bit as by the functions below them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.trainers.metrics.test_detections import pictures
from tests.trainers.metrics.test_reidentification import views
from tsuiseki.datamodules.appearance import APART
from tsuiseki.tracking.evaluation.detection import evaluate_classes
from tsuiseki.tracking.evaluation.reidentification import evaluate_retrieval
from tsuiseki.tracking.types import Detections
from tsuiseki.trainers.appearance import Appearance
from tsuiseki.trainers.detector import Detector


@pytest.mark.parametrize("names", [["person", "car", "dog"], ["person"]])
def test_a_detector_scores_as_evaluate_classes(names: list[str]) -> None:
    preds, target = pictures(5)
    labels = [np.where(t["ignored"].numpy(), -1, np.minimum(t["labels"].numpy(), len(names))) for t in target]
    kinds = [np.minimum(p["labels"].numpy(), len(names)) for p in preds]
    detected = [
        Detections(p["boxes"].numpy(), p["scores"].numpy(), classes=k) for p, k in zip(preds, kinds, strict=True)
    ]
    boxes = [t["boxes"].numpy() for t in target]
    model = Detector(classes=names, height=64, width=64, trunk="mobilenet_v3_small")
    scores = model.scores([*zip(boxes, labels, detected, strict=True)])
    at = [evaluate_classes(boxes, labels, detected, names, percent / 100) for percent in range(50, 100, 5)]
    means = [float(np.mean([of_class.average_precision for of_class in by_class.values()])) for by_class in at]
    by_class = at[0]
    expected = {f"ap50_{name}": by_class[name].average_precision for name in by_class} if len(names) > 1 else {}
    expected |= {"ap": float(np.mean(means)), "ap50": means[0], "ap75": means[5]}
    expected["f1"] = float(np.mean([of_class.best_f1 for of_class in by_class.values()]))
    assert scores == expected


def test_appearance_scores_as_evaluate_retrieval() -> None:
    table = {name: column.numpy() for name, column in views(4).items()}
    columns = [table[name] for name in ("features", "ids", "frames", "query")]
    scores = Appearance(height=32, width=16).scores([*zip(*columns, strict=True)])
    features, ids, frames, query = columns[0].astype(np.float64), *columns[1:]
    near = np.abs(frames[query][:, None] - frames[~query]) < APART
    junk = near & (ids[query][:, None] == ids[~query])
    expected = evaluate_retrieval(1 - features[query] @ features[~query].T, ids[query], ids[~query], junk)
    assert scores == {"rank1": expected.rank1, "map": expected.mean_average_precision}
