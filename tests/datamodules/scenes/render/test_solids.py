from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.render.solids import Solids, Surface, boxes, cone_spheres
from tsuiseki.datamodules.scenes.render.tracing import extents, inner_normals, intersect, silhouette_box, trace
from tsuiseki.tracking.cameras.projective import PinholeCamera

CAMERA = PinholeCamera.look_at(np.array([0, -10, 1.0]), np.array([0, 0, 1.0]), 300, 160, 120)


def one_cone(start: list[float], end: list[float], radii: tuple[float, float], flat: float = 1.0) -> Solids:
    surfaces = [Surface((0.5, 0.5, 0.5))]
    return cone_spheres(
        np.array([start]), np.array([end]), np.array([radii]), np.array([[0.0, 1, 0]]), np.array([flat]), surfaces
    )


def test_silhouette_of_a_sphere() -> None:
    # The tangent cone of a sphere of radius r at distance d meets the image in a circle of f r / sqrt(d^2 - r^2).
    layer = trace(one_cone([0, 0, 1], [0, 0, 1], (1.2, 1.2)), CAMERA, 4)
    assert layer is not None
    radius = 300 * 1.2 / np.sqrt(10**2 - 1.2**2)
    box = silhouette_box(layer, 4)
    # A subpixel is a quarter of a pixel, and each side of the box ends on one.
    np.testing.assert_allclose(box, [80 - radius, 60 - radius, 80 + radius, 60 + radius], atol=0.25)
    assert layer.mask.sum() / 16 == pytest.approx(np.pi * radius**2, rel=0.01)
    assert layer.distance.min() == pytest.approx(10 - 1.2, abs=1e-3)


def test_flattened_sphere_is_as_flat_as_asked() -> None:
    camera = PinholeCamera.look_at(np.array([-10, 0, 1.0]), np.array([0, 0, 1.0]), 300, 160, 120)
    layer = trace(one_cone([0, 0, 1], [0, 0, 1], (1.0, 1.0), 0.5), camera, 4)
    assert layer is not None
    x1, y1, x2, y2 = silhouette_box(layer, 4)
    # Seen along x, the y axis that was halved runs across the image.
    assert (x2 - x1) / (y2 - y1) == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("radii", [(0.5, 0.5), (0.9, 0.2), (0.1, 0.8), (1.4, 0.5)])
def test_cone_sphere_is_the_hull_of_its_spheres(radii: tuple[float, float]) -> None:
    # The hull of two spheres is the union of all spheres between them: 4,000 of these leave gaps below 1e-5.
    rng = np.random.default_rng(0)
    length, part = 1.0, np.linspace(0, 1, 4000)[:, None]
    centres, sizes = part * [[0, 0, length]], radii[0] + part[:, 0] * (radii[1] - radii[0])
    for origin in ([3.0, 0.4, 0.3], [0.2, 0.1, 4.0], [0.1, -0.3, -5.0], [2.0, 2.0, 2.5]):
        aim = rng.normal([0, 0, 0.5], 0.9, (300, 3)) - origin
        away = np.array(origin) - centres
        a = np.einsum("ij,ij->i", aim, aim)[:, None]
        b, c = aim @ away.T, np.einsum("ij,ij->i", away, away) - sizes**2
        inner = b**2 - a * c
        with np.errstate(invalid="ignore"):
            expected = np.where(inner >= 0, (-b - np.sqrt(inner)) / a, np.inf).min(axis=1)
        found = intersect(aim.T.astype(np.float32), np.array(origin, dtype=np.float32), length, radii)
        # Grazing rays amplify the rounding of float32, so leave those out that nearly miss.
        clear = np.abs(inner.max(axis=1)) > 1e-2 * a[:, 0]
        np.testing.assert_array_equal(np.isfinite(found)[clear], np.isfinite(expected)[clear])
        hit = clear & np.isfinite(expected)
        assert hit.sum() > 30
        np.testing.assert_allclose(found[hit], expected[hit], rtol=2e-4)


def test_normals_point_away_from_the_axis_by_the_slope() -> None:
    solids = one_cone([0, 0, 0], [0, 0, 2], (0.8, 0.4))
    slope = 0.4 / 2
    # A point where the cone touches the sphere with radius 0.6 half-way up.
    lateral = np.array([[0.6 * np.sqrt(1 - slope**2)], [0], [1 + 0.6 * slope]], dtype=np.float32)
    normal = inner_normals(lateral, solids, 0)[:, 0]
    np.testing.assert_allclose(normal / np.linalg.norm(normal), [np.sqrt(1 - slope**2), 0, slope], atol=1e-5)
    top = inner_normals(np.array([[0], [0], [2.4]], dtype=np.float32), solids, 0)[:, 0]
    np.testing.assert_allclose(top / np.linalg.norm(top), [0, 0, 1], atol=1e-6)


def test_sphere_within_the_other_leaves_the_larger() -> None:
    inside = trace(one_cone([0, 0, 1], [0, 0, 1.1], (0.3, 1.0)), CAMERA, 2)
    alone = trace(one_cone([0, 0, 1.1], [0, 0, 1.1], (1.0, 1.0)), CAMERA, 2)
    assert inside is not None
    assert alone is not None
    np.testing.assert_array_equal(silhouette_box(inside, 2), silhouette_box(alone, 2))


def test_box_silhouette_is_the_hull_of_its_corners() -> None:
    surfaces = [Surface((0.5, 0.5, 0.5))]
    solids = boxes(np.array([[0.2, 0, 1.0]]), np.array([[0.8, 0.5, 0.6]]), np.array([0.5]), surfaces)
    layer = trace(solids, CAMERA, 4)
    assert layer is not None
    c, s = np.cos(0.5), np.sin(0.5)
    corners = [
        [0.2 + c * x - s * y, s * x + c * y, 1 + z] for x in (-0.8, 0.8) for y in (-0.5, 0.5) for z in (-0.6, 0.6)
    ]
    pixels, _ = CAMERA.project(np.array(corners))
    expected = [*pixels.min(axis=0), *pixels.max(axis=0)]
    np.testing.assert_allclose(silhouette_box(layer, 4), expected, atol=0.3)


def test_extents_hold_the_silhouette() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        start = rng.uniform([-1, -2, 0], [1, 2, 2])
        solids = one_cone(start.tolist(), (start + rng.normal(0, 0.5, 3)).tolist(), (0.3, 0.15), rng.uniform(0.5, 1.2))
        layer = trace(solids, CAMERA, 2)
        assert layer is not None
        box, rect = silhouette_box(layer, 2), extents(solids, CAMERA)[0]
        assert (rect[:2] <= box[:2]).all()
        assert (rect[2:] >= box[2:]).all()


def test_behind_the_camera_nothing_is_seen() -> None:
    assert trace(one_cone([0, -15, 1], [0, -15, 2], (0.3, 0.3)), CAMERA, 2) is None
