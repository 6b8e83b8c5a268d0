"""The witness knows the target among what surrounds it, and does not slide along with a box."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracking.single.moving_texture import clip, walk
from tsuiseki.tracking.single import regularised
from tsuiseki.tracking.single.regularised import Model, RegularisedSettings
from tsuiseki.tracking.single.tracker import box_centre
from tsuiseki.tracking.single.witness import HEARD, LOW, Regression, Witness


def test_the_regression_is_that_of_all_dimensions():
    rng = np.random.default_rng(0)
    on, around = (rng.normal(mean, 1, (count, 5)).astype(np.float32) for mean, count in ((0.5, 3), (-0.5, 9)))
    shares = np.repeat([0.5 / 3, 0.5 / 9], [3, 9])
    rows, wanted = np.concatenate([on, around]).astype(float), np.repeat([1.0, -1.0], [3, 9])
    centred = rows - shares @ rows
    weights = np.linalg.solve(
        centred.T @ (shares[:, None] * centred) + 0.002 * np.eye(5), centred.T @ (shares * wanted)
    )
    found = Regression.learn(on, around)
    np.testing.assert_allclose(found.weights, weights, rtol=2e-3)
    np.testing.assert_allclose(found(on), centred[:3] @ weights, atol=2e-3)


@pytest.fixture
def known():
    """A witness of a moving texture after eight looks at it; the clip, and what gives the target at a place."""
    images, boxes = clip(walk(20))
    width, height = boxes[0, 2:] - boxes[0, :2]
    model = Model.of(RegularisedSettings(), float(width), float(height))
    first = regularised.start(model, images[0], box_centre(boxes[0]))
    witness = Witness(model, images[0], first)

    def at(frame, shift=0.0):
        return replace(first, centre=box_centre(boxes[frame]) + shift)

    for frame in range(1, 9):
        witness.update(images[frame], at(frame), sure=True)
    return witness, images, at


def test_a_box_on_the_target_is_alike_and_one_beside_it_is_not(known):
    witness, images, at = known
    assert witness.heard
    assert not witness.lost
    assert witness.answer(images[15], at(15)) > 0.5
    assert witness.answer(images[15], at(15, 60.0)) < -0.3


def test_unlike_looks_in_a_row_say_lost_and_the_target_takes_it_back(known):
    witness, images, at = known
    said = []
    for frame in range(9, 9 + LOW + 1):
        witness.update(images[frame], at(frame, 60.0), sure=True)
        said.append(witness.lost)
    assert said == [False] * (LOW - 1) + [True] * 2
    assert witness.answer(images[15], at(15, 60.0)) < -0.3  # it has not learnt what it does not know
    witness.update(images[15], at(15), sure=True)
    assert not witness.lost


def test_a_witness_that_has_not_known_the_target_again_is_not_heard():
    images, boxes = clip(walk(20))
    model = Model.of(RegularisedSettings(), 24.0, 36.0)
    first = regularised.start(model, images[0], box_centre(boxes[0]))
    witness = Witness(model, images[0], first)
    for frame in range(1, 2 * HEARD):
        witness.update(images[frame], replace(first, centre=np.array([150.0, 30.0])), sure=True)
    assert not witness.lost


def test_a_target_without_room_around_it_has_no_witness():
    image = np.random.default_rng(0).integers(0, 256, (60, 200, 3), dtype=np.uint8)
    model = Model.of(RegularisedSettings(), 200.0, 4.0)
    target = regularised.start(model, image, np.array([100.0, 30.0]))
    witness = Witness(model, image, target)
    witness.update(image, target, sure=True)
    assert not witness.lost
