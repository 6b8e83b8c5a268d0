"""The region likelihood against sums over pixels, and colours that match all, nothing, or are none."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.colour_region import (
    NAMED_COLOURS,
    ColourImage,
    ColourRange,
    colour_of_box,
    colour_pixels,
    parse_colour,
    region_contrast,
)


def square(purity=1.0, seed=0):
    mask = np.zeros((60, 80), dtype=bool)
    mask[20:40, 30:50] = np.random.default_rng(seed).random((20, 20)) < purity
    return ColourImage.of_mask(mask)


def test_counts_equal_sums_over_pixels():
    rng = np.random.default_rng(0)
    mask = rng.random((40, 50)) < 0.3
    corners = rng.integers(-10, 60, (100, 4))
    boxes = np.concatenate(
        [np.minimum(corners[:, :2], corners[:, 2:]), np.maximum(corners[:, :2], corners[:, 2:])], axis=1
    )
    coloured, area = ColourImage.of_mask(mask).counts(boxes.astype(float))
    for (x1, y1, x2, y2), inside, pixels in zip(np.clip(boxes, 0, [50, 40, 50, 40]), coloured, area, strict=True):
        assert inside == mask[y1:y2, x1:x2].sum()
        assert pixels == max(x2 - x1, 0) * max(y2 - y1, 0)


@pytest.mark.parametrize(
    ("box", "expected"),
    [
        ([30, 20, 50, 40], 1.0),  # all inside coloured, nothing around
        ([0, 0, 20, 20], 0.0),  # nothing inside
        ([20, 20, 40, 40], 0.5 * (1 - (20 * 5) / 500)),  # half inside; 5 of the 30 columns around are coloured
        ([70, 50, 90, 70], 0.0),  # over the border
    ],
)
def test_likelihood_is_p_times_one_minus_q(box, expected):
    found = region_contrast(square(), np.array([box], dtype=float), margin=0.5)
    assert found[0] == pytest.approx(expected)


def test_the_right_box_is_the_best_and_purity_scales_it():
    best = region_contrast(square(), np.array([[30.0, 20, 50, 40]]))[0]
    others = np.array([[28.0, 18, 48, 38], [25.0, 15, 55, 45], [35.0, 25, 45, 35]])
    assert np.all(region_contrast(square(), others) < best)
    assert region_contrast(square(0.5), np.array([[30.0, 20, 50, 40]]))[0] == pytest.approx(0.5, abs=0.06)


def test_pixels_of_others_belong_to_nobody_else():
    box = np.array([[20.0, 20, 40, 40]])
    other = np.array([[[30.0, 20, 50, 40]]])
    assert region_contrast(square(), box, others=other)[0] == 0.0
    behind = np.zeros((1, 1), dtype=bool)
    assert region_contrast(square(), box, others=other, in_front=behind)[0] == pytest.approx(0.5)  # q loses them, p not
    hiding = np.array([[[15.0, 15, 38, 45]]])
    assert np.isnan(region_contrast(square(), box, others=hiding)[0])
    nobody = np.zeros((1, 1, 4))
    assert region_contrast(square(), box, others=nobody)[0] == region_contrast(square(), box)[0]


@pytest.mark.parametrize("value", [False, True], ids=["nothing", "everything"])
def test_a_colour_that_matches_nothing_or_everything_has_no_region(value):
    image = ColourImage.of_mask(np.full((30, 30), value))
    boxes = np.array([[5.0, 5, 15, 15], [-50.0, -50, -40, -40], [10.0, 10, 10, 10]])
    found = region_contrast(image, boxes)
    assert np.isfinite(found).all()
    assert np.all(found == 0.0)


@pytest.mark.parametrize(
    ("name", "rgb"),
    [("red", (210, 20, 30)), ("green", (30, 180, 40)), ("blue", (30, 60, 220)), ("white", (250, 250, 250))],
)
def test_named_colours(name, rgb):
    image = np.full((4, 4, 3), rgb, dtype=np.uint8)
    assert [other for other in NAMED_COLOURS if colour_pixels(image, NAMED_COLOURS[other]).all()] == [name]


def test_the_colour_of_a_box_is_found_again():
    image = np.full((40, 40, 3), (120, 130, 120), dtype=np.uint8)
    image[10:20, 10:20] = (220, 40, 20)
    mask = colour_pixels(image, colour_of_box(image, np.array([10.0, 10, 20, 20]))) > 0
    assert mask[10:20, 10:20].all()
    assert mask.sum() == 100


@pytest.mark.parametrize("text", ["pink-ish", "10-20", "10-20,0-1", "0-400,0-1,0-1", "0-10,0.9-0.1,0-1", "a-b,0-1,0-1"])
def test_what_is_no_colour_is_refused(text):
    with pytest.raises(RequestError, match="expected a"):
        parse_colour(text)


def test_a_grey_or_empty_box_is_refused():
    grey = np.full((20, 20, 3), 128, dtype=np.uint8)
    with pytest.raises(RequestError, match="found grey"):
        colour_of_box(grey, np.array([0.0, 0, 10, 10]))
    with pytest.raises(RequestError, match="inside the image"):
        colour_of_box(grey, np.array([50.0, 50, 60, 60]))


def test_ranges_are_checked():
    with pytest.raises(RequestError, match="saturation"):
        ColourRange((0.0, 10.0), saturation=(0.0, 1.5))
