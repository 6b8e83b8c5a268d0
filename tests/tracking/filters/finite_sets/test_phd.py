"""The finite-set filters: against the Kalman filter, against the true count, and with odd measurements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.evaluation.point_distances import PointTracks, evaluate_points
from tsuiseki.tracking.filters.finite_sets.births import MeasurementBirths, MixtureBirths, newborn
from tsuiseki.tracking.filters.finite_sets.clusters import by_clusters, by_measurements
from tsuiseki.tracking.filters.finite_sets.labelled_multi_bernoulli import LabelledMultiBernoulliFilter
from tsuiseki.tracking.filters.finite_sets.phd import PhdFilter
from tsuiseki.tracking.filters.finite_sets.phd_identity import TrackIdentity
from tsuiseki.tracking.filters.finite_sets.point_model import (
    GaussianSensor,
    PointModel,
    bearing_range,
    cartesian,
    from_bearing_range,
)
from tsuiseki.tracking.filters.point_motion import constant_velocity, coordinated_turn

SENSOR = GaussianSensor(cartesian, np.array([10.0, 10.0]))
REGION = 1000.0
PLACES = MixtureBirths(np.full(2, 0.05), np.array([[0.0, 0, 0, 0], [300, 0, 300, 0]]), np.full(4, 10.0), 500)
ANYWHERE = MeasurementBirths(0.1 / REGION**2, SENSOR, newborn(lambda places: places, 2, 10.0), 4, 100)

NO_BIRTHS = MixtureBirths(np.empty(0), np.empty((0, 4)), np.ones(4))


def model(clutter=5.0, detection=0.95, survival=0.99):
    return PointModel(constant_velocity(1.0), SENSOR, survival, detection, clutter / REGION**2)


def kalman(observations, mean, covariance):
    transition = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])
    gain_noise = np.kron(np.eye(2), [[0.5], [1.0]])
    seen = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0]])
    for y in observations:
        mean, covariance = transition @ mean, transition @ covariance @ transition.T + gain_noise @ gain_noise.T
        gain = covariance @ seen.T @ np.linalg.inv(seen @ covariance @ seen.T + 100 * np.eye(2))
        mean, covariance = mean + gain @ (y - seen @ mean), covariance - gain @ seen @ covariance
    return mean, covariance


def simulate(steps, seed, clutter=5.0, detection=0.95, starts=((0.0, 3.0, 0.0, 2.0), (300.0, -2.0, 300.0, 4.0))):
    rng = np.random.default_rng(seed)
    states, truth, measurements = np.array(starts), [], []
    move = constant_velocity(1.0)
    for _ in range(steps):
        states = move(states, 1.0, rng)
        truth.append(states[:, [0, 2]])
        seen = truth[-1][rng.random(len(states)) < detection]
        false = rng.uniform(-REGION / 2, REGION / 2, (rng.poisson(clutter), 2))
        measurements.append(np.concatenate([seen + 10 * rng.standard_normal(seen.shape), false]))
    return np.array(truth), measurements


def run(chosen, measurements, seed=0):
    state, rng, infos = chosen.init(np.empty((0, 4))), np.random.default_rng(seed), []
    for found in measurements:
        state, info = chosen.step(state, found, rng)
        infos.append(info)
    return infos


def test_the_newborn_at_known_places_have_any_of_the_motions():
    births = replace(PLACES, means=np.zeros((2, 5)), deviations=np.array([10.0, 10, 10, 10, 0]), modes=2)
    modes = births.draw(np.empty((0, 2)), np.random.default_rng(0)).particles[:, -1]
    assert set(modes) == {0.0, 1.0}
    assert 0.45 < modes.mean() < 0.55


def test_without_clutter_and_births_the_phd_is_the_kalman_posterior():
    _, measurements = simulate(15, 0, clutter=0.0, detection=1.0, starts=((0.0, 3.0, 0.0, 2.0),))
    chosen = PhdFilter(model(0.0, 1.0, 1.0), NO_BIRTHS, density=20_000)
    rng = np.random.default_rng(1)
    start, spread = np.array([0.0, 3.0, 0.0, 2.0]), np.diag([25.0, 4.0, 25.0, 4.0])
    state = chosen.init(start + rng.standard_normal((20_000, 4)) * np.sqrt(np.diag(spread)), 1.0)
    for found in measurements:
        state, info = chosen.step(state, found, rng)
        assert info.expected_count == pytest.approx(1.0)
    mean, covariance = kalman([found[0] for found in measurements], start, spread)
    weights = np.exp(info.posterior.log_weights)
    # Ten standard errors of 20,000 particles: resampling at each step makes them dependent.
    tolerance = 10 * np.sqrt(np.diag(covariance) / 20_000)
    assert np.all(np.abs(weights @ info.posterior.particles - mean) < tolerance)
    difference = info.posterior.particles - mean
    np.testing.assert_allclose((weights[:, None] * difference).T @ difference, covariance, atol=0.1 * covariance.max())
    assert info.estimates.ids.tolist() == [1]


@pytest.mark.parametrize("detection", [1.0, 0.8])
def test_a_missed_scan_leaves_the_share_of_equation_45(detection):
    chosen = PhdFilter(model(0.0, detection, survival=0.5), NO_BIRTHS, density=1000)
    _, info = chosen.step(chosen.init(np.zeros((1000, 4)), 3.0), np.empty((0, 2)), np.random.default_rng(0))
    assert info.expected_count == pytest.approx(3.0 * 0.5 * (1 - detection))


@pytest.mark.parametrize(("printed", "expected"), [(False, 1.2), (True, 1.0)])
def test_equations_54_and_55_as_printed_leave_out_a_factor_of_46(printed, expected):
    # Without clutter a measurement is explained by one target by (46), and by p_D of one as (55) is printed.
    chosen = PhdFilter(model(0.0, 0.8, survival=1.0), NO_BIRTHS, density=1000, printed=printed)
    _, info = chosen.step(chosen.init(np.zeros((1000, 4)), 1.0), np.zeros((1, 2)), np.random.default_rng(0))
    assert info.expected_count == pytest.approx(expected)


@pytest.mark.parametrize("kind", ["phd", "labelled"])
def test_expected_count_is_the_true_one_in_the_mean(kind):
    counts = []
    for seed in range(6):
        _, measurements = simulate(25, seed)
        chosen = (PhdFilter if kind == "phd" else LabelledMultiBernoulliFilter)(model(), PLACES, 300)
        counts += [info.expected_count for info in run(chosen, measurements, seed)[8:]]
    # 17 steps of 6 seeds; a missed target (5 %) empties its PHD for a step, clutter in a gate adds to it.
    assert np.mean(counts) == pytest.approx(2.0, abs=0.2)


@pytest.mark.parametrize("births", [PLACES, ANYWHERE], ids=["places", "measurements"])
@pytest.mark.parametrize("kind", ["phd", "phd-clusters", "labelled"])
def test_two_targets_are_followed_with_their_identities(kind, births):
    truth, measurements = simulate(40, 3)
    extract = by_clusters if kind == "phd-clusters" else by_measurements
    chosen = (
        LabelledMultiBernoulliFilter(model(), births, 300)
        if kind == "labelled"
        else PhdFilter(model(), births, 300, extract=extract)
    )
    infos = run(chosen, measurements)
    ids = [i for info in infos for i in info.estimates.ids.tolist()]
    frames = [k for k, info in enumerate(infos) for _ in range(len(info.estimates))]
    found = PointTracks(frames, ids, np.concatenate([info.estimates.states[:, [0, 2]] for info in infos]))
    labels = PointTracks(np.repeat(np.arange(40), 2), np.tile([1, 2], 40), truth.reshape(-1, 2))
    scores = evaluate_points(labels, found, 40, 100.0)
    assert scores.ospa1 < 25.0  # the noise alone makes about 8; starting takes a few steps
    assert scores.switches <= 2
    assert len({int(i) for i in infos[-1].estimates.ids}) == len(infos[-1].estimates)


def test_two_targets_born_at_one_place_part():
    starts = ((0.0, 12.0, 0.0, 0.0), (0.0, -12.0, 0.0, 0.0))
    _, measurements = simulate(20, 1, clutter=1.0, detection=1.0, starts=starts)
    births = MixtureBirths(np.array([0.1]), np.zeros((1, 4)), np.array([10.0, 10, 10, 10]), 500)
    for chosen in (PhdFilter(model(1.0), births, 500), LabelledMultiBernoulliFilter(model(1.0), births, 500)):
        last = run(chosen, measurements)[-1].estimates
        assert len(last) == 2
        assert len(set(last.ids.tolist())) == 2


def test_identity_survives_one_missed_scan_and_not_many():
    _, measurements = simulate(20, 2, clutter=0.5, detection=1.0, starts=((0.0, 3.0, 0.0, 2.0),))
    measurements[12] = np.empty((0, 2))
    for chosen in (PhdFilter(model(0.5), PLACES, 300), LabelledMultiBernoulliFilter(model(0.5), PLACES, 300)):
        infos = run(chosen, [*measurements, *[np.empty((0, 2))] * 6])
        assert infos[11].estimates.ids.tolist() == infos[12].estimates.ids.tolist() == infos[15].estimates.ids.tolist()
        assert len(infos[-1].estimates) == 0


@pytest.mark.parametrize("kind", ["labelled", "phd"])
def test_a_target_that_leaves_is_gone_at_once_where_the_model_says_so(kind):
    truth = np.array([[30.0 * k, 0.0] for k in range(1, 6)])
    scans = [*(place[None] for place in truth), np.empty((0, 2))]
    # The last measured place is 150: 30 further on it is outside for nearly every particle.
    bounded = replace(model(0.1), inside=lambda states: states[:, 0] < 160)
    births = MixtureBirths(np.array([0.1]), np.array([[0.0, 30, 0, 0]]), np.full(4, 10.0), 500)
    made = {"labelled": LabelledMultiBernoulliFilter, "phd": PhdFilter}[kind]
    counts = {}
    for name, chosen in {"bounded": bounded, "open": model(0.1)}.items():
        info = run(made(chosen, births), scans)
        assert len(info[-2].estimates) == 1
        counts[name] = len(info[-1].estimates)
    assert counts == {"bounded": 0, "open": 1}


def test_as_printed_the_weight_alone_reports():
    _, measurements = simulate(15, 2, clutter=0.5, detection=1.0, starts=((0.0, 3.0, 0.0, 2.0),))
    measurements[12] = np.empty((0, 2))
    infos = run(
        PhdFilter(model(0.5), PLACES, 300, extract=by_clusters, identity=TrackIdentity(printed=True)), measurements
    )
    assert len(infos[11].estimates) == 1
    assert len(infos[12].estimates) == 0


@pytest.mark.parametrize("kind", ["phd", "labelled"])
@pytest.mark.parametrize("births", [PLACES, ANYWHERE], ids=["places", "measurements"])
@pytest.mark.parametrize(
    "scan",
    [np.empty((0, 2)), np.zeros((60, 2)), np.full((2, 2), 1e9), np.random.default_rng(0).uniform(-500, 500, (400, 2))],
    ids=["none", "coincident", "far away", "hundreds"],
)
@pytest.mark.parametrize("clutter", [0.0, 5.0])
def test_odd_scans_make_no_nan(kind, births, scan, clutter):
    _, measurements = simulate(4, 0)
    chosen = (PhdFilter if kind == "phd" else LabelledMultiBernoulliFilter)(model(clutter), births, 50)
    with np.errstate(invalid="raise"):
        infos = run(chosen, [*measurements, scan, scan])
    assert any(len(info.estimates) for info in infos)
    for info in infos:
        assert np.isfinite(info.expected_count)
        assert np.isfinite(info.estimates.states).all()
        assert len(set(info.estimates.ids.tolist())) == len(info.estimates)


@pytest.mark.parametrize("kind", ["phd", "labelled"])
def test_broken_measurements_are_refused(kind):
    chosen = (PhdFilter if kind == "phd" else LabelledMultiBernoulliFilter)(model(), PLACES, 50)
    with pytest.raises(ValueError, match="finite measurements"):
        run(chosen, [np.array([[0.0, np.nan]])])
    with pytest.raises(ValueError, match=r"shape \(M, 2\)"):
        run(chosen, [np.zeros((3, 3))])


@pytest.mark.parametrize("bad", [{"survival": 1.1}, {"detection": -0.1}, {"survival": np.nan}, {"clutter": -1.0}])
def test_a_model_refuses_what_is_no_probability(bad):
    with pytest.raises(ValueError, match="expected"):
        model(**bad)


def test_detection_may_depend_on_the_state():
    """Targets on the left are never seen: they stay, unmeasured, at their weight."""
    hidden = PointModel(
        constant_velocity(0.1),
        SENSOR,
        1.0,
        lambda p: np.where(p[:, 0] < 0, 0.0, 1.0),
        lambda y: np.full(len(y), 1e-6),
    )
    chosen = PhdFilter(hidden, NO_BIRTHS, 500)
    particles = np.repeat([[-300.0, 0, 0, 0], [300.0, 0, 0, 0]], 500, axis=0)
    _, info = chosen.step(chosen.init(particles, 2.0), np.empty((0, 2)), np.random.default_rng(0))
    assert info.expected_count == pytest.approx(1.0)


def test_birth_weights_sum_to_the_expected_births():
    rng = np.random.default_rng(0)
    assert np.exp(PLACES.draw(np.empty((0, 2)), rng).log_weights).sum() == pytest.approx(0.1)
    # Around one measurement the uniform intensity over the proposal has its mass within the gate: about the area of
    # the particles' cells; the mean of 1/q over q is the area where q > 0.
    many = MeasurementBirths(1e-4, SENSOR, newborn(lambda places: places, 2, 10.0), 4, 20_000)
    born = many.draw(np.array([[0.0, 0.0]]), rng)
    inside = np.hypot(born.particles[:, 0], born.particles[:, 2]) < 20.0
    assert np.exp(born.log_weights[inside]).sum() == pytest.approx(1e-4 * np.pi * 400, rel=0.05)


def test_a_place_where_nothing_was_measured_gets_few_particles_of_the_same_mass():
    births = replace(PLACES, sensor=SENSOR)
    rng = np.random.default_rng(0)
    born = births.draw(np.array([[5.0, -5.0]]), rng)
    sizes = np.diff(born.starts, append=len(born.particles))
    np.testing.assert_array_equal(sizes, [500, 50])
    np.testing.assert_allclose(np.add.reduceat(np.exp(born.log_weights), born.starts), 0.05)
    for place, mean in enumerate(PLACES.means):
        part = born.particles[born.groups == place]
        # Four standard errors of the mean of 50 draws with a deviation of 10.
        assert np.abs(part.mean(axis=0) - mean).max() < 4 * 10 / np.sqrt(50)
    assert len(births.draw(np.empty((0, 2)), rng).particles) == 100


def test_as_printed_newborn_particles_take_the_label_of_the_near_cluster():
    identity = TrackIdentity(printed=True)
    births = replace(PLACES, count=50)
    chosen = PhdFilter(model(), births, 500, smallest_cluster=0, extract=by_clusters, identity=identity)
    _, measurements = simulate(12, seed=3, clutter=0.0, detection=1.0)
    infos = run(chosen, measurements)
    # Both are born in the first scans, near their places; from then on every step is born on them.
    assert all(len(info.estimates) == 2 for info in infos[5:])
    # All that is born within the first cluster has its label.
    last = infos[2].posterior
    names = np.unique(last.labels)
    assert len(names) <= 4


def labelled_state(existence, places, reported=None):
    """Tracks of 200 particles about places ``(T, 2)``, labels from 1."""
    count, rng = len(existence), np.random.default_rng(0)
    particles = np.zeros((count, 200, 4))
    particles[:, :, [0, 2]] = np.asarray(places)[:, None] + 5 * rng.standard_normal((count, 200, 2))
    empty = LabelledMultiBernoulliFilter(model(), NO_BIRTHS, 200).init(np.empty((0, 4)))
    return replace(
        empty, labels=np.arange(1, count + 1), existence=np.array(existence), particles=particles,
        log_weights=np.full((count, 200), -np.log(200)), next_label=count + 1,
        reported=np.zeros(count, dtype=bool) if reported is None else np.array(reported),
    )  # fmt: skip


def test_unreported_tracks_of_one_place_become_one_of_the_same_expected_count():
    chosen = LabelledMultiBernoulliFilter(model(), NO_BIRTHS, 200)
    before = labelled_state([0.2, 0.4, 0.3, 0.9, 0.45], [[0, 0], [5, 0], [0, 5], [0, 0], [300, 0]])
    after = chosen._merge(before, np.random.default_rng(1))
    assert after.labels.tolist() == [1, 4, 5]
    np.testing.assert_allclose(after.existence, [0.9, 0.9, 0.45])
    assert after.existence.sum() == pytest.approx(before.existence.sum())
    # The mean of the mixture; four standard errors of 200 draws whose deviation is about 5.5.
    mixture = (0.2 * before.particles[0] + 0.4 * before.particles[1] + 0.3 * before.particles[2]).mean(axis=0) / 0.9
    assert np.abs(after.particles[0].mean(axis=0) - mixture).max() < 4 * 5.5 / np.sqrt(200)
    # More than one target cannot be one: 0.45 + 0.45 + 0.3 leaves the weakest out.
    crowded = chosen._merge(labelled_state([0.45, 0.3, 0.45], [[0, 0], [0, 0], [0, 0]]), np.random.default_rng(1))
    assert sorted(crowded.existence.round(3).tolist()) == [0.3, 0.9]


def test_a_track_is_reported_when_it_is_confirmed_and_held_while_it_is_likely():
    chosen = LabelledMultiBernoulliFilter(model(), NO_BIRTHS, 200, confirm=0.65)
    state, first = chosen._estimate(labelled_state([0.6, 0.7, 0.6, 0.4], np.zeros((4, 2)), [False, False, True, True]))
    assert first.ids.tolist() == [2, 3]
    assert state.reported.tolist() == [False, True, True, True]


def test_turns_conserve_speed_and_bearings_invert():
    rng = np.random.default_rng(0)
    states = np.array([[0.0, 10.0, 0.0, 0.0, 0.3], [5.0, 3.0, -4.0, 2.0, 0.0]])
    moved = coordinated_turn(0.0, 0.0)(states, 1.0, rng)
    np.testing.assert_allclose(np.hypot(moved[:, 1], moved[:, 3]), np.hypot(states[:, 1], states[:, 3]))
    np.testing.assert_allclose(moved[1, :4], [8.0, 3.0, -2.0, 2.0])
    # A chord of an arc of 0.3 radians at speed 10.
    assert np.hypot(moved[0, 0], moved[0, 2]) == pytest.approx(2 * 10 / 0.3 * np.sin(0.15))
    np.testing.assert_allclose(from_bearing_range(bearing_range(states)), states[:, [0, 2]])


def test_same_seed_same_estimates():
    _, measurements = simulate(8, 5)
    for kind in (PhdFilter, LabelledMultiBernoulliFilter):
        first, second = (run(kind(model(), PLACES, 100), measurements, 7)[-1].estimates for _ in range(2))
        assert len(first)
        np.testing.assert_array_equal(first.states, second.states)
        np.testing.assert_array_equal(first.ids, second.ids)
