"""Cameras: what is projected and looked along again is where it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.properties.drawn import seeds
from tsuiseki.tracking.cameras.calibration import calibrate_camera, decompose, locate_over_floor, pose_at
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera, OmnidirectionalLens
from tsuiseki.tracking.cameras.panorama import CylinderView, DownwardView
from tsuiseki.tracking.cameras.projective import PinholeCamera, distort, largest_radius, undistort
from tsuiseki.tracking.sphere.points import triangulate
from tsuiseki.tracking.types import FloatArray

SIZE = (640, 480)


def pinhole_of(rng: np.random.Generator, bent: bool = True) -> PinholeCamera:
    """A camera some metres up, which looks down before it through a lens that bends lines or does not."""
    position, target = rng.uniform([-5, -5, 2], [5, 5, 9]), rng.uniform([-8, 8, 0], [8, 25, 1])
    camera = PinholeCamera.look_at(position, target, rng.uniform(300, 900), *SIZE, rng.uniform(-0.3, 0.3))
    lens = rng.normal(0, [0.1, 0.03, 0.002, 0.002, 0.01])
    return replace(camera, distortion=lens) if bent else camera


def fisheye_of(rng: np.random.Generator) -> OmnidirectionalLens:
    """A lens that sees all before it and little behind, its centre beside the middle, its pixels not quite square."""
    focal = rng.uniform(100, 200)
    direct = focal * np.array([1.0, 0, -rng.uniform(0.3, 0.6) / focal**2, 0, -rng.uniform(0, 0.05) / focal**4])
    stretch = np.eye(2) + rng.normal(0, 0.01, (2, 2))
    return OmnidirectionalLens(*SIZE, direct, np.array(SIZE) / 2 + rng.normal(0, 8, 2), stretch)


@given(seed=seeds)
def test_rays_and_pixels_of_a_pinhole_camera_are_inverse(seed: int) -> None:
    """A point anywhere along a pixel's ray is seen in that pixel, through any lens."""
    rng = np.random.default_rng(seed)
    camera = pinhole_of(rng)
    pixels = rng.uniform(0, SIZE, (20, 2))
    rays = camera.rays(pixels)
    visible = np.isfinite(rays).all(axis=1)
    seen, depth = camera.project(camera.position + rng.uniform(1, 30, (20, 1)) * rays)
    np.testing.assert_allclose(seen[visible], pixels[visible], atol=1e-4)
    assert (depth[visible] > 0).all()
    assert visible[np.linalg.norm(pixels - camera.principal_point, axis=1) < 100].all()


@given(seed=seeds, depth=st.sampled_from([0.0, -0.0, -1e-9, -1.0, -40.0]))
def test_nothing_beside_or_behind_a_camera_has_a_pixel(seed: int, depth: float) -> None:
    """A point in the plane of the optical centre, or behind it, has no place in the picture."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.normal(0, 3, (9, 2)), np.full(9, depth)])
    points[0, :2] = 0
    assert np.isnan(pinhole_of(rng, bent=seed % 2 == 0).project_local(points)).all()


@given(seed=seeds)
def test_the_matrix_of_a_camera_is_what_it_projects(seed: int) -> None:
    """The projection matrix gives the pixels and depths of the ideal lens, and the camera again."""
    rng = np.random.default_rng(seed)
    camera = pinhole_of(rng, bent=False)
    points = camera.position + rng.uniform(1, 30, (8, 1)) * camera.rays(rng.uniform(0, SIZE, (8, 2)))
    homogeneous = np.column_stack([points, np.ones(8)]) @ camera.matrix.T
    pixels, depth = camera.project(points)
    np.testing.assert_allclose(homogeneous[:, :2] / homogeneous[:, 2:], pixels)
    np.testing.assert_allclose(homogeneous[:, 2], depth)
    back = decompose(3 * camera.matrix, *SIZE)
    for name in ("focal", "principal_point", "rotation", "position"):
        np.testing.assert_allclose(getattr(back, name), getattr(camera, name), atol=1e-6)


@given(seed=seeds, terms=st.sampled_from([5, 8, 12]))
def test_distortion_and_its_undoing_are_inverse(seed: int, terms: int) -> None:
    """Within the radius that the coefficients describe, points bent by a lens and straightened are where they were."""
    rng = np.random.default_rng(seed)
    lens = rng.normal(0, 0.05, 12)[:terms]
    lens[2:4] *= 0.05
    lens[8:] *= 0.02
    radius = 0.6 * min(largest_radius(lens), 1.0)
    points = rng.uniform(-radius, radius, (20, 2)) / np.sqrt(2)
    np.testing.assert_allclose(undistort(distort(points, lens), lens), points, atol=1e-7)


@given(seed=seeds, height=st.floats(-1, 1.9))
def test_the_ground_below_a_pixel_is_seen_in_it(seed: int, height: float) -> None:
    """Where a pixel's ray meets a level, the camera sees that point in the pixel; above the horizon there is none."""
    rng = np.random.default_rng(seed)
    camera = pinhole_of(rng, bent=False)
    pixels = rng.uniform(0, SIZE, (20, 2))
    ground, rays = camera.ground(pixels, height), camera.rays(pixels)
    below = rays[:, 2] < 0
    np.testing.assert_array_equal(np.isfinite(ground).all(axis=1), below)
    np.testing.assert_allclose(ground[below, 2], height, atol=1e-6)
    np.testing.assert_allclose(camera.project(ground[below])[0], pixels[below], atol=1e-3)


@given(seed=seeds)
def test_rays_and_pixels_of_a_fisheye_are_inverse(seed: int) -> None:
    """A point along the ray of any pixel within the rim is seen in that pixel; beyond there is no ray."""
    rng = np.random.default_rng(seed)
    lens = fisheye_of(rng)
    camera = pose_at(OmnidirectionalCamera(lens, np.eye(3), np.zeros(3)), 3.0, *rng.uniform(-0.5, 0.5, 2))
    pixels = rng.uniform(-50, np.array(SIZE) + 50, (40, 2))
    rays, within = camera.rays(pixels), lens.within_rim(pixels)
    np.testing.assert_array_equal(np.isfinite(rays).all(axis=1), within)
    np.testing.assert_allclose(np.linalg.norm(rays[within], axis=1), 1)
    seen, distance = camera.project(camera.position + 7 * rays[within])
    np.testing.assert_allclose(seen, pixels[within], atol=1e-5)
    np.testing.assert_allclose(distance, 7)


@given(seed=seeds, scale=st.floats(0.5, 3))
def test_a_larger_picture_of_a_fisheye_shows_the_same_rays(seed: int, scale: float) -> None:
    """The lens over a picture of another size sees along a pixel what it saw along that pixel before."""
    rng = np.random.default_rng(seed)
    lens = fisheye_of(rng)
    size = np.rint(np.array(SIZE) * scale).astype(int)
    larger, factor = lens.resized(*size.tolist()), (size / SIZE).max()
    pixels = lens.centre + rng.uniform(-60, 60, (10, 2))
    moved = (pixels - np.array(SIZE) / 2) * factor + size / 2
    np.testing.assert_allclose(larger.rays(moved), lens.rays(pixels), atol=1e-9)


@given(seed=seeds)
def test_views_around_a_ceiling_camera_invert_their_projection(seed: int) -> None:
    """In the cylinder and in the view down, a point along the ray of a pixel is seen in that pixel."""
    rng = np.random.default_rng(seed)
    position, turn = rng.normal(0, 3, 3), rng.uniform(-np.pi, np.pi)
    pixels = rng.uniform(1, SIZE, (20, 2))
    for view in (CylinderView(position, turn, rng.uniform(110, 300), 15.0, *SIZE),
                 DownwardView(position, turn, rng.uniform(100, 500), *SIZE)):  # fmt: skip
        seen, distance = view.project(position + rng.uniform(1, 9, (20, 1)) * view.rays(pixels))
        np.testing.assert_allclose(seen, pixels, atol=1e-6)
        assert (distance > 0).all()


@given(seed=seeds)
def test_a_camera_calibrated_from_its_own_points_is_itself(seed: int) -> None:
    """Points of the world and their exact pixels give back the camera."""
    rng = np.random.default_rng(seed)
    camera = pinhole_of(rng, bent=False)
    points = camera.position + rng.uniform(4, 30, (14, 1)) * camera.rays(rng.uniform(0, SIZE, (14, 2)))
    back = calibrate_camera(points, camera.project(points)[0], *SIZE).camera
    np.testing.assert_allclose(back.position, camera.position, atol=1e-3)
    np.testing.assert_allclose(back.rotation, camera.rotation, atol=1e-4)
    np.testing.assert_allclose(back.focal, camera.focal, rtol=1e-3)


@given(seed=seeds)
def test_a_camera_over_a_floor_is_located_by_its_homography(seed: int) -> None:
    """Four or more points of the floor and their pixels give the camera's place and direction."""
    rng = np.random.default_rng(seed)
    camera = pinhole_of(rng, bent=False)
    floor = camera.ground(rng.uniform([60, 300], [580, 470], (9, 2)))[:, :2]
    if np.isfinite(floor).all():
        pixels = camera.project(np.column_stack([floor, np.zeros(9)]))[0]
        back, errors, _ = locate_over_floor(replace(camera, rotation=np.eye(3), position=np.zeros(3)), pixels, floor)
        np.testing.assert_allclose(back.position, camera.position, atol=0.01)
        np.testing.assert_allclose(back.rotation, camera.rotation, atol=1e-3)
        assert np.max(errors) < 0.1


@given(seed=seeds, count=st.integers(2, 4))
def test_cameras_that_see_a_point_find_it(seed: int, count: int) -> None:
    """Exact pixels of a point in two or more cameras give the point, in whatever order the cameras are."""
    rng = np.random.default_rng(seed)
    point = rng.uniform([-1, -1, 0], [1, 1, 2])
    angles = 2 * np.pi * np.arange(count) / (count + 0.5) + rng.uniform(0, 6)
    places = np.column_stack([6 * np.cos(angles), 6 * np.sin(angles), rng.uniform(2, 4, count)])
    cameras = [PinholeCamera.look_at(place, point + rng.normal(0, 0.2, 3), 500, *SIZE) for place in places]
    pixels = np.stack([camera.project(point[None])[0][0] for camera in cameras])
    for order in (np.arange(count), np.arange(count)[::-1]):
        points, _ = triangulate([cameras[k] for k in order], pixels[None, order], 1.0)
        np.testing.assert_allclose(points[0], point, atol=1e-4)


def turned(camera: PinholeCamera, turn: FloatArray) -> PinholeCamera:
    """The camera with the whole world turned about its z axis."""
    return replace(camera, rotation=camera.rotation @ turn.T, position=turn @ camera.position)


@given(seed=seeds, angle=st.floats(-3, 3))
def test_a_turned_world_looks_the_same(seed: int, angle: float) -> None:
    """A camera and points that turn and move together have the same pixels."""
    rng = np.random.default_rng(seed)
    camera = pinhole_of(rng)
    points = camera.position + rng.uniform(1, 9, (8, 1)) * camera.rays(rng.uniform(100, 300, (8, 2)))
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    np.testing.assert_allclose(turned(camera, turn).project(points @ turn.T)[0], camera.project(points)[0], atol=1e-6)
    assert pytest.approx(1) == np.linalg.det(turned(camera, turn).rotation)
