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
from tsuiseki.tracking.filters.region_states import RegionState, boxes_of, cluster_means, select
from tsuiseki.tracking.filters.region_updates import Regions, Update, calibrated
from tsuiseki.tracking.filters.resampling import Resampler, systematic
from tsuiseki.tracking.geometry import intersections, iou_matrix
from tsuiseki.tracking.likelihoods.colour_region import ColourImage, region_likelihood
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

JOINED_OVERLAP = 0.3
HIDDEN_SHARE = 0.4
MOST_OTHERS = 4


class RegionBirths(Protocol):
    """Proposes new targets: particles ``(J, 6)``, expected counts ``(J,)``, and a group number ``(J,)`` from 0 each."""

    def __call__(
        self, image: ColourImage, explained: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray, IntArray]: ...


class RegionLikelihood(Protocol):
    """``h`` ``(N,)`` of the particles, NaN where the image says nothing; ``believed`` is the weight of a target."""

    def __call__(self, state: RegionState, image: ColourImage, margin: float, believed: float) -> FloatArray: ...


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
        with np.errstate(divide="ignore"):
            survived = state.log_weights + np.log(self.survival)
        survivors = replace(state, particles=self.motion(state.particles, rng), log_weights=survived)
        _, masses, means = cluster_means(survivors)
        predicted = self._with_births(survivors, observation, boxes_of(means[masses > self.report]), rng)
        likelihood = self.likelihood(predicted, observation, self.margin, self.report)
        background = background_level(observation, predicted, self.margin, rng)
        weights = np.exp(predicted.log_weights)
        starts = group_starts(predicted.labels)
        after = self.update(Regions(weights, likelihood, starts, background, self.detection))
        with np.errstate(divide="ignore"):
            posterior = _joined(replace(predicted, log_weights=np.log(after)))
        names, masses, means = cluster_means(posterior)
        shown = masses > self.report
        tops = np.fmax.reduceat(likelihood, starts) if len(starts) else np.empty(0)
        top = tops[np.searchsorted(predicted.labels[starts], names[shown])]
        estimates = PointEstimates(names[shown], means[shown], np.minimum(masses[shown], 1.0))
        info = RegionInfo(estimates, float(np.exp(posterior.log_weights).sum()), posterior, background, top)
        return self._resample(posterior, rng), info

    def _with_births(
        self, state: RegionState, image: ColourImage, explained: FloatArray, rng: np.random.Generator
    ) -> RegionState:
        born, weights, groups = self.births(image, explained, rng)
        with np.errstate(divide="ignore"):
            log_weights = np.log(weights)
        return RegionState(
            np.concatenate([state.particles, born]),
            np.concatenate([state.labels, state.next_label + groups]),
            np.concatenate([state.log_weights, log_weights]),
            state.next_label + int(groups.max(initial=-1)) + 1,
        )

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
        factor = np.repeat(wanted / np.maximum(masses, np.finfo(np.float64).tiny), sizes)
        count = round(float(wanted.sum()))
        if count == 0:
            return select(posterior, np.zeros(len(posterior), dtype=np.bool_))
        drawn = self.resample(weights * factor, count, rng)
        return replace(select(posterior, drawn), log_weights=-np.log(factor[drawn]))


def each_alone(state: RegionState, image: ColourImage, margin: float, believed: float) -> FloatArray:
    """(68) of each particle, whatever else is there."""
    del believed
    return region_likelihood(image, boxes_of(state.particles), margin)


def without_others(state: RegionState, image: ColourImage, margin: float, believed: float) -> FloatArray:
    """(68) of each particle without the pixels that other targets cover; those speak for the others alone.

    A target mostly behind others cannot be judged by what is left of it: its likelihood is NaN, and it is carried on.
    """
    _, masses, means = cluster_means(state)
    if len(state) == 0:
        return np.empty(0)
    boxes = boxes_of(means)
    touching = _touching(boxes, masses > believed, 1.0 + margin)
    most = min(int(touching.sum(axis=1).max()), MOST_OTHERS)
    nearest = np.argsort(~touching, axis=1, kind="stable")[:, :most]
    others = np.where(np.take_along_axis(touching, nearest, axis=1)[:, :, None], boxes[nearest], 0.0)
    sizes = np.diff(np.append(group_starts(state.labels), len(state)))
    likelihood = region_likelihood(image, boxes_of(state.particles), margin, np.repeat(others, sizes, axis=0))
    hidden = (_covered(boxes, touching) > HIDDEN_SHARE) & (masses > believed)
    return np.where(np.repeat(hidden, sizes), np.nan, likelihood)


def background_level(image: ColourImage, state: RegionState, margin: float, rng: np.random.Generator) -> float:
    """What ``h`` reaches on background: its 0.95 quantile over boxes like the particles' at random places.

    Boxes that lie on a cluster are left out. At least 0.05, so that a colour that is nowhere (or everywhere, where
    ``h`` is zero too) does not make every spot a target.
    """
    width, height = image.size
    sizes = state.particles[:, 4:6] if len(state) else np.array([[width, height]]) / 16.0
    chosen = sizes[rng.integers(len(sizes), size=300)]
    centres = rng.random((300, 2)) * [width, height]
    boxes = np.concatenate([centres - chosen / 2, centres + chosen / 2], axis=1)
    _, masses, means = cluster_means(state)
    claimed = boxes_of(means[masses > 0.1])
    if len(claimed):
        boxes = boxes[intersections(boxes[:, None], claimed[None]).max(axis=1) <= 0]
    if len(boxes) == 0:
        return 0.05
    return max(float(np.quantile(region_likelihood(image, boxes, margin), 0.95)), 0.05)


def _touching(boxes: FloatArray, counted: BoolArray, grown: float) -> BoolArray:
    """Which counted boxes ``(G, G)`` lie on each box grown by a factor, itself excepted."""
    centre, half = (boxes[:, :2] + boxes[:, 2:]) / 2, (boxes[:, 2:] - boxes[:, :2]) / 2 * grown
    wide = np.concatenate([centre - half, centre + half], axis=1)
    near = (intersections(wide[:, None], boxes[None]) > 0) & counted[None, :]
    np.fill_diagonal(near, val=False)
    return near


def _covered(boxes: FloatArray, touching: BoolArray) -> FloatArray:
    """Share ``(G,)`` of each box that the touching ones cover."""
    area = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
    shared = (intersections(boxes[:, None], boxes[None]) * touching).sum(axis=1)
    return np.asarray(np.minimum(shared / np.maximum(area, 1.0), 1.0))


def _joined(state: RegionState) -> RegionState:
    """Clusters that overlap an older one and weigh about one with it take its label, section 5.2."""
    names, masses, means = cluster_means(state)
    if len(names) < 2:
        return state
    boxes = boxes_of(means)
    near = np.tril(iou_matrix(boxes, boxes) > JOINED_OVERLAP, k=-1) & (masses[:, None] + masses[None, :] < 1.5)
    target = np.where(near.any(axis=1), names[np.argmax(near, axis=1)], names)
    labels = target[np.searchsorted(names, state.labels)]
    order = np.argsort(labels, kind="stable")
    return replace(select(state, order), labels=labels[order])
