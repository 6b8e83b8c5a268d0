"""Augmentation: boxes follow the pixels, and nothing depends on anything but the generator."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tsuiseki.datamodules.augmentation import (
    Augmentation,
    Example,
    augment,
    random_affine,
    recolour,
    texture,
    transform_boxes,
)

SIZE = (96, 128)
STILL = Augmentation(
    scale=(1.0, 1.0), aspect=0, rotation=0, shear=0, flip=0, colour=0, grey=0, blur=0, noise=0, compression=0, holes=0
)


def example(height: int = 96, width: int = 128) -> Example:
    """A grey image with one red box."""
    image = np.full((height, width, 3), 90, dtype=np.uint8)
    image[30:70, 50:66] = (200, 20, 20)
    return Example(image, np.array([[50.0, 30.0, 66.0, 70.0]]), np.zeros(1, dtype=np.bool_))


def fill() -> np.ndarray:
    return np.zeros((*SIZE, 3), dtype=np.uint8)


def red_box(image: np.ndarray) -> np.ndarray:
    """The box of what is red."""
    red = image[..., 0].astype(int) - image[..., 1] > 60
    rows, columns = np.flatnonzero(red.any(axis=1)), np.flatnonzero(red.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])


def test_without_changes_the_image_stays() -> None:
    result = augment(np.random.default_rng(0), example(), SIZE, STILL, fill())
    assert np.array_equal(result.image, example().image)
    assert np.array_equal(result.boxes, example().boxes)


@pytest.mark.parametrize(
    "change",
    [{"flip": 1.0}, {"scale": (0.5, 0.6)}, {"scale": (1.5, 1.8)}, {"aspect": 0.4}, {"flip": 1.0, "scale": (0.7, 1.4)}],
)
def test_boxes_follow_the_pixels(change: dict[str, float]) -> None:
    settings = dataclasses.replace(STILL, smallest=0, **change)  # type: ignore[arg-type]
    seen = 0
    for seed in range(12):
        result = augment(np.random.default_rng(seed), example(), SIZE, settings, fill())
        seen += int((~result.ignored).sum())
        for box in result.boxes[~result.ignored]:
            # Interpolation blurs an edge over a pixel to each side.
            assert np.abs(red_box(result.image) - box).max() <= 1.5
    assert seen > 6


def test_the_middle_follows_rotation_and_shear() -> None:
    settings = dataclasses.replace(STILL, rotation=20.0, shear=0.2, smallest=0)
    for seed in range(12):
        result = augment(np.random.default_rng(seed), example(), SIZE, settings, fill())
        seen = red_box(result.image)
        assert np.abs((seen[:2] + seen[2:]) - (result.boxes[0, :2] + result.boxes[0, 2:])).max() / 2 <= 1.5
        # About the inscribed ellipse: never larger than the turned rectangle.
        assert ((result.boxes[0, 2:] - result.boxes[0, :2]) <= (seen[2:] - seen[:2]) + 1.5).all()


def test_ellipse_by_hand() -> None:
    """A quarter turn swaps the sides; a turn by 45 degrees of semi-axes 3 and 4 spans sqrt((9 + 16) / 2)."""
    box = np.array([[-3.0, -4.0, 3.0, 4.0]])
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    assert transform_boxes(box, quarter).tolist() == [[-4.0, -3.0, 4.0, 3.0]]
    eighth = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0]]) / np.sqrt(2)
    assert transform_boxes(box, eighth)[0, 2:].tolist() == pytest.approx([np.sqrt(12.5)] * 2)


def test_what_does_not_fill_the_input_lies_inside_it() -> None:
    settings = dataclasses.replace(STILL, scale=(0.4, 0.9))
    corners = np.array([[0.0, 0.0, 1.0], [64.0, 48.0, 1.0]])
    for seed in range(20):
        affine = random_affine(np.random.default_rng(seed), (48, 64), SIZE, settings)
        placed = corners @ affine.T
        assert placed.min() >= -1e-9
        assert (placed <= np.array([SIZE[1], SIZE[0]]) + 1e-9).all()


def test_people_cut_off_or_too_small_are_ignored() -> None:
    at_border = Example(
        example().image, np.array([[-14.0, 30.0, 2.0, 70.0], [50.0, 30.0, 54.0, 39.0]]), np.zeros(2, bool)
    )
    result = augment(np.random.default_rng(0), at_border, SIZE, dataclasses.replace(STILL, smallest=12.0), fill())
    assert result.boxes.tolist() == [[0.0, 30.0, 2.0, 70.0], [50.0, 30.0, 54.0, 39.0]]
    assert result.ignored.tolist() == [True, True]


def test_all_at_once_keeps_shapes_and_repeats_with_the_seed() -> None:
    first, second, other = (
        augment(np.random.default_rng(s), example(48, 64), SIZE, Augmentation(), fill()) for s in (5, 5, 6)
    )
    assert first.image.shape == (*SIZE, 3)
    assert first.image.dtype == np.uint8
    assert np.array_equal(first.image, second.image)
    assert not np.array_equal(first.image, other.image)


def test_colour_changes_leave_geometry_alone_and_grey_is_grey() -> None:
    image = example().image
    changed = recolour(np.random.default_rng(1), image, 0.6, grey=0.0)
    assert not np.array_equal(changed, image)
    assert len(np.unique(changed.reshape(-1, 3), axis=0)) == 2
    grey = recolour(np.random.default_rng(1), image, 0.0, grey=1.0)
    assert np.ptp(grey.astype(int), axis=2).max() <= 1


def test_textures_are_full_of_nothing() -> None:
    pattern = texture(np.random.default_rng(0), SIZE)
    assert pattern.shape == (*SIZE, 3)
    assert pattern.std() > 3
