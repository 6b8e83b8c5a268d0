from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.cameras.projective import PinholeCamera


def cameras() -> list[PinholeCamera]:
    rng = np.random.default_rng(0)
    positions = rng.uniform([-5, -5, 1], [5, 5, 9], (6, 3))
    targets = rng.uniform([-20, 10, 0], [20, 30, 2], (6, 3))
    down = PinholeCamera.look_at(np.array([1.0, 2.0, 5.0]), np.array([1.0, 2.0, 0.0]), 300, 320, 240)
    return [
        down,
        *(PinholeCamera.look_at(p, t, 500, 640, 480, 0.1) for p, t in zip(positions, targets, strict=True)),
    ]


def test_known_pixels() -> None:
    # 10 m ahead at 100 px focal length, a metre is 10 px; x goes right and y down.
    camera = PinholeCamera.look_at(np.array([0, 0, 2.0]), np.array([0, 10, 2.0]), 100, 200, 100)
    pixels, depth = camera.project(np.array([[0, 10, 2], [1, 10, 2], [0, 10, 3], [0, -1, 2]]))
    np.testing.assert_allclose(pixels[:3], [[100, 50], [110, 50], [100, 40]], atol=1e-9)
    np.testing.assert_allclose(depth, [10, 10, 10, -1])
    assert np.isnan(pixels[3]).all()


def test_roll_turns_the_camera_clockwise() -> None:
    camera = PinholeCamera.look_at(np.array([0, 0, 2.0]), np.array([0, 10, 2.0]), 100, 200, 100, np.pi / 2)
    pixels, _ = camera.project(np.array([[0, 10, 3.0]]))
    np.testing.assert_allclose(pixels, [[90, 50]], atol=1e-9)


@pytest.mark.parametrize("camera", cameras())
def test_rays_invert_project(camera: PinholeCamera) -> None:
    rng = np.random.default_rng(1)
    pixels = rng.uniform(0, [camera.width, camera.height], (50, 2))
    rays = camera.rays(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, atol=1e-12)
    back, depth = camera.project(camera.position + rng.uniform(1, 50, (50, 1)) * rays)
    np.testing.assert_allclose(back, pixels, atol=1e-8)
    assert (depth > 0).all()


@pytest.mark.parametrize("camera", cameras())
def test_single_precision_is_kept_and_close(camera: PinholeCamera) -> None:
    pixels = np.random.default_rng(2).uniform(0, 200, (20, 2))
    single = camera.rays(pixels.astype(np.float32))
    assert single.dtype == np.float32
    # Seven digits of float32 on unit vectors.
    np.testing.assert_allclose(single, camera.rays(pixels), atol=1e-6)


@pytest.mark.parametrize("camera", cameras())
def test_ground_lies_on_the_plane_and_projects_back(camera: PinholeCamera) -> None:
    pixels = np.random.default_rng(3).uniform(0, [camera.width, camera.height], (40, 2))
    for height in (0.0, 0.5):
        points = camera.ground(pixels, height)
        seen = np.isfinite(points).all(axis=1)
        assert seen.any()
        np.testing.assert_allclose(points[seen, 2], height, atol=1e-9)
        np.testing.assert_allclose(camera.project(points[seen])[0], pixels[seen], atol=1e-6)


def test_sky_has_no_ground() -> None:
    camera = PinholeCamera.look_at(np.array([0, 0, 2.0]), np.array([0, 10, 2.0]), 100, 200, 100)
    points = camera.ground(np.array([[100.0, 10.0], [100.0, 50.0], [100.0, 90.0]]))
    assert np.isnan(points[:2]).all()
    np.testing.assert_allclose(points[2], [0, 5, 0], atol=1e-9)


def test_bad_cameras_are_refused() -> None:
    good = PinholeCamera.look_at(np.array([0, 0, 2.0]), np.array([0, 10, 0.0]), 100, 200, 100)
    with pytest.raises(ValueError, match="target away"):
        PinholeCamera.look_at(np.ones(3), np.ones(3), 100, 200, 100)
    with pytest.raises(ValueError, match="positive image size"):
        PinholeCamera.look_at(np.ones(3), np.zeros(3), -100, 200, 100)
    with pytest.raises(ValueError, match="rotation matrix"):
        PinholeCamera(200, 100, good.focal, good.principal_point, 2 * np.eye(3), good.position)
    with pytest.raises(ValueError, match="position of shape"):
        PinholeCamera(200, 100, good.focal, good.principal_point, np.eye(3), np.array([0, np.nan, 1]))
