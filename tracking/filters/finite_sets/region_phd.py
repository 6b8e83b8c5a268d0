"""The PHD filter on image regions: particles refer to the part of the image under them, section 6 of the paper.

States are rectangles with a memory, (63): ``x, y, x before, y before, width, height`` in pixels, centre and size. There
are no measured points, so what enters the update (46) is an argument, one of
:mod:`tsuiseki.tracking.filters.finite_sets.region_likelihoods`. Time is counted in frames, and a step is one frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.features.colour_region import ColourImage
from tsuiseki.tracking.filters.base import Births, BornParticles, Motion, TargetEstimates
from tsuiseki.tracking.filters.finite_sets.clusters import (
    LabelledParticles,
    cluster_sizes,
    cluster_starts,
    first_particles,
)
from tsuiseki.tracking.filters.finite_sets.region_births import ExplainedImage
from tsuiseki.tracking.filters.finite_sets.region_likelihoods import (
    RegionLikelihood,
    Regions,
    Update,
    background_level,
    boxes_of,
    calibrated,
    cluster_means,
)
from tsuiseki.tracking.filters.resampling import systematic
from tsuiseki.tracking.geometry import areas, intersections, iou_matrix
from tsuiseki.tracking.types import FloatArray, IntArray

TINY = float(np.finfo(np.float64).tiny)
JOINED_OVERLAP = 0.05
"""Intersection over union above which two clusters are near, section 5.2."""
WHOLE = 1.5
"""Weight below which two near clusters are one target, section 5.2."""
ADOPTED_SHARE = 0.5
"""Of the smaller of two boxes, above which what is born lies on a cluster, section 5.2."""


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

    estimates: TargetEstimates
    expected_count: float
    posterior: LabelledParticles
    background: float
    likelihood: FloatArray


@dataclass(frozen=True)
class RegionPhdFilter:
    """Settings and step of the filter.

    Attributes:
        motion: draws the next states, (64).
        births: proposes new targets, (51).
        likelihood: :class:`WithoutOthers`, or :class:`EachAlone` as printed.
        update: :data:`calibrated`, :func:`as_printed`, or either :class:`Equalised`.
        density: particles for each expected target, (56).
        fixed: number of particles whatever the count, for an update whose count means nothing; 0 follows the count.
        survival: ``pS`` in [0, 1].
        detection: ``pD`` in [0, 1].
        report: a cluster is an estimate above this weight.
        smallest_cluster: particles that a cluster keeps at least.
    """

    motion: Motion
    births: Births[ExplainedImage]
    likelihood: RegionLikelihood
    update: Update = calibrated
    density: int = 500
    fixed: int = 0
    survival: float = 0.99
    detection: float = 0.95
    report: float = 0.5
    smallest_cluster: int = 100

    def __post_init__(self) -> None:
        for name, value in (("survival", self.survival), ("detection", self.detection)):
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"expected the probability of {name} in [0, 1], got {value}")

    def init(self, particles: FloatArray, labels: IntArray | None = None, count: float = 0.0) -> LabelledParticles:
        """``count`` expected targets spread evenly over particles ``(N, 6)``; ``(0, 6)`` begins with no target.

        Args:
            particles: of all targets.
            labels: ``(N,)`` positive, of the target that each particle is of; None is one target.
            count: expected targets in all.

        Raises:
            ValueError: a particle is not finite, or the count is negative or has no particle to stand on.
        """
        first = first_particles(particles, count)
        if labels is None or len(first) == 0:
            return first
        order = np.argsort(labels, kind="stable")
        labels = np.asarray(labels, dtype=np.int64)
        return replace(first, labels=labels, next_label=int(labels.max()) + 1).select(order)

    def step(
        self, state: LabelledParticles, observation: ColourImage, rng: np.random.Generator
    ) -> tuple[LabelledParticles, RegionInfo]:
        """One frame further: predict, bear, weigh, update, tidy, read off the targets, draw anew."""
        predicted = self._predict(state, observation, rng)
        log_likelihood = self.likelihood(predicted, observation)
        background = background_level(observation, predicted, self.likelihood.margin, rng)
        starts = cluster_starts(predicted.labels)
        regions = Regions(predicted.log_weights, log_likelihood, starts, background, self.detection)
        updated = replace(predicted, log_weights=self.update(regions))
        count = updated.expected_count
        # With a fixed number of particles a cluster's weight is read off its share of them.
        scale = self.fixed / (self.density * max(count, TINY)) if self.fixed else 1.0
        posterior = _joined(updated, scale)
        names, masses, means = cluster_means(posterior)
        tops = np.exp(np.fmax.reduceat(log_likelihood, starts)) if len(starts) else np.empty(0)
        tops = tops[np.searchsorted(predicted.labels[starts], names)]
        shown = scale * masses > self.report
        if self.fixed:
            shown &= tops > background  # a share is large also where nothing is seen anywhere
        estimates = TargetEstimates(names[shown], means[shown], np.minimum(scale * masses[shown], 1.0))
        return self._resample(posterior, rng), RegionInfo(estimates, count, posterior, background, tops[shown])

    def _predict(self, state: LabelledParticles, image: ColourImage, rng: np.random.Generator) -> LabelledParticles:
        """(44): survivors (48)-(49), and births where no reported target explains the image."""
        with np.errstate(divide="ignore"):
            survived = state.log_weights + np.log(self.survival)
        survivors = replace(state, particles=self.motion(state.particles, 1.0, rng), log_weights=survived)
        _, masses, means = cluster_means(survivors)
        return self._with_births(survivors, image, boxes_of(means[masses > self.report]), rng)

    def _with_births(
        self, state: LabelledParticles, image: ColourImage, explained: FloatArray, rng: np.random.Generator
    ) -> LabelledParticles:
        """Births with provisional labels (62); those that lie on a cluster take its label, section 5.2."""
        born = self.births.draw(ExplainedImage(image, explained), rng)
        labels = np.concatenate([state.labels, _adopted(state, born)])
        order = np.argsort(labels, kind="stable")
        joined = LabelledParticles(
            np.concatenate([state.particles, born.particles]),
            labels,
            np.concatenate([state.log_weights, born.log_weights]),
            int(max(state.next_label, labels.max(initial=0) + 1)),
        )
        return joined.select(order)

    def _resample(self, posterior: LabelledParticles, rng: np.random.Generator) -> LabelledParticles:
        """(56)-(59); of a light cluster at least ``smallest_cluster`` particles, of less weight."""
        weights, starts = np.exp(posterior.log_weights), cluster_starts(posterior.labels)
        total = float(weights.sum())
        if len(starts) == 0 or total <= 0.0:
            return posterior.select(np.zeros(len(posterior), dtype=np.bool_))
        if self.fixed:
            drawn = systematic(weights, self.fixed, rng)
            return replace(posterior.select(drawn), log_weights=np.full(self.fixed, np.log(total / self.fixed)))
        masses = np.add.reduceat(weights, starts)
        wanted = np.where(masses > 1e-3, np.maximum(self.density * masses, self.smallest_cluster), 0.0)
        factor = np.repeat(wanted / np.maximum(masses, TINY), cluster_sizes(starts, len(weights)))
        count = round(float(wanted.sum()))
        if count == 0:
            return posterior.select(np.zeros(len(posterior), dtype=np.bool_))
        drawn = systematic(weights * factor, count, rng)
        return replace(posterior.select(drawn), log_weights=-np.log(factor[drawn]))


def _adopted(state: LabelledParticles, born: BornParticles) -> IntArray:
    """Labels ``(J,)`` of born particles: that of the cluster that their group lies on most, or new ones."""
    groups = born.groups
    labels = state.next_label + groups
    names, _, means = cluster_means(state)
    if len(names) == 0 or len(groups) == 0:
        return labels
    sizes = cluster_sizes(born.starts, len(groups))
    places = boxes_of(np.add.reduceat(born.particles, born.starts, axis=0) / sizes[:, None])
    there = boxes_of(means)
    smaller = np.minimum(areas(places)[:, None], areas(there)[None])
    shared = intersections(places[:, None], there[None]) / smaller
    owner = np.where(shared.max(axis=1) > ADOPTED_SHARE, names[np.argmax(shared, axis=1)], 0)
    return np.asarray(np.where(owner[groups] > 0, owner[groups], labels))


def _joined(state: LabelledParticles, scale: float) -> LabelledParticles:
    """Clusters that overlap an older one and weigh, times ``scale``, about one with it take its label, section 5.2."""
    names, masses, means = cluster_means(state)
    if len(names) < 2:
        return state
    boxes = boxes_of(means)
    near = np.tril(iou_matrix(boxes, boxes) > JOINED_OVERLAP, k=-1) & (scale * (masses[:, None] + masses) < WHOLE)
    target = np.where(near.any(axis=1), names[np.argmax(near, axis=1)], names)
    labels = target[np.searchsorted(names, state.labels)]
    order = np.argsort(labels, kind="stable")
    return replace(state.select(order), labels=labels[order])
