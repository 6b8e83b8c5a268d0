"""Where the camera stands and what stands about: shared by single pictures and clips."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tsuiseki.datamodules.scenes.render.raster import RayCamera, extents
from tsuiseki.datamodules.scenes.render.scene import Thing
from tsuiseki.datamodules.scenes.render.solids import Solids
from tsuiseki.datamodules.scenes.street.clutter import building, random_clutter
from tsuiseki.datamodules.scenes.street.town import front
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray


def apparent_heights(camera: PinholeCamera, spots: FloatArray) -> FloatArray:
    """Pixels ``(N,)`` between foot and head of a person of 1.7 m at ``spots`` ``(N, 2)``; 0 where that is not seen."""
    foot = np.concatenate([spots, np.zeros((len(spots), 1))], axis=1)
    low, depth = camera.project(np.nan_to_num(foot, nan=-1e6))
    high, above = camera.project(np.nan_to_num(foot + np.array([0, 0, 1.7]), nan=-1e6))
    size = np.linalg.norm(low - high, axis=1)
    return np.where((depth > 1.0) & (above > 1.0) & np.isfinite(size), size, 0.0)


def random_camera(
    rng: np.random.Generator, width: int, height: int, camera_height: tuple[float, float]
) -> PinholeCamera:
    """A surveillance camera over the origin that looks along +y, more or less down."""
    up = float(rng.uniform(*camera_height))
    tilt = float(rng.uniform(0.03, 0.25) + rng.uniform(0, 0.085) * up)
    focal = width * float(np.exp(rng.uniform(np.log(0.65), np.log(2.2))))
    forward = np.array([0.0, np.cos(tilt), -np.sin(tilt)])
    position = np.array([0.0, 0.0, up])
    return PinholeCamera.look_at(position, position + forward, focal, width, height, float(rng.normal(0, 0.025)))


def covered_share(solids: Solids, camera: RayCamera) -> float:
    """Share of the image in the rectangle about ``solids``; infinite where they reach behind the camera."""
    rects = extents(solids, camera)
    if not np.isfinite(rects).all():
        return float("inf")
    size = np.array([camera.width, camera.height])
    low, high = np.clip(rects[:, :2].min(axis=0), 0, size), np.clip(rects[:, 2:].max(axis=0), 0, size)
    return float(np.prod(high - low) / np.prod(size))


def reach_of(solids: Solids, spot: FloatArray) -> float:
    """Metres from ``spot`` ``(2,)`` to the outermost point of ``solids``, roughly."""
    away = np.linalg.norm(solids.start[:, :2] - spot, axis=1)
    size = np.where(solids.box, solids.scale[:, :2].max(axis=1), solids.radius.max(axis=1))
    return float((away + size).max())


def clutter_around(
    rng: np.random.Generator,
    camera: PinholeCamera,
    count: int,
    taken: FloatArray,
    largest: float,
    make: Callable[[np.random.Generator, FloatArray], Solids] = random_clutter,
) -> list[Thing]:
    """Up to ``count`` things that are nobody at random places in view.

    They keep clear of the places ``taken`` ``(N, 2)``, and none covers more of the image than ``largest``.
    ``make`` gives one that stands at a place.
    """
    feet = rng.uniform([-0.05, 0.0], [1.05, 1.3], (4 * count + 8, 2)) * [camera.width, camera.height]
    spots = camera.ground(feet)[:, :2]
    spots = spots[np.isfinite(spots).all(axis=1) & (np.linalg.norm(spots, axis=1) < 60)]
    things: list[Thing] = []
    for spot in spots:
        if len(things) == count:
            break
        solids = make(rng, spot)
        clear = len(taken) == 0 or np.linalg.norm(taken - spot, axis=1).min() > 0.4 + reach_of(solids, spot)
        if clear and covered_share(solids, camera) < largest:
            things.append(Thing(solids))
    return things


def buildings_behind(rng: np.random.Generator, count: int, distance: float) -> list[Thing]:
    """Buildings at more than ``distance`` metres from the origin, along +y."""
    things = []
    for _ in range(count):
        place = np.array([rng.uniform(-30, 30), distance + rng.uniform(16, 45)])
        things.append(Thing(building(rng, place, float(rng.normal(0, 0.25)))))
    return things


def fronts_behind(rng: np.random.Generator, count: int, taken: FloatArray, reach: float) -> list[Thing]:
    """Up to ``count`` walls of a town along +y, behind most of the places ``taken`` ``(N, 2)`` and clear of them.

    ``reach`` is how far those lie, metres.
    """
    things = []
    for _ in range(count):
        distance = reach * float(rng.uniform(0.75, 1.8))
        place = np.array([rng.uniform(-0.7, 0.7) * distance, distance])
        angle = float(rng.normal(0, 0.35)) if rng.random() < 0.75 else float(rng.uniform(0, np.pi))
        along = np.array([np.cos(angle), np.sin(angle)])
        offset = taken - place
        beside = np.abs(offset @ [-along[1], along[0]])
        if not ((beside < 0.7) & (np.abs(offset @ along) < 8.0)).any():
            things.append(Thing(front(rng, place, angle)))
    return things
