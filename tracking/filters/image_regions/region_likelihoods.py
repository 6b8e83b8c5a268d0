"""What the image says of coloured regions among others: (68) for each particle, and its level on background."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tsuiseki.tracking.features.colour_region import ColourImage, region_contrast
from tsuiseki.tracking.filters.finite_sets.labelled_particles import LabelledParticles, cluster_sizes, cluster_starts
from tsuiseki.tracking.filters.image_regions.region_states import boxes_of, cluster_means
from tsuiseki.tracking.filters.particles.weights import logarithms
from tsuiseki.tracking.geometry import grown, intersections
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

MOST_OTHERS = 4
"""Nearest other targets whose pixels are taken from a cluster."""
OUTLINE = 0.15
"""Growth of the boxes that take pixels from others: a fringe left over would be a target to them."""


class RegionLikelihood(Protocol):
    """``log h`` ``(N,)`` of labelled particles, NaN where the image says nothing.

    Attributes:
        margin: of the frame around a box, for ``q``.
    """

    @property
    def margin(self) -> float: ...

    def __call__(self, state: LabelledParticles, image: ColourImage, /) -> FloatArray: ...


@dataclass(frozen=True)
class EachAlone:
    """(68) of each particle, whatever else is there.

    Attributes:
        margin: of the frame around a box, for ``q``.
    """

    margin: float = 0.5

    def __call__(self, state: LabelledParticles, image: ColourImage) -> FloatArray:
        """See `RegionLikelihood`."""
        return logarithms(region_contrast(image, boxes_of(state.particles), self.margin))


@dataclass(frozen=True)
class WithoutOthers:
    """(68) of each particle without the pixels that other targets cover; those speak for the others alone.

    Of two targets that overlap, the one whose box fits better alone is in front and keeps the pixels of both. A
    particle mostly behind others cannot be judged by what is left of it: its likelihood is NaN, as if ``pD`` were zero
    there. What was never seen is not behind anything: there the likelihood is zero.

    Attributes:
        margin: of the frame around a box, for ``q``.
        believed: a cluster that weighs more is a target, and covers others.
    """

    margin: float = 0.5
    believed: float = 0.5

    def __call__(self, state: LabelledParticles, image: ColourImage) -> FloatArray:
        """See `RegionLikelihood`."""
        if len(state) == 0:
            return np.empty(0)
        _, masses, means = cluster_means(state)
        boxes, starts = boxes_of(means), cluster_starts(state.labels)
        counted = masses > self.believed
        touching = _touching(boxes, _reach(grown(boxes_of(state.particles), self.margin), starts), counted)
        front = touching & _fits_better(region_contrast(image, boxes, self.margin), counted)
        most = min(int(touching.sum(axis=1).max()), MOST_OTHERS)
        apart = np.linalg.norm(means[:, None, :2] - means[None, :, :2], axis=2)
        nearest = np.argsort(np.where(touching, apart, np.inf), axis=1, kind="stable")[:, :most]
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
        unseen = np.isnan(contrast) & np.repeat(masses <= self.believed, sizes)
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


def _reach(boxes: FloatArray, starts: IntArray) -> FloatArray:
    """The least box ``(G, 4)`` around all of each cluster's boxes ``(N, 4)``."""
    low, high = np.minimum.reduceat(boxes[:, :2], starts, axis=0), np.maximum.reduceat(boxes[:, 2:], starts, axis=0)
    return np.concatenate([low, high], axis=1)


def _touching(boxes: FloatArray, reach: FloatArray, counted: BoolArray) -> BoolArray:
    """Which counted boxes lie in each cluster's reach ``(G, G)``, itself excepted."""
    near = (intersections(reach[:, None], boxes[None]) > 0) & counted[None, :]
    np.fill_diagonal(near, val=False)
    return near


def _fits_better(fit: FloatArray, counted: BoolArray) -> BoolArray:
    """``(G, G)`` whether the second is in front of the first: the only one that counts, the better fit, the older."""
    order = np.lexsort((np.arange(len(fit)), -fit, ~counted))
    rank = np.empty(len(fit), dtype=np.int64)
    rank[order] = np.arange(len(fit))
    return np.asarray(rank[None, :] < rank[:, None])
