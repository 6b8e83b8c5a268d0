"""What moves while the shutter is open: light is kept, and only what moves smears."""

from __future__ import annotations

import numpy as np
import pytest

from tests.datamodules.scenes.render.test_scene import CAMERA, LIGHT, ball, empty, slab
from tsuiseki.datamodules.scenes.render.motion_blur import line_kernel, move_camera, move_people, smeared
from tsuiseki.datamodules.scenes.render.scene import compose


@pytest.mark.parametrize("shift", [[0.6, 0.0], [3.0, 0.0], [0.0, -5.0], [4.3, 2.1], [-7.0, 3.0]])
def test_a_line_weighs_one_about_its_middle_and_reaches_as_far_as_it_is_long(shift: list[float]) -> None:
    kernel = line_kernel(np.array(shift)).astype(np.float64)
    side = len(kernel)
    assert side % 2 == 1
    assert kernel.sum() == pytest.approx(1)
    y, x = np.mgrid[:side, :side] - side // 2
    assert (kernel * x).sum() == pytest.approx(0, abs=1e-6)
    assert (kernel * y).sum() == pytest.approx(0, abs=1e-6)
    # Of a line of length L the variance is L^2 / 12, and splitting between pixels adds a sixth at most.
    spread = np.sqrt(12 * (kernel * (x**2 + y**2)).sum())
    assert np.hypot(*shift) - 1e-3 <= spread <= np.hypot(*shift) + 2


def test_a_turned_camera_smears_a_point_along_its_way() -> None:
    colour = np.zeros((21, 31, 3), dtype=np.float32)
    colour[10, 15] = 1
    moved = move_camera(colour, np.array([6.0, 0.0]))
    assert moved[10].sum() == pytest.approx(3, abs=1e-4)
    rows, columns = np.nonzero(moved[..., 0] > 1e-6)
    assert set(rows) == {10}
    assert (columns.min(), columns.max()) == (12, 18)
    assert move_camera(colour, np.array([0.2, 0.2])) is colour


def test_who_moves_smears_and_who_stands_does_not() -> None:
    picture, sightings = compose(empty(), [ball(-1.5, 0, 0.6), ball(1.5, 0, 0.6)], CAMERA, LIGHT)
    moved = move_people(picture, sightings, np.array([[8.0, 0.0], [0.0, 0.0]]))
    changed = np.abs(moved - picture.colour).max(axis=2) > 1e-4
    assert not changed[:, 80:].any()
    columns = np.flatnonzero(changed.any(axis=0))
    first = sightings[0]
    assert first is not None
    # Half of the way beyond either side.
    assert columns.min() == pytest.approx(first.box[0] - 4, abs=1.5)
    assert columns.max() == pytest.approx(first.box[2] + 4, abs=1.5)
    before, after = (image[:, :80].sum() for image in (picture.colour, moved))
    assert after == pytest.approx(before, rel=0.004)
    assert np.isfinite(moved).all()
    assert moved.min() >= 0


def test_nobody_smears_over_what_is_nearer() -> None:
    picture, sightings = compose(empty(), [ball(0, 0), slab(5, -3, 5)], CAMERA, LIGHT)
    moved = move_people(picture, sightings[:1], np.array([[12.0, 0.0]]))
    changed = np.abs(moved - picture.colour).max(axis=2) > 1e-4
    assert changed[:, :78].any()
    assert not changed[:, 82:].any()


def test_the_order_of_people_does_not_matter() -> None:
    things, shifts = [ball(-0.3, 0), ball(0.5, -3, 0.6), ball(0.9, 2)], np.array([[9.0, 1.0], [-6.0, 0.0], [4.0, 4.0]])
    results = []
    for order in ([0, 1, 2], [2, 1, 0], [1, 2, 0]):
        picture, sightings = compose(empty(), [things[n] for n in order], CAMERA, LIGHT)
        results.append(move_people(picture, sightings, shifts[order]))
    assert np.abs(results[0] - picture.colour).max() > 0.02
    for other in results[1:]:
        np.testing.assert_allclose(results[0], other, atol=1e-5)


def test_who_is_not_seen_does_no_harm() -> None:
    things = [ball(0, -40), ball(30, 0), ball(0, 3, 0.3)]
    picture, sightings = compose(empty(), [*things, slab(0, -2, 5)], CAMERA, LIGHT)
    moved = move_people(picture, sightings[:3], np.full((3, 2), 9.0))
    np.testing.assert_allclose(moved, picture.colour, atol=1e-5)


def test_the_same_seed_smears_alike_and_another_does_not() -> None:
    picture, sightings = compose(empty(), [ball(-1, 0), ball(1, 0)], CAMERA, LIGHT)
    results = [smeared(np.random.default_rng(seed), picture, sightings) for seed in (1, 1, 2, 3, 4)]
    np.testing.assert_array_equal(results[0], results[1])
    assert any(not np.array_equal(results[0], other) for other in results[2:])
