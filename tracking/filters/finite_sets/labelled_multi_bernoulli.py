"""Labelled multi-Bernoulli filter with Poisson births, in particle form, and smoothing with a lag of one step.

Beyond the paper's PHD filter, on the same model (30)-(43): every target that has been measured is a Bernoulli track
with a label, a probability of existence ``r`` and its own particles; targets not yet measured stay a Poisson intensity,
so that several may appear at one place at once. Reuter, Vo, Vo and Dietmayer, "The labeled multi-Bernoulli filter"
(2014); the Poisson part and the marginal association are those of Williams, "Marginal multi-Bernoulli filters" (2015).

Whether a target has ended or was only missed, and whether a measurement began one, mostly shows in the next
observation. A place between two measurements is known better than the last one. `SmoothingStep` is a fixed lag of
one step of the forward-backward recursions (Kitagawa, "Monte Carlo filter and smoother", 1996): the particles as they
were before they moved get the weights that they have after.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.filters.base import Births, BornParticles, SetInfo, TargetEstimates
from tsuiseki.tracking.filters.finite_sets.clusters import cluster_sizes, first_particles
from tsuiseki.tracking.filters.finite_sets.pairs import (
    association_evidence,
    association_marginals,
    draw_by_measurement,
    find_pairs,
)
from tsuiseki.tracking.filters.finite_sets.point_model import PointModel, check_measurements
from tsuiseki.tracking.filters.resampling import logarithms, systematic_rows
from tsuiseki.tracking.types import BoolArray, Columns, FloatArray, IntArray

TINY = float(np.finfo(np.float64).tiny)
RESAMPLE_BELOW = 0.5
"""A track's particles are drawn anew below this share of effective ones, in [0, 1]."""
PRUNE = 1e-3
"""A track ends when its existence is below this."""
NEAR = 2.0
"""Unreported tracks whose means are closer than this, in deviations of the sensor, become one while their existences
sum to at most one: they tell of one target that each measurement near its birth began anew."""


@dataclass(frozen=True)
class TrackParticles(Columns):
    """Tracks in particle form.

    Attributes:
        labels: ``(T,)`` positive, never used again.
        existence: ``(T,)`` probabilities.
        particles: ``(T, P, D)``.
        log_weights: ``(T, P)``; the weights of each track sum to one.
    """

    labels: IntArray
    existence: FloatArray
    particles: FloatArray
    log_weights: FloatArray

    def likely(self, report: float | FloatArray) -> TargetEstimates:
        """The tracks whose existence is above ``report``, one for all or ``(T,)``, at the mean of their particles."""
        reported = self.existence > report
        means = np.einsum("tp,tpd->td", np.exp(self.log_weights[reported]), self.particles[reported])
        return TargetEstimates(self.labels[reported], means, self.existence[reported])


@dataclass(frozen=True)
class SmoothingStep:
    """The same T tracks through one step of a filter.

    Attributes:
        prior: as they were.
        predicted: their probabilities of being there and of going on, with weights of the particles that go on.
        posterior: the same, given the observation.
    """

    prior: TrackParticles
    predicted: TrackParticles
    posterior: TrackParticles

    def smoothed(self) -> TrackParticles:
        """The tracks before the step, given its observation.

        A track was there if it goes on, or if it ended just now. The observation tells the second from one that never
        was there no better than the probabilities before it: ``r' = r+ + (1 - r+) r (1 - s) / (1 - r s)`` with ``r``
        before, ``r s`` predicted, and ``r+`` after.
        """
        prior, r, existence_after = self.prior, self.prior.existence, self.posterior.existence
        going_on = self.predicted.existence
        unlike = (1.0 - existence_after) / np.maximum(1.0 - going_on, TINY)
        ended = unlike * (r - going_on)
        existence = np.clip(existence_after + ended, 0.0, 1.0)
        died = r[:, None] * np.exp(prior.log_weights) - going_on[:, None] * np.exp(self.predicted.log_weights)
        weights = existence_after[:, None] * np.exp(self.posterior.log_weights) + unlike[:, None] * np.maximum(
            died, 0.0
        )
        total = weights.sum(axis=1, keepdims=True)
        equal = np.full(weights.shape, 1.0 / max(weights.shape[1], 1))
        shares = np.divide(weights, total, out=equal, where=total > 0)
        return TrackParticles(prior.labels, existence, prior.particles, logarithms(shares))


@dataclass(frozen=True)
class LabelledState(TrackParticles):
    """Tracks, and the intensity of the targets never measured.

    Attributes:
        hidden: the targets never measured.
        next_label: of the next new track.
        reported: ``(T,)`` whether a track was an estimate before.
    """

    hidden: BornParticles
    next_label: int
    reported: BoolArray


@dataclass(frozen=True)
class LabelledInfo(SetInfo):
    """What one step found: the tracks more likely there than not.

    Attributes:
        smoothing_step: what this observation says of the tracks before it.
        log_evidence: logarithm of ``p(Y_k | Y_1:k-1)`` of (11) but for ``exp(-m)``, where ``m`` is the expected number
            of false measurements and of newborn targets that are measured: who made the model knows it.
    """

    smoothing_step: SmoothingStep
    log_evidence: float


@dataclass(frozen=True)
class LabelledMultiBernoulliFilter:
    """Settings and step of the filter.

    Attributes:
        model: motion, sensor, survival, detection and clutter.
        births: draws of the birth intensity.
        particles: of each track.
        report: a track is an estimate when its existence is above this,
        confirm: and for the first time when it is above this: clutter beside a place of birth seldom gets so far.
        kernel: width of the kernel by which they are spread then, over their own deviation, in [0, 1); it keeps their
            mean and covariance (Liu and West, 2001). 0 leaves copies, which is right where the motion is restless.
        discrete: so many last columns of a state are numbers of modes, which no kernel moves.
    """

    model: PointModel
    births: Births[FloatArray]
    particles: int = 1000
    report: float = 0.5
    confirm: float = 0.55
    kernel: float = 0.0
    discrete: int = 0

    def init(self, particles: FloatArray, count: float = 0.0) -> LabelledState:
        """``count`` targets never measured, spread evenly over particles ``(N, D)``; ``(0, D)`` begins with no target.

        Raises:
            ValueError: a particle is not finite, or the count is negative or has no particle to stand on.
        """
        first = first_particles(particles, count)
        starts = np.zeros(min(len(first), 1), dtype=np.int64)
        hidden = BornParticles(first.particles, first.log_weights, starts)
        none, flags = np.empty((0, self.particles, first.particles.shape[1])), np.empty(0, dtype=np.bool_)
        return LabelledState(np.empty(0, np.int64), np.empty(0), none, none[:, :, 0], hidden, 1, flags)

    def step(
        self, state: LabelledState, observation: FloatArray, rng: np.random.Generator
    ) -> tuple[LabelledState, LabelledInfo]:
        """One observation further: predict, associate, update, begin new tracks, prune, estimate."""
        measurements = check_measurements(observation, len(self.model.sensor.deviation))
        predicted = self._predict(state, measurements, rng)
        new_mass, new_particles, hidden = self._hidden_update(predicted.hidden, measurements, rng)
        unclaimed = self.model.clutter_at(measurements) + new_mass
        updated, free, associations = self._track_update(predicted, measurements, unclaimed)
        begun = free * np.divide(new_mass, unclaimed, out=np.zeros_like(new_mass), where=unclaimed > 0)
        joined = self._merge(self._join(updated, begun, new_particles, hidden), rng)
        joined, estimates = self._estimate(joined)
        count = float(joined.existence.sum() + np.exp(hidden.log_weights).sum())
        evidence = associations - self._expected_of(predicted.hidden, len(state.hidden.particles))
        info = LabelledInfo(estimates, count, SmoothingStep(state, predicted, updated), evidence)
        return self._resample(joined, rng), info

    def _predict(self, state: LabelledState, measurements: FloatArray, rng: np.random.Generator) -> LabelledState:
        """Tracks and hidden targets move and survive, (44); the births join the hidden."""
        moved = self.model.moved(state.particles.reshape(-1, state.particles.shape[-1]), rng)
        weights = np.exp(state.log_weights) * self.model.survival_of(moved).reshape(state.log_weights.shape)
        survival = weights.sum(axis=1)
        # A track that is gone keeps equal weights: they have to sum to one, and its existence is zero.
        weights[survival <= 0] = 1.0
        log_weights = logarithms(weights / weights.sum(axis=1, keepdims=True))
        born, old = self.births.draw(measurements, rng), state.hidden
        unseen = self.model.moved(old.particles, rng)
        hidden = BornParticles(
            np.concatenate([unseen, born.particles]),
            np.concatenate([logarithms(self.model.survival_of(unseen)) + old.log_weights, born.log_weights]),
            np.concatenate([old.starts, born.starts + len(old.particles)]),
        )
        moved = moved.reshape(state.particles.shape)
        return replace(
            state, existence=survival * state.existence, particles=moved, log_weights=log_weights, hidden=hidden
        )

    def _hidden_update(
        self, hidden: BornParticles, measurements: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray, BornParticles]:
        """Intensity at each measurement ``(M,)``, particles for a new track there ``(M, P, D)``, and what stays hidden.

        The first is the second term of the denominator of (46), for targets that no track stands for.
        """
        weights, detection = np.exp(hidden.log_weights), self.model.detection_of(hidden.particles)
        pairs = find_pairs(hidden.particles, hidden.starts, measurements, self.model.sensor)
        joint = (detection * weights)[pairs.particle] * np.exp(pairs.log_likelihood)
        mass = pairs.by_measurement(joint, len(measurements))
        drawn = draw_by_measurement(pairs, joint, mass, self.particles, rng)
        # A group much lighter than a track that is pruned can begin none.
        left = _heavy_groups(hidden, (1.0 - detection) * weights, PRUNE / 10)
        # Without a hidden target nothing begins: its particles are never used.
        nothing = np.zeros((*drawn.shape, hidden.particles.shape[1]))
        return mass, self._spread(hidden.particles[drawn], rng) if len(hidden.particles) else nothing, left

    def _track_update(
        self, state: LabelledState, measurements: FloatArray, unclaimed: FloatArray
    ) -> tuple[LabelledState, FloatArray, float]:
        """Tracks after marginal association, the chance ``(M,)`` that no track has each, and the log evidence."""
        tracks, count = len(state), len(measurements)
        flat = state.particles.reshape(-1, state.particles.shape[-1])
        weights, detection = np.exp(state.log_weights), self.model.detection_of(flat).reshape(tracks, self.particles)
        pairs = find_pairs(flat, np.arange(tracks) * self.particles, measurements, self.model.sensor)
        joint = (weights * detection).ravel()[pairs.particle] * np.exp(pairs.log_likelihood)
        evidence = pairs.sums(joint)
        likelihood = np.zeros((tracks, count))
        likelihood[pairs.groups, pairs.measurements] = evidence
        undetected = np.sum(weights * (1.0 - detection), axis=1)
        r = state.existence
        missed = 1.0 - r + r * undetected
        detected = r[:, None] * likelihood
        claimed, none = association_marginals(detected, missed, unclaimed)
        alive = none * r * undetected / np.maximum(missed, TINY)
        existence = alive + claimed.sum(axis=1)
        share = claimed[pairs.groups, pairs.measurements] / np.maximum(evidence, TINY)
        sizes = cluster_sizes(pairs.starts, len(pairs.particle))
        gained = pairs.by_particle(joint * np.repeat(share, sizes), weights.size)
        stayed = weights * (1.0 - detection) * (alive / np.maximum(undetected, TINY))[:, None]
        total = stayed + gained.reshape(weights.shape)
        # A track that can neither be missed nor measured is gone; equal weights instead of 0 / 0.
        total[total.sum(axis=1) <= 0] = 1.0
        log_weights = logarithms(total / total.sum(axis=1, keepdims=True))
        free = np.clip(1.0 - claimed.sum(axis=0), 0.0, 1.0)
        updated = replace(state, existence=np.minimum(existence, 1.0), log_weights=log_weights)
        return updated, free, association_evidence(detected, missed, unclaimed, claimed, none)

    def _expected_of(self, hidden: BornParticles, count: int) -> float:
        """Expected measurements of the first ``count`` particles of targets never measured."""
        return float(np.exp(hidden.log_weights[:count]) @ self.model.detection_of(hidden.particles[:count]))

    def _join(
        self, state: LabelledState, begun: FloatArray, new_particles: FloatArray, hidden: BornParticles
    ) -> LabelledState:
        """The likely ones of old and new tracks."""
        new = np.flatnonzero(begun >= PRUNE)
        begun_tracks = replace(
            state,
            labels=state.next_label + np.arange(len(new)),
            existence=begun[new],
            particles=new_particles[new],
            log_weights=np.full((len(new), self.particles), -np.log(self.particles)),
            reported=np.zeros(len(new), dtype=np.bool_),
        )
        tracks = state.select(state.existence >= PRUNE).and_then(begun_tracks)
        return replace(tracks, hidden=hidden, next_label=state.next_label + len(new))

    def _merge(self, state: LabelledState, rng: np.random.Generator) -> LabelledState:
        """Unreported tracks near each other as one Bernoulli track of the same expected count and the oldest label."""
        weak = np.flatnonzero(state.existence <= self.report)
        if len(weak) < 2:
            return state
        sensor = self.model.sensor
        means = np.einsum("tp,tpd->td", np.exp(state.log_weights[weak]), state.particles[weak])
        places = sensor.project(means)
        apart = sensor.difference(places[:, None, :], places[None, :, :]) / sensor.deviation
        groups = _groups_of_one(state.existence[weak], np.einsum("tuz,tuz->tu", apart, apart) < NEAR**2)
        if not groups:
            return state
        existence, labels, reported = state.existence.copy(), state.labels.copy(), state.reported.copy()
        particles, log_weights = state.particles.copy(), state.log_weights.copy()
        gone = np.zeros(len(state), dtype=np.bool_)
        for members in groups:
            first, group = weak[members[0]], weak[members]
            shares = state.existence[group, None] * np.exp(state.log_weights[group])
            drawn = systematic_rows(shares.reshape(1, -1), self.particles, rng)[0]
            particles[first] = state.particles[group].reshape(-1, particles.shape[2])[drawn]
            log_weights[first] = -np.log(self.particles)
            existence[first], labels[first] = float(state.existence[group].sum()), int(state.labels[group].min())
            reported[first] = state.reported[group].any()
            gone[group[1:]] = True
        order = np.flatnonzero(~gone)
        order = order[np.argsort(labels[order], kind="stable")]
        return replace(
            state, labels=labels, existence=existence, particles=particles, log_weights=log_weights, reported=reported
        ).select(order)

    def _estimate(self, state: LabelledState) -> tuple[LabelledState, TargetEstimates]:
        """The tracks that are likely there; one that was not reported before has to be likelier."""
        estimates = state.likely(np.where(state.reported, self.report, max(self.confirm, self.report)))
        return replace(state, reported=state.reported | np.isin(state.labels, estimates.ids)), estimates

    def _resample(self, state: LabelledState, rng: np.random.Generator) -> LabelledState:
        """Tracks whose weights have become uneven, drawn anew, (16)-(19)."""
        weights = np.exp(state.log_weights)
        uneven = np.flatnonzero(np.sum(weights**2, axis=1) * self.particles * RESAMPLE_BELOW > 1.0)
        drawn = systematic_rows(weights[uneven], self.particles, rng)
        particles, log_weights = state.particles.copy(), state.log_weights.copy()
        particles[uneven] = self._spread(particles[uneven[:, None], drawn], rng)
        log_weights[uneven] = -np.log(self.particles)
        return replace(state, particles=particles, log_weights=log_weights)

    def _spread(self, drawn: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Particles ``(T, P, D)`` spread by the kernel."""
        if not self.kernel or not drawn.size:
            return drawn
        moved, columns = drawn.copy(), drawn.shape[2] - self.discrete
        mean = drawn[:, :, :columns].mean(axis=1, keepdims=True)
        away = drawn[:, :, :columns] - mean
        values, vectors = np.linalg.eigh(np.matmul(away.transpose(0, 2, 1), away) / self.particles)
        root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
        noise = np.matmul(rng.standard_normal(away.shape), root.transpose(0, 2, 1))
        moved[:, :, :columns] = mean + np.sqrt(1 - self.kernel**2) * away + self.kernel * noise
        return moved


def _groups_of_one(existence: FloatArray, near: BoolArray) -> list[IntArray]:
    """Groups of two or more tracks ``(T,)`` that are near ``(T, T)`` their strongest one and may be one target."""
    free, groups = np.ones(len(existence), dtype=np.bool_), []
    for strongest in np.argsort(-existence, kind="stable"):
        if not free[strongest]:
            continue
        others = np.flatnonzero(free & near[strongest])
        others = others[others != strongest]
        others = others[np.argsort(-existence[others], kind="stable")]
        companions = others[existence[strongest] + np.cumsum(existence[others]) <= 1.0]
        if len(companions):
            members = np.concatenate([[strongest], companions])
            free[members] = False
            groups.append(members)
    return groups


def _heavy_groups(hidden: BornParticles, weights: FloatArray, lightest: float) -> BornParticles:
    """The groups whose weights ``(N,)`` sum to at least ``lightest``, with these weights."""
    if len(weights) == 0:
        return hidden
    sizes = cluster_sizes(hidden.starts, len(weights))
    heavy = np.add.reduceat(weights, hidden.starts) >= lightest
    of_heavy = np.repeat(heavy, sizes)
    ends = np.cumsum(sizes[heavy])
    return BornParticles(
        hidden.particles[of_heavy], logarithms(weights[of_heavy]), (ends - sizes[heavy]).astype(np.int64)
    )
