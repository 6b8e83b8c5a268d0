"""Filters of one target: units, origins, the order of particles and of measurements, and unbiased draws."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.properties.drawn import boxes_of, seeds
from tsuiseki.tracking.filters.base import bootstrap
from tsuiseki.tracking.filters.kalman import (
    BoxBelief,
    BoxMotion,
    Gaussians,
    per_longer_frame,
    predict,
    predict_boxes,
    start_boxes,
    update,
    update_boxes,
)
from tsuiseki.tracking.filters.particle_filter import ParticleFilter
from tsuiseki.tracking.filters.point_motion import Ballistic
from tsuiseki.tracking.filters.resampling import (
    bearable_share,
    circular_mean,
    effective_sample_size,
    log_sum,
    normalise,
    open_after,
    probabilities,
    systematic,
    weigh_views,
    weighted_covariance,
    weighted_mean,
)
from tsuiseki.tracking.types import FloatArray

MOTION = BoxMotion()
counts = st.integers(1, 30)


def followed(boxes: FloatArray, steps: int = 4) -> BoxBelief:
    """What is known after boxes were detected in some frames."""
    belief = start_boxes(boxes[0], MOTION)
    for k in range(1, steps):
        belief = update_boxes(predict_boxes(belief, MOTION), boxes[k], MOTION)
    return belief


def boxes_over_time(seed: int) -> FloatArray:
    return np.stack([boxes_of(np.random.default_rng(seed + k), 3) for k in range(4)])


@given(seed=seeds, scale=st.floats(0.01, 100), shift=st.floats(-1e3, 1e3))
def test_boxes_are_filtered_alike_in_any_unit(seed: int, scale: float, shift: float) -> None:
    """Boxes of another unit and origin give the same estimates there; the variances are shares and stay."""
    boxes = boxes_over_time(seed)
    belief, moved = followed(boxes), followed(scale * boxes + shift)
    np.testing.assert_allclose(moved.boxes, scale * belief.boxes + shift, atol=1e-6 * scale)
    np.testing.assert_allclose(moved.velocities, scale * belief.velocities, atol=1e-6 * scale)
    np.testing.assert_array_equal(moved.variance, belief.variance)


@given(seed=seeds)
def test_the_filter_of_boxes_is_the_textbook_filter(seed: int) -> None:
    """In closed form it gives, for each corner coordinate, what the filter of matrices gives."""
    boxes = boxes_over_time(seed)
    transition, seen = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    noise = MOTION.acceleration**2 * np.outer([0.5, 1.0], [0.5, 1.0])
    error = np.array([[MOTION.measurement**2]])
    columns = boxes.reshape(4, -1)
    state = Gaussians(
        np.column_stack([columns[0], np.zeros(12)]),
        np.tile(np.diag([MOTION.measurement**2, MOTION.start_velocity**2]), (12, 1, 1)),
    )
    for measured in columns[1:]:
        state = update(predict(state, transition, noise), measured[:, None], seen, error)
    belief = followed(boxes)
    np.testing.assert_allclose(belief.boxes.ravel(), state.mean[:, 0])
    np.testing.assert_allclose(belief.velocities.ravel(), state.mean[:, 1], atol=1e-9)
    covariance = np.repeat(belief.variance, 4, axis=0)
    np.testing.assert_allclose(covariance, state.covariance[:, [0, 0, 1], [0, 1, 1]], atol=1e-12)


def gaussians(rng: np.random.Generator) -> Gaussians:
    roots = rng.normal(size=(5, 3, 3))
    return Gaussians(rng.normal(size=(5, 3)), roots @ np.swapaxes(roots, 1, 2) + 0.1 * np.eye(3))


def assert_close(state: Gaussians, expected: Gaussians) -> None:
    np.testing.assert_allclose(state.mean, expected.mean, atol=1e-7)
    np.testing.assert_allclose(state.covariance, expected.covariance, atol=1e-7)


@given(seed=seeds)
def test_measurements_of_one_time_may_come_in_any_order(seed: int) -> None:
    """Two measurements of a state give the same estimate one after the other, the other way round, and both at once."""
    rng = np.random.default_rng(seed)
    state, (first, second) = gaussians(rng), rng.normal(size=(2, 1, 3))
    a, b = rng.normal(size=(2, 5, 1))
    one, two = np.array([[0.3]]), np.array([[0.7]])
    forwards = update(update(state, a, first, one), b, second, two)
    assert_close(update(update(state, b, second, two), a, first, one), forwards)
    both = update(state, np.concatenate([a, b], axis=1), np.concatenate([first, second]), np.diag([0.3, 0.7]))
    assert_close(both, forwards)
    assert (np.linalg.eigvalsh(state.covariance - forwards.covariance) > -1e-9).all()


@given(seed=seeds, longer=st.floats(0.2, 5))
def test_a_longer_frame_is_the_same_motion(seed: int, longer: float) -> None:
    """Where frames last so many times as long, boxes stand after one of them where they stood after so many."""
    belief = followed(boxes_over_time(seed))
    still = BoxMotion(acceleration=0)
    long = predict_boxes(per_longer_frame(belief, longer), still)
    short = predict_boxes(belief, still, longer)
    np.testing.assert_allclose(long.boxes, short.boxes)
    np.testing.assert_allclose(long.velocities, longer * short.velocities)
    np.testing.assert_allclose(long.variance, short.variance * (1, longer, longer**2))


@given(seed=seeds, frames=st.integers(1, 6))
def test_a_gap_is_predicted_as_frame_by_frame(seed: int, frames: int) -> None:
    """Several frames at once give the place and the variances that they give one after the other."""
    belief = followed(boxes_over_time(seed))
    steps = belief
    for _ in range(frames):
        steps = predict_boxes(steps, MOTION)
    once = predict_boxes(belief, MOTION, frames)
    np.testing.assert_allclose(once.boxes, steps.boxes)
    np.testing.assert_allclose(once.variance, steps.variance, rtol=1e-9)


@given(seed=seeds, count=counts, shift=st.floats(-500, 500), impossible=st.integers(0, 3))
def test_weights_sum_to_one_whatever_they_are_multiplied_by(
    seed: int, count: int, shift: float, impossible: int
) -> None:
    """Probabilities of log-weights sum to one and stay when all are multiplied; they are worth one to all particles."""
    log_weights = np.random.default_rng(seed).normal(0, 20, count)
    log_weights[:impossible] = -np.inf
    weights = probabilities(log_weights)
    assert weights.sum() == pytest.approx(1)
    np.testing.assert_allclose(probabilities(log_weights + shift), weights, atol=1e-9)
    assert log_sum(normalise(log_weights)) == pytest.approx(0, abs=1e-9)
    assert 1 - 1e-9 <= effective_sample_size(log_weights) <= count + 1e-9
    assert effective_sample_size(np.zeros(count)) == pytest.approx(count)


class Offsets(np.random.Generator):
    """Gives a fixed offset in [0, 1) instead of a random one."""

    def __init__(self, offset: float) -> None:
        super().__init__(np.random.PCG64(0))
        self.offset = offset

    def random(self, size: Any = None) -> Any:  # type: ignore[override]
        return np.full(() if size is None else size, self.offset)


@pytest.mark.slow
@given(seed=seeds, particles=st.integers(1, 6), count=st.integers(1, 12))
def test_resampling_is_unbiased(seed: int, particles: int, count: int) -> None:
    """Over all offsets a particle is drawn its share of the times; in each draw that share, rounded up or down."""
    rng = np.random.default_rng(seed)
    weights = rng.random(particles) * (rng.random(particles) < 0.8)
    weights[rng.integers(particles)] += 0.1
    expected, steps = count * weights / weights.sum(), 400
    copies = np.zeros(particles)
    for step in range(steps):
        drawn = systematic(weights, count, Offsets((step + 0.5) / steps))
        assert len(drawn) == count
        number = np.bincount(drawn, minlength=particles)
        assert (np.abs(number - expected) < 1 + 1e-9).all()
        assert (number[weights == 0] == 0).all()
        copies += number / steps
    # Each of a particle's two ends lies within a step of the grid of offsets.
    np.testing.assert_allclose(copies, expected, atol=2 / steps)


def filter_of(threshold: float) -> ParticleFilter[Any]:
    """Particles that go on by their velocity, weighed by their distance from a point."""
    return ParticleFilter(
        bootstrap(lambda states, seconds, _: states + seconds * np.array([1.0, -2.0])),
        lambda particles, seen: -0.5 * np.square(particles - seen).sum(axis=1),
        threshold,
    )


@given(seed=seeds, count=counts)
def test_the_order_of_particles_does_not_matter(seed: int, count: int) -> None:
    """Particles in another order have the same weights, the same evidence and the same mean."""
    rng = np.random.default_rng(seed)
    particles, seen, order = rng.normal(0, 2, (count, 2)), rng.normal(0, 2, 2), rng.permutation(count)
    chosen = filter_of(threshold=0.0)
    state, info = chosen.step(chosen.init(particles), seen, rng)
    shuffled, shuffled_info = chosen.step(chosen.init(particles[order]), seen, rng)
    np.testing.assert_allclose(shuffled.log_weights, state.log_weights[order])
    assert shuffled_info.log_evidence == pytest.approx(info.log_evidence)
    mean, shuffled_mean = (weighted_mean(s.particles, s.log_weights) for s in (state, shuffled))
    np.testing.assert_allclose(shuffled_mean, mean)
    assert np.exp(state.log_weights).sum() == pytest.approx(1)


@given(seed=seeds, count=st.integers(2, 30))
def test_evidence_is_the_mean_likelihood(seed: int, count: int) -> None:
    """From equal weights the evidence of the first observation is the mean likelihood of the moved particles."""
    rng = np.random.default_rng(seed)
    particles, seen = rng.normal(0, 2, (count, 2)), rng.normal(0, 2, 2)
    chosen = filter_of(threshold=0.9)
    _, info = chosen.step(chosen.init(particles), seen, rng)
    likelihood = np.exp(-0.5 * np.square(particles + np.array([1.0, -2.0]) - seen).sum(axis=1))
    assert np.exp(info.log_evidence) == pytest.approx(likelihood.mean())
    assert not info.resampled


@given(seed=seeds, count=st.integers(2, 30), shift=st.floats(-5, 5))
def test_moments_move_and_turn_with_the_particles(seed: int, count: int, shift: float) -> None:
    """A mean moves with its particles, an angle's on the circle, and the covariance stays as it is."""
    rng = np.random.default_rng(seed)
    particles, log_weights = rng.normal(0, 1, (count, 3)), rng.normal(0, 1, count)
    mean, covariance = (f(particles, log_weights, (2,)) for f in (weighted_mean, weighted_covariance))
    shifted = particles + shift
    shifted[:, 2] = (shifted[:, 2] + np.pi) % (2 * np.pi) - np.pi
    moved = weighted_mean(shifted, log_weights, (2,))
    np.testing.assert_allclose(moved[:2], mean[:2] + shift, atol=1e-9)
    assert np.exp(1j * (moved[2] - mean[2] - shift)) == pytest.approx(1)
    np.testing.assert_allclose(weighted_covariance(shifted, log_weights, (2,)), covariance, atol=1e-9)
    expected = np.cov(particles[:, :2].T, aweights=probabilities(log_weights), ddof=0)
    np.testing.assert_allclose(covariance[:2, :2], expected, atol=1e-9)
    assert circular_mean(particles[:, 2], np.ones(count)) == pytest.approx(
        np.angle(np.exp(1j * particles[:, 2]).mean())
    )


@given(seed=seeds, size=st.floats(1, 20), sharp=st.floats(0.1, 1e4))
def test_the_share_of_a_likelihood_is_what_particles_bear(seed: int, size: float, sharp: float) -> None:
    """What is applied leaves as many effective particles as wanted; all of it is applied where they bear it."""
    values = sharp * np.random.default_rng(seed).normal(0, 1, 30)
    share = bearable_share(lambda part: part * values, size)
    assert 0 < share <= 1
    if effective_sample_size(values) >= size:
        assert share == 1
    elif share > 2e-4:
        assert effective_sample_size(share * values) >= size
        assert effective_sample_size(2.5 * share * values) < size


@given(seed=seeds)
def test_views_that_tell_nothing_change_nothing(seed: int) -> None:
    """A view that weighs all particles alike, as if covered, leaves its chance to be open; one for them raises it."""
    rng = np.random.default_rng(seed)
    open_before, weights = rng.uniform(0.05, 0.95, 3), np.full(6, 1 / 6)
    np.testing.assert_allclose(weigh_views(np.zeros((6, 3)), open_before), 0, atol=1e-12)
    np.testing.assert_allclose(open_after(np.zeros((6, 3)), open_before, weights), open_before)
    ratios = rng.uniform(0.1, 3, (6, 3))
    assert (open_after(ratios, open_before, weights) > open_before).all()
    assert (open_after(-ratios, open_before, weights) < open_before).all()
    np.testing.assert_allclose(np.exp(weigh_views(ratios, open_before)), open_before * np.exp(ratios) + 1 - open_before)


@given(height=st.floats(0.5, 3), speed=st.floats(0.1, 8), seconds=st.floats(0.01, 0.2))
def test_a_ball_keeps_its_energy_in_flight_and_loses_its_share_at_a_bounce(
    height: float, speed: float, seconds: float
) -> None:
    """Without noise and air, energy stays until the ball bounces, and is the square of the restitution after it."""
    flight, low = Ballistic(radius=0.1, agitation=0.0, restitution=0.8), 0.1
    state, energies = np.array([[0.0, 0, height, 1.0, 2.0, -speed]]), []
    for _ in range(3):
        energies.append(0.5 * state[0, 5] ** 2 + 9.81 * (state[0, 2] - low))
        state = flight(state, seconds, np.random.default_rng(0))
        assert state[0, 2] >= low
        np.testing.assert_allclose(state[0, 3:5], [1.0, 2.0])
    for start, end in itertools.pairwise(energies):
        assert end == pytest.approx(start) or end == pytest.approx(0.64 * start)
    assert replace(flight, restitution=1.0)(state, seconds, np.random.default_rng(0))[0, 2] >= low
