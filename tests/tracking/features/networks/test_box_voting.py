from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.features.networks.box_voting import voted_boxes

BOXES = np.array([[0.0, 0, 10, 10], [1, 0, 11, 10], [0, 0, 10, 12], [40, 40, 50, 60]])
SCORES = np.array([0.9, 0.3, 0.6, 0.5])


def test_a_box_goes_to_the_weighted_mean_of_those_about_it() -> None:
    # Overlaps with the first: 9 / 11 and 10 / 12.
    found = voted_boxes(BOXES, SCORES, np.array([0, 3]), 0.8)
    np.testing.assert_allclose(found[0], [0.3 / 1.8, 0, 10 + 0.3 / 1.8, 10 + 2 * 0.6 / 1.8])
    np.testing.assert_array_equal(found[1], BOXES[3])


@pytest.mark.parametrize("threshold", [0.9, 1.0])
def test_nothing_moves_where_nobody_else_votes(threshold: float) -> None:
    np.testing.assert_allclose(voted_boxes(BOXES, SCORES, np.arange(4), threshold), BOXES)


def test_nothing_found_is_nothing_moved() -> None:
    nothing = np.empty(0, dtype=np.int64)
    assert voted_boxes(BOXES, SCORES, nothing, 0.5).shape == (0, 4)
    assert voted_boxes(np.empty((0, 4)), np.empty(0), nothing, 0.5).shape == (0, 4)


def test_votes_scale_with_the_picture() -> None:
    rng = np.random.default_rng(0)
    corners = rng.uniform(0, 50, (30, 2))
    boxes = np.concatenate([corners, corners + rng.uniform(5, 60, (30, 2))], axis=1)
    scores, kept = rng.uniform(0.1, 1, 30), np.arange(0, 30, 3)
    np.testing.assert_allclose(
        voted_boxes(3 * boxes + 7, scores, kept, 0.4), 3 * voted_boxes(boxes, scores, kept, 0.4) + 7
    )
