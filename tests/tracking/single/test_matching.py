"""Matching by templates and histograms finds copies, and what looking everywhere finds."""

from typing import get_args

import numpy as np
import pytest

from tests.tracking.single.moving_texture import texture
from tsuiseki.tracking.single.matching import Measure, active_search, colour_bins, match

MEASURES = get_args(Measure)


@pytest.mark.parametrize("measure", MEASURES)
def test_matching_finds_an_exact_copy(measure):
    area = np.random.default_rng(0).integers(1, 256, (20, 25), dtype=np.uint8)
    likeness = match(area, area[6:13, 9:19].copy(), measure)
    assert np.unravel_index(np.argmax(likeness), likeness.shape) == (6, 9)
    # OpenCV's sum of squares comes out of a transform: some thousandths of a grey value remain
    assert likeness.max() == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize(("rows", "columns"), [(6, 25), (20, 9)])
def test_an_area_smaller_than_what_is_looked_for_is_refused(rows, columns):
    area, template = np.zeros((rows, columns), dtype=np.uint8), np.zeros((7, 10), dtype=np.uint8)
    said = f"expected an area of at least 7 x 10, got {rows} x {columns}"
    for measure in MEASURES:
        with pytest.raises(ValueError, match=said):
            match(area, template, measure)
    with pytest.raises(ValueError, match=said):
        active_search(area, np.ones(64) / 64, 7, 10)


@pytest.mark.parametrize("seed", range(3))
def test_active_search_finds_what_looking_everywhere_finds(seed):
    image = texture(seed, 40, 50, (120, 120, 120))
    bins = colour_bins(image)
    reference = np.bincount(bins[8:24, 20:32].ravel(), minlength=64) / (16 * 12)
    row, column, value = active_search(bins, reference, 16, 12)
    best = max(
        np.minimum(np.bincount(bins[y : y + 16, x : x + 12].ravel(), minlength=64) / 192, reference).sum()
        for y in range(25)
        for x in range(39)
    )
    assert value == pytest.approx(best)
    assert (row, column) == (8, 20)
