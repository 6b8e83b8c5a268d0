from __future__ import annotations

import numpy as np

from tsuiseki.datamodules.scenes.figures.mesh import nearest, rasterise


def test_pixels_are_those_whose_centres_lie_in_the_triangle() -> None:
    rng = np.random.default_rng(0)
    corners = rng.uniform(-4, 24, (40, 3, 2))
    found = rasterise(corners, np.ones((40, 3)), 20, 16)
    for n, (a, b, c) in enumerate(corners):
        rows, columns = np.mgrid[:16, :20]
        x, y = columns + 0.5, rows + 0.5
        sides = [(q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) for p, q in ((a, b), (b, c), (c, a))]
        inside = np.all([s > 0 for s in sides], axis=0) | np.all([s < 0 for s in sides], axis=0)
        mine = np.zeros((16, 20), dtype=np.bool_)
        mine.ravel()[found.pixel[found.triangle == n]] = True
        np.testing.assert_array_equal(mine, inside)


def test_coordinates_on_a_slanted_triangle_are_right_in_space() -> None:
    """A pinhole of focal length 10: the mix of the corners is the point that the pixel shows."""
    points = np.array([[-1.0, -1.0, 2.0], [3.0, -1.0, 6.0], [-1.0, 2.0, 3.0]])
    pixels = 10 * points[:, :2] / points[:, 2:] + 8
    found = rasterise(pixels[None], points[None, :, 2], 16, 16)
    assert len(found.pixel) > 20
    in_space = found.where @ points
    rows, columns = np.divmod(found.pixel, 16)
    np.testing.assert_allclose(10 * in_space[:, 0] / in_space[:, 2] + 8, columns + 0.5, atol=1e-9)
    np.testing.assert_allclose(10 * in_space[:, 1] / in_space[:, 2] + 8, rows + 0.5, atol=1e-9)
    np.testing.assert_allclose(found.depth, in_space[:, 2], atol=1e-9)


def test_the_nearer_triangle_hides_the_farther() -> None:
    square = np.array([[[0, 0], [8, 0], [0, 8]], [[0, 0], [8, 0], [0, 8]]], dtype=np.float64)
    seen = nearest(rasterise(square, np.array([[5.0] * 3, [2.0] * 3]), 8, 8))
    assert len(seen.pixel) > 20
    assert set(seen.triangle) == {1}
    assert len(np.unique(seen.pixel)) == len(seen.pixel)


def test_triangles_behind_the_camera_or_beside_the_picture_are_left_out() -> None:
    corners = np.array([[[0, 0], [8, 0], [0, 8]], [[20, 20], [30, 20], [20, 30]]], dtype=np.float64)
    assert len(rasterise(corners, np.array([[1.0, -1.0, 1.0], [1.0, 1.0, 1.0]]), 8, 8).pixel) == 0
