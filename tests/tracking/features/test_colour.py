"""Clothing colour in closed form, and what it should and should not notice."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.features.colour import ClothingColour

BOX = np.array([[10.0, 5, 50, 105]])


def _person(upper: tuple[int, int, int], lower: tuple[int, int, int]) -> np.ndarray:
    """An image with a person's box of two hues, saturation and value; RGB."""
    image = np.zeros((120, 80, 3), dtype=np.uint8)
    image[5:55, 10:50], image[55:105, 10:50] = upper, lower
    return cv2.cvtColor(image, cv2.COLOR_HSV2RGB)


def test_features_have_unit_length_and_match_themselves() -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (120, 80, 3), dtype=np.uint8)
    boxes = np.vstack([BOX, [[0, 0, 80, 120]], [[30.2, 20.7, 33.1, 25.9]]])
    features = ClothingColour().describe(image, boxes)
    assert features.shape == (3, ClothingColour().length)
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1)
    np.testing.assert_array_equal(features[:1], ClothingColour().describe(image, BOX))


def test_pure_colours_in_the_middle_of_their_bins() -> None:
    """Both parts of one colour each: similarity is the mean over the parts of what their histograms share."""
    red, blue = (5, 96, 96), (119, 96, 96)  # hues in fine bins that are blurred into different coarse ones
    describe = ClothingColour().describe
    same, half, none = (describe(_person(*c), BOX)[0] for c in ((red, blue), (red, red), (blue, red)))
    assert same @ same == pytest.approx(1)
    assert same @ half == pytest.approx(0.5)
    assert same @ none == pytest.approx(0)


def test_hue_is_a_circle() -> None:
    describe = ClothingColour().describe
    below, above, far = (describe(_person((h, 200, 200), (h, 200, 200)), BOX)[0] for h in (178, 2, 90))
    assert below @ above > 0.9
    assert below @ far == pytest.approx(0)


def test_a_little_light_changes_little() -> None:
    describe = ClothingColour().describe
    for value in range(40, 220, 12):
        darker, lighter = (describe(_person((60, 150, v), (110, 90, v)), BOX)[0] for v in (value, value + 10))
        assert darker @ lighter > 0.8


@pytest.mark.parametrize("box", [[-50, -50, -20, -10], [500, 500, 600, 700], [79.6, 3, 90, 4], [40, 60, 40.2, 60.3]])
def test_boxes_beyond_the_image_are_described_all_the_same(box: list[float]) -> None:
    features = ClothingColour().describe(_person((5, 200, 200), (90, 200, 200)), np.array([box]))
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1)


def test_no_boxes() -> None:
    assert ClothingColour().describe(np.zeros((9, 9, 3), np.uint8), np.empty((0, 4))).shape == (0, 256)
