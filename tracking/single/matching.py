"""Trackers that search for the region most like the first one; thesis 2.2.1 and 2.2.3.

`ColourParticle` is Perez et al., "Color-based probabilistic tracking", ECCV 2002: particles are boxes ``x, y, scale``;
the likelihood falls with the squared Bhattacharyya distance between the histogram of a box and the first frame's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.filters.base import bootstrap
from tsuiseki.tracking.filters.kalman import Gaussians, log_likelihood, predict, update
from tsuiseki.tracking.filters.particle_filter import ParticleFilter
from tsuiseki.tracking.filters.point_motion import PlaneVelocity, PlaneWalk
from tsuiseki.tracking.filters.resampling import probabilities
from tsuiseki.tracking.single.search_windows import cut
from tsuiseki.tracking.single.tracker import TargetState, box_about, box_centre
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray

Measure = Literal["ssd", "sad", "ncc"]
# Pixels of the longer side when matching; matching costs its square times the window's.
TEMPLATE_SIDE = 32
# How far from the last place is searched, in sides of the target.
REACH = 1
# Likeness of templates under which the target is lost.
LIKE = 0.75
# Intersection of histograms under which the target is lost.
SHARED = 0.5
# Bhattacharyya coefficient under which the target is lost.
SAME_COLOURS = 0.6


def match(area: ImageArray, template: ImageArray, measure: Measure) -> NDArray[np.float32]:
    """Likeness ``(H - h + 1, W - w + 1)`` of a template ``(h, w)`` to the regions of a grey area ``(H, W)``, at most 1.

    ``ncc`` is equation (2.3); ``ssd`` (2.1) and ``sad`` (2.2) become ``1 - root of the mean square`` and ``1 - mean``
    of the differences, over 255.
    """
    if measure == "ncc":
        return np.asarray(cv2.matchTemplate(area, template, cv2.TM_CCORR_NORMED))
    if measure == "ssd":
        squares = cv2.matchTemplate(area, template, cv2.TM_SQDIFF) / template.size
        return np.asarray(1 - np.sqrt(np.maximum(squares, 0)) / 255, dtype=np.float32)
    regions = np.lib.stride_tricks.sliding_window_view(area, template.shape).astype(np.int16)
    return np.asarray(1 - np.abs(regions - template.astype(np.int16)).mean(axis=(2, 3)) / 255, dtype=np.float32)


class RegionSearch:
    """Compares all places within `REACH` of the last one, in an image that is scaled to a small target."""

    def _learn(self, image: ImageArray, box: FloatArray) -> ImageArray:
        """The scaled target of the first frame."""
        self._size, self._centre = np.asarray(box[2:] - box[:2], dtype=np.float64), box_centre(box)
        self._scale = max(float(self._size.max()) / TEMPLATE_SIDE, 1e-6)
        self._sides = np.maximum(np.round(self._size / self._scale).astype(int), 3)
        return self._cut(image, self._sides)

    def _cut(self, image: ImageArray, sides: IntArray) -> ImageArray:
        width, height = sides.tolist()
        return np.asarray(cut(image, self._centre[None], np.array([self._scale]), width, height)[0])

    def _area(self, image: ImageArray) -> ImageArray:
        """The part of the image that is searched, at the scale of the template."""
        return self._cut(image, self._sides + 2 * REACH * self._sides)

    def _best(self, likeness: FloatArray | NDArray[np.float32]) -> tuple[FloatArray, float]:
        """Centre ``(2,)`` of the region of the greatest ``likeness``, and that."""
        row, column = np.unravel_index(int(np.argmax(likeness)), likeness.shape)
        shift = np.array([column, row]) - REACH * self._sides
        return self._centre + self._scale * shift, float(likeness[row, column])


@dataclass(frozen=True)
class PlaceNoise:
    """Of a target of constant velocity and its measured place, standard deviations in mean sides of the target.

    Attributes:
        velocity: of the change of velocity in a frame; the place changes by half as much besides.
        measurement: of a measured place.
    """

    velocity: float = 0.1
    measurement: float = 0.05


class TemplateMatching(RegionSearch):
    """The best match of the first frame's template; the score is its likeness.

    Attributes:
        measure: of likeness.
        noise: of a Kalman filter of constant velocity, equations (2.7)-(2.8), which says where the window stands and
            takes the best match as its measurement; None does without.
        log_evidence: of all matches so far by that filter, equation (11) of the finite-sets paper, in pixels.
    """

    def __init__(self, measure: Measure = "ncc", noise: PlaceNoise | None = None) -> None:
        self.measure = measure
        self.noise = noise
        self.log_evidence = 0.0

    def start(self, image: ImageArray, box: FloatArray) -> None:
        self._template = cv2.cvtColor(self._learn(image, box), cv2.COLOR_RGB2GRAY)
        self._motion = Gaussians(
            np.concatenate([box_centre(box), np.zeros(2)])[None],
            np.diag([1.0, 1.0, 4.0, 4.0])[None] * self._size.mean(),
        )

    def follow(self, image: ImageArray) -> TargetState:
        side = float(self._size.mean())
        if self.noise is not None:
            variance = (self.noise.velocity * side) ** 2
            self._motion = predict(self._motion, *PlaneVelocity(variance / 4, variance).linear(1.0))
        # Nothing is to be found outside the image, and nothing would stop the box there.
        self._centre = np.clip(self._motion.mean[0, :2], 0, [image.shape[1], image.shape[0]])
        area = cv2.cvtColor(self._area(image), cv2.COLOR_RGB2GRAY)
        place, score = self._best(match(np.asarray(area), np.asarray(self._template), self.measure))
        if self.noise is not None:
            measured = place[None], np.eye(2, 4), np.eye(2) * (self.noise.measurement * side) ** 2
            self.log_evidence += float(log_likelihood(self._motion, *measured)[0])
            self._motion = update(self._motion, *measured)
        else:
            self._motion = Gaussians(np.concatenate([place, np.zeros(2)])[None], self._motion.covariance)
        box = box_about(self._motion.mean[0, :2], self._size)
        return TargetState(box, score, "tracking" if score >= LIKE else "lost")


def colour_bins(image: ImageArray) -> ImageArray:
    """``(H, W)`` one of 64 colours a pixel, four levels a channel."""
    steps = image >> 6
    return np.asarray((steps[..., 0] << 4) | (steps[..., 1] << 2) | steps[..., 2])


def intersections(bins: ImageArray, reference: FloatArray, height: int, width: int) -> FloatArray:
    """How much the histograms of all windows ``height`` x ``width`` share with ``reference``, in [0, 1].

    Args:
        bins: ``(H, W)`` from `colour_bins`, at least as large as the window.
        reference: ``(64,)`` that sums to one.

    Returns:
        ``(H - height + 1, W - width + 1)``.
    """
    one_hot = (bins[..., None] == np.arange(len(reference), dtype=bins.dtype)).astype(np.int32)
    sums = np.pad(one_hot.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0), (0, 0)))
    counts = sums[height:, width:] - sums[:-height, width:] - sums[height:, :-width] + sums[:-height, :-width]
    return np.asarray(np.minimum(counts / (height * width), reference).sum(axis=2))


class HistogramMatching(RegionSearch):
    """The region whose colours are most like the first frame's; the score is the intersection of histograms.

    Position only, as in the thesis; the colours of the first frame are kept.
    """

    def start(self, image: ImageArray, box: FloatArray) -> None:
        bins = colour_bins(self._learn(image, box))
        self._reference = np.bincount(bins.ravel(), minlength=64) / bins.size

    def follow(self, image: ImageArray) -> TargetState:
        width, height = self._sides.tolist()
        place, score = self._best(intersections(colour_bins(self._area(image)), self._reference, height, width))
        self._centre = np.clip(place, 0, [image.shape[1], image.shape[0]])
        return TargetState(box_about(self._centre, self._size), score, "tracking" if score >= SHARED else "lost")


# Of `ColourParticle`.
PARTICLES = 200
# Lambda of its likelihood ``exp(-lambda d^2)``.
SHARPNESS = 20.0
# Side of a box at which its colours are counted, pixels.
SIDE = 12
# Standard deviation of a particle's step, in sides of the target.
POSITION = 0.12
# Standard deviation of the change of the logarithm of its size.
SCALE = 0.02


class ColourParticle:
    """The box is the mean of the particles, the score the Bhattacharyya coefficient of the best one."""

    def __init__(self, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)

    def start(self, image: ImageArray, box: FloatArray) -> None:
        self._size = np.asarray(box[2:] - box[:2], dtype=np.float64)
        first = np.concatenate([box_centre(box), [0.0]])
        self._reference = self._histograms(image, first[None])[0]
        self._filter = ParticleFilter[ImageArray](bootstrap(self._move), self._log_likelihood)
        self._state = self._filter.init(np.repeat(first[None], PARTICLES, axis=0))

    def follow(self, image: ImageArray) -> TargetState:
        self._state, _ = self._filter.step(self._state, image, self._rng)
        weights = probabilities(self._state.log_weights)
        mean = weights @ self._state.particles
        score = float(self._coefficients(image, self._state.particles[[int(np.argmax(weights))]])[0])
        box = box_about(mean[:2], self._size * np.exp(mean[2]))
        return TargetState(box, score, "tracking" if score >= SAME_COLOURS else "lost")

    def _move(self, states: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        walk = PlaneWalk(np.concatenate([POSITION * self._size, [SCALE]]))
        moved = walk(states, seconds, rng)
        moved[:, 2] = np.clip(moved[:, 2], -1.5, 1.5)
        return moved

    def _log_likelihood(self, particles: FloatArray, observation: ImageArray) -> FloatArray:
        return -SHARPNESS * (1 - self._coefficients(observation, particles))

    def _coefficients(self, image: ImageArray, particles: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(self._histograms(image, particles) * self._reference).sum(axis=1))

    def _histograms(self, image: ImageArray, particles: FloatArray) -> FloatArray:
        """``(N, 64)`` colours at a grid of points in each box; points outside the image repeat its border."""
        grid = (np.arange(SIDE) + 0.5) / SIDE - 0.5
        size = self._size * np.exp(particles[:, 2:3])
        x = particles[:, 0:1] + size[:, 0:1] * grid
        y = particles[:, 1:2] + size[:, 1:2] * grid
        column = np.clip(np.floor(x).astype(int), 0, image.shape[1] - 1)
        row = np.clip(np.floor(y).astype(int), 0, image.shape[0] - 1)
        bins = colour_bins(image[row[:, :, None], column[:, None, :]]).reshape(len(particles), -1).astype(np.int64)
        bins += 64 * np.arange(len(particles))[:, None]
        counts = np.bincount(bins.ravel(), minlength=64 * len(particles))
        return counts.reshape(len(particles), 64) / SIDE**2
