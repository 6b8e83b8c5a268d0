"""The witness knows the target among what surrounds it, and does not slide along with a box."""

import numpy as np
import pytest

from tests.tracking.single.moving_texture import clip, mean_colours, walk
from tsuiseki.tracking.single.witness import RIDGE, Witness, regression


def test_the_regression_is_that_of_all_rows():
    rng = np.random.default_rng(0)
    on, around = (rng.normal(mean, 1, (count, 5)) for mean, count in ((0.5, 3), (-0.5, 9)))
    roots = np.sqrt(np.repeat([0.5 / 3, 0.5 / 9], [3, 9]))[:, None]
    rows = np.column_stack([np.concatenate([on, around]), np.ones(12)])
    wanted = np.repeat([1.0, -1.0], [3, 9])[:, None]
    penalty = np.sqrt(RIDGE) * np.eye(5, 6)  # none on the offset
    found = np.linalg.lstsq(np.vstack([roots * rows, penalty]), np.vstack([roots * wanted, np.zeros((5, 1))]))[0]
    weights, offset = regression(on, around)
    np.testing.assert_allclose(on @ weights + offset, rows[:3] @ found[:, 0], atol=1e-9)


@pytest.fixture
def known():
    """A witness of a moving texture after eight looks at it, the clip, and its boxes."""
    images, boxes = clip(walk(20))
    witness = Witness(mean_colours, images[0], boxes[0])
    for frame in range(1, 9):
        witness.update(images[frame], boxes[frame])
    return witness, images, boxes


def test_a_box_on_the_target_is_alike_and_one_beside_it_is_not(known):
    witness, images, boxes = known
    assert not witness.lost
    on, beside = witness.evidence(images[15], boxes[15] + np.array([[0.0], [60.0]]))
    assert on > 0.5
    assert beside < -0.3


def test_a_clear_look_says_lost_and_another_takes_it_back(known):
    witness, images, boxes = known
    witness.update(images[9], boxes[9] + 60)
    assert witness.lost
    witness.update(images[10], boxes[10])
    assert not witness.lost


def test_where_looks_say_nothing_the_belief_becomes_even(known):
    witness, images, boxes = known
    features = iter([1.0, *[0.65] * 20])
    witness._compare = lambda _: (np.array([next(features)]), np.zeros(1))
    beliefs = []
    for frame in range(9, 19):
        witness.update(images[frame], boxes[frame])
        beliefs.append(witness.belief)
    assert beliefs == sorted(beliefs, reverse=True)
    assert 0 < beliefs[-1] < 0.5


def test_a_box_that_was_moved_counts_as_the_target_until_it_is_seen_not_to_be(known):
    witness, images, boxes = known
    for frame in range(9, 15):
        witness.update(images[frame], boxes[frame] + 60)
    witness.moved()
    assert not witness.lost
    witness.update(images[15], boxes[15] + 60)
    assert witness.lost


def test_what_is_not_known_is_not_learnt(known):
    witness, images, boxes = known
    before = witness.evidence(images[15], boxes[10:15])
    for frame in range(9, 15):
        witness.update(images[frame], boxes[frame] + 60)
    np.testing.assert_array_equal(witness.evidence(images[15], boxes[10:15]), before)
