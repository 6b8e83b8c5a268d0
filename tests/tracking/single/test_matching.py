"""Matching by templates and histograms finds copies, and what looking everywhere finds."""

from typing import get_args

import numpy as np
import pytest

from tests.tracking.single.moving_texture import texture
from tsuiseki.tracking.single.matching import Measure, colour_bins, intersections, match

MEASURES = get_args(Measure)


@pytest.mark.parametrize("measure", MEASURES)
def test_matching_finds_an_exact_copy(measure):
    area = np.random.default_rng(0).integers(1, 256, (20, 25), dtype=np.uint8)
    likeness = match(area, area[6:13, 9:19].copy(), measure)
    assert np.unravel_index(np.argmax(likeness), likeness.shape) == (6, 9)
    # OpenCV's sum of squares comes out of a transform: some thousandths of a grey value remain
    assert likeness.max() == pytest.approx(1, abs=1e-3)


def test_intersections_are_those_of_every_window():
    bins = colour_bins(texture(0, 40, 50, (120, 120, 120)))
    reference = np.bincount(bins[8:24, 20:32].ravel(), minlength=64) / (16 * 12)
    shared = intersections(bins, reference, 16, 12)
    assert shared.shape == (25, 39)
    assert np.unravel_index(np.argmax(shared), shared.shape) == (8, 20)
    there = np.bincount(bins[3:19, 30:42].ravel(), minlength=64) / (16 * 12)
    assert shared[3, 30] == pytest.approx(np.minimum(there, reference).sum())
