"""Detections as people have them: every form gives the same, and what is none says what was expected."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.interchange import as_detections
from tsuiseki.tracking.types import Detections

BOXES = np.array([[10, 20, 30, 80], [50, 20, 70, 90.0]])
SCORES = np.array([0.9, 0.4])
LABELS = np.array([0, 2])
TABLE = np.column_stack([BOXES, SCORES, LABELS])


class Tensor:
    """An array of another library, as torch's behave: on an accelerator, and in a graph of gradients."""

    def __init__(self, values: np.ndarray) -> None:
        self.values = values

    def detach(self) -> Tensor:
        return self

    def cpu(self) -> np.ndarray:
        return self.values


@dataclass
class Supervision:
    xyxy: np.ndarray
    confidence: np.ndarray | None
    class_id: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.xyxy)


ULTRALYTICS = SimpleNamespace(boxes=SimpleNamespace(xyxy=Tensor(BOXES), conf=Tensor(SCORES), cls=Tensor(LABELS)))
TORCHVISION = {"boxes": Tensor(BOXES), "scores": Tensor(SCORES), "labels": Tensor(LABELS)}
FORMS: dict[str, Any] = {
    "Detections": Detections(BOXES, SCORES),
    "(N, 5)": TABLE[:, :5],
    "(N, 6)": TABLE,
    "float32": TABLE.astype(np.float32),
    "rows": TABLE.tolist(),
    "tuples": [tuple(row) for row in TABLE.tolist()],
    "supervision": Supervision(BOXES, SCORES, LABELS),
    "ultralytics": ULTRALYTICS,
    "ultralytics, one image": [ULTRALYTICS],
    "torchvision": TORCHVISION,
    "torchvision, one image": [TORCHVISION],
}


@pytest.mark.parametrize("found", FORMS.values(), ids=FORMS.keys())
def test_every_form_gives_the_same(found: Any) -> None:
    given = as_detections(found)
    np.testing.assert_allclose(given.boxes, BOXES)
    np.testing.assert_allclose(given.scores, SCORES, rtol=1e-6)


@pytest.mark.parametrize("found", [BOXES, BOXES.tolist(), Supervision(BOXES, None), {"boxes": BOXES}])
def test_without_scores_all_are_sure(found: Any) -> None:
    np.testing.assert_array_equal(as_detections(found).scores, [1, 1])


@pytest.mark.parametrize(
    "found",
    [
        [],
        (),
        np.empty(0),
        np.empty((0, 4)),
        np.empty((0, 5)),
        np.empty((0, 6)),
        np.empty((1, 0)),
        Supervision(np.empty((0, 4)), np.empty(0)),
        {"boxes": np.empty((0, 4)), "scores": np.empty(0), "labels": np.empty(0)},
        SimpleNamespace(boxes=SimpleNamespace(xyxy=np.empty((0, 4)), conf=np.empty(0))),
    ],
)
def test_empty_of_any_shape_is_nobody(found: Any) -> None:
    assert len(as_detections(found)) == 0


@pytest.mark.parametrize("form", ["(N, 6)", "supervision", "ultralytics", "torchvision"])
def test_classes_are_chosen(form: str) -> None:
    np.testing.assert_allclose(as_detections(FORMS[form], classes=[2]).boxes, BOXES[1:])


@pytest.mark.parametrize(
    ("found", "message"),
    [
        (None, "got None"),
        ("boxes", "got str"),
        (7.0, r"array of shape \(\)"),
        (np.zeros((2, 3)), r"array of shape \(2, 3\)"),
        (np.zeros((2, 7)), r"array of shape \(2, 7\)"),
        (np.zeros((1, 2, 4)), r"array of shape \(1, 2, 4\)"),
        ([[1, 2, 3, 4], [1, 2]], "got list"),
        ({"bbox": BOXES}, "a dictionary with bbox"),
        ({"boxes": BOXES, "scores": [1.0]}, "2 scores, one a box, got 1"),
        ([[50, 60, 20, 40, 0.9]], "row 0; are they x, y, width, height"),
        ([[1, 1, 2, 2, 0.5], [0, 0, np.nan, 5, 0.9], [0, 0, 0, 5, 0.9]], "row 1"),
        ([[1, 1, 2, 2, np.inf]], "finite"),
        (SimpleNamespace(pred=3), "got SimpleNamespace"),
    ],
)
def test_what_is_none_says_what_was_expected(found: Any, message: str) -> None:
    with pytest.raises(RequestError, match=message) as raised:
        as_detections(found)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("found", [TABLE[:, :5], Detections(BOXES, SCORES)])
def test_classes_of_what_has_none_are_refused(found: Any) -> None:
    with pytest.raises(RequestError, match="expected detections that have classes"):
        as_detections(found, classes=[0])
