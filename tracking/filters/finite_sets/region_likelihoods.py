"""What the image says of coloured regions among others, and what that does to their weights, section 6 of the paper.

States are rectangles that remember where they were in the frame before, (63). The likelihood of each particle is (68).
Nothing was measured as a point, so (46) has alternatives:

* :func:`as_printed`: the likelihood ``h = p (1 - q)`` itself. Since ``h <= 1`` the expected count can only shrink,
  whatever the image shows: the weights rank particles, and their sum means nothing.
* :class:`Calibrated`: the likelihood over its value ``b`` on background. Take (46) for one cluster of weight ``m`` and
  the part of the image under it as the one measurement ``y`` there. If no target is there, ``y`` is background, with
  density proportional to ``b``; this takes the place of the clutter ``mu_C p_C(y)`` and is weighed by the probability
  ``1 - m`` that the cluster is nothing. (45) then reads ``D'(x) = {(1 - pD) + pD h(x)/b} D(x) / {(1 - m) + m <(1 - pD)
  + pD h/b>}``: the posterior of a target that is there or not. A cluster measured well above the background weighs
  about one however pure its colour, one at the level of the background keeps its weight, a missed one loses it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.features.colour_region import ColourImage, region_contrast
from tsuiseki.tracking.filters.finite_sets.clusters import (
    LabelledParticles,
    cluster_moments,
    cluster_sizes,
    cluster_starts,
)
from tsuiseki.tracking.filters.point_motion import SMALLEST_SIDE
from tsuiseki.tracking.filters.resampling import logarithms
from tsuiseki.tracking.geometry import grown, intersections
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


def boxes_of(states: FloatArray) -> FloatArray:
    """Boxes ``(N, 4)`` x1, y1, x2, y2 of states ``(N, 6)``."""
    half = states[:, 4:6] / 2
    return np.concatenate([states[:, :2] - half, states[:, :2] + half], axis=1)


def cluster_means(state: LabelledParticles) -> tuple[IntArray, FloatArray, FloatArray]:
    """Label, weight and mean state of each cluster."""
    starts = cluster_starts(state.labels)
    masses, means = cluster_moments(state, starts)
    means[:, 4:] = np.maximum(means[:, 4:], SMALLEST_SIDE)
    return state.labels[starts], masses, means


COVERING = 0.5
"""A cluster that weighs more is a target, and covers others."""
MOST_OTHERS = 4
"""Nearest other targets whose pixels are taken from a cluster."""
OUTLINE = 0.15
"""Growth of the boxes that take pixels from others: a fringe left over would be a target to them."""


@dataclass(frozen=True)
class EachAlone:
    """(68) of each particle, whatever else is there.

    Attributes:
        margin: of the frame around a box, for ``q``.
    """

    margin: float = 0.5

    def __call__(self, state: LabelledParticles, image: ColourImage) -> FloatArray:
        """``log h`` ``(N,)`` of labelled particles, NaN where the image says nothing."""
        return logarithms(region_contrast(image, boxes_of(state.particles), self.margin))


@dataclass(frozen=True)
class WithoutOthers(EachAlone):
    """(68) of each particle without the pixels that other targets cover; those speak for the others alone.

    Of two targets that overlap, the one whose box fits better alone is in front and keeps the pixels of both. A
    particle mostly behind others cannot be judged by what is left of it: its likelihood is NaN, as if ``pD`` were zero
    there. What was never seen is not behind anything: there the likelihood is zero.
    """

    def __call__(self, state: LabelledParticles, image: ColourImage) -> FloatArray:
        if len(state) == 0:
            return np.empty(0)
        _, masses, means = cluster_means(state)
        boxes, starts = boxes_of(means), cluster_starts(state.labels)
        counted = masses > COVERING
        # The least box around all of each cluster's boxes, with the margin.
        low, high = np.split(grown(boxes_of(state.particles), self.margin), 2, axis=1)
        reach = np.column_stack([np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)])
        touching = (intersections(reach[:, None], boxes[None]) > 0) & counted
        np.fill_diagonal(touching, val=False)
        front = touching & _fits_better(region_contrast(image, boxes, self.margin), counted)
        count = min(int(touching.sum(axis=1).max()), MOST_OTHERS)
        apart = np.linalg.norm(means[:, None, :2] - means[None, :, :2], axis=2)
        nearest = np.argsort(np.where(touching, apart, np.inf), axis=1, kind="stable")[:, :count]
        there = np.take_along_axis(touching, nearest, axis=1)[:, :, None]
        others = np.where(there, grown(boxes, OUTLINE)[nearest], 0.0)
        in_front = np.take_along_axis(front, nearest, axis=1)
        sizes = cluster_sizes(starts, len(state))
        contrast = region_contrast(
            image,
            boxes_of(state.particles),
            self.margin,
            np.repeat(others, sizes, axis=0),
            np.repeat(in_front, sizes, axis=0),
        )
        unseen = np.isnan(contrast) & np.repeat(masses <= COVERING, sizes)
        return logarithms(np.where(unseen, 0.0, contrast))


def background_level(image: ColourImage, state: LabelledParticles, margin: float, rng: np.random.Generator) -> float:
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
    return max(float(np.quantile(region_contrast(image, boxes, margin), 0.95)), 0.05)


def _fits_better(fit: FloatArray, counted: BoolArray) -> BoolArray:
    """``(G, G)`` whether the second is in front of the first: the only one that counts, the better fit, the older."""
    order = np.lexsort((np.arange(len(fit)), -fit, ~counted))
    rank = np.empty(len(fit), dtype=np.int64)
    rank[order] = np.arange(len(fit))
    return np.asarray(rank[None, :] < rank[:, None])


LARGEST_LOG_RATIO = float(np.log(1e12))
"""Bound of the ratio's logarithm, so that one particle cannot stand for all."""


@dataclass(frozen=True)
class Regions:
    """The image evidence for the update.

    Attributes:
        log_weights: ``(N,)`` predicted.
        log_likelihood: ``(N,)`` logarithm of ``h = p (1 - q)``, NaN for a target hidden by others.
        starts: ``(G,)`` first particle of each cluster.
        background: ``b``, what ``h`` reaches on background.
        detection: ``pD``.
    """

    log_weights: FloatArray
    log_likelihood: FloatArray
    starts: IntArray
    background: float
    detection: float

    @property
    def weights(self) -> FloatArray:
        """``(N,)`` expected targets of each particle."""
        return np.asarray(np.exp(self.log_weights))

    @property
    def likelihood(self) -> FloatArray:
        """``(N,)`` ``h``, zero for a target hidden by others."""
        return np.asarray(np.nan_to_num(np.exp(self.log_likelihood)))

    def sums(self, values: FloatArray) -> FloatArray:
        """Sums ``(G,)`` over the clusters of values ``(N,)``."""
        return np.asarray(np.add.reduceat(values, self.starts)) if len(self.starts) else np.empty(0)

    def spread(self, values: FloatArray) -> FloatArray:
        """Values ``(G,)`` of the clusters at their particles ``(N,)``."""
        return np.repeat(values, np.diff(self.starts, append=len(self.log_weights)))


Update = Callable[[Regions], FloatArray]
"""The log-weights ``(N,)`` after the update."""


def as_printed(regions: Regions) -> FloatArray:
    """(45) with the likelihood (68) in the place of (46), as section 6.2 has it."""
    return logarithms(regions.weights * (1.0 - regions.detection + regions.detection * regions.likelihood))


@dataclass(frozen=True)
class Calibrated:
    """(45) with the ratio of the likelihood to its value on background, cluster by cluster; see the module.

    Attributes:
        sharpness: power of the ratio, > 0. Above 1 it makes up for ``p (1 - q)`` being flat about its top.
    """

    sharpness: float = 4.0

    def __call__(self, regions: Regions) -> FloatArray:
        log_ratio = np.minimum(
            self.sharpness * (regions.log_likelihood - np.log(regions.background)), LARGEST_LOG_RATIO
        )
        ratio = np.exp(np.where(np.isnan(log_ratio), 0.0, log_ratio))  # hidden: the image says nothing
        weights = regions.weights
        joint = weights * (1.0 - regions.detection + regions.detection * ratio)
        mass = np.minimum(regions.sums(weights), 1.0)
        total = 1.0 - mass + regions.sums(joint)
        return logarithms(joint / regions.spread(np.maximum(total, np.finfo(np.float64).tiny)))


calibrated = Calibrated()


VISIBLE = 0.1
"""A cluster whose likelihood nowhere reaches this is not a target and stays as it is when others are raised."""


@dataclass(frozen=True)
class Equalised:
    """Raises the likelihood of every target to the same level before the update, end of section 6.2.

    The log-likelihood of each cluster is raised by what its level lacks to the highest; without it the particles of a
    target of low likelihood die out.

    Attributes:
        update: what follows.
    """

    update: Update

    def __call__(self, regions: Regions) -> FloatArray:
        if len(regions.starts) == 0:
            return self.update(regions)
        # The greatest likelihood in each cluster, which the paper compares.
        level = np.maximum.reduceat(regions.likelihood, regions.starts)
        visible, level = level >= VISIBLE, np.maximum(level, 1e-6)
        raised = np.where(visible, np.max(level[visible], initial=0.0) / level, 1.0)
        return self.update(replace(regions, log_likelihood=regions.log_likelihood + regions.spread(np.log(raised))))
