"""Filters of several targets: weights by their equations, and no meaning in the order of measurements."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.properties.drawn import matchings, seeds
from tsuiseki.tracking.filters.base import BornParticles, TargetEstimates
from tsuiseki.tracking.filters.finite_sets.births import MixtureBirths
from tsuiseki.tracking.filters.finite_sets.labelled_multi_bernoulli import LabelledMultiBernoulliFilter, LabelledState
from tsuiseki.tracking.filters.finite_sets.phd import PhdFilter
from tsuiseki.tracking.filters.finite_sets.point_model import (
    GaussianSensor,
    PointModel,
    bearing_range,
    cartesian,
    from_bearing_range,
    polar_sensor,
)
from tsuiseki.tracking.filters.point_motion import constant_velocity
from tsuiseki.tracking.types import FloatArray

SENSOR = GaussianSensor(cartesian, np.array([3.0, 5.0]))
NO_BIRTHS = MixtureBirths(np.empty(0), np.empty((0, 4)), np.ones(4))
PLACES = MixtureBirths(np.full(2, 0.1), np.array([[0.0, 0, 0, 0], [40, 0, 40, 0]]), np.full(4, 3.0), 60)
CLUTTER = 1e-4
few = st.integers(0, 4)


def still(states: FloatArray, _seconds: float, _rng: np.random.Generator) -> FloatArray:
    """A motion of what stands still."""
    return states


def model(detection: float = 0.9, survival: float = 0.95, moving: bool = False) -> PointModel:
    return PointModel(constant_velocity(0.3) if moving else still, SENSOR, survival, detection, CLUTTER)


def states_about(rng: np.random.Generator, count: int) -> FloatArray:
    return rng.normal([10, 0, 20, 0], [4, 1, 4, 1], (count, 4))


def density(states: FloatArray, measurement: FloatArray) -> FloatArray:
    """``(N,)`` of a measurement, given each state."""
    away = (cartesian(states) - measurement) / SENSOR.deviation
    return np.exp(-0.5 * np.square(away).sum(axis=1)) / (2 * np.pi * SENSOR.deviation.prod())


def ordered(estimates: TargetEstimates) -> list[list[float]]:
    """Weights and states of what is reported, in an order that does not depend on names."""
    return sorted(np.column_stack([estimates.weights, estimates.states]).round(5).tolist())


@given(seed=seeds, count=few, mass=st.floats(0.2, 3), detection=st.floats(0.3, 1))
def test_weights_of_the_phd_are_those_of_its_equation(seed: int, count: int, mass: float, detection: float) -> None:
    """A particle's weight is what it has undetected and its share of each measurement, clutter among the claimants."""
    rng = np.random.default_rng(seed)
    particles, measurements = states_about(rng, 50), rng.normal([10, 20], 4, (count, 2))
    chosen = PhdFilter(model(detection), NO_BIRTHS)
    _, info = chosen.step(chosen.init(particles, mass), measurements, rng)
    weights = np.full(50, 0.95 * mass / 50)
    expected = (1 - detection) * weights
    for measurement in measurements:
        joint = detection * weights * density(particles, measurement)
        expected = expected + joint / (CLUTTER + joint.sum())
    places = {tuple(state): weight for state, weight in zip(particles.tolist(), expected.tolist(), strict=True)}
    posterior = info.posterior
    reported = [places[tuple(state)] for state in posterior.particles.tolist()]
    np.testing.assert_allclose(np.exp(posterior.log_weights), reported, atol=1e-12)
    assert info.expected_count == pytest.approx(expected.sum())
    assert info.expected_count <= count + (1 - detection) * mass + 1e-9


@given(seed=seeds, count=st.integers(1, 4), births=st.booleans())
def test_the_order_of_measurements_does_not_matter_to_the_phd(seed: int, count: int, births: bool) -> None:
    """Measurements in another order give the same expected count and the same targets."""
    rng = np.random.default_rng(seed)
    particles, measurements = states_about(rng, 60), rng.normal([10, 20], 6, (count, 2))
    chosen = PhdFilter(model(moving=True), PLACES if births else NO_BIRTHS, 100)
    start = chosen.init(particles, 1.0)
    infos = [chosen.step(start, part, np.random.default_rng(seed))[1]
             for part in (measurements, measurements[rng.permutation(count)])]  # fmt: skip
    assert infos[0].expected_count == pytest.approx(infos[1].expected_count)
    np.testing.assert_allclose(*(ordered(info.estimates) for info in infos), atol=1e-4)


def tracks_of(rng: np.random.Generator, tracks: int, particles: int = 40) -> LabelledState:
    """Tracks side by side, each as likely there as not, and nobody hidden."""
    states = np.stack([states_about(rng, particles) + np.array([12 * k, 0, 0, 0]) for k in range(tracks)])
    equal = np.full((tracks, particles), -np.log(particles))
    hidden = BornParticles(np.empty((0, 4)), np.empty(0), np.empty(0, dtype=np.int64))
    existence = rng.uniform(0.2, 0.95, tracks)
    return LabelledState(
        np.arange(1, tracks + 1), existence, states, equal, hidden, tracks + 1, np.ones(tracks, np.bool_)
    )


@given(seed=seeds, count=few, tracks=st.integers(1, 3))
def test_existence_is_that_of_all_associations(seed: int, count: int, tracks: int) -> None:
    """Where the pairs form no loop, a track exists with the share of the associations in which it does."""
    rng = np.random.default_rng(seed)
    state = tracks_of(rng, tracks)
    # One track and any measurements, or any tracks and one measurement: a tree.
    measurements = rng.normal([10, 20], 5, (count if tracks == 1 else min(count, 1), 2))
    chosen = LabelledMultiBernoulliFilter(model(), NO_BIRTHS, 40)
    _, info = chosen.step(state, measurements, rng)
    r = 0.95 * state.existence
    seen = np.array([[0.9 * density(p, y).mean() for y in measurements] for p in state.particles]).reshape(tracks, -1)
    total, expected = 0.0, np.zeros(tracks)
    for pairs, alive in itertools.product(
        matchings(tracks, len(measurements)), itertools.product([0, 1], repeat=tracks)
    ):
        if any(not alive[i] for i, _ in pairs):
            continue
        missed = np.delete(np.arange(tracks), [i for i, _ in pairs])
        weight = np.prod([r[i] if there else 1 - r[i] for i, there in enumerate(alive)])
        weight *= np.prod([seen[pair] for pair in pairs]) * np.prod([0.1 if alive[i] else 1.0 for i in missed])
        weight *= CLUTTER ** (len(measurements) - len(pairs))
        total += weight
        expected += weight * np.array(alive)
    np.testing.assert_allclose(info.smoothing_step.posterior.existence, expected / total, atol=1e-3)
    np.testing.assert_allclose(np.exp(info.smoothing_step.posterior.log_weights).sum(axis=1), 1)


@given(seed=seeds, count=st.integers(1, 4), tracks=st.integers(1, 3))
def test_the_order_of_measurements_does_not_matter_to_labels(seed: int, count: int, tracks: int) -> None:
    """Measurements in another order give the tracks the same existence and places, and the same expected count."""
    rng = np.random.default_rng(seed)
    state, measurements = tracks_of(rng, tracks), rng.normal([15, 20], 6, (count, 2))
    chosen = LabelledMultiBernoulliFilter(model(moving=True), PLACES, 40)
    infos = [chosen.step(state, part, np.random.default_rng(seed))[1]
             for part in (measurements, measurements[rng.permutation(count)])]  # fmt: skip
    for name in ("existence", "particles"):
        values = [getattr(info.smoothing_step.posterior, name) for info in infos]
        np.testing.assert_allclose(*values, atol=1e-4)
    assert infos[0].expected_count == pytest.approx(infos[1].expected_count, abs=1e-3)


@given(seed=seeds, count=few)
def test_what_is_smoothed_lies_between_gone_and_there(seed: int, count: int) -> None:
    """Before the step a track was at least as likely there as after it, and its smoothed weights sum to one."""
    rng = np.random.default_rng(seed)
    state = tracks_of(rng, 2)
    chosen = LabelledMultiBernoulliFilter(model(), NO_BIRTHS, 40)
    _, info = chosen.step(state, rng.normal([15, 20], 6, (count, 2)), rng)
    smoothed, posterior = info.smoothing_step.smoothed(), info.smoothing_step.posterior
    assert (smoothed.existence >= posterior.existence - 1e-9).all()
    assert (smoothed.existence <= 1).all()
    np.testing.assert_allclose(np.exp(smoothed.log_weights).sum(axis=1), 1)


@given(seed=seeds, dimensions=st.sampled_from([2, 3]))
def test_bearings_and_ranges_invert_to_places(seed: int, dimensions: int) -> None:
    """What a sensor of directions and distances measures leads back to the place, about any origin."""
    rng = np.random.default_rng(seed)
    states, origin = rng.normal(0, 50, (8, 2 * dimensions)), rng.normal(0, 20, dimensions)
    project, invert = polar_sensor(dimensions, origin)
    np.testing.assert_allclose(invert(project(states)), states[:, ::2], atol=1e-9)
    np.testing.assert_allclose(from_bearing_range(bearing_range(states)), cartesian(states), atol=1e-9)


@given(seed=seeds, turns=st.integers(-2, 2))
def test_angles_differ_the_shortest_way_round(seed: int, turns: int) -> None:
    """Whole turns added to a measured angle change neither its difference from another nor its likelihood."""
    rng = np.random.default_rng(seed)
    sensor = GaussianSensor(bearing_range, np.array([0.1, 2.0]), circular=(0,))
    projected, measured = bearing_range(states_about(rng, 6)), bearing_range(states_about(rng, 6))
    turned, rows = measured + np.array([2 * np.pi * turns, 0.0]), np.arange(6)
    difference = sensor.difference(projected, measured)
    assert (np.abs(difference[:, 0]) <= np.pi + 1e-9).all()
    np.testing.assert_allclose(sensor.difference(projected, turned), difference, atol=1e-9)
    values = [sensor.log_likelihood(projected, rows, part, rows) for part in (measured, turned)]
    np.testing.assert_allclose(*values, atol=1e-6)
    expected = -0.5 * np.square(difference / [0.1, 2.0]).sum(axis=1) - np.log(2 * np.pi * 0.1 * 2)
    np.testing.assert_allclose(values[0], expected)
