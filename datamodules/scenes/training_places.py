"""Where people of random training pictures stand, and the camera that sees them in the wanted size."""

from __future__ import annotations

import numpy as np

from tsuiseki.datamodules.scenes.figures.standing_sprites import away_from
from tsuiseki.datamodules.scenes.room_clip import ceiling_lens, looking_down
from tsuiseki.datamodules.scenes.things import street_things
from tsuiseki.datamodules.scenes.training_settings import TrainingSettings
from tsuiseki.tracking.cameras.camera_files import AnyCamera
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray

# Cameras tried until one shows people in the wanted size.
CAMERAS = 300
# People of whom each but the first may stand behind the one before.
_QUEUE = 5
# (least, greatest) distance behind another, metres.
_BEHIND = (0.4, 1.8)
# (least, greatest) distance aside of the line of sight to another, metres: shoulders are about half a metre wide.
_ASIDE = (0.08, 0.42)


def places(rng: np.random.Generator, settings: TrainingSettings) -> tuple[AnyCamera, FloatArray]:
    """A camera, and ``(N, 2)`` places on the ground, metres, where people stand as the ``settings`` have it.

    Raises:
        RequestError: no camera at the wanted heights shows people in the wanted size.
    """
    camera, spots = _overhead(rng, settings) if settings.overhead else _camera_with_spots(rng, settings)
    return camera, _beside(rng, spots, settings.beside)


def count_between(rng: np.random.Generator, bounds: tuple[int, int]) -> int:
    """A number within ``bounds``, both included."""
    return int(rng.integers(bounds[0], bounds[1] + 1))


def in_queues(rng: np.random.Generator, spots: FloatArray, camera: AnyCamera, share: float) -> FloatArray:
    """``spots`` ``(N, 2)``, of which a ``share`` lie behind the one before, on nearly the same line of sight."""
    moved = spots.copy()
    behind = (rng.random(len(spots)) < share) & (np.arange(len(spots)) % _QUEUE > 0)
    back = rng.uniform(*_BEHIND, len(spots))
    aside = rng.uniform(*_ASIDE, len(spots)) * rng.choice([-1.0, 1.0], len(spots))
    for k in np.flatnonzero(behind):
        # Each depends on where the one before came to stand.
        away = away_from(camera, moved[k - 1])
        moved[k] = moved[k - 1] + back[k] * away + aside[k] * np.array([-away[1], away[0]])
    return moved


def _camera_with_spots(rng: np.random.Generator, settings: TrainingSettings) -> tuple[AnyCamera, FloatArray]:
    """A camera and ``(N, 2)`` places on the ground where a person has a wanted size in its image."""
    count = count_between(rng, settings.people)
    for _ in range(CAMERAS):
        camera = street_things.random_camera(rng, *settings.size, settings.camera_height)
        feet = rng.uniform([-0.03, 0.05], [1.03, 1.2], (400, 2)) * settings.size
        spots = camera.ground(feet)[:, :2]
        apparent = street_things.apparent_heights(camera, spots)
        low, high = settings.person_height
        good = np.flatnonzero((apparent > low) & (apparent < high))
        if len(good) >= 40:
            break
    else:
        raise RequestError(
            f"expected a person_height that cameras {settings.camera_height} m over the ground can show, "
            f"got {settings.person_height} pixels; widen one of the two"
        )
    # Few people are as near as the image is large: draw sizes evenly on a logarithmic scale.
    heights = np.exp(rng.uniform(np.log(apparent[good].min()), np.log(apparent[good].max()), count))
    order = np.argsort(np.abs(np.log(apparent[good])[None] - np.log(heights)[:, None]), axis=1)
    return camera, spots[good[order[np.arange(count), rng.integers(0, 12, count)]]]


def _overhead(rng: np.random.Generator, settings: TrainingSettings) -> tuple[AnyCamera, FloatArray]:
    """A fisheye camera that looks down, and ``(N, 2)`` places about its foot, near ones as often as far ones."""
    count, up = count_between(rng, settings.people), float(rng.uniform(*settings.camera_height))
    lens = ceiling_lens(None, *settings.size)
    turned = looking_down(float(rng.uniform(0, 2 * np.pi)), *rng.normal(0, 0.03, 2))
    camera = OmnidirectionalCamera(lens, turned, np.array([0.0, 0.0, up]))
    angle, away = rng.uniform(0, 2 * np.pi, count), up * np.exp(rng.uniform(np.log(0.1), np.log(3.0), count))
    return camera, away[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _beside(rng: np.random.Generator, spots: FloatArray, share: float) -> FloatArray:
    """``spots`` ``(N, 2)``, of which a ``share`` lie close to the one before."""
    beside = rng.random(len(spots)) < share
    beside[:1] = False
    angle = rng.uniform(0, 2 * np.pi, len(spots))
    step = rng.uniform(0.35, 1.0, len(spots))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(np.where(beside[:, None], np.roll(spots, 1, axis=0) + step, spots))
