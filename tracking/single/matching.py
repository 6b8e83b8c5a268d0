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
from tsuiseki.tracking.filters.kalman import Gaussians, predict, update
from tsuiseki.tracking.filters.motion.points import PlaneVelocity, PlaneWalk
from tsuiseki.tracking.filters.particle_filter import ParticleFilter
from tsuiseki.tracking.filters.resampling import probabilities
from tsuiseki.tracking.single.search_windows import cut
from tsuiseki.tracking.single.tracker import TargetState, box_centre
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray, Status

Measure = Literal["ssd", "sad", "ncc"]
TEMPLATE_SIDE = 32  # pixels of the longer side when matching; matching costs its square times the window's
REACH = 1.0  # how far from the last place is searched, in sides of the target


def match(area: ImageArray, template: ImageArray, measure: Measure) -> NDArray[np.float32]:
    """Likeness ``(H - h + 1, W - w + 1)`` of a template ``(h, w)`` to the regions of a grey area ``(H, W)``, at most 1.

    ``ncc`` is equation (2.3); ``ssd`` (2.1) and ``sad`` (2.2) become ``1 - root of the mean square`` and ``1 - mean``
    of the differences, over 255.

    Raises:
        ValueError: the area is smaller than the template.
    """
    _check_holds(area, *template.shape)
    if measure == "ncc":
        return np.asarray(cv2.matchTemplate(area, template, cv2.TM_CCORR_NORMED))
    if measure == "ssd":
        squares = cv2.matchTemplate(area, template, cv2.TM_SQDIFF) / template.size
        return np.asarray(1 - np.sqrt(np.maximum(squares, 0)) / 255, dtype=np.float32)
    regions = np.lib.stride_tricks.sliding_window_view(area, template.shape).astype(np.int16)
    return np.asarray(1 - np.abs(regions - template.astype(np.int16)).mean(axis=(2, 3)) / 255, dtype=np.float32)


def _check_holds(area: ImageArray, height: int, width: int) -> None:
    """OpenCV would look for the smaller of the two in the larger one without a word."""
    if area.shape[0] < height or area.shape[1] < width:
        raise ValueError(f"expected an area of at least {height} x {width}, got {area.shape[0]} x {area.shape[1]}")


class TemplateMatching:
    """The best match of the first frame's template; the score is its likeness.

    Attributes:
        measure: of likeness.
        smoothed: a Kalman filter of constant velocity, equations (2.7)-(2.8), says where the window stands and takes
            the best match as its measurement.
    """

    def __init__(
        self, measure: Measure = "ncc", smoothed: bool = False, lost_below: float = 0.75, seed: int = 0
    ) -> None:
        del seed
        self.measure = measure
        self.smoothed = smoothed
        self.lost_below = lost_below

    def start(self, image: ImageArray, box: FloatArray) -> None:
        """See `SingleTracker.start`."""
        self._size = np.asarray(box[2:] - box[:2], dtype=np.float64)
        self._scale = max(float(self._size.max()) / TEMPLATE_SIDE, 1e-6)
        width, height = np.maximum(np.round(self._size / self._scale).astype(int), 3).tolist()
        self._shape = height, width
        self._template = self._grey(image, box_centre(box), width, height)
        self._motion = Gaussians(
            np.concatenate([box_centre(box), np.zeros(2)])[None],
            np.diag([1.0, 1.0, 4.0, 4.0])[None] * self._size.mean(),
        )

    def follow(self, image: ImageArray) -> TargetState:
        """See `SingleTracker.follow`."""
        if self.smoothed:
            # Velocities wander by a tenth of a side a frame.
            square = float(self._size.mean() ** 2)
            self._motion = predict(self._motion, *PlaneVelocity(0.0025 * square, 0.01 * square).linear(1.0))
        # Nothing is to be found outside the image, and nothing would stop the box there.
        centre = np.clip(self._motion.mean[0, :2], 0, [image.shape[1], image.shape[0]])
        height, width = self._shape
        reach_x, reach_y = round(REACH * width), round(REACH * height)
        area = self._grey(image, centre, width + 2 * reach_x, height + 2 * reach_y)
        likeness = match(area, self._template, self.measure)
        row, column = np.unravel_index(int(np.argmax(likeness)), likeness.shape)
        found = centre + self._scale * np.array([column - reach_x, row - reach_y])
        score = float(likeness[row, column])
        if self.smoothed:
            certainty = np.eye(2) * (0.05 * self._size.mean()) ** 2
            self._motion, _ = update(self._motion, found[None], np.eye(2, 4), certainty)
        else:
            self._motion = Gaussians(np.concatenate([found, np.zeros(2)])[None], self._motion.covariance)
        place = self._motion.mean[0, :2]
        status: Status = "tracking" if score >= self.lost_below else "lost"
        return TargetState(np.concatenate([place - self._size / 2, place + self._size / 2]), score, status)

    def _grey(self, image: ImageArray, centre: FloatArray, width: int, height: int) -> ImageArray:
        patch = cut(image, centre[None], np.array([self._scale]), width, height)[0]
        return np.asarray(cv2.cvtColor(patch, cv2.COLOR_RGB2GRAY))


def colour_bins(image: ImageArray) -> ImageArray:
    """``(H, W)`` one of 64 colours a pixel, four levels a channel."""
    steps = image >> 6
    return np.asarray((steps[..., 0] << 4) | (steps[..., 1] << 2) | steps[..., 2])


def active_search(bins: ImageArray, reference: FloatArray, height: int, width: int) -> tuple[int, int, float]:
    """The window ``height`` x ``width`` whose histogram intersects ``reference`` most, without looking at all.

    Two windows that share a part ``p`` of their pixels differ by at most ``1 - p`` in their intersection, so around a
    poor window none can be good (Vinod and Murase, "Focused color intersection with efficient searching", 1997).
    Windows on a coarse grid come first; of the others only those that could beat the best one are looked at. The answer
    is that of looking everywhere.

    Args:
        bins: ``(H, W)`` from `colour_bins`, at least as large as the window.
        reference: ``(64,)`` that sums to one.

    Returns:
        Row and column of the window's corner and its intersection in [0, 1].

    Raises:
        ValueError: ``bins`` are smaller than the window.
    """
    _check_holds(bins, height, width)
    sums = _integral_histograms(bins, len(reference))
    rows, columns = bins.shape[0] - height + 1, bins.shape[1] - width + 1
    step_y, step_x = max(1, height // 4), max(1, width // 4)
    grid_y, grid_x = (np.unique(np.append(np.arange(0, n, s), n - 1)) for n, s in ((rows, step_y), (columns, step_x)))
    y, x = (a.ravel() for a in np.meshgrid(grid_y, grid_x, indexing="ij"))
    values = _intersections(sums, reference, y, x, height, width)
    best = int(np.argmax(values))
    every_y, every_x = np.arange(rows), np.arange(columns)
    near_y, near_x = (np.abs(e[:, None] - g[None]).argmin(axis=1) for e, g in ((every_y, grid_y), (every_x, grid_x)))
    shared_y = 1 - np.abs(every_y - grid_y[near_y]) / height
    shared_x = 1 - np.abs(every_x - grid_x[near_x]) / width
    at_grid = values.reshape(len(grid_y), len(grid_x))[near_y[:, None], near_x[None]]
    bound = at_grid + 1 - shared_y[:, None] * shared_x[None]
    more_y, more_x = np.nonzero(bound > values[best])
    more = _intersections(sums, reference, more_y, more_x, height, width)
    if len(more) and more.max() > values[best]:
        k = int(np.argmax(more))
        return int(more_y[k]), int(more_x[k]), float(more[k])
    return int(y[best]), int(x[best]), float(values[best])


def _integral_histograms(bins: ImageArray, count: int) -> NDArray[np.int32]:
    """``(H + 1, W + 1, count)``: how often each colour occurs above and left of a corner."""
    one_hot = (bins[..., None] == np.arange(count, dtype=bins.dtype)).astype(np.int32)
    sums = one_hot.cumsum(axis=0).cumsum(axis=1)
    return np.pad(sums, ((1, 0), (1, 0), (0, 0)))


def _intersections(
    sums: NDArray[np.int32], reference: FloatArray, y: IntArray, x: IntArray, height: int, width: int
) -> FloatArray:
    counts = sums[y + height, x + width] - sums[y, x + width] - sums[y + height, x] + sums[y, x]
    return np.asarray(np.minimum(counts / (height * width), reference).sum(axis=1))


class HistogramMatching:
    """The region whose colours are most like the first frame's; the score is the intersection of histograms.

    Position only, as in the thesis; the colours of the first frame are kept.
    """

    def __init__(self, lost_below: float = 0.5, seed: int = 0) -> None:
        del seed
        self.lost_below = lost_below

    def start(self, image: ImageArray, box: FloatArray) -> None:
        """See `SingleTracker.start`."""
        self._size = np.asarray(box[2:] - box[:2], dtype=np.float64)
        self._centre = box_centre(box)
        self._scale = max(float(self._size.max()) / TEMPLATE_SIDE, 1e-6)
        width, height = np.maximum(np.round(self._size / self._scale).astype(int), 3).tolist()
        self._shape = height, width
        bins = colour_bins(cut(image, self._centre[None], np.array([self._scale]), width, height)[0])
        self._reference = np.bincount(bins.ravel(), minlength=64) / bins.size

    def follow(self, image: ImageArray) -> TargetState:
        """See `SingleTracker.follow`."""
        height, width = self._shape
        reach_x, reach_y = round(REACH * width), round(REACH * height)
        scale = np.array([self._scale])
        area = cut(image, self._centre[None], scale, width + 2 * reach_x, height + 2 * reach_y)[0]
        row, column, score = active_search(colour_bins(area), self._reference, height, width)
        found = self._centre + self._scale * np.array([column - reach_x, row - reach_y])
        self._centre = np.clip(found, 0, [image.shape[1], image.shape[0]])
        status: Status = "tracking" if score >= self.lost_below else "lost"
        return TargetState(
            np.concatenate([self._centre - self._size / 2, self._centre + self._size / 2]), score, status
        )


@dataclass(frozen=True)
class ColourParticleSettings:
    """Constants.

    Attributes:
        particles: how many.
        position: standard deviation of the walk, in sides of the target.
        scale: standard deviation of the walk of the logarithm of the size.
        sharpness: lambda of the likelihood ``exp(-lambda d^2)``.
        side: pixels of a box when its colours are counted.
        lost_below: Bhattacharyya coefficient at which the target counts as lost.
    """

    particles: int = 200
    position: float = 0.12
    scale: float = 0.02
    sharpness: float = 20.0
    side: int = 12
    lost_below: float = 0.6


class ColourParticle:
    """The box is the mean of the particles, the score the Bhattacharyya coefficient of the best one."""

    def __init__(self, settings: ColourParticleSettings | None = None, seed: int = 0) -> None:
        self.settings = ColourParticleSettings() if settings is None else settings
        self._rng = np.random.default_rng(seed)

    def start(self, image: ImageArray, box: FloatArray) -> None:
        """See `SingleTracker.start`."""
        self._size = np.asarray(box[2:] - box[:2], dtype=np.float64)
        first = np.concatenate([box_centre(box), [0.0]])
        self._reference = self._histograms(image, first[None])[0]
        self._filter = ParticleFilter[ImageArray](bootstrap(self._move), self._log_likelihood)
        self._state = self._filter.init(np.repeat(first[None], self.settings.particles, axis=0))

    def follow(self, image: ImageArray) -> TargetState:
        """See `SingleTracker.follow`."""
        self._state, _ = self._filter.step(self._state, image, self._rng)
        weights = probabilities(self._state.log_weights)
        mean = weights @ self._state.particles
        half = self._size * np.exp(mean[2]) / 2
        score = float(self._coefficients(image, self._state.particles[[int(np.argmax(weights))]])[0])
        status: Status = "tracking" if score >= self.settings.lost_below else "lost"
        return TargetState(np.concatenate([mean[:2] - half, mean[:2] + half]), score, status)

    def _move(self, states: FloatArray, seconds: float, rng: np.random.Generator) -> FloatArray:
        """A `Motion`."""
        walk = PlaneWalk(np.concatenate([self.settings.position * self._size, [self.settings.scale]]))
        moved = walk(states, seconds, rng)
        moved[:, 2] = np.clip(moved[:, 2], -1.5, 1.5)
        return moved

    def _log_likelihood(self, particles: FloatArray, observation: ImageArray) -> FloatArray:
        return -self.settings.sharpness * (1 - self._coefficients(observation, particles))

    def _coefficients(self, image: ImageArray, particles: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(self._histograms(image, particles) * self._reference).sum(axis=1))

    def _histograms(self, image: ImageArray, particles: FloatArray) -> FloatArray:
        """``(N, 64)`` colours at a grid of points in each box; points outside the image repeat its border."""
        side = self.settings.side
        grid = (np.arange(side) + 0.5) / side - 0.5
        size = self._size * np.exp(particles[:, 2:3])
        x = particles[:, 0:1] + size[:, 0:1] * grid
        y = particles[:, 1:2] + size[:, 1:2] * grid
        column = np.clip(np.floor(x).astype(int), 0, image.shape[1] - 1)
        row = np.clip(np.floor(y).astype(int), 0, image.shape[0] - 1)
        bins = colour_bins(image[row[:, :, None], column[:, None, :]]).reshape(len(particles), -1).astype(np.int64)
        bins += 64 * np.arange(len(particles))[:, None]
        counts = np.bincount(bins.ravel(), minlength=64 * len(particles))
        return counts.reshape(len(particles), 64) / side**2
