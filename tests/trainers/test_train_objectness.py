"""Objectness learnt from labelled squares."""

import cv2
import numpy as np
import pytest

pytest.importorskip("sklearn", reason="training needs the train extra")

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.objectness import propose, recall
from tsuiseki.trainers import train_objectness
from tsuiseki.trainers.train_objectness import BoxedImage, fit_objectness


@pytest.fixture(autouse=True)
def few_sizes(monkeypatch):
    for name, value in {"SIDES": (17, 24, 34, 48), "STEEPEST": 1.5, "MIN_EXAMPLES": 5}.items():
        monkeypatch.setattr(train_objectness, name, value)


def squares(count, seed):
    rng = np.random.default_rng(seed)
    images = []
    for _ in range(count):
        image = np.clip(rng.normal(90, 6, (100, 120, 3)), 0, 255).astype(np.uint8)
        side = int(rng.integers(18, 44))
        x, y = rng.integers(0, 120 - side), rng.integers(0, 100 - side)
        cv2.rectangle(image, (int(x), int(y)), (int(x) + side - 1, int(y) + side - 1), (220, 210, 60), -1)
        images.append(BoxedImage(image, np.array([[x, y, x + side, y + side]], dtype=float)))
    return images


def test_it_finds_squares_of_sizes_it_learnt():
    model = fit_objectness(squares(40, 0), 0, "squares")
    test = squares(20, 1)
    proposals = [propose(item.image, model, 50)[0] for item in test]
    found = recall([item.boxes for item in test], proposals, [3, 50])
    assert found[0] > 0.7
    assert found[1] > 0.9


def test_the_same_seed_gives_the_same_model():
    first, second = (fit_objectness(squares(25, 2), 0, "") for _ in range(2))
    np.testing.assert_array_equal(first.weights, second.weights)
    np.testing.assert_array_equal(first.gains, second.gains)


def test_too_few_boxes_are_an_error():
    with pytest.raises(RequestError, match="at least 5 labelled boxes"):
        fit_objectness(squares(2, 0), 0, "")
