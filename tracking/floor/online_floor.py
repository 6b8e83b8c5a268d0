"""People on one floor as they come: the labelled multi-Bernoulli filter with several sensors, state on the floor.

At each moment the tracks move once, and are then updated by one sensor after the other: the iterated corrector (Mahler,
"The multisensor PHD filter", 2009, for the PHD; the order matters little where all sensors see well). Each sensor has
its own visibility, by its lens and by people who hide others, and its own false alarms. Each moment is
reported at once, without delay.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tsuiseki.tracking.filters.finite_sets.births import MeasurementBirths, newborn
from tsuiseki.tracking.filters.finite_sets.labelled_multi_bernoulli import LabelledMultiBernoulliFilter, LabelledState
from tsuiseki.tracking.filters.finite_sets.point_model import GaussianSensor, PointModel, cartesian, linear_sensor
from tsuiseki.tracking.filters.point_motion import straight
from tsuiseki.tracking.floor.measured_floor import MeasuredFloor, SensorView
from tsuiseki.tracking.floor.walking import BIRTHS, LIVES, SPEED
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray
from tsuiseki.tracking.types.measurements import PersonOnFloor

# Probability that a sensor detects a person in full view.
DETECTION = 0.75
# False positives of a sensor, a moment.
FALSE = 1.5
# Of people, m/s².
ACCELERATION = 0.8
# Of each person.
PARTICLES = 300
# Squared Mahalanobis distance within which a detection counts as a person's: three deviations.
NEAR = 9.0
# Existence from which a person is reported.
REPORT = 0.5
# Existence from which a person is reported for the first time.
CONFIRM = 0.8
# Relative width of the kernel that spreads particles.
KERNEL = 0.3
# Moments that a track has at least.
SHORTEST = 3


def people_online(measured: MeasuredFloor, seed: int = 0) -> list[PersonOnFloor]:
    """The tracks that the answers at each moment make, of at least `SHORTEST` moments on the plan.

    Args:
        measured: of the run.
        seed: of the particles.
    """
    rng, points, times, views = np.random.default_rng(seed), measured.points, measured.times, measured.views
    edges = np.searchsorted(points.moment, np.arange(len(times) + 1))
    held: dict[int, list[tuple[Any, ...]]] = {}
    state: LabelledState | None = None
    for moment, seconds in enumerate(np.diff(times, prepend=times[0] - 1.0).tolist()):
        scan = np.arange(edges[moment], edges[moment + 1])
        active = [k for k, view in enumerate(views) if view.measured[moment] and not view.names]
        ids = np.empty(0, np.int64)
        for number, sensor in enumerate(active):
            of_sensor = scan[points.sensor[scan] == sensor]
            corrector = _corrector(views[sensor], moment, seconds if number == 0 else None, seconds / len(active),
                             points.covariances[of_sensor], FALSE * points.spread[of_sensor])  # fmt: skip
            state, info = corrector.step(state or corrector.init(np.empty((0, 4))), points.places[of_sensor], rng)
            ids = info.estimates.ids
        if state is None or not len(ids):
            continue
        rows = np.searchsorted(state.labels, ids)
        mean, covariance = _moments(np.exp(state.log_weights[rows]), state.particles[rows])
        detected = _detected_by(
            mean, covariance, points.places[scan], points.covariances[scan], points.sensor[scan], len(views)
        )
        inside = measured.inside(mean[:, [0, 2]])
        for k in np.flatnonzero(inside).tolist():
            held.setdefault(int(ids[k]), []).append(
                (moment, mean[k], covariance[k], state.existence[rows[k]], detected[k])
            )
    tracks = [states for _, states in sorted(held.items()) if len(states) >= SHORTEST]
    people = []
    for number, states in enumerate(tracks, start=1):
        at, mean, covariance, existence, detected = (np.array(column) for column in zip(*states, strict=True))
        state_of = mean[:, [0, 2]], mean[:, [1, 3]], covariance
        people.append(PersonOnFloor(number, at, times[at], *state_of, existence, np.empty((len(states), 0)), detected))
    return people


def _corrector(
    view: SensorView, moment: int, seconds: float | None, share: float, covariances: FloatArray, clutter: FloatArray
) -> LabelledMultiBernoulliFilter:
    """The filter of one sensor; ``seconds`` where it is the first of the moment, which moves the tracks."""
    project, invert = linear_sensor(2, np.zeros(2))
    gaussian = GaussianSensor(project, np.array([0.3, 0.3])).of_scan(covariances)

    def detection(states: FloatArray) -> FloatArray:
        at = np.full(len(states), moment)
        return np.asarray(np.clip(DETECTION * view.share(at, cartesian(states)), 1e-6, 1 - 1e-6))

    motion = straight(ACCELERATION, 2) if seconds is not None else lambda states, _, __: states
    survival = 1.0 if seconds is None else float(np.exp(-seconds / LIVES))
    model = PointModel(motion, gaussian, survival, detection, lambda _: clutter, seconds or 1.0)
    births = MeasurementBirths(BIRTHS * share, gaussian, newborn(invert, 2, SPEED), 4, PARTICLES // 5)
    return LabelledMultiBernoulliFilter(model, births, PARTICLES, report=REPORT, confirm=CONFIRM, kernel=KERNEL)


def _moments(weights: FloatArray, particles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Means ``(N, 4)`` and covariances ``(N, 4, 4)`` of particles ``(N, P, 4)``."""
    mean = np.einsum("tp,tpd->td", weights, particles)
    away = particles - mean[:, None]
    return mean, np.einsum("tp,tpi,tpj->tij", weights, away, away)


def _detected_by(
    mean: FloatArray, covariance: FloatArray, places: FloatArray, covariances: FloatArray, sensor: IntArray, count: int
) -> BoolArray:
    """``(N, S)`` which sensors detected people, by their distances from the points of the moment."""
    apart = places[None] - mean[:, None, [0, 2]]
    spread = covariance[:, None][..., [0, 2], :][..., [0, 2]] + covariances[None]
    square = np.einsum("tni,tnij,tnj->tn", apart, np.linalg.inv(spread), apart)
    detected = np.zeros((len(mean), count), dtype=np.bool_)
    person, point = np.nonzero(square < NEAR)
    detected[person, sensor[point]] = True
    return detected
