"""How far a body's contour lies from the edges of a coloured region, equation (7) of the goldfish paper.

Image preparation happens once a frame: the pixels of the colour, their Canny edges, and the distance of every pixel to
the nearest edge. A particle then costs one look-up for each of its contour points. `find_starts` searches bodies where
nothing is known yet: states that fit the extracted regions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.bodies.body import Body
from tsuiseki.tracking.features.colour_region import ColourRange, colour_pixels
from tsuiseki.tracking.filters.base import bootstrap
from tsuiseki.tracking.filters.body_motion import HEADING, Noise, RandomWalk
from tsuiseki.tracking.filters.particle_filter import ParticleFilter
from tsuiseki.tracking.filters.resampling import best_particle, systematic
from tsuiseki.tracking.types import FloatArray, ImageArray

Points: TypeAlias = NDArray[np.float32]
Mask: TypeAlias = NDArray[np.uint8]
Value = TypeVar("Value", np.float32, np.uint8)

# Distances in pixels are cut off here: farther away, every place is as wrong as any other.
FARTHEST = 80.0
# Where a region's border lies from the index of Canny's mark: a pixel's centre is half a pixel beyond its index, and at
# straight borders the mark is the pixel before the step, outside the region at its left and top. This is the mean.
EDGE_OFFSET = np.float32(0.75)
# Subtracted from the log-likelihood of a contour that is hidden in full and was expected in view.
HIDDEN_COST = 14.0
# Pixels around another body's expected contour that count as that body.
MARGIN = 4
# OpenCV maps at most this many rows of points at a time (it counts them in 16 bits).
ROWS_AT_ONCE = 16384


@dataclass(frozen=True)
class Extraction:
    """What belongs to the bodies in an image.

    Attributes:
        colour: theirs.
        smooth: side in pixels of the median filter that takes specks away and closes pinholes; 1 leaves it out.
    """

    colour: ColourRange
    smooth: int = 5

    def pixels(self, image: ImageArray) -> Mask:
        """``(H, W)`` uint8, 255 where an RGB image shows a body and 0 elsewhere."""
        mask = colour_pixels(image, self.colour)
        return np.asarray(cv2.medianBlur(mask, self.smooth), dtype=np.uint8) if self.smooth > 1 else mask


class BodyPixels(Protocol):
    """Says which pixels ``(H, W)`` of an image are of bodies: `Extraction`, or a difference from a background."""

    def pixels(self, image: ImageArray) -> Mask: ...


@dataclass(frozen=True)
class EdgeImage:
    """A frame as the contour likelihood sees it.

    Attributes:
        mask: ``(H, W)`` uint8, 255 where a body is.
        distance: ``(H, W)`` float32 pixels to the nearest edge, in [0, FARTHEST].
        has_edges: False where nothing of the colour was found; every distance is ``FARTHEST`` then.
    """

    mask: Mask
    distance: NDArray[np.float32]
    has_edges: bool

    @classmethod
    def of(cls, image: ImageArray, extraction: BodyPixels) -> EdgeImage:
        """Extract, find edges, and measure the distance to them."""
        return cls.of_mask(extraction.pixels(image))

    @classmethod
    def of_mask(cls, mask: Mask) -> EdgeImage:
        """From the pixels ``(H, W)`` of the bodies."""
        edges = cv2.Canny(mask, 100, 200)
        if not cv2.hasNonZero(edges):
            return cls(mask, np.full(mask.shape, FARTHEST, dtype=np.float32), has_edges=False)
        distance = cv2.distanceTransform(cv2.bitwise_not(edges), cv2.DIST_L2, cv2.DIST_MASK_3)
        np.minimum(distance, FARTHEST, out=distance)
        return cls(mask, np.asarray(distance, dtype=np.float32), has_edges=True)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.mask.shape[1], self.mask.shape[0]


def look_up(image: NDArray[Value], points: Points) -> NDArray[Value]:
    """Values ``(N, K)`` at the pixels nearest to points ``(N, K, 2)`` x, y; off the image those of its border."""
    parts = [
        # None is right for a second map, but OpenCV's types do not know it.
        cv2.remap(image, part, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
        for part in (points[row : row + ROWS_AT_ONCE] for row in range(0, len(points), ROWS_AT_ONCE))
    ]
    return np.asarray(parts[0] if len(parts) == 1 else np.concatenate(parts), dtype=image.dtype)


def point_distances(image: EdgeImage, points: Points) -> NDArray[np.float32]:
    """Distance ``(N, K)`` in pixels of points ``(N, K, 2)`` to the nearest edge, in [0, FARTHEST].

    Off the image it is that of the border, and at least the distance to the border.
    """
    distance = look_up(image.distance, points - EDGE_OFFSET)
    last = np.array([image.size[0] - 1, image.size[1] - 1], dtype=np.float32)
    # Over the particles first: that axis is long, and the reduction fast.
    flat = points.reshape(len(points), -1)
    low, high = (flat.min(axis=0).reshape(-1, 2), flat.max(axis=0).reshape(-1, 2))
    if np.any(low < 0.0) or np.any(high > last):
        outside = np.linalg.norm(points - np.clip(points, 0.0, last), axis=2)
        distance = np.maximum(distance, np.minimum(outside, FARTHEST))
    return distance


@dataclass(frozen=True)
class BodyView:
    """What one body's contours are compared with.

    Attributes:
        edges: of the frame.
        neighbours: ``(H, W)`` uint8, above 0 where other bodies are expected; None where none is near.
        hidden: share of the body's contour that is expected to lie there, in [0, 1].
    """

    edges: EdgeImage
    neighbours: Mask | None = None
    hidden: float = 0.0

    def visible_distance(self, contours: Points) -> tuple[FloatArray, FloatArray]:
        """``d_max`` ``(N,)`` of the points of contours ``(N, K, 2)`` that no neighbour hides, and the share it does."""
        distance = point_distances(self.edges, contours)
        if self.neighbours is None:
            return distance.max(axis=1).astype(np.float64), np.zeros(len(contours))
        hidden = look_up(self.neighbours, contours) > 0
        return np.where(hidden, 0.0, distance).max(axis=1).astype(np.float64), np.asarray(hidden.mean(axis=1))

    def log_likelihood(self, contours: Points, spread: float) -> FloatArray:
        """Logarithm of ``exp(-d_max^2 / spread)``, Eq. (7), and what becomes of it where another body is in the way.

        Contour points inside a neighbour are hidden: the image there is explained by the neighbour, so they take no
        part in ``d_max``, and the share of the contour that is hidden beyond what was expected has a cost. Without the
        cost a particle would fit best with all of itself inside the neighbour, and without the exclusion it would fit
        best on the neighbour's outline. Where bodies are expected to cross, being hidden is no fault.

        Args:
            contours: ``(N, K, 2)`` float32 pixels.
            spread: ``sigma_d``, pixels squared.

        Returns:
            ``(N,)``.
        """
        farthest, hidden = self.visible_distance(contours)
        return np.asarray(-(farthest**2) / spread - HIDDEN_COST * np.maximum(hidden - self.hidden, 0.0))


# States drawn all over a region to find where its body begins.
CANDIDATES = 3000
# Spread of the likelihood, pixels squared, and share of the wide noise, from layer to layer.
LAYERS = ((900.0, 0.4), (225.0, 0.2), (60.0, 0.1), (20.0, 0.05), (20.0, 0.03))
# Regions of less than this share of the body's area are none.
SMALLEST_REGION = 0.5
# Pixels that the contour of a state found may lie from the edges.
LARGEST_MISFIT = 12.0


def wide_noise(body: Body) -> Noise:
    """The wide deviations of the paper's learning run: 30 pixels, and pi/4 for each angle.

    What is neither has a quarter of its limits.
    """
    deviation = np.full(len(body.fields), np.pi / 4)
    deviation[:HEADING] = 30.0
    for column in range(HEADING, len(deviation)):
        if column not in body.angles:
            deviation[column] = np.ptp(body.limits[column]) / 4
    return Noise.independent(np.zeros(len(deviation)), deviation)


def find_starts(edges: EdgeImage, body: Body, rng: np.random.Generator, others: Sequence[Points] = ()) -> FloatArray:
    """States ``(K, D)`` of the bodies that a frame shows, the largest region first.

    In each, candidates are drawn all over it and improved by an annealed particle filter. Bodies that touch are one
    region, and one of them is found; their states have to be given.

    Args:
        edges: the frame.
        body: to search.
        rng: of the candidates.
        others: contours ``(K, 2)`` of bodies that are known already.
    """
    starts: list[FloatArray] = []
    view = BodyView(edges, contours_mask(edges.size, others) if others else None)
    mask = edges.mask if view.neighbours is None else cv2.subtract(edges.mask, view.neighbours)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    # Inside the hull of the body at rest.
    area = cv2.contourArea(cv2.convexHull(body.contour(np.zeros((1, len(body.fields))))[0]))
    for label in sorted(range(1, count), key=lambda n: -stats[n, cv2.CC_STAT_AREA]):
        size = stats[label, cv2.CC_STAT_AREA]
        if size < SMALLEST_REGION * area:
            break
        pixels = np.argwhere(labels == label)[:, ::-1].astype(np.float64)
        state, misfit = _best_state(view, body, pixels, rng)
        if misfit <= LARGEST_MISFIT:
            starts.append(state)
    return np.array(starts).reshape(-1, len(body.fields))


def _best_state(view: BodyView, body: Body, pixels: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, float]:
    """The state in the region of ``pixels`` that fits best, and its distance to the edges."""
    wide = wide_noise(body)
    states = np.zeros((CANDIDATES, len(body.fields)))
    states[:, :2] = pixels[rng.integers(len(pixels), size=CANDIDATES)]
    states[:, HEADING] = rng.uniform(-np.pi, np.pi, CANDIDATES)
    states[:, HEADING + 1 :] = 0.5 * wide.draw(CANDIDATES, rng)[:, HEADING + 1 :]
    best = states[0]
    for number, (spread, share) in enumerate(LAYERS):
        noise = Noise(wide.mean, share * wide.factor * (number > 0))
        layer = ParticleFilter(
            bootstrap(RandomWalk(noise)),
            lambda particles, view, spread=spread: view.log_likelihood(body.contour(particles), spread),
            threshold=1.0,
        )
        posterior, _ = layer.step(layer.init(states), view, rng)
        best = best_particle(posterior.particles, posterior.log_weights)
        drawn = systematic(np.exp(posterior.log_weights), CANDIDATES, rng)
        states = within_limits(posterior.particles[drawn], body)
    (distance,), (hidden,) = view.visible_distance(body.contour(best[None]))
    best[HEADING] = np.angle(np.exp(1j * best[HEADING]))
    return best, float(distance) if hidden < 0.5 else np.inf


def within_limits(states: FloatArray, body: Body) -> FloatArray:
    """States ``(N, >= D)`` with their shape inside the body's limits."""
    columns = slice(HEADING + 1, len(body.fields))
    limits = body.limits[columns]
    states[:, columns] = np.clip(states[:, columns], limits[:, 0], limits[:, 1])
    return states


def contours_mask(size: tuple[int, int], contours: Sequence[Points]) -> Mask:
    """``(H, W)`` uint8, 255 inside the hulls of contours ``(K, 2)`` and up to `MARGIN` pixels around them."""
    mask = np.zeros(size[::-1], dtype=np.uint8)
    for contour in contours:
        hull = np.round(cv2.convexHull(contour)).astype(np.int32)
        cv2.fillConvexPoly(mask, hull, 255)
        cv2.polylines(mask, [hull], isClosed=True, color=255, thickness=2 * MARGIN + 1)
    return mask


def near_mask(size: tuple[int, int], contour: Points, others: Sequence[Points]) -> Mask | None:
    """`contours_mask` of those whose bounding boxes come near that of ``contour``; None where there is none."""
    low, high = contour.min(axis=0), contour.max(axis=0)
    reach = (high - low).max() / 2 + MARGIN
    near = [o for o in others if np.all(o.min(axis=0) < high + reach) and np.all(o.max(axis=0) > low - reach)]
    return contours_mask(size, near) if near else None
