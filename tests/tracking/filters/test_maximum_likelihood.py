"""Settings by maximum likelihood: against the closed form of a linear model, with and without particles."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from tsuiseki.tracking.filters.base import bootstrap
from tsuiseki.tracking.filters.kalman import Gaussians, predict, update
from tsuiseki.tracking.filters.maximum_likelihood import Range, fit_settings
from tsuiseki.tracking.filters.particle_filter import ParticleFilter
from tsuiseki.tracking.filters.point_motion import PlaneWalk
from tsuiseki.tracking.types import FloatArray

STEP, ERROR = 2.0, 2.0
RANGES = {"step": Range(3.0, 0.05, 50.0), "error": Range(1.0, 0.05, 50.0)}


def walk(seed: int, steps: int = 150) -> FloatArray:
    """Measurements ``(T,)`` of a random walk."""
    rng = np.random.default_rng(seed)
    return np.asarray(np.cumsum(STEP * rng.standard_normal(steps)) + ERROR * rng.standard_normal(steps))


def kalman_evidence(measured: FloatArray, settings: Mapping[str, float]) -> float:
    """Logarithm of (11) in closed form."""
    one, error = np.eye(1), settings["error"] ** 2
    state, total = Gaussians(np.zeros((1, 1)), np.zeros((1, 1, 1))), 0.0
    for value in measured:
        state = predict(state, one, settings["step"] ** 2 * one)
        variance = float(state.covariance[0, 0, 0]) + error
        total -= 0.5 * ((value - float(state.mean[0, 0])) ** 2 / variance + np.log(2 * np.pi * variance))
        state = update(state, np.array([[value]]), one, error * one)
    return total


def particle_evidence(measured: FloatArray, settings: Mapping[str, float], count: int = 500) -> float:
    """The same by particles with common random numbers."""
    error = settings["error"]

    def log_likelihood(particles: FloatArray, observation: float) -> FloatArray:
        return np.asarray(-0.5 * ((particles[:, 0] - observation) / error) ** 2 - np.log(np.sqrt(2 * np.pi) * error))

    chosen = ParticleFilter[float](bootstrap(PlaneWalk(np.array([settings["step"]]))), log_likelihood)
    state, total, rng = chosen.init(np.zeros((count, 1))), 0.0, np.random.default_rng(0)
    for value in measured.tolist():
        state, info = chosen.step(state, value, rng)
        total += info.log_evidence
    return total


def profile_interval(measured: FloatArray, name: str, other: str) -> FloatArray:
    """The maximum and the ends of the 95 % interval of the exact profile."""

    def lowered(scaled: float) -> float:
        def of_other(x: float) -> float:
            return -kalman_evidence(measured, {name: float(np.exp(scaled)), other: float(np.exp(x))})

        return float(minimize_scalar(of_other, bounds=(-4, 4), method="bounded").fun)

    top = minimize_scalar(lowered, bounds=(-3, 3), method="bounded")
    ends = [brentq(lambda x: lowered(x) - top.fun - 1.92, top.x, top.x + way) for way in (-3, 3)]
    return np.exp([top.x, *ends])


@pytest.mark.slow
def test_the_maximum_and_its_profile_are_those_of_the_kalman_filter() -> None:
    measured = walk(0)
    fitted = fit_settings(lambda settings: kalman_evidence(measured, settings), RANGES)
    for name, other in (("step", "error"), ("error", "step")):
        exact = profile_interval(measured, name, other)
        found = np.array([fitted[name].value, fitted[name].low, fitted[name].high])
        # A quadratic surface stands for one that is none: within a fifth of the interval.
        np.testing.assert_allclose(np.log(found), np.log(exact), atol=0.2 * float(np.log(exact[2] / exact[1])))


def test_particles_have_the_evidence_of_the_kalman_filter() -> None:
    measured, settings = walk(1), {"step": STEP, "error": ERROR}
    assert particle_evidence(measured, settings, 5000) == pytest.approx(kalman_evidence(measured, settings), abs=1.0)


@pytest.mark.slow
def test_settings_of_a_simulated_recording_lie_in_their_intervals() -> None:
    measured = walk(0)
    fitted = fit_settings(lambda settings: particle_evidence(measured, settings), RANGES)
    assert fitted["step"].low < STEP < fitted["step"].high
    assert fitted["error"].low < ERROR < fitted["error"].high
    for setting in fitted.values():
        assert setting.high < 4 * setting.low


def test_a_setting_that_changes_nothing_has_the_whole_range_as_interval() -> None:
    fitted = fit_settings(lambda settings: -(np.log(settings["error"]) ** 2), RANGES)
    assert (fitted["step"].low, fitted["step"].high) == pytest.approx((0.05, 50.0))
    assert fitted["error"].value == pytest.approx(1.0, abs=0.01)


def test_the_same_seed_gives_the_same_settings_and_bounds_hold() -> None:
    def falling(settings: Mapping[str, float]) -> float:
        assert 0.1 <= settings["p"] <= 0.9
        return -5.0 * settings["p"]

    ranges = {"p": Range(0.5, 0.1, 0.9, probability=True)}
    first, second = (fit_settings(falling, ranges, seed=3)["p"] for _ in range(2))
    assert first == second
    assert first.low == pytest.approx(0.1)
    assert first.value < 0.2
