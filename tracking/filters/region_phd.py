"""The PHD filter on image regions: particles refer to the part of the image under them, section 6 of the paper.

States are rectangles with a memory, (63): ``x, y, x before, y before, width, height`` in pixels, centre and size. There
are no measured points, so what enters the update (46) is an argument, one of
:mod:`tsuiseki.tracking.filters.region_updates`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from tsuiseki.tracking.filters.particle import Motion
from tsuiseki.tracking.filters.phd_identity import group_starts
from tsuiseki.tracking.filters.points import PointEstimates
from tsuiseki.tracking.filters.region_likelihoods import RegionLikelihood, background_level
from tsuiseki.tracking.filters.region_states import RegionState, boxes_of, cluster_means, select
from tsuiseki.tracking.filters.region_updates import Regions, Update, calibrated
from tsuiseki.tracking.filters.resampling import Resampler, systematic
from tsuiseki.tracking.geometry import areas, intersections, iou_matrix
from tsuiseki.tracking.likelihoods.colour_region import ColourImage
from tsuiseki.tracking.types import FloatArray, IntArray

TINY = float(np.finfo(np.float64).tiny)
JOINED_OVERLAP = 0.05
"""Intersection over union above which two clusters are near, section 5.2."""
WHOLE = 1.5
"""Weight below which two near clusters are one target, section 5.2."""
ADOPTED_SHARE = 0.5
"""Of the smaller of two boxes, above which what is born lies on a cluster, section 5.2."""


class RegionBirths(Protocol):
    """Proposes new targets: particles ``(J, 6)``, expected counts ``(J,)``, and a group number ``(J,)`` from 0 each."""

    def __call__(
        self, image: ColourImage, explained: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray, IntArray]: ...


@dataclass(frozen=True)
class RegionInfo:
    """What one step found.

    Attributes:
        estimates: clusters whose weight is near one.
        expected_count: sum of the weights after the update.
        posterior: the weighted particles after the update, before they are drawn anew.
        background: ``b`` of this frame.
        likelihood: greatest ``h`` of each estimate.
    """

    estimates: PointEstimates
    expected_count: float
    posterior: RegionState
    background: float
    likelihood: FloatArray


@dataclass(frozen=True)
class RegionPhdFilter:
    """Settings and step of the filter.

    Attributes:
        motion: draws the next states, (64).
        births: proposes new targets, (51).
        likelihood: :func:`without_others`, or :func:`each_alone` as printed.
        update: :data:`calibrated`, :func:`as_printed`, or either :class:`Equalised`.
        density: particles for each expected target, (56).
        fixed: number of particles whatever the count, for an update whose count means nothing; 0 follows the count.
        survival: ``pS`` in [0, 1].
        detection: ``pD`` in [0, 1].
        margin: of the frame around a box, for ``q``.
        report: a cluster is an estimate above this weight.
        least: smallest number of particles of a cluster that is kept.
        resample: one of :mod:`tsuiseki.tracking.filters.resampling`.
    """

    motion: Motion
    births: RegionBirths
    likelihood: RegionLikelihood
    update: Update = calibrated
    density: int = 500
    fixed: int = 0
    survival: float = 0.99
    detection: float = 0.95
    margin: float = 0.5
    report: float = 0.5
    least: int = 100
    resample: Resampler = systematic

    def __post_init__(self) -> None:
        for name, value in (("survival", self.survival), ("detection", self.detection)):
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"expected the probability of {name} in [0, 1], got {value}")

    def init(self, particles: FloatArray, labels: IntArray, weights: FloatArray) -> RegionState:
        """Particles ``(N, 6)`` with their labels and weights ``(N,)``; all empty to begin with no target."""
        order = np.argsort(labels, kind="stable")
        with np.errstate(divide="ignore"):
            log_weights = np.log(np.asarray(weights, dtype=np.float64)[order])
        labels = np.asarray(labels, dtype=np.int64)[order]
        return RegionState(
            np.asarray(particles, dtype=np.float64)[order], labels, log_weights, int(labels.max(initial=0)) + 1
        )

    def step(
        self, state: RegionState, observation: ColourImage, rng: np.random.Generator
    ) -> tuple[RegionState, RegionInfo]:
        """One frame further: predict, bear, weigh, update, tidy, read off the targets, draw anew."""
        predicted = self._predict(state, observation, rng)
        likelihood = self.likelihood(predicted, observation, self.margin, self.report)
        background = background_level(observation, predicted, self.margin, rng)
        weights, starts = np.exp(predicted.log_weights), group_starts(predicted.labels)
        after = self.update(Regions(weights, likelihood, starts, background, self.detection))
        count = float(after.sum())
        # With a fixed number of particles a cluster's weight is read off its share of them.
        scale = self.fixed / (self.density * max(count, TINY)) if self.fixed else 1.0
        with np.errstate(divide="ignore"):
            posterior = _joined(replace(predicted, log_weights=np.log(after)), scale)
        names, masses, means = cluster_means(posterior)
        tops = np.fmax.reduceat(likelihood, starts) if len(starts) else np.empty(0)
        tops = tops[np.searchsorted(predicted.labels[starts], names)]
        shown = scale * masses > self.report
        if self.fixed:
            shown &= tops > background  # a share is large also where nothing is seen anywhere
        estimates = PointEstimates(names[shown], means[shown], np.minimum(scale * masses[shown], 1.0))
        return self._resample(posterior, rng), RegionInfo(estimates, count, posterior, background, tops[shown])

    def _predict(self, state: RegionState, image: ColourImage, rng: np.random.Generator) -> RegionState:
        """(44): survivors (48)-(49), and births where no reported target explains the image."""
        with np.errstate(divide="ignore"):
            survived = state.log_weights + np.log(self.survival)
        survivors = replace(state, particles=self.motion(state.particles, rng), log_weights=survived)
        _, masses, means = cluster_means(survivors)
        return self._with_births(survivors, image, boxes_of(means[masses > self.report]), rng)

    def _with_births(
        self, state: RegionState, image: ColourImage, explained: FloatArray, rng: np.random.Generator
    ) -> RegionState:
        """Births with provisional labels (62); those that lie on a cluster take its label, section 5.2."""
        born, weights, groups = self.births(image, explained, rng)
        with np.errstate(divide="ignore"):
            log_weights = np.log(weights)
        labels = np.concatenate([state.labels, _adopted(state, born, groups)])
        order = np.argsort(labels, kind="stable")
        joined = RegionState(
            np.concatenate([state.particles, born]),
            labels,
            np.concatenate([state.log_weights, log_weights]),
            int(max(state.next_label, labels.max(initial=0) + 1)),
        )
        return select(joined, order)

    def _resample(self, posterior: RegionState, rng: np.random.Generator) -> RegionState:
        """(56)-(59); of a light cluster at least ``least`` particles, of less weight."""
        weights, starts = np.exp(posterior.log_weights), group_starts(posterior.labels)
        total = float(weights.sum())
        if len(starts) == 0 or total <= 0.0:
            empty = np.zeros(len(posterior), dtype=np.bool_)
            return select(posterior, empty)
        sizes = np.diff(np.append(starts, len(weights)))
        if self.fixed:
            drawn = self.resample(weights, self.fixed, rng)
            return replace(select(posterior, drawn), log_weights=np.full(self.fixed, np.log(total / self.fixed)))
        masses = np.add.reduceat(weights, starts)
        wanted = np.where(masses > 1e-3, np.maximum(self.density * masses, self.least), 0.0)
        factor = np.repeat(wanted / np.maximum(masses, TINY), sizes)
        count = round(float(wanted.sum()))
        if count == 0:
            return select(posterior, np.zeros(len(posterior), dtype=np.bool_))
        drawn = self.resample(weights * factor, count, rng)
        return replace(select(posterior, drawn), log_weights=-np.log(factor[drawn]))


def _adopted(state: RegionState, born: FloatArray, groups: IntArray) -> IntArray:
    """Labels ``(J,)`` of born particles: that of the cluster that their group lies on most, or new ones."""
    labels = state.next_label + groups
    names, _, means = cluster_means(state)
    if len(names) == 0 or len(born) == 0:
        return labels
    starts = group_starts(groups)
    sizes = np.diff(np.append(starts, len(groups)))
    places = boxes_of(np.add.reduceat(born, starts, axis=0) / sizes[:, None])
    there = boxes_of(means)
    smaller = np.minimum(areas(places)[:, None], areas(there)[None])
    shared = intersections(places[:, None], there[None]) / smaller
    owner = np.where(shared.max(axis=1) > ADOPTED_SHARE, names[np.argmax(shared, axis=1)], 0)
    return np.asarray(np.where(np.repeat(owner, sizes) > 0, np.repeat(owner, sizes), labels))


def _joined(state: RegionState, scale: float) -> RegionState:
    """Clusters that overlap an older one and weigh, times ``scale``, about one with it take its label, section 5.2."""
    names, masses, means = cluster_means(state)
    if len(names) < 2:
        return state
    boxes = boxes_of(means)
    near = np.tril(iou_matrix(boxes, boxes) > JOINED_OVERLAP, k=-1) & (scale * (masses[:, None] + masses) < WHOLE)
    target = np.where(near.any(axis=1), names[np.argmax(near, axis=1)], names)
    labels = target[np.searchsorted(names, state.labels)]
    order = np.argsort(labels, kind="stable")
    return replace(select(state, order), labels=labels[order])
