"""Views about the vertical through a camera: everybody upright, rays and pixels each other's inverse."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.cameras.panorama import CylinderView, DownwardView

POSITION = np.array([1.0, -2.0, 3.0])
CYLINDER = CylinderView(POSITION, 0.7, 100.0, 10.0, 500, 300)
DOWN = DownwardView(POSITION, 0.4, 150.0, 300, 200)


@pytest.mark.parametrize("view", [CYLINDER, DOWN])
def test_a_ray_leads_back_to_its_pixel(view):
    rng = np.random.default_rng(0)
    pixels = rng.uniform(5, [view.width - 5, view.height - 5], (200, 2))
    rays = view.rays(pixels)
    assert np.allclose(np.linalg.norm(rays, axis=1), 1)
    again, depth = view.project(view.position + 4 * rays)
    assert np.allclose(again, pixels, atol=1e-9)
    assert (depth > 0).all()
    assert view.rays(pixels.astype(np.float32)).dtype == np.float32


def test_people_stand_upright_on_a_cylinder_and_shrink_with_their_distance():
    for azimuth in (0.0, 1.5, -1.2):
        for distance in (0.8, 2.0, 6.0):
            foot = POSITION * [1, 1, 0] + distance * np.array([np.cos(azimuth), np.sin(azimuth), 0])
            pixels, depth = CYLINDER.project(np.array([foot, foot + np.array([0, 0, 1.7])]))
            assert np.isclose(pixels[0, 0], pixels[1, 0])
            assert np.isclose(pixels[0, 1] - pixels[1, 1], 100 * 1.7 / distance)
            assert np.allclose(depth, distance)


def test_what_lies_behind_the_seam_is_not_seen():
    behind = POSITION + 2 * np.array([[np.cos(0.7 + np.pi), np.sin(0.7 + np.pi), 0]])
    assert CYLINDER.project(behind)[1][0] < 0


def test_right_and_left_are_those_of_somebody_who_looks_from_the_camera():
    ahead = np.array([np.cos(0.7), np.sin(0.7)])
    right = POSITION + np.array([*(ahead + 0.1 * np.array([ahead[1], -ahead[0]])), -1.0])
    assert CYLINDER.project(right[None])[0][0, 0] > CYLINDER.width / 2
    upward = np.array([np.cos(0.4), np.sin(0.4)])
    middle = np.array([DOWN.width, DOWN.height]) / 2

    def below(direction):
        return DOWN.project((POSITION + np.array([*direction, -3.0]))[None])[0][0]

    assert np.allclose(below(upward), middle - np.array([0, 50]))
    aside = np.array([upward[1], -upward[0]])
    assert np.allclose(below(aside), middle + np.array([50, 0]))
