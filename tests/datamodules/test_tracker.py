"""Generated pairs for the Siamese tracker: the same seed, the same pair; boxes where the target is; absent targets."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from tsuiseki.datamodules.scenes.pairs import pair as pairs_module
from tsuiseki.datamodules.scenes.pairs.looks import Wardrobe, cut_out, outlined, read_things
from tsuiseki.datamodules.scenes.pairs.pair import Placement, TargetPair, draw_pair
from tsuiseki.datamodules.scenes.render.photographs import Photographs
from tsuiseki.datamodules.tracker import GeneratedPairs, TrackerData, collate
from tsuiseki.tracking.errors import RequestError


@pytest.fixture(scope="module")
def wardrobe() -> Wardrobe:
    return Wardrobe((0,))


@pytest.fixture(scope="module")
def some(wardrobe: Wardrobe) -> list[TargetPair]:
    return [draw_pair(np.random.default_rng(n), wardrobe, 127, 255) for n in range(24)]


@pytest.mark.slow
def test_shapes_and_kinds(some: list[TargetPair]) -> None:
    for drawn in some:
        assert (drawn.template.shape, drawn.template.dtype) == ((127, 127, 3), np.uint8)
        assert (drawn.search.shape, drawn.search.dtype) == ((255, 255, 3), np.uint8)
        assert (drawn.box.shape, drawn.box.dtype) == ((4,), np.float32)


def test_the_middle_of_a_target_is_in_the_search_picture(some: list[TargetPair]) -> None:
    boxes = np.stack([drawn.box for drawn in some if drawn.present])
    middles, sides = (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]
    assert (middles > 0).all()
    assert (middles < 255).all()
    # A square target fills half of the template; a size up to 1.7 times as large or small, and long ones less.
    assert ((np.sqrt(sides.prod(axis=1)) > 20) & (np.sqrt(sides.prod(axis=1)) < 127)).all()


def test_some_targets_are_absent(some: list[TargetPair]) -> None:
    absent = [drawn for drawn in some if not drawn.present]
    assert 0 < len(absent) < len(some) / 4
    assert all(not drawn.box.any() for drawn in absent)


def test_the_same_seed_has_the_same_pair(some: list[TargetPair]) -> None:
    """Whatever was drawn before it."""
    again = draw_pair(np.random.default_rng(7), Wardrobe((0,)), 127, 255)
    assert all(np.array_equal(a, b) for a, b in zip(some[7], again, strict=True))
    assert not np.array_equal(some[7].search, some[8].search)


def test_the_extent_of_a_turned_thing_is_that_of_its_picture() -> None:
    """Against the opaque pixels of the warped picture itself."""
    pixels = np.zeros((40, 60, 4), np.uint8)
    cv2.ellipse(pixels, (28, 19), (20, 9), 30, 0, 360, (200, 100, 50, 255), -1)
    turn = np.array([[0.8, -0.6], [0.6, 0.8]]) * 1.5
    thing, canvas = Placement(outlined(pixels), turn), np.zeros((120, 120, 3), np.float32)
    middle = np.array([60.0, 60.0])
    opacity = pairs_module._lay(canvas, thing, middle)
    assert opacity is not None
    rows, columns = np.nonzero(opacity > 0.5)
    seen = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
    np.testing.assert_allclose(thing.extent() + np.tile(middle, 2), seen, atol=1.0)


def test_a_cover_leaves_a_share_of_the_target() -> None:
    square = outlined(np.full((40, 40, 4), 255, np.uint8))
    canvas, middle = np.zeros((100, 100, 3), np.float32), np.array([50.0, 50.0])
    left = pairs_module._lay(canvas, Placement(square, np.eye(2)), middle)
    assert left is not None
    before = float(left.sum())
    assert pairs_module._lay(canvas, Placement(square, np.eye(2)), middle, left) is None
    assert float(left.sum()) == before
    assert pairs_module._lay(canvas, Placement(square, np.eye(2)), middle + np.array([20, 0]), left) is not None
    assert float(left.sum()) == pytest.approx(before / 2)


def test_epochs_have_other_pairs() -> None:
    epoch = [0]
    data = GeneratedPairs(3, 127, lambda: (5, epoch[0]))
    first = data[1]
    assert np.array_equal(data[1].search, first.search)
    epoch[0] = 1
    assert not np.array_equal(data[1].search, first.search)
    with pytest.raises(IndexError):
        data[3]


def test_pairs_are_stacked(some: list[TargetPair]) -> None:
    batch = collate(some[:3])
    assert [tuple(part.shape) for part in batch] == [(3, 127, 127, 3), (3, 255, 255, 3), (3, 4), (3,)]
    assert batch.present.dtype == torch.bool


def test_things_are_cut_out_of_pictures(tmp_path: Path) -> None:
    """Colours are taken times opacity; what shows nothing is left out."""
    (tmp_path / "things").mkdir()
    picture = np.zeros((50, 80, 4), np.uint8)
    picture[10:40, 20:70] = (10, 20, 200, 255)
    for name, pixels in (("a", picture), ("empty", np.zeros_like(picture))):
        cv2.imwrite(str(tmp_path / "things" / f"{name}.png"), pixels)
    (thing,) = read_things(Photographs(tmp_path))
    assert thing.pixels.shape == (67, 112, 4)
    assert thing.pixels[30, 50].tolist() == [200, 20, 10, 255]
    assert cut_out(np.zeros_like(picture)) is None
    data = TrackerData(tmp_path, batch_size=2, batches=1, validation=2)
    data.setup("fit")
    assert len(data.things) == 1
    assert next(iter(data.val_dataloader())).search.shape == (2, 255, 255, 3)


def test_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match=r"`batch_size`: expected at least 1, got 0"):
        TrackerData(batch_size=0)
    with pytest.raises(
        RequestError, match=r"`search_side`: expected 16 k - 1 pixels from 127 on, such as 255, got 200"
    ):
        TrackerData(search_side=200)
    with pytest.raises(RequestError, match=r"expected photographs in surfaces, views or things"):
        TrackerData(tmp_path)
