"""Cameras over the floor: from height and tilt, from points, and on disk."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.cameras.calibration import locate_over_floor, pose_at
from tsuiseki.tracking.cameras.camera_files import CameraOverFloor, read_cameras, write_cameras
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera, OmnidirectionalLens
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError

LENS = OmnidirectionalLens(640, 480, np.array([160.0, 0.0, -1.2e-3, 1e-6, -5e-9]), np.array([322.5, 238.0]))
FISHEYE = OmnidirectionalCamera(LENS, np.eye(3), np.zeros(3))
PINHOLE = PinholeCamera(640, 480, np.full(2, 400.0), np.array([320.0, 240.0]), np.eye(3), np.zeros(3))


def test_a_level_camera_sees_the_floor_under_it_at_the_centre():
    camera = pose_at(FISHEYE, 2.8)
    assert np.allclose(camera.ground(LENS.centre[None]), 0, atol=1e-9)
    right, up = camera.project(np.array([[1.0, 0, 0], [0, 1.0, 0]]))[0] - LENS.centre
    assert right[0] > 0 > up[1]


def test_tilt_moves_the_axis_towards_y():
    camera = pose_at(FISHEYE, 2.0, tilt=np.radians(45))
    assert np.allclose(camera.ground(LENS.centre[None]), [[0, 2.0, 0]], atol=1e-9)


@pytest.mark.parametrize("camera", [FISHEYE, PINHOLE], ids=["fisheye", "projective"])
def test_points_of_the_floor_give_the_pose_back(camera):
    rng = np.random.default_rng(3)
    truth = replace(pose_at(camera, 3.1, 0.3, 1.1), position=np.array([1.0, -2.0, 3.1]))
    floor = rng.uniform((0.0, -2.2), (2.0, -0.2), (8, 2))
    pixels = truth.project(np.column_stack([floor, np.zeros(8)]))[0]
    found, residuals, away = locate_over_floor(camera, pixels, floor)
    assert np.allclose(found.position, truth.position, atol=1e-6)
    assert np.allclose(found.rotation, truth.rotation, atol=1e-6)
    assert residuals.max() < 1e-6
    assert away.max() < 1e-8


@pytest.mark.parametrize(
    ("pixels", "floor", "message"),
    [
        (np.zeros((3, 2)), np.zeros((3, 2)), "at least 4 points"),
        (np.ones((5, 2)), np.outer(np.arange(5.0), [1, 2]), "on one line"),
    ],
)
def test_points_that_fix_nothing_are_refused(pixels, floor, message):
    with pytest.raises(RequestError, match=message):
        locate_over_floor(FISHEYE, pixels, floor)


@pytest.mark.parametrize("height", [0.0, -1.0, np.nan])
def test_a_camera_hangs_above_the_floor(height):
    with pytest.raises(RequestError, match="above 0 m"):
        pose_at(FISHEYE, height)


def test_cameras_over_a_floor_come_back_from_disk(tmp_path):
    floor = np.array([0.0, 0, 8, 16])
    written = [
        CameraOverFloor("a", replace(pose_at(FISHEYE, 3.0), lens=replace(LENS, field=1.5)), 15.0, floor=floor),
        CameraOverFloor("b", pose_at(PINHOLE, 3.0), floor=floor),
    ]
    write_cameras(tmp_path / "cameras.yaml", written)
    points = np.array([[0.3, 0.2, 0.0], [-0.5, 0.1, 1.7]])
    for before, after in zip(written, read_cameras(tmp_path / "cameras.yaml"), strict=True):
        assert np.allclose(before.camera.project(points)[0], after.camera.project(points)[0], atol=1e-6)
        assert (before.name, before.frame_rate) == (after.name, after.frame_rate)
        assert np.allclose(after.floor, floor)


def test_two_floors_are_refused(tmp_path):
    floors = {name: np.array([0.0, 0, 8, y]) for name, y in (("a", 16), ("b", 9))}
    cameras = [CameraOverFloor(name, pose_at(FISHEYE, 3.0), floor=floor) for name, floor in floors.items()]
    write_cameras(tmp_path / "cameras.yaml", cameras)
    with pytest.raises(RequestError, match="one floor for all cameras"):
        read_cameras(tmp_path / "cameras.yaml")


def test_a_field_that_is_missing_is_named(tmp_path):
    (tmp_path / "cameras.yaml").write_text(
        "cameras:\n- {model: omnidirectional, image_size: [640, 480], centre: [320, 240], "
        "rotation: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], position: [0, 0, 3]}\n"
    )
    with pytest.raises(RequestError, match="the field direct"):
        read_cameras(tmp_path / "cameras.yaml")
