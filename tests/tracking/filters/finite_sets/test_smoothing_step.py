"""One step back: against Bayes' rule, and against the smoother of Rauch, Tung and Striebel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.filters.finite_sets.births import MixtureBirths
from tsuiseki.tracking.filters.finite_sets.labelled_multi_bernoulli import (
    LabelledMultiBernoulliFilter,
    LabelledState,
    SmoothingStep,
    TrackParticles,
)
from tsuiseki.tracking.filters.finite_sets.point_model import GaussianSensor, PointModel, cartesian
from tsuiseki.tracking.filters.point_motion import constant_velocity
from tsuiseki.tracking.types import FloatArray

SENSOR = GaussianSensor(cartesian, np.array([10.0, 10.0]))

NO_BIRTHS = MixtureBirths(np.empty(0), np.empty((0, 4)), np.ones(4))


def one_track(existence: float, particles: FloatArray, chosen: LabelledMultiBernoulliFilter) -> LabelledState:
    count = len(particles)
    empty = chosen.init(np.empty((0, 4)))
    return LabelledState(
        np.array([1]), np.array([existence]), particles[None], np.full((1, count), -np.log(count)), empty.hidden, 2,
        np.array([True]),
    )  # fmt: skip


def model(detection: float, survival: float, clutter: float = 0.0) -> PointModel:
    return PointModel(constant_velocity(1.0), SENSOR, survival, detection, clutter)


@pytest.mark.parametrize(("r", "survival", "detection"), [(0.9, 0.95, 0.8), (0.4, 0.5, 0.9), (1.0, 0.9, 0.6)])
def test_after_a_miss_existence_is_that_of_bayes(r: float, survival: float, detection: float) -> None:
    chosen = LabelledMultiBernoulliFilter(model(detection, survival), NO_BIRTHS, 50)
    state = one_track(r, np.zeros((50, 4)), chosen)
    _, info = chosen.step(state, np.empty((0, 2)), np.random.default_rng(0))
    # Nothing measured: there and gone on but missed, there and ended, or never there.
    missed, ended, never = r * survival * (1 - detection), r * (1 - survival), 1 - r
    smoothed = info.smoothing_step.smoothed()
    assert smoothed.existence[0] == pytest.approx((missed + ended) / (missed + ended + never))
    np.testing.assert_allclose(np.exp(smoothed.log_weights).sum(axis=1), 1.0)


def test_a_measurement_makes_the_track_before_it_certain() -> None:
    chosen = LabelledMultiBernoulliFilter(model(0.9, 0.9), NO_BIRTHS, 200)
    particles = 5 * np.random.default_rng(1).standard_normal((200, 4))
    _, info = chosen.step(one_track(0.3, particles, chosen), np.array([[2.0, 1.0]]), np.random.default_rng(0))
    smoothed = info.smoothing_step.smoothed()
    assert smoothed.existence[0] == pytest.approx(1.0)
    assert smoothed.likely(0.5).ids.tolist() == [1]
    assert len(smoothed.likely(1.0)) == 0


def test_the_smoothed_mean_is_that_of_the_rauch_tung_striebel_smoother() -> None:
    rng, count = np.random.default_rng(0), 40_000
    chosen = LabelledMultiBernoulliFilter(model(1.0, 1.0), NO_BIRTHS, count)
    mean, covariance = np.array([0.0, 5.0, 0.0, -2.0]), np.diag([64.0, 9.0, 64.0, 9.0])
    particles = mean + rng.standard_normal((count, 4)) * np.sqrt(np.diag(covariance))
    found = np.array([14.0, -9.0])
    _, info = chosen.step(one_track(1.0, particles, chosen), found[None], rng)
    transition = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])
    push = np.kron(np.eye(2), [[0.5], [1.0]])
    seen = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0]])
    predicted = transition @ covariance @ transition.T + push @ push.T
    spread = seen @ predicted @ seen.T + 100 * np.eye(2)
    gain = covariance @ transition.T @ seen.T @ np.linalg.inv(spread)
    expected = mean + gain @ (found - seen @ transition @ mean)
    smoothed = info.smoothing_step.smoothed()
    # Five standard errors of as many particles, whose weights are uneven by less than a half.
    tolerance = 5 * np.sqrt(np.diag(covariance) / (0.5 * count))
    assert np.all(np.abs(smoothed.likely(0.5).states[0] - expected) < tolerance)


def test_particles_that_leave_are_where_a_target_ended() -> None:
    # Two particles: the second left for certain. Nothing was measured, though what is there is always measured.
    before = TrackParticles(np.array([1]), np.array([0.8]), np.zeros((1, 2, 4)), np.log(np.array([[0.5, 0.5]])))
    with np.errstate(divide="ignore"):
        predicted = replace(before, existence=np.array([0.4]), log_weights=np.log(np.array([[1.0, 0.0]])))
    smoothed = SmoothingStep(before, predicted, replace(before, existence=np.zeros(1))).smoothed()
    np.testing.assert_allclose(np.exp(smoothed.log_weights), [[0.0, 1.0]], atol=1e-12)
    assert smoothed.existence[0] == pytest.approx(0.4 / (0.4 + 0.2))
