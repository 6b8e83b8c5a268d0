"""Optical flow against pairs whose flow is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from benchmarks.drone.flow_pairs import FlowPair, end_point_error
from tsuiseki.tracking.features.optical_flow import (
    ATTACHMENT,
    FLOW_METHODS,
    TIGHTNESS,
    _gradient,
    _Level,
    dis_flow,
    optical_flow,
    tv_l1,
)


@pytest.fixture(scope="module")
def pair():
    return FlowPair(np.random.default_rng(5), (224, 160), motion=6, people=2)


@pytest.mark.parametrize("name", FLOW_METHODS)
def test_every_method_finds_the_flow(pair, name):
    still = float(np.linalg.norm(pair.flow, axis=2)[pair.inside].mean())
    assert end_point_error(optical_flow(pair.first, pair.second, FLOW_METHODS[name]), pair) < 0.25 * still


def test_tv_l1_is_finer_than_what_it_starts_from(pair):
    start = optical_flow(pair.first, pair.second, dis_flow)
    refined = optical_flow(pair.first, pair.second, lambda a, b: tv_l1(a, b, start=start))
    assert end_point_error(refined, pair) < end_point_error(start, pair)


def test_a_shift_by_whole_pixels_is_found_to_a_fiftieth():
    rng = np.random.default_rng(1)
    pair = FlowPair(rng, (160, 120), motion=0, people=0, noise=0)
    shifted = np.roll(pair.first, (2, -3), axis=(0, 1))
    flow = optical_flow(pair.first, shifted, tv_l1)[20:-20, 20:-20]
    np.testing.assert_allclose(flow.reshape(-1, 2).mean(axis=0), [-3, 2], atol=0.02)


def test_slopes_are_exact_for_polynomials_of_degree_four():
    x, y = np.meshgrid(np.arange(12.0), np.arange(9.0))
    image = 1e-3 * (x**4 - 5 * x**2 * y + y**3)
    expected = 1e-3 * np.stack([4 * x**3 - 10 * x * y, -5 * x**2 + 3 * y**2])
    np.testing.assert_allclose(
        _gradient(image.astype(np.float32))[:, 2:-2, 2:-2], expected[:, 2:-2, 2:-2], rtol=1e-4, atol=1e-4
    )


def test_the_auxiliary_flow_minimises_its_pointwise_energy(pair):
    """No flow nearby has a smaller (u - v)^2 / 2 theta + lambda |rho(v)|."""
    rng = np.random.default_rng(3)
    first, second = (
        cv2.cvtColor(i[:24, :32], cv2.COLOR_RGB2GRAY).astype(np.float32) for i in (pair.first, pair.second)
    )
    level = _Level(first, second)
    constant, inverse = level._warp(rng.normal(0, 1, (2, 24, 32)).astype(np.float32))
    flow = rng.normal(0, 2, (2, 24, 32)).astype(np.float32)
    level._threshold(flow, constant, inverse)

    def energy(v):
        residual = constant + (level.slope * v).sum(axis=0)
        return ((flow - v) ** 2).sum(axis=0) / (2 * TIGHTNESS) + ATTACHMENT * np.abs(residual)

    least = energy(level.auxiliary)
    for _ in range(200):
        elsewhere = level.auxiliary + rng.normal(0, 10 ** rng.uniform(-3, 1), (2, 24, 32)).astype(np.float32)
        # Energies reach some hundreds; float32 keeps seven digits of them.
        assert (energy(elsewhere) >= least - 1e-4 * (1 + least)).all()


def test_the_dual_comes_to_the_denoised_flow():
    """Total variation moves each side of a step by theta over its length (Strong and Chan 2003)."""
    theta, length = TIGHTNESS, 20
    level = _Level(*(np.zeros((3, 2 * length), dtype=np.float32),) * 2)
    step = np.zeros((2, 3, 2 * length), dtype=np.float32)
    step[:, :, length:] = 1
    level.auxiliary[:] = step
    flow = step.copy()
    for _ in range(4000):
        level._smooth(flow)
    np.testing.assert_allclose(flow[:, :, :length], theta / length, atol=1e-3)
    np.testing.assert_allclose(flow[:, :, length:], 1 - theta / length, atol=1e-3)


def test_equal_images_do_not_move(pair):
    for method in (tv_l1, dis_flow):
        assert np.abs(optical_flow(pair.first, pair.first, method)).max() < 0.05
    # Farneback's windows run into the border.
    assert np.abs(optical_flow(pair.first, pair.first, FLOW_METHODS["farneback"])).max() < 0.3


def test_small_images_have_a_flow_and_unlike_ones_are_refused(pair):
    for method in FLOW_METHODS.values():
        flow = optical_flow(pair.first[:2, :3], pair.second[:2, :3], method)
        assert flow.shape == (2, 3, 2)
        assert np.isfinite(flow).all()
    with pytest.raises(ValueError, match="expected two images of one shape"):
        optical_flow(pair.first, pair.second[:-1])
