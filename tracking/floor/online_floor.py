"""People on one floor as they come: the labelled multi-Bernoulli filter with several sensors, state on the floor.

At each moment the tracks move once, and are then updated by one sensor after the other: the iterated corrector (Mahler,
"The multisensor PHD filter", 2009, for the PHD; the order matters little where all sensors see well). Each sensor has
its own visibility, by its lens and by people who hide others, and its own false alarms. An answer comes with the moment
itself: the delay is none.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.filters.finite_sets.births import MeasurementBirths, newborn
from tsuiseki.tracking.filters.finite_sets.labelled_multi_bernoulli import LabelledMultiBernoulliFilter, LabelledState
from tsuiseki.tracking.filters.finite_sets.models import GaussianSensor, PointModel, cartesian, linear_sensor
from tsuiseki.tracking.filters.motion.points import straight
from tsuiseki.tracking.floor.measured_floor import MeasuredFloor
from tsuiseki.tracking.floor.sensors import SensorView
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray
from tsuiseki.tracking.types.measurements import PersonOnFloor

DETECTION, FALSE = 0.75, 1.5
"""Of each sensor: probability of detecting somebody in full view, and false ones a moment."""
BIRTHS, LIVES, SPEED, ACCELERATION = 0.004, 20.0, 0.9, 0.8
"""New people a square metre and second; seconds for which one stays; m/s; m/s²."""
PARTICLES, NEAR = 300, 9.0
REPORT, CONFIRM, KERNEL = 0.5, 0.8, 0.3
"""Existence above which somebody is reported, and for the first time; width of the kernel that spreads particles."""


def _stay(states: FloatArray, _: float, __: np.random.Generator) -> FloatArray:
    return states


@dataclass(frozen=True)
class FloorMoment:
    """Everybody at one moment.

    Attributes:
        ids: ``(N,)``.
        states: ``(N, 4)`` x, vx, y, vy.
        covariances: ``(N, 4, 4)``.
        existence: ``(N,)``.
        seen: ``(N, S)`` which sensors detected them.
    """

    ids: IntArray
    states: FloatArray
    covariances: FloatArray
    existence: FloatArray
    seen: BoolArray


class FloorFilter:
    """Follows people moment by moment.

    Args:
        views: S of them, what the sensors see.
        seed: of the particles.
    """

    def __init__(self, views: Sequence[SensorView], seed: int = 0) -> None:
        self.views, self.rng = views, np.random.default_rng(seed)
        self._filter: LabelledMultiBernoulliFilter | None = None
        self._state: LabelledState | None = None

    def update(self, measured: MeasuredFloor, moment: int, seconds: float) -> FloorMoment:
        """The people at the next moment.

        Args:
            measured: holds the points of the moment.
            moment: its number.
            seconds: since the one before, above 0.
        """
        points = measured.points
        first, last = np.searchsorted(points.moment, [moment, moment + 1])
        looked = [k for k, view in enumerate(self.views) if view.looked[moment] and not view.names]
        state, info = self._state, None
        for number, sensor in enumerate(looked):
            own = first + np.flatnonzero(points.sensor[first:last] == sensor)
            one = self._corrector(sensor, moment, seconds if number == 0 else None, seconds / len(looked),
                                  points.covariances[own], FALSE * points.spread[own])  # fmt: skip
            state = one.init(np.empty((0, 4))) if state is None else state
            state, info = one.step(state, points.places[own], self.rng)
        self._state = state
        assert state is not None
        assert info is not None
        return self._answer(state, info.estimates.ids, measured, slice(int(first), int(last)))

    def _corrector(
        self,
        sensor: int,
        moment: int,
        seconds: float | None,
        share: float,
        covariances: FloatArray,
        clutter: FloatArray,
    ) -> LabelledMultiBernoulliFilter:
        """The filter of one sensor; ``seconds`` where it is the first of the moment, which moves the tracks."""
        project, invert = linear_sensor(2, np.zeros(2))
        gaussian = GaussianSensor(project, np.array([0.3, 0.3])).of_scan(covariances)
        view = self.views[sensor]

        def detection(states: FloatArray) -> FloatArray:
            at = np.full(len(states), moment)
            return np.asarray(np.clip(DETECTION * view.share(at, cartesian(states)), 1e-6, 1 - 1e-6))

        motion = _stay if seconds is None else straight(ACCELERATION, 2)
        survival = 1.0 if seconds is None else float(np.exp(-seconds / LIVES))
        model = PointModel(motion, gaussian, survival, detection, lambda _: clutter, seconds or 1.0)
        births = MeasurementBirths(BIRTHS * share, gaussian, newborn(invert, 2, SPEED), 4, PARTICLES // 5)
        return LabelledMultiBernoulliFilter(model, births, PARTICLES, report=REPORT, confirm=CONFIRM, kernel=KERNEL)

    def _answer(self, state: LabelledState, ids: IntArray, measured: MeasuredFloor, own: slice) -> FloorMoment:
        rows = np.searchsorted(state.labels, ids)
        weights, particles = np.exp(state.log_weights[rows]), state.particles[rows]
        mean = np.einsum("tp,tpd->td", weights, particles)
        away = particles - mean[:, None]
        covariance = np.einsum("tp,tpi,tpj->tij", weights, away, away)
        points = measured.points
        apart = points.places[own][None] - mean[:, None, [0, 2]]
        spread = covariance[:, None][..., [0, 2], :][..., [0, 2]] + points.covariances[own][None]
        square = np.einsum("tni,tnij,tnj->tn", apart, np.linalg.inv(spread), apart)
        seen = np.zeros((len(rows), len(self.views)), dtype=np.bool_)
        person, point = np.nonzero(square < NEAR)
        seen[person, points.sensor[own][point]] = True
        return FloorMoment(ids, mean, covariance, state.existence[rows], seen)


def follow_measured(measured: MeasuredFloor, seed: int = 0) -> Iterator[FloorMoment]:
    """Everybody at each moment, one after the other."""
    tracker, times = FloorFilter(measured.views, seed), measured.times
    for moment in range(len(times)):
        yield tracker.update(measured, moment, float(times[moment] - times[moment - 1]) if moment else 1.0)


def people_online(measured: MeasuredFloor, seed: int = 0, short: int = 3) -> list[PersonOnFloor]:
    """The tracks that the answers make, of at least ``short`` moments on the plan."""
    rows = [(moment, k, one) for moment, one in enumerate(follow_measured(measured, seed)) for k in range(len(one.ids))]
    low, high = measured.floor[:2], measured.floor[2:]
    held: dict[int, list[tuple[int, int, FloorMoment]]] = {}
    for moment, k, one in rows:
        place = one.states[k, [0, 2]]
        if (place >= low).all() and (place <= high).all():
            held.setdefault(int(one.ids[k]), []).append((moment, k, one))
    kept = [own for _, own in sorted(held.items()) if len(own) >= short]
    return [_person(number, own, measured.times) for number, own in enumerate(kept, start=1)]


def _person(number: int, own: Sequence[tuple[int, int, FloorMoment]], times: FloatArray) -> PersonOnFloor:
    moments = np.array([moment for moment, *_ in own])
    states = np.array([one.states[k] for _, k, one in own])
    return PersonOnFloor(
        number,
        moments,
        times[moments],
        states[:, [0, 2]],
        states[:, [1, 3]],
        np.array([one.covariances[k] for _, k, one in own]),
        np.array([one.existence[k] for _, k, one in own]),
        np.empty((len(own), 0)),
        np.array([one.seen[k] for _, k, one in own]),
    )
