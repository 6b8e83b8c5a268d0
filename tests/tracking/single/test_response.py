"""Equations (3.4)-(3.6) and the colours of a box."""

import numpy as np
import pytest

from tsuiseki.tracking.single.colours import ForegroundColour
from tsuiseki.tracking.single.search_windows import ResponseMaps


def ramp_maps():
    """Two filters whose response at a shift x, y is x + 10 y, and its negative."""
    y, x = np.meshgrid(np.fft.fftfreq(6, 1 / 6), np.fft.fftfreq(8, 1 / 8), indexing="ij")
    plane = (x + 10 * y).astype(np.float32)
    return ResponseMaps(np.stack([plane, -plane])[None], np.array([[100.0, 50.0]]), cell=4.0)


def test_a_place_is_read_by_its_displacement_from_the_box_before():
    maps = ramp_maps()
    places = np.array([[100.0, 50.0], [104.0, 50.0], [100.0, 42.0], [102.0, 54.0]])
    np.testing.assert_allclose(maps.at(places, np.array([0, 0, 1, 0])), [0, 1, 20, 10.5], atol=1e-5)


def test_outside_the_window_there_is_no_response():
    assert ramp_maps().at(np.array([[100 + 4 * 4.1, 50.0], [100.0, 50 - 4 * 3.1]]), np.array([0, 0])).tolist() == [0, 0]


def test_the_nearest_window_answers():
    maps = np.stack([np.full((1, 4, 4), v, dtype=np.float32) for v in (1.0, 2.0)])
    both = ResponseMaps(maps, np.array([[0.0, 0.0], [8.0, 0.0]]), cell=4.0)
    assert both.at(np.array([[1.0, 0.0], [7.0, 0.0]]), np.array([0, 0])).tolist() == [1, 2]


def test_colours_tell_the_target_from_its_surroundings():
    image = np.full((60, 80, 3), (30, 200, 30), dtype=np.uint8)
    image[20:40, 30:50] = (200, 20, 20)
    model = ForegroundColour.learn(image, np.array([30, 20, 50, 40.0]))
    on, half, off, outside = model.score(
        image, np.array([[30, 20, 50, 40], [40, 20, 60, 40], [0, 0, 20, 20], [100, 100, 120, 120.0]])
    )
    assert on == pytest.approx(1, abs=0.01)
    assert half == pytest.approx(0.5, abs=0.1)
    assert off == pytest.approx(0, abs=0.01)
    assert outside == 0


@pytest.mark.parametrize("box", [[-50, -50, -20, -20], [0, 0, 80, 60]])
def test_without_target_or_surroundings_there_are_no_colours(box):
    assert ForegroundColour.learn(np.zeros((60, 80, 3), dtype=np.uint8), np.array(box, dtype=float)) is None


def test_climbing_ends_on_the_maximum_between_cells():
    cells = np.arange(8)
    bump = np.exp(-0.1 * ((cells - 2.25)[None] ** 2 + (cells - 3.0)[:, None] ** 2)).astype(np.float32)
    maps = ResponseMaps(bump[None, None], np.array([[100.0, 200.0]]), cell=4.0)
    # a parabola through a Gaussian is a hundredth of a cell off
    np.testing.assert_allclose(maps.climb(np.array([105.0, 209.0]), 0), [109, 212], atol=0.1)
    far = np.array([100.0, 200.0])  # two cells away: one step uphill does not reach it
    assert np.abs(maps.climb(far, 0) - far).max() <= 1.5 * 4
