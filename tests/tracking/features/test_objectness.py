"""Objectness: binarised models, windows in their places, recall by hand."""

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.objectness import (
    ObjectnessModel,
    binarise,
    normed_gradients,
    propose,
    read_objectness,
    recall,
    shipped_objectness,
)


def border_model(*sizes):
    """A model that likes gradients on the border of its window and none inside."""
    weights = np.full((8, 8), -1.0)
    weights[[0, -1], :] = weights[:, [0, -1]] = 1.0
    return ObjectnessModel(weights, np.array(sizes, dtype=float), np.ones(len(sizes)), np.zeros(len(sizes)), "hand")


def square(x, y, width, height, shape=(120, 160)):
    image = np.full((*shape, 3), 60, dtype=np.uint8)
    cv2.rectangle(image, (x, y), (x + width - 1, y + height - 1), (200, 180, 90), -1)
    return image


def test_binarised_models_are_sums_of_signs_and_come_close():
    weights = np.random.default_rng(0).normal(size=(8, 8))
    one = binarise(weights, 1)
    assert len(np.unique(np.abs(one))) == 1
    errors = [np.abs(weights - binarise(weights, terms)).mean() for terms in (1, 2, 3, 8)]
    assert errors == sorted(errors, reverse=True)


def test_normed_gradients_by_hand():
    image = np.zeros((1, 5, 3), dtype=np.uint8)
    image[0, 2] = (10, 100, 200)
    # 200 keeps its four highest bits: 192
    assert normed_gradients(image).tolist() == [[0, 192, 0, 192, 0]]


@pytest.mark.parametrize("region", [None, np.array([20, 10, 130, 110.0])])
def test_a_square_is_found_where_it_is(region):
    boxes, scores = propose(square(60, 40, 40, 40), border_model((40, 40)), 5, region)
    np.testing.assert_allclose(boxes[0], [60, 40, 100, 80], atol=6)  # a cell is five pixels
    assert (np.diff(scores) <= 0).all()


def test_a_region_outside_holds_nothing():
    boxes, _ = propose(square(60, 40, 40, 40), border_model((40, 40)), 5, np.array([500, 500, 600, 600.0]))
    assert len(boxes) == 0


def test_sizes_near_the_target():
    model = border_model((10, 10), (20, 40), (40, 40), (200, 200))
    assert model.near(30, 40).sizes.tolist() == [[20, 40], [40, 40]]
    assert len(model.near(1000, 1000).sizes) == 1


def test_recall_by_hand():
    truths = [np.array([[0, 0, 10, 10], [50, 50, 60, 60.0]])]
    proposals = [np.array([[80, 80, 90, 90], [0, 0, 10, 9], [50, 50, 53, 60.0]])]
    assert recall(truths, proposals, [1, 2, 100]).tolist() == [0, 0.5, 0.5]
    with pytest.raises(ValueError, match="at least one"):
        recall([np.empty((0, 4))], [np.empty((0, 4))], [1])


def test_models_survive_a_file(tmp_path):
    model = border_model((40, 40), (20, 30))
    model.write(tmp_path / "m.json")
    read = read_objectness(tmp_path / "m.json")
    np.testing.assert_allclose(read.weights, model.weights)
    assert read.sizes.tolist() == model.sizes.tolist()


@pytest.mark.parametrize(
    "content", ["", "{}", '{"format": "other"}', '{"format": "tsuiseki-objectness-1", "weights": [1]}']
)
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "m.json").write_text(content)
    with pytest.raises(RequestError, match="expected a file of tsuiseki train objectness"):
        read_objectness(tmp_path / "m.json")


def test_the_shipped_model_finds_a_square_and_ranks_it_above_noise():
    model = shipped_objectness()
    assert (model.gains > 0).all()
    image = square(50, 30, 40, 60)
    image = np.clip(image + np.random.default_rng(0).normal(0, 5, image.shape), 0, 255).astype(np.uint8)
    boxes, scores = propose(image, model, 20)
    assert recall([np.array([[50, 30, 90, 90.0]])], [boxes], [20]) == 1.0
    assert (np.diff(scores) <= 0).all()
