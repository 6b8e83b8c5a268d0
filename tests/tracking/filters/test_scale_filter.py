"""The filter over sizes on rows whose content is known to shift with the size."""

import numpy as np
import pytest

from tsuiseki.tracking.filters.scale_filter import ScaleFilter, ScaleSample, best_offset, far_area, far_peak

SIZES = 11


def rows(offset):
    """Smooth features of the logarithm of the size, seen at a target ``offset`` steps larger."""
    frequencies = np.linspace(0.05, 2.5, 40)
    steps = np.arange(SIZES) - SIZES // 2 - offset
    return ScaleSample(np.sin(np.outer(steps, frequencies) + np.arange(40)))


@pytest.mark.parametrize("offset", [-2, 0, 1, 3])
def test_the_size_that_was_learnt_is_found(offset):
    response = ScaleFilter.learn(rows(0)).respond(rows(offset))
    assert int(np.argmax(response)) - SIZES // 2 == offset
    assert best_offset(response) == pytest.approx(offset, abs=0.5)


@pytest.mark.parametrize("offset", [-0.4, 0.3, 0.5])
def test_a_size_between_two_rows_can_be_learnt(offset):
    response = ScaleFilter.learn(rows(offset), offset).respond(rows(offset))
    assert best_offset(response) == pytest.approx(offset, abs=0.1)


def test_a_response_at_the_border_is_taken_as_it_is():
    assert best_offset(np.array([3.0, 1.0, 0.0])) == -1


def test_blending_goes_from_the_old_to_the_new():
    old, new = ScaleFilter.learn(rows(0)), ScaleFilter.learn(rows(2))
    np.testing.assert_allclose(old.blend(new, 1.0).numerator, new.numerator, rtol=1e-4, atol=1e-4)
    np.testing.assert_array_equal(old.blend(new, 0.0).denominator, old.denominator)


@pytest.mark.parametrize(
    ("at", "height", "found"),
    [(9, 0.5, 9), (-7, 0.5, -7), (3, 0.5, 0), (9, 0.05, 0), (10, 0.5, 0)],
    ids=["larger", "smaller", "near", "hardly greater", "at the end: no peak"],
)
def test_a_far_size_is_a_clear_peak_away_from_the_middle(at, height, found):
    response = np.zeros(21)
    response[10 + at] += height
    assert far_peak(response, least=4, margin=0.1) == found


def test_an_area_tells_the_steps_to_a_far_size():
    assert far_area(1.03**16, step=1.03, least=4) == pytest.approx(8)  # an area grows with the square of the size
    assert far_area(1.03**-16, step=1.03, least=4) == pytest.approx(-8)
    assert far_area(1.03**6, step=1.03, least=4) == 0  # three steps are near
    assert np.isfinite(far_area(0.0, step=1.03, least=4))
