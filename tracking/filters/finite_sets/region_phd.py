"""The PHD filter on image regions: particles refer to the part of the image under them, section 6 of the paper.

States are rectangles with a memory, (63): ``x, y, x before, y before, width, height`` in pixels, centre and size. There
are no measured points, so what enters the update (46) is an argument, one of `region_likelihoods`; and what proposes
new targets, (51), is another: `AnywhereBirths` or `PatchBirths`. Time is counted in frames, and a step is one frame.

The ratio of a likelihood to its value on background may be so great that one frame makes a target certain. Where
patches flash, every flash begins a false target, which then rests on the next spot of the colour. So a new target has
to show again: M of N, as radar trackers begin tracks (Bar-Shalom and Li, "Multitarget-multisensor tracking", 1995).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from tsuiseki.tracking.features.colour_region import ColourImage
from tsuiseki.tracking.filters.base import Births, BornParticles, Motion, SetInfo, TargetEstimates
from tsuiseki.tracking.filters.finite_sets.clusters import (
    REPORTED,
    LabelledParticles,
    cluster_sizes,
    cluster_starts,
    first_particles,
)
from tsuiseki.tracking.filters.finite_sets.region_likelihoods import (
    EachAlone,
    Regions,
    Update,
    background_level,
    boxes_of,
    calibrated,
    cluster_means,
)
from tsuiseki.tracking.filters.resampling import logarithms, systematic
from tsuiseki.tracking.geometry import areas, intersections, iou_matrix
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class ExplainedImage:
    """The image evidence for births.

    Attributes:
        image: where the colour is.
        explained: ``(K, 4)`` boxes of the targets that are known.
    """

    image: ColourImage
    explained: FloatArray


FIRST_STEP = 3.0
"""Standard deviation of the first step of what is born, pixels a frame."""
PATCH_MASS = 0.05
"""Expected count of a patch before its likelihood is known."""
COLOURED = 0.3
"""Share of coloured pixels around a pixel from which it belongs to a patch."""


def _states(centres: FloatArray, sizes: FloatArray, rng: np.random.Generator) -> FloatArray:
    """States (63) at centres ``(J, 2)`` with sizes ``(J, 2)`` and random steps behind them."""
    previous = centres - FIRST_STEP * rng.standard_normal(centres.shape)
    return np.concatenate([centres, previous, np.maximum(sizes, 3.0)], axis=1)


@dataclass(frozen=True)
class AnywhereBirths:
    """Births as the paper has them: places uniform over the image, velocities about zero.

    Attributes:
        mass: expected births a frame, ``mu_Gamma``.
        count: particles.
        size: mean width and height, pixels.
    """

    mass: float
    count: int
    size: tuple[float, float]

    def draw(self, observation: ExplainedImage, rng: np.random.Generator) -> BornParticles:
        """Each particle is a group of its own."""
        centres = rng.random((self.count, 2)) * observation.image.size
        sizes = np.asarray(self.size) * np.exp(0.2 * rng.standard_normal((self.count, 2)))
        log_weights = logarithms(np.full(self.count, self.mass / max(self.count, 1)))
        return BornParticles(_states(centres, sizes, rng), log_weights, np.arange(self.count))


@dataclass(frozen=True)
class PatchBirths:
    """Births at patches of the colour that no target covers.

    Attributes:
        count: particles of a patch.
        smallest: least side of a patch, pixels.
        limit: patches a frame, the largest first.
    """

    count: int = 300
    smallest: float = 12.0
    limit: int = 20

    def draw(self, observation: ExplainedImage, rng: np.random.Generator) -> BornParticles:
        """A group of particles for each patch."""
        boxes = self.patches(observation.image, observation.explained)
        groups = np.repeat(np.arange(len(boxes)), self.count)
        centres = (boxes[:, :2] + boxes[:, 2:])[groups] / 2
        sizes = (boxes[:, 2:] - boxes[:, :2])[groups]
        centres = centres + 0.1 * sizes * rng.standard_normal(centres.shape)
        sizes = sizes * np.exp(0.15 * rng.standard_normal(sizes.shape))
        log_weights = logarithms(np.full(len(groups), PATCH_MASS / self.count))
        return BornParticles(_states(centres, sizes, rng), log_weights, np.arange(len(boxes)) * self.count)

    def patches(self, image: ColourImage, explained: FloatArray) -> FloatArray:
        """Boxes ``(G, 4)`` of the patches that no target explains, largest first.

        A patch apart from all targets may be a new one. A patch much smaller than the box over it, or much larger than
        the one box in it, shows that the box is wrong: several targets were taken for one, or a part for one.
        """
        boxes = self.components(image)
        if len(boxes) and len(explained):
            shared = intersections(boxes[:, None], explained[None])
            patch, target = areas(boxes)[:, None], areas(explained)[None]
            part = (shared > 0.7 * patch) & (patch < 0.6 * target)
            inside = shared > 0.5 * target
            around = inside & (inside.sum(axis=1, keepdims=True) == 1) & (target < 0.6 * patch)
            # Colour that adjoins a target is the rest of it, as when it comes in over the border.
            grown = explained + self.smallest / 2 * np.array([-1.0, -1.0, 1.0, 1.0])
            apart = intersections(boxes[:, None], grown[None]).max(axis=1) <= 0
            boxes = boxes[apart | (part | around).any(axis=1)]
        return boxes[: self.limit]

    def components(self, image: ColourImage) -> FloatArray:
        """Boxes ``(G, 4)`` of the connected patches, largest first, targets there or not."""
        side = 2 * (int(self.smallest) // 2) + 1
        colour = image.mask.astype(np.float32)
        dense = cv2.boxFilter(colour, -1, (side, side), borderType=cv2.BORDER_CONSTANT) > COLOURED
        _, _, stats, _ = cv2.connectedComponentsWithStats(dense.astype(np.uint8))
        x, y, width, height, area = stats[1:].T.astype(np.float64)
        large = np.flatnonzero((width >= self.smallest) & (height >= self.smallest))
        large = large[np.argsort(-area[large], kind="stable")]
        return np.stack([x, y, x + width, y + height], axis=1)[large]


SHARED = 0.5
"""Of the smaller of a target's box and a patch's, above which the patch is at the target."""


class Confirmation:
    """The confirmed targets, and the hits of the others.

    Args:
        hits: a target is confirmed once it was supported in so many frames,
        frames: of its first so many, at least ``hits``.
    """

    def __init__(self, hits: int, frames: int) -> None:
        self.hits, self.frames = hits, frames
        # Frames and hits of each target until it is confirmed.
        self._covered: dict[int, tuple[int, int]] = {}

    def update(self, labels: IntArray, supported: BoolArray) -> IntArray:
        """Take the targets of the next frame; the labels of those that cannot be confirmed any more.

        Args:
            labels: ``(T,)`` of all targets that are followed. A label that is missing is never used again.
            supported: ``(T,)`` whether a patch is at each.
        """
        previous, failed = self._covered, list[int]()
        self._covered = {}
        for name, hit in zip(labels.tolist(), supported.tolist(), strict=True):
            age, hits = previous.get(name, (0, 0))
            if hits < self.hits:
                age, hits = age + 1, hits + hit
                if hits < self.hits and age - hits > self.frames - self.hits:
                    failed.append(name)
            self._covered[name] = age, hits
        return np.array(failed, dtype=np.int64)

    def confirmed(self, labels: IntArray) -> BoolArray:
        """Which of the targets ``(N,)`` are confirmed."""
        hits = [self._covered.get(name, (0, 0))[1] for name in labels.tolist()]
        return np.array(hits, dtype=np.int64) >= self.hits


def at_patches(boxes: FloatArray, patches: FloatArray) -> BoolArray:
    """Which of the boxes ``(T, 4)`` have one of the patches ``(G, 4)`` at them, pixels."""
    if len(boxes) == 0 or len(patches) == 0:
        return np.zeros(len(boxes), dtype=np.bool_)
    smaller = np.minimum(areas(boxes)[:, None], areas(patches)[None])
    return np.asarray((intersections(boxes[:, None], patches[None]) > SHARED * smaller).any(axis=1))


TINY = float(np.finfo(np.float64).tiny)
SMALLEST_CLUSTER = 100
"""Particles that a cluster keeps at least."""
JOINED_OVERLAP = 0.05
"""Intersection over union above which two clusters are near, section 5.2."""
WHOLE = 1.5
"""Weight below which two near clusters are one target, section 5.2."""
ADOPTED_SHARE = 0.5
"""Of the smaller of two boxes, above which what is born lies on a cluster, section 5.2."""


@dataclass(frozen=True)
class RegionInfo(SetInfo):
    """What one step found: clusters whose weight is near one.

    Attributes:
        posterior: the weighted particles after the update, before they are drawn anew.
        background: ``b`` of this frame.
        likelihood: greatest ``h`` of each estimate.
    """

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
    """

    motion: Motion
    births: Births[ExplainedImage]
    likelihood: EachAlone
    update: Update = calibrated
    density: int = 500
    fixed: int = 0
    survival: float = 0.99
    detection: float = 0.95

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
        reported = scale * masses > REPORTED
        if self.fixed:
            reported &= tops > background  # a share is large also where nothing is seen anywhere
        estimates = TargetEstimates(names[reported], means[reported], np.minimum(scale * masses[reported], 1.0))
        return self._resample(posterior, rng), RegionInfo(estimates, count, posterior, background, tops[reported])

    def _predict(self, state: LabelledParticles, image: ColourImage, rng: np.random.Generator) -> LabelledParticles:
        """(44): survivors (48)-(49), and births where no reported target explains the image.

        Births have provisional labels (62); those that lie on a cluster take its label, section 5.2.
        """
        with np.errstate(divide="ignore"):
            survived = state.log_weights + np.log(self.survival)
        survivors = replace(state, particles=self.motion(state.particles, 1.0, rng), log_weights=survived)
        _, masses, means = cluster_means(survivors)
        born = self.births.draw(ExplainedImage(image, boxes_of(means[masses > REPORTED])), rng)
        labels = np.concatenate([state.labels, _adopted(survivors, born)])
        order = np.argsort(labels, kind="stable")
        union = LabelledParticles(
            np.concatenate([survivors.particles, born.particles]),
            labels,
            np.concatenate([survived, born.log_weights]),
            int(max(state.next_label, labels.max(initial=0) + 1)),
        )
        return union.select(order)

    def _resample(self, posterior: LabelledParticles, rng: np.random.Generator) -> LabelledParticles:
        """(56)-(59); of a light cluster at least `SMALLEST_CLUSTER` particles, of less weight."""
        weights, starts = np.exp(posterior.log_weights), cluster_starts(posterior.labels)
        total = float(weights.sum())
        if len(starts) == 0 or total <= 0.0:
            return posterior.select(np.zeros(len(posterior), dtype=np.bool_))
        if self.fixed:
            drawn = systematic(weights, self.fixed, rng)
            return replace(posterior.select(drawn), log_weights=np.full(self.fixed, np.log(total / self.fixed)))
        masses = np.add.reduceat(weights, starts)
        shares = np.where(masses > 1e-3, np.maximum(self.density * masses, SMALLEST_CLUSTER), 0.0)
        factor = np.repeat(shares / np.maximum(masses, TINY), cluster_sizes(starts, len(weights)))
        count = round(float(shares.sum()))
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
