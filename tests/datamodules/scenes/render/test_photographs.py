from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.datamodules.scenes.render.photographs import Photographs
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError

# The horizon lies in the picture.
CAMERA = PinholeCamera.look_at(np.array([0, 0, 4.0]), np.array([0, 20.0, 1.0]), 100, 160, 120)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "surfaces").mkdir()
    (tmp_path / "views").mkdir()
    board = np.kron(np.indices((8, 8)).sum(axis=0) % 2, np.ones((16, 16))) * 160 + 40
    cv2.imwrite(str(tmp_path / "surfaces" / "board.png"), board.astype(np.uint8))
    ramp = np.tile(np.linspace(0, 255, 400), (300, 1)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "views" / "ramp.png"), ramp)
    return tmp_path


def test_a_surface_covers_the_ground_and_not_the_sky(folder: Path) -> None:
    picture = np.full((120, 160, 3), 0.3, np.float32)
    covered = Photographs(folder).covered(np.random.default_rng(2), picture, CAMERA)
    rays = CAMERA.rays(np.stack(np.meshgrid(np.arange(160) + 0.5, np.arange(120) + 0.5), axis=-1).reshape(-1, 2))
    above = rays[:, 2].reshape(120, 160) > 0
    assert above.any()
    np.testing.assert_array_equal(covered[above], picture[above])
    # Near the camera the board shows, far away it is as bright as its mean; light is neither added nor lost by much.
    assert covered[-20:].std() > 0.02
    assert 0.15 < covered[~above].mean() < 0.45


def test_far_ground_is_calm(folder: Path) -> None:
    picture = np.full((120, 160, 3), 0.3, np.float32)
    covered = Photographs(folder).covered(np.random.default_rng(2), picture, CAMERA)
    rows = covered.std(axis=(1, 2))
    horizon = int(np.argmax(rows > 0))
    assert rows[horizon + 1] < 0.25 * rows[-1]


def test_a_view_is_a_part_of_a_photograph(folder: Path) -> None:
    view = Photographs(folder).view(np.random.default_rng(0), 64, 48)
    assert view is not None
    assert view.shape == (48, 64, 3)
    steps = np.diff(np.sqrt(view[20, :, 0]))
    assert (steps >= -1e-3).all() or (steps <= 1e-3).all()


def test_a_thing_is_cut_out_tightly(tmp_path: Path) -> None:
    (tmp_path / "things").mkdir()
    picture = np.zeros((40, 60, 4), np.uint8)
    picture[10:30, 20:25] = (10, 20, 200, 255)
    cv2.imwrite(str(tmp_path / "things" / "post.png"), picture)
    thing = Photographs(tmp_path).thing(np.random.default_rng(0))
    np.testing.assert_array_equal(thing, np.broadcast_to(np.array([200, 20, 10, 255], np.uint8), (20, 5, 4)))


@pytest.mark.parametrize("channels", [3, 4])
def test_a_thing_without_opacity_is_refused(tmp_path: Path, channels: int) -> None:
    (tmp_path / "things").mkdir()
    cv2.imwrite(str(tmp_path / "things" / "nothing.png"), np.zeros((8, 8, channels), np.uint8))
    with pytest.raises(RequestError, match=r"expected a cut-out thing at .*nothing\.png"):
        Photographs(tmp_path).thing(np.random.default_rng(0))


def test_an_empty_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="expected photographs in"):
        Photographs(tmp_path)
