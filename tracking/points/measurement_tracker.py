"""Targets from a sensor's measurements: points in two or three dimensions, with the time of every scan.

The filters are those of `tracking.filters.finite_sets`; before every step they are told the time that passed and the
covariances of what was measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal, TypeAlias

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.base import TargetEstimates
from tsuiseki.tracking.filters.finite_sets.births import MeasurementBirths, MixtureBirths
from tsuiseki.tracking.filters.finite_sets.clusters import PhdState
from tsuiseki.tracking.filters.finite_sets.labelled_multi_bernoulli import (
    LabelledMultiBernoulliFilter,
    LabelledState,
    TrackParticles,
    likely,
)
from tsuiseki.tracking.filters.finite_sets.phd import PhdFilter, PhdInfo
from tsuiseki.tracking.points.measurement_model import point_births, point_model, state_columns
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.measurements import Scan, SensedTargets, SensedTrack, SensingModel

MeasurementMethod = Literal["labelled", "phd"]
Lag = Literal[0, 1]
AnyFilter: TypeAlias = LabelledMultiBernoulliFilter | PhdFilter
REPORT = 0.5
"""Existence above which a target is shown once the next scan is known; 0.4 and 0.6 were no better on seeds 200-209."""
KERNEL = 0.5
"""A new target's velocity is known by a few of its particles only; without a kernel a calm motion keeps those few."""


class MeasurementTracker:
    """Feeds a filter with one scan after the other.

    Args:
        model: of the sensor and the targets, with a region.
        method: labelled multi-Bernoulli filter, or phd.
        particles: of each target.
        seed: of the particles.
        lag: 0 answers a scan at once; 1, of the labelled filter, after the next one, which tells whether a target has
            ended or was missed, and better where it was.

    Raises:
        RequestError: the model has no region, there is no particle, or no such lag.
    """

    def __init__(
        self,
        model: SensingModel,
        method: MeasurementMethod = "labelled",
        particles: int = 1000,
        seed: int = 0,
        lag: Lag = 0,
    ) -> None:
        if particles < 1:
            raise RequestError(f"`particles`: expected at least 1, got {particles}")
        if lag not in ((0, 1) if method == "labelled" else (0,)):
            raise RequestError(f"`lag`: expected 0, or 1 with the method labelled, got {lag} with {method}")
        self.model, self.lag = model, lag
        self._rng = np.random.default_rng(seed)
        self._births = point_births(model, particles)
        self._filter: AnyFilter = PhdFilter(point_model(model), self._births, particles)
        if method == "labelled":
            self._filter = LabelledMultiBernoulliFilter(
                point_model(model), self._births, particles, kernel=KERNEL, discrete=int(len(model.motions) > 1)
            )
        self._state: Any = self._filter.init(np.empty((0, state_columns(model))))
        self._times: list[float] = []
        self._found: list[SensedTargets] = []
        self._unsettled: SensedTargets | None = None

    def update(self, scan: Scan) -> SensedTargets | None:
        """Take the next scan; its targets, or with a lag those of the scan before and None of the first.

        Raises:
            RequestError: it is not later than the last one.
        """
        if self._times and not scan.time > self._times[-1]:
            raise RequestError(f"expected scans in order of time, got {scan.time:g} s after {self._times[-1]:g} s")
        # Before the first scan there is nothing to move: any time will do.
        seconds = scan.time - self._times[-1] if self._times else 1.0
        self._times.append(scan.time)
        chosen = self._at(seconds, scan.covariances)
        self._state, info = chosen.step(self._state, scan.measurements, self._rng)
        posterior = info.posterior if isinstance(info, PhdInfo) else self._state
        newest = self._targets(scan.time, info.estimates, posterior)
        if not self.lag:
            self._found.append(newest)
            return newest
        before, self._unsettled = self._unsettled, newest
        if before is None or isinstance(info, PhdInfo):
            return None
        smoothed = info.look_back.smoothed()
        self._found.append(self._targets(before.time, likely(smoothed, REPORT), smoothed))
        return self._found[-1]

    def finish(self) -> SensedTargets | None:
        """The targets of the last scan, which no other follows; None without a lag, when they were answered."""
        return self._unsettled

    def tracks(self, shortest: int = 1) -> list[SensedTrack]:
        """The tracks so far with at least so many scans, by id."""
        scans = self._found if self._unsettled is None else [*self._found, self._unsettled]
        rows: dict[int, list[tuple[int, int]]] = {}
        for scan, found in enumerate(scans):
            for place, identity in enumerate(found.ids):
                rows.setdefault(int(identity), []).append((scan, place))
        long = {identity: places for identity, places in sorted(rows.items()) if len(places) >= shortest}
        return [SensedTrack(identity, *_columns(scans, places)) for identity, places in long.items()]

    def forget(self) -> None:
        """Drop what `tracks` would give; the filter goes on, and the ids with it."""
        self._found.clear()
        self._times = self._times[-1:]

    def _at(self, seconds: float, covariances: FloatArray | None) -> AnyFilter:
        """The filter for one step."""
        model = self._filter.model
        sensor = model.sensor if covariances is None else model.sensor.of_scan(covariances)
        survival = self.model.survival**seconds
        births = self._births
        if isinstance(births, MeasurementBirths):
            births = replace(births, density=births.density * seconds, sensor=sensor)
        elif isinstance(births, MixtureBirths):
            births = replace(births, masses=births.masses * seconds, sensor=sensor)
        model = replace(model, period=seconds, sensor=sensor, survival=survival)
        return replace(self._filter, model=model, births=births)

    def _targets(
        self, time: float, found: TargetEstimates, posterior: LabelledState | PhdState | TrackParticles
    ) -> SensedTargets:
        width = 2 * self.model.sensor.dimensions
        spread, modes = moments(found, posterior, len(self.model.motions) if len(self.model.motions) > 1 else 0)
        places, speeds = found.states[:, :width:2], found.states[:, 1:width:2]
        return SensedTargets(
            time, found.ids, places, speeds, spread[:, :width, :width], np.minimum(found.weights, 1.0), modes
        )


def _columns(found: Sequence[SensedTargets], places: Sequence[tuple[int, int]]) -> list[Any]:
    """The fields of `SensedTrack` from numbers of scans and places in them."""
    scans = np.array([scan for scan, _ in places])
    names = ("positions", "velocities", "covariances", "existence", "modes")
    values = [np.array([getattr(found[scan], name)[k] for scan, k in places]) for name in names]
    return [scans, np.array([found[scan].time for scan in scans]), *values]


def moments(
    estimates: TargetEstimates, posterior: LabelledState | PhdState | TrackParticles, modes: int
) -> tuple[FloatArray, FloatArray]:
    """Covariance ``(N, D, D)`` of each estimate's particles, and the shares ``(N, modes)`` of the motions in force."""
    columns = estimates.states.shape[1]
    spread, shares = np.zeros((len(estimates), columns, columns)), np.zeros((len(estimates), modes))
    for k, identity in enumerate(estimates.ids):
        mine = posterior.labels == identity
        particles = posterior.particles[mine].reshape(-1, columns)
        if len(particles) == 0:
            continue
        weights = np.exp(posterior.log_weights[mine].ravel())
        weights /= weights.sum()
        away = particles - weights @ particles
        spread[k] = (weights[:, None] * away).T @ away
        if modes:
            shares[k] = np.bincount(particles[:, -1].astype(np.int64), weights, minlength=modes)
    return spread, shares
