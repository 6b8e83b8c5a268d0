"""Proposals of new targets in an image, (51): anywhere, or where the colour is and nothing explains it yet.

Which new targets are confirmed: those with a patch of the colour in several frames.

The ratio of a likelihood to its value on background may be so great that one frame makes a target certain. Where
patches flash, every flash begins a false target, which then rests on the next spot of the colour. So a new target has
to show again: M of N, as radar trackers begin tracks (Bar-Shalom and Li, "Multitarget-multisensor tracking", 1995).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tsuiseki.tracking.features.colour_region import ColourImage
from tsuiseki.tracking.filters.base import BornParticles
from tsuiseki.tracking.filters.resampling import logarithms
from tsuiseki.tracking.geometry import areas, intersections
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


def _states(centres: FloatArray, sizes: FloatArray, speed: float, rng: np.random.Generator) -> FloatArray:
    """States (63) at centres ``(J, 2)`` with sizes ``(J, 2)`` and random steps behind them."""
    before = centres - speed * rng.standard_normal(centres.shape)
    return np.concatenate([centres, before, np.maximum(sizes, 3.0)], axis=1)


@dataclass(frozen=True)
class AnywhereBirths:
    """Births as the paper has them: places uniform over the image, velocities about zero.

    Attributes:
        mass: expected births a frame, ``mu_Gamma``.
        count: particles.
        size: mean width and height, pixels.
        speed: standard deviation of the first step, pixels a frame.
    """

    mass: float
    count: int
    size: tuple[float, float]
    speed: float = 3.0

    def draw(self, observation: ExplainedImage, rng: np.random.Generator) -> BornParticles:
        """See `Births`; each particle is a group of its own."""
        centres = rng.random((self.count, 2)) * observation.image.size
        sizes = np.asarray(self.size) * np.exp(0.2 * rng.standard_normal((self.count, 2)))
        log_weights = logarithms(np.full(self.count, self.mass / max(self.count, 1)))
        return BornParticles(_states(centres, sizes, self.speed, rng), log_weights, np.arange(self.count))


@dataclass(frozen=True)
class PatchBirths:
    """Births at patches of the colour that no target covers.

    Attributes:
        mass: expected count of a patch before its likelihood is known, in (0, 1).
        count: particles of a patch.
        smallest: least side of a patch, pixels.
        limit: patches a frame, the largest first.
        share: of coloured pixels around a pixel from which it belongs to a patch, in (0, 1].
        speed: standard deviation of the first step, pixels a frame.
    """

    mass: float = 0.05
    count: int = 300
    smallest: float = 12.0
    limit: int = 20
    share: float = 0.3
    speed: float = 3.0

    def draw(self, observation: ExplainedImage, rng: np.random.Generator) -> BornParticles:
        """See `Births`; a group of particles for each patch."""
        boxes = self.patches(observation.image, observation.explained)
        groups = np.repeat(np.arange(len(boxes)), self.count)
        centres = (boxes[:, :2] + boxes[:, 2:])[groups] / 2
        sizes = (boxes[:, 2:] - boxes[:, :2])[groups]
        centres = centres + 0.1 * sizes * rng.standard_normal(centres.shape)
        sizes = sizes * np.exp(0.15 * rng.standard_normal(sizes.shape))
        log_weights = logarithms(np.full(len(groups), self.mass / self.count))
        return BornParticles(_states(centres, sizes, self.speed, rng), log_weights, np.arange(len(boxes)) * self.count)

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
            whole = inside & (inside.sum(axis=1, keepdims=True) == 1) & (target < 0.6 * patch)
            # Colour that adjoins a target is the rest of it, as when it comes in over the border.
            grown = explained + self.smallest / 2 * np.array([-1.0, -1.0, 1.0, 1.0])
            apart = intersections(boxes[:, None], grown[None]).max(axis=1) <= 0
            boxes = boxes[apart | (part | whole).any(axis=1)]
        return boxes[: self.limit]

    def components(self, image: ColourImage) -> FloatArray:
        """Boxes ``(G, 4)`` of the connected patches, largest first, targets there or not."""
        side = 2 * (int(self.smallest) // 2) + 1
        colour = image.mask.astype(np.float32)
        dense = cv2.boxFilter(colour, -1, (side, side), borderType=cv2.BORDER_CONSTANT) > self.share
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
        self._confirmed: set[int] = set()
        self._covered: dict[int, tuple[int, int]] = {}  # frames and hits of each target not confirmed yet

    def update(self, labels: IntArray, supported: BoolArray) -> IntArray:
        """Take the targets of the next frame; the labels of those that cannot be confirmed any more.

        Args:
            labels: ``(T,)`` of all targets that are followed. A label that is missing is never used again.
            supported: ``(T,)`` whether a patch is at each.
        """
        names = labels.tolist()
        self._confirmed.intersection_update(names)
        self._covered = {name: self._covered.get(name, (0, 0)) for name in names if name not in self._confirmed}
        failed = []
        for name, hit in zip(names, supported.tolist(), strict=True):
            if name in self._confirmed:
                continue
            age, hits = self._covered[name]
            self._covered[name] = age, hits = age + 1, hits + hit
            if hits >= self.hits:
                self._confirmed.add(name)
            elif age - hits > self.frames - self.hits:
                failed.append(name)
        return np.array(failed, dtype=np.int64)

    def confirmed(self, labels: IntArray) -> BoolArray:
        """Which of the targets ``(N,)`` are confirmed."""
        return np.array([name in self._confirmed for name in labels.tolist()], dtype=np.bool_)


def at_patches(boxes: FloatArray, patches: FloatArray) -> BoolArray:
    """Which of the boxes ``(T, 4)`` have one of the patches ``(G, 4)`` at them, pixels."""
    if len(boxes) == 0 or len(patches) == 0:
        return np.zeros(len(boxes), dtype=np.bool_)
    smaller = np.minimum(areas(boxes)[:, None], areas(patches)[None])
    return np.asarray((intersections(boxes[:, None], patches[None]) > SHARED * smaller).any(axis=1))
