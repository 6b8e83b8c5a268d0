"""Colour probabilities on a red target before a blue ground, where everything is known."""

import numpy as np
import pytest

from tsuiseki.tracking.single.colours import PixelColour, coloured_area, shift_response, size_contrast
from tsuiseki.tracking.single.search_windows import peak

SIDE, WIDTH, HEIGHT = 104, 24, 40


def patch(dx=0, dy=0, width=WIDTH, height=HEIGHT):
    image = np.full((SIDE, SIDE, 3), (40, 80, 170), dtype=np.uint8)
    x, y = SIDE // 2 + dx, SIDE // 2 + dy
    image[y - height // 2 : y + height // 2, x - width // 2 : x + width // 2] = (200, 50, 40)
    return image


COLOUR = PixelColour.learn(patch(), WIDTH, HEIGHT)


def test_pixels_are_told_apart():
    found = COLOUR.probabilities(patch())
    truth = patch()[::2, ::2, 0] == 200
    assert found[truth].min() > 0.99
    assert found[~truth].max() < 0.01


@pytest.mark.parametrize("shift", [(0, 0), (3, -2), (-4, 5)])
def test_the_response_is_greatest_where_the_target_is(shift):
    moved = COLOUR.probabilities(patch(4 * shift[0], 4 * shift[1]))
    response = shift_response(moved, WIDTH, HEIGHT, (24, 24), 4)
    # the box's inner part is smaller than the target: a plateau of a cell about the middle
    np.testing.assert_allclose(peak(response)[0], shift, atol=1.01)
    assert response.max() == pytest.approx(1, abs=0.01)
    assert response[shift[1] % 24, shift[0] % 24] == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("factor", [0.8, 1.0, 1.25])
def test_the_contrast_is_greatest_at_the_right_size(factor):
    probabilities = COLOUR.probabilities(patch(width=2 * round(12 * factor), height=2 * round(20 * factor)))
    factors = 1.05 ** np.arange(-8, 9)
    contrast = size_contrast(probabilities, WIDTH, HEIGHT, factors)
    assert factors[int(np.argmax(contrast))] == pytest.approx(factor, rel=0.08)
    assert contrast.max() > 0.85


def test_a_colour_that_was_never_seen_counts_as_neither():
    assert COLOUR.probabilities(np.full((8, 8, 3), (0, 255, 0), dtype=np.uint8)) == pytest.approx(0.5)


def test_blending_moves_by_the_rate():
    other = PixelColour.learn(patch()[..., ::-1].copy(), WIDTH, HEIGHT)
    half = COLOUR.blend(other, 0.5)
    np.testing.assert_allclose(half.target, (COLOUR.target + other.target) / 2)
    assert half.around.sum() == pytest.approx(1)


@pytest.mark.parametrize("outline", [(60, 20), (20, 60), (36, 36)])
def test_the_area_of_the_targets_colours_does_not_depend_on_its_outline(outline):
    wide, high = outline
    probabilities = np.full((120, 120), 0.2, np.float32)
    probabilities[60 - high // 2 : 60 + high // 2, 60 - wide // 2 : 60 + wide // 2] = 1.0
    area = coloured_area(probabilities, 80.0, 80.0)
    assert area == pytest.approx(wide * high / 2)  # certain pixels count a half
    probabilities[:10], probabilities[-10:] = 1.0, 1.0  # beyond twice the target's sides
    assert coloured_area(probabilities, 80.0, 80.0) == area
