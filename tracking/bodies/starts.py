"""Where bodies are when nothing is known yet: states that fit the extracted regions."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from tsuiseki.tracking.bodies.body import Body
from tsuiseki.tracking.bodies.contour import (
    BodyView,
    ContourLikelihood,
    EdgeImage,
    Mask,
    Points,
    look_up,
    point_distances,
)
from tsuiseki.tracking.filters.base import bootstrap
from tsuiseki.tracking.filters.motion.bodies import HEADING, Noise, RandomWalk
from tsuiseki.tracking.filters.particles.particle_filter import ParticleFilter
from tsuiseki.tracking.filters.particles.resampling import best_particle
from tsuiseki.tracking.types import FloatArray

CANDIDATES = 3000
# Spread of the likelihood and share of the wide noise, from layer to layer.
LAYERS = ((900.0, 0.4), (225.0, 0.2), (60.0, 0.1), (20.0, 0.05), (20.0, 0.03))
SMALLEST_REGION = 0.5
"""Regions of less than this share of the body's area are none."""
LARGEST_MISFIT = 12.0
"""Pixels that the contour of a state found may lie from the edges."""


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


def find_starts(
    edges: EdgeImage, body: Body, rng: np.random.Generator, others: Sequence[Points] = (), margin: int = 4
) -> FloatArray:
    """States ``(K, D)`` of the bodies that a frame shows, the largest region first.

    In each, candidates are drawn all over it and improved by an annealed particle filter. Bodies that touch are one
    region, and one of them is found; their states have to be given.

    Args:
        edges: the frame.
        body: what to look for.
        rng: of the candidates.
        others: contours ``(K, 2)`` of bodies that are known already.
        margin: pixels around a contour that count as its body.
    """
    found: list[FloatArray] = []
    neighbours = contours_mask(edges.size, others, margin) if others else None
    mask = edges.mask if neighbours is None else cv2.subtract(edges.mask, neighbours)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    area = silhouette_area(body)
    for label in sorted(range(1, count), key=lambda n: -stats[n, cv2.CC_STAT_AREA]):
        size = stats[label, cv2.CC_STAT_AREA]
        if size < SMALLEST_REGION * area:
            break
        pixels = np.argwhere(labels == label)[:, ::-1].astype(np.float64)
        state, misfit = _best_state(edges, body, pixels, neighbours, rng)
        if misfit <= LARGEST_MISFIT:
            found.append(state)
    return np.array(found).reshape(-1, len(body.fields))


def _best_state(
    edges: EdgeImage, body: Body, pixels: FloatArray, neighbours: Mask | None, rng: np.random.Generator
) -> tuple[FloatArray, float]:
    """The state in the region of ``pixels`` that fits best, and its distance to the edges."""
    wide = wide_noise(body)
    states = np.zeros((CANDIDATES, len(body.fields)))
    states[:, :2] = pixels[rng.integers(len(pixels), size=CANDIDATES)]
    states[:, HEADING] = rng.uniform(-np.pi, np.pi, CANDIDATES)
    states[:, HEADING + 1 :] = 0.5 * wide.draw(CANDIDATES, rng)[:, HEADING + 1 :]
    best, view = states[0], BodyView(edges, neighbours)
    for number, (spread, share) in enumerate(LAYERS):
        likelihood = ContourLikelihood(spread)
        noise = Noise(wide.mean, share * wide.factor * (number > 0))
        layer = ParticleFilter(
            bootstrap(RandomWalk(noise)),
            lambda particles, view, use=likelihood: use(body.contour(particles), view),
            threshold=1.0,
        )
        after, _ = layer.step(layer.init(states), view, rng)
        best = best_particle(after.particles, after.log_weights)
        drawn = layer.resample(np.exp(after.log_weights), CANDIDATES, rng)
        states = within_limits(after.particles[drawn], body)
    contour = body.contour(best[None])
    distance, hidden = visible_distance(edges, contour, neighbours)
    best[HEADING] = np.angle(np.exp(1j * best[HEADING]))
    return best, distance if hidden < 0.5 else np.inf


def within_limits(states: FloatArray, body: Body) -> FloatArray:
    """States ``(N, >= D)`` with their shape inside the body's limits."""
    columns = slice(HEADING + 1, len(body.fields))
    limits = body.limits[columns]
    states[:, columns] = np.clip(states[:, columns], limits[:, 0], limits[:, 1])
    return states


def silhouette_area(body: Body) -> float:
    """Pixels inside the hull of the contour of the body at rest."""
    return float(cv2.contourArea(cv2.convexHull(body.contour(np.zeros((1, len(body.fields))))[0])))


def contours_mask(size: tuple[int, int], contours: Sequence[Points], margin: int) -> Mask:
    """``(H, W)`` uint8, 255 inside the hulls of contours ``(K, 2)`` and up to ``margin`` pixels around them."""
    mask = np.zeros(size[::-1], dtype=np.uint8)
    for contour in contours:
        hull = np.round(cv2.convexHull(contour)).astype(np.int32)
        cv2.fillConvexPoly(mask, hull, 255)
        if margin:
            cv2.polylines(mask, [hull], isClosed=True, color=255, thickness=2 * margin + 1)
    return mask


def near_mask(size: tuple[int, int], contour: Points, others: Sequence[Points], margin: int) -> Mask | None:
    """`contours_mask` of those whose bounding boxes come near that of ``contour``; None where there is none."""
    low, high = contour.min(axis=0), contour.max(axis=0)
    reach = (high - low).max() / 2 + margin
    near = [o for o in others if np.all(o.min(axis=0) < high + reach) and np.all(o.max(axis=0) > low - reach)]
    return contours_mask(size, near, margin) if near else None


def visible_distance(edges: EdgeImage, contour: Points, neighbours: Mask | None) -> tuple[float, float]:
    """``d_max`` of the contour points ``(1, K, 2)`` that no neighbour hides, and the share that one does."""
    distance = point_distances(edges, contour)[0]
    if neighbours is None:
        return float(distance.max()), 0.0
    hidden = look_up(neighbours, contour)[0] > 0
    return float(distance[~hidden].max(initial=0.0)), float(hidden.mean())
