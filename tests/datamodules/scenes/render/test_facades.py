from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.datamodules.scenes.render.photographs import Facade, Photographs, random_facades
from tsuiseki.datamodules.scenes.render.shading import Light
from tsuiseki.tracking.cameras.projective import PinholeCamera

CAMERA = PinholeCamera.look_at(np.array([0, 0, 1.5]), np.array([0, 10.0, 1.5]), 200, 160, 120)


def halves() -> np.ndarray:
    """Red on the left, blue on the right."""
    picture = np.zeros((40, 80, 3), np.uint8)
    picture[:, :40, 0], picture[:, 40:, 2] = 255, 255
    return picture


def test_a_wall_is_where_its_corners_are_seen() -> None:
    traced = Facade(np.array([0.0, 10.0]), 0.0, (4.0, 3.0), halves()).trace(CAMERA, 2)
    assert traced is not None
    layer, shown = traced, traced.picture
    # 4 m at 10 m and a focal length of 200 pixels are 80 pixels, 3 m are 60; the camera looks at its middle.
    mask = np.zeros((240, 320), dtype=np.bool_)
    h, w = layer.mask.shape
    mask[layer.top : layer.top + h, layer.left : layer.left + w] = layer.mask
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    assert (rows[0], rows[-1] + 1, columns[0], columns[-1] + 1) == pytest.approx((60, 180, 80, 240), abs=1)
    assert layer.distance.min() == pytest.approx(10, abs=1e-3)
    assert layer.distance[np.isfinite(layer.distance)].max() == pytest.approx(np.sqrt(100 + 4 + 2.25), abs=0.05)
    assert shown[60, 20, 0] == 255
    assert shown[60, -20, 2] == 255


def test_light_from_behind_a_wall_does_not_reach_its_front() -> None:
    facade = Facade(np.array([0.0, 10.0]), 0.0, (4.0, 3.0), np.full((8, 8, 3), 255, np.uint8))
    traced = facade.trace(CAMERA, 1)
    assert traced is not None
    sun, nothing = np.ones(3, np.float32), np.zeros(3, np.float32)
    for y, brightness in ((-1, 1.0), (1, 0.0)):
        light = Light(np.array([0, y, 0], np.float32), sun, nothing, nothing)
        np.testing.assert_allclose(facade.shade(traced, traced.mask, CAMERA, 1, light), brightness)


def test_a_wall_that_reaches_behind_the_camera_is_left_out() -> None:
    assert Facade(np.array([0.0, 1.0]), np.pi / 2, (8.0, 3.0), halves()).trace(CAMERA, 2) is None


def test_random_walls_keep_clear_of_people(tmp_path: Path) -> None:
    (tmp_path / "surfaces").mkdir()
    cv2.imwrite(str(tmp_path / "surfaces" / "a.png"), halves())
    spots = np.array([[0.0, 10.0], [3.0, 15.0]])
    for seed in range(8):
        for thing in random_facades(np.random.default_rng(seed), Photographs(tmp_path), 5, spots, 15.0):
            assert isinstance(thing, Facade)
            assert np.linalg.norm(spots - thing.place, axis=1).min() > 0.5
            assert thing.picture.max() > 0
