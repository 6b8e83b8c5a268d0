"""Where in a volume a ball is, from one image of each camera and no earlier estimate.

The outline likelihood is flat farther than half a radius from the ball, so random particles would not find it. Each
camera is searched alone first, over a grid of pixels and image sizes; a size stands for a depth. The best places of
each camera are then weighed by all cameras, in fine steps of depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.cameras.volume import LARGEST_SHARE, SMALLEST_RADIUS, in_view
from tsuiseki.tracking.filters.resampling import probabilities, systematic
from tsuiseki.tracking.sphere.views import ViewLikelihood, Views
from tsuiseki.tracking.types import FloatArray

# Step between pixels over the ball's radius there: what the outline's Gaussian bears.
PIXEL_STEP = 0.2
# Ratio of neighbouring depths, likewise.
DEPTH_STEP = 1.15
# Least step between pixels: an edge is no sharper than a pixel.
LEAST_STEP = 0.8
# Places that stay of each camera's own search.
BEST_PLACES = 1500
# Steps over the depth of each of these places.
FINE = 24
# Positions that are weighed at a time, so that memory stays small.
CHUNK = 20000
# A view that speaks against a place counts for no more than this: it may be covered.
WORST = -3.0
# Of weighing.
ROUNDS = 6
# The first of them, with the broad likelihood.
BROAD_ROUNDS = 2


def find_ball(
    likelihood: ViewLikelihood,
    broad: ViewLikelihood,
    cameras: Sequence[PinholeCamera],
    radius: float,
    volume: FloatArray,
    count: int,
    views: Views,
    rng: np.random.Generator,
) -> FloatArray:
    """``(count, 3)`` positions, metres, drawn around the places that explain the views best.

    ``broad`` is the likelihood with a peak wide enough for the steps of the search, and cheaper; ``volume`` ``(2, 3)``
    has the lowest and highest corner, metres.
    """
    candidates = [np.empty((0, 3))]
    for number, camera in enumerate(cameras):
        if views[number] is None:
            continue
        places = _places(camera, cameras, radius, volume)
        values = _in_chunks(broad, places, [view if k == number else None for k, view in enumerate(views)])
        best = places[np.argsort(values[:, number])[::-1][:BEST_PLACES]]
        depths = DEPTH_STEP ** np.linspace(-0.5, 0.5, FINE)
        candidates.append((camera.position + depths[:, None, None] * (best - camera.position)).reshape(-1, 3))
    low, high = volume
    positions = np.concatenate(candidates)
    if len(positions) == 0:
        return np.asarray(low + rng.random((count, 3)) * (high - low))
    # Weighed ever more sharply, drawn and moved by ever smaller steps over the same images (Deutscher and Reid,
    # "Articulated body motion capture by stochastic search", 2005).
    for done in range(ROUNDS):
        sharpness = (done + 1) / ROUNDS
        weigher = broad if done < BROAD_ROUNDS else likelihood
        total = np.maximum(_in_chunks(weigher, positions, views), WORST).sum(axis=1)
        positions = positions[systematic(probabilities(sharpness * total), max(count, 1000), rng)]
        positions = positions + rng.standard_normal(positions.shape) * radius * max(0.3 * (1 - sharpness), 0.03)
    return positions[rng.permutation(len(positions))[:count]]


def _places(camera: PinholeCamera, cameras: Sequence[PinholeCamera], radius: float, volume: FloatArray) -> FloatArray:
    """``(N, 3)`` places in the volume that ``camera`` and another one see, evenly spread over its image and sizes."""
    focal = float(camera.focal.mean())
    size = camera.height * LARGEST_SHARE
    places = []
    while size >= SMALLEST_RADIUS:
        step = max(PIXEL_STEP * size, LEAST_STEP)
        at = (np.arange(step / 2, end, step) for end in (camera.width, camera.height))
        pixels = np.stack(np.meshgrid(*at), axis=-1).reshape(-1, 2)
        rays = camera.rays(pixels)
        depth = focal * radius / size
        points = camera.position + rays * (depth / (rays @ camera.rotation[2]))[:, None]
        inside = ((points >= volume[0]) & (points <= volume[1])).all(axis=1)
        cameras_there = sum(in_view(viewer, points).astype(np.int64) for viewer in cameras)
        places.append(points[inside & (cameras_there >= 2)])
        size /= DEPTH_STEP
    return np.concatenate(places)


def _in_chunks(likelihood: ViewLikelihood, positions: FloatArray, views: Sequence[NDArray[Any] | None]) -> FloatArray:
    parts = [likelihood(positions[k : k + CHUNK], views) for k in range(0, len(positions), CHUNK)]
    return np.concatenate(parts) if parts else np.empty((0, len(views)))
