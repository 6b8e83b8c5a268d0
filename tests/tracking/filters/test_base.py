"""What every filter keeps to, whatever it filters."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import fields, is_dataclass

import numpy as np
import pytest

from tsuiseki.tracking.features.colour_region import ColourImage
from tsuiseki.tracking.filters.base import BornParticles, bootstrap
from tsuiseki.tracking.filters.finite_sets.births import MeasurementBirths, MixtureBirths, newborn
from tsuiseki.tracking.filters.finite_sets.labelled_multi_bernoulli import LabelledMultiBernoulliFilter
from tsuiseki.tracking.filters.finite_sets.phd import PhdFilter
from tsuiseki.tracking.filters.finite_sets.point_model import GaussianSensor, PointModel, cartesian
from tsuiseki.tracking.filters.finite_sets.region_likelihoods import EachAlone, WithoutOthers
from tsuiseki.tracking.filters.finite_sets.region_phd import (
    AnywhereBirths,
    ExplainedImage,
    PatchBirths,
    RegionPhdFilter,
)
from tsuiseki.tracking.filters.particle_filter import ParticleFilter
from tsuiseki.tracking.filters.point_motion import (
    Ballistic,
    ConstantVelocity3D,
    DriftingBox,
    PlaneWalk,
    RandomWalk3D,
    SteppingBox,
    constant_velocity,
    coordinated_turn,
)
from tsuiseki.tracking.types import Position

SENSOR = GaussianSensor(cartesian, np.array([10.0, 10.0]))
MODEL = PointModel(constant_velocity(1.0), SENSOR, 0.99, 0.95, 5.0 / 1000**2)
BIRTHS = MixtureBirths(np.array([0.05]), np.zeros((1, 4)), np.full(4, 10.0), 100)
SCAN = np.array([[3.0, -4.0], [200.0, 100.0]])
MASK = np.zeros((90, 120), dtype=bool)
MASK[30:60, 40:70] = True
IMAGE = ColourImage.of_mask(MASK)

NO_BIRTHS = MixtureBirths(np.empty(0), np.empty((0, 4)), np.ones(4))


def square_likelihood(particles, observation):
    return -0.5 * ((particles[:, [0, 2]] - observation) ** 2).sum(axis=1)


FILTERS = {
    "particle": (ParticleFilter(bootstrap(constant_velocity(1.0)), square_likelihood), np.zeros(2)),
    "phd": (PhdFilter(MODEL, BIRTHS, 100), SCAN),
    "labelled": (LabelledMultiBernoulliFilter(MODEL, BIRTHS, 100), SCAN),
    "region": (RegionPhdFilter(SteppingBox(2, 1), PatchBirths(count=50), WithoutOthers()), IMAGE),
    "region, printed": (
        RegionPhdFilter(SteppingBox(2, 1), AnywhereBirths(0.1, 50, (30.0, 30.0)), EachAlone()),
        IMAGE,
    ),
}
OF_SETS = ("phd", "labelled", "region", "region, printed")


def first_state(name):
    chosen, _ = FILTERS[name]
    rng = np.random.default_rng(5)
    if name == "particle":
        return chosen.init(rng.standard_normal((200, 4)))
    if name.startswith("region"):
        around = np.array([55.0, 45, 55, 45, 30, 30])
        return chosen.init(around + rng.standard_normal((200, 6)), count=1.0)
    return chosen.init(rng.standard_normal((200, 4)), 1.0)


def same(a, b):
    """Whether two states or infos hold the same numbers."""
    if is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return np.array_equal(a, b, equal_nan=isinstance(a, np.ndarray) and a.dtype.kind == "f")


@pytest.mark.parametrize("name", FILTERS)
def test_a_step_repeats_with_its_seed_and_changes_nothing_it_was_given(name):
    chosen, observation = FILTERS[name]
    state = first_state(name)
    before, seen = deepcopy(state), deepcopy(observation)
    np.random.seed(1)  # noqa: NPY002 - the global generator must not matter
    first = chosen.step(state, observation, np.random.default_rng(3))
    np.random.seed(2)  # noqa: NPY002
    again = chosen.step(state, observation, np.random.default_rng(3))
    other = chosen.step(state, observation, np.random.default_rng(4))
    assert same(state, before)
    assert same(observation, seen)
    assert same(first[0], again[0])
    assert same(first[1], again[1])
    assert not same(first[0], other[0])


@pytest.mark.parametrize("name", FILTERS)
def test_weights_are_logarithms(name):
    chosen, observation = FILTERS[name]
    state, _ = chosen.step(first_state(name), observation, np.random.default_rng(0))
    log_weights = np.ravel(state.log_weights)
    assert len(log_weights)
    assert not np.isnan(log_weights).any()
    assert (log_weights < np.inf).all()
    assert (log_weights < 0).any()


@pytest.mark.parametrize("name", OF_SETS)
def test_filters_of_several_targets_begin_with_none_or_with_a_count(name):
    chosen, _ = FILTERS[name]
    columns = 6 if name.startswith("region") else 4
    nothing = ColourImage.of_mask(np.zeros_like(MASK)) if columns == 6 else np.empty((0, 2))
    _, info = chosen.step(chosen.init(np.empty((0, columns))), nothing, np.random.default_rng(0))
    assert info.expected_count <= 0.1  # what may have been born
    assert len(info.estimates.ids) == len(info.estimates.states) == len(info.estimates.weights)
    with pytest.raises(ValueError, match="finite particles"):
        chosen.init(np.full((3, columns), np.nan))
    with pytest.raises(ValueError, match="count"):
        chosen.init(np.zeros((3, columns)))
    with pytest.raises(ValueError, match="count"):
        chosen.init(np.empty((0, columns)), count=1.0)


def test_what_is_known_at_the_start_is_expected():
    for name in ("phd", "labelled"):
        chosen, _ = FILTERS[name]
        _, info = chosen.step(first_state(name), np.zeros((1, 2)), np.random.default_rng(0))
        # Measured where it is: the target is there, almost for certain.
        assert info.expected_count == pytest.approx(1.0, abs=0.1), name


MOTIONS = {
    "constant velocity": (constant_velocity(2.0), 4),
    "coordinated turn": (coordinated_turn(2.0, 0.1), 5),
    "second order": (SteppingBox(2, 1), 6),
    "boxes": (DriftingBox(0.5, 0.1), 6),
    "walk of filters": (PlaneWalk(np.array([2.0, 3.0])), 3),
    "walk in space": (RandomWalk3D(), 6),
    "constant velocity in space": (ConstantVelocity3D(), 6),
    "ballistic": (Ballistic(0.1), 6),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_motions_take_their_time(name):
    motion, columns = MOTIONS[name]
    particles = 50 + 1e-3 * np.random.default_rng(0).standard_normal((4000, columns))
    before = particles.copy()
    short, long = (motion(particles, seconds, np.random.default_rng(1)) for seconds in (1.0, 4.0))
    np.testing.assert_array_equal(particles, before)
    assert short.shape == long.shape == particles.shape
    # What is random grows with the time, in every motion.
    spread = [np.std((moved - moved.mean(axis=0))[:, 0]) for moved in (short, long)]
    assert spread[1] > 1.5 * spread[0]


def test_a_motion_of_one_frame_is_repeated():
    motion = PlaneWalk(np.ones(1))
    found = motion(np.zeros((20_000, 1)), 4.0, np.random.default_rng(0))
    assert np.var(found) == pytest.approx(4.0, rel=0.05)  # five standard errors of a variance of 20,000 draws
    for frames in (0.0, 1.5, -1.0):
        with pytest.raises(ValueError, match="whole number of frames"):
            motion(np.zeros((1, 1)), frames, np.random.default_rng(0))


DRAWS = {
    "nowhere": (NO_BIRTHS, SCAN, 0.0),
    "places": (BIRTHS, SCAN, 0.05),
    "measurements": (MeasurementBirths(1e-7, SENSOR, newborn(lambda z: z, 2, 10.0), 4, 5000), SCAN, None),
    "anywhere": (AnywhereBirths(0.1, 50, (30.0, 30.0)), ExplainedImage(IMAGE, np.empty((0, 4))), 0.1),
    "patches": (PatchBirths(count=40), ExplainedImage(IMAGE, np.empty((0, 4))), 0.05),
}


@pytest.mark.parametrize("name", DRAWS)
def test_births_come_in_groups_with_log_weights(name):
    births, observation, expected = DRAWS[name]
    born = births.draw(observation, np.random.default_rng(0))
    assert isinstance(born, BornParticles)
    assert len(born.particles) == len(born.log_weights) == len(born.groups)
    assert (np.diff(born.groups) >= 0).all()
    np.testing.assert_array_equal(np.unique(born.groups), np.arange(len(born.starts)))
    if expected is not None:
        assert np.exp(born.log_weights).sum() == pytest.approx(expected)


def test_a_varying_period_is_a_setting_of_the_step():
    from dataclasses import replace

    still = PointModel(constant_velocity(0.0), SENSOR, 1.0, 0.0, 0.0)
    chosen = PhdFilter(still, NO_BIRTHS, 10)
    state = chosen.init(np.tile([0.0, 1.0, 0.0, 2.0], (10, 1)), 1.0)
    for seconds in (0.5, 3.0):
        now = replace(chosen, model=replace(still, period=seconds))
        state, _ = now.step(state, np.empty((0, 2)), np.random.default_rng(0))
    np.testing.assert_allclose(state.particles[0], [3.5, 1.0, 7.0, 2.0])
    with pytest.raises(ValueError, match="period"):
        replace(still, period=0.0)


def test_the_sphere_tracker_is_a_filter_too():
    from tsuiseki.tracking.sphere.tracker import SphereTracker, TimedViews, with_velocities

    def pulled(positions, views):
        return np.where(views[0] is None, 0.0, -(positions[:, :1] ** 2))

    tracker = SphereTracker(pulled)
    state = tracker.init(with_velocities(np.zeros((100, 3)), 0.3, np.random.default_rng(0)), 1)
    results = [tracker.step(state, TimedViews(0.1, [np.zeros(2)]), np.random.default_rng(1)) for _ in range(2)]
    assert same(results[0][0].particles, results[1][0].particles)
    assert isinstance(results[0][1], Position)
    assert state.particles.log_weights == pytest.approx(-np.log(100))
