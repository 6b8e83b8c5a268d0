"""Independent random pictures of people with exact boxes, made on the fly to train detectors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.datamodules.scenes.clutter import building, random_clutter
from tsuiseki.datamodules.scenes.degrade import automatic_exposure, degrade, random_degradation
from tsuiseki.datamodules.scenes.ground import draw_ground, random_ground
from tsuiseki.datamodules.scenes.person import person_solids, random_person
from tsuiseki.datamodules.scenes.scene import Sighting, Thing, compose, empty_picture, shadows
from tsuiseki.datamodules.scenes.shading import random_light
from tsuiseki.datamodules.scenes.sprites import random_pose
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.geometry import clip_boxes
from tsuiseki.tracking.types import FloatArray, ImageArray


@dataclass(frozen=True)
class TrainingSettings:
    """What random pictures look like.

    Attributes:
        width: pixels.
        height: pixels.
        people: (fewest, most) people that are tried.
        person_height: (least, greatest) height of a person, pixels.
        clutter: (fewest, most) things that are nobody.
        camera_height: (lowest, highest), metres.
        degradation: strength of blur, noise and the like; 0 for none.
        samples: rays along each side of a pixel.
    """

    width: int = 640
    height: int = 480
    people: tuple[int, int] = (3, 20)
    person_height: tuple[float, float] = (20.0, 250.0)
    clutter: tuple[int, int] = (4, 22)
    camera_height: tuple[float, float] = (1.8, 9.0)
    degradation: float = 1.0
    samples: int = 2

    def __post_init__(self) -> None:
        for name in ("people", "person_height", "clutter", "camera_height"):
            low, high = getattr(self, name)
            if not 0 <= low <= high:
                raise ValueError(f"expected {name} as (least, greatest) with 0 <= least <= greatest, got {low}, {high}")
        if min(self.width, self.height) < 32 or self.samples < 1:
            raise ValueError(f"expected at least 32x32 pixels, got {self.width}x{self.height}")


def random_training_scene(
    rng: np.random.Generator, settings: TrainingSettings | None = None
) -> tuple[ImageArray, FloatArray, FloatArray]:
    """One random picture with people.

    Returns:
        The image ``(H, W, 3)`` uint8 RGB, the boxes ``(N, 4)`` in pixels of the whole silhouettes, hidden parts
        included, clipped to the image, and the visibilities ``(N,)`` in (0, 1].
    """
    settings = TrainingSettings() if settings is None else settings
    camera, spots = _camera_with_spots(rng, settings)
    light = random_light(rng)
    ground, sunlit = draw_ground(random_ground(rng), camera, light)
    people = _people(rng, spots)
    static = _clutter(rng, camera, settings, people)
    dark = shadows(static + people, camera, light, float(rng.uniform(0.5, 2.5)))
    picture = empty_picture(ground * (1 - dark * sunlit)[:, :, None], settings.samples)
    # One pass: static things and people hide each other alike.
    picture, sightings = compose(picture, people + static, camera, light)
    how = random_degradation(rng, settings.degradation)
    image = degrade(picture.colour, replace(how, exposure=how.exposure * automatic_exposure(picture.colour)), rng)
    boxes, visibility = seen_boxes(sightings[: len(people)], settings.width, settings.height)
    return image, boxes, visibility


def seen_boxes(sightings: list[Sighting | None], width: int, height: int) -> tuple[FloatArray, FloatArray]:
    """Boxes ``(N, 4)`` clipped to the image and visibilities ``(N,)`` of those of which anything is seen."""
    seen = [s for s in sightings if s is not None and s.visibility > 0]
    boxes = np.array([s.box for s in seen], dtype=np.float64).reshape(-1, 4)
    return clip_boxes(boxes, width, height), np.array([s.visibility for s in seen], dtype=np.float64)


def _camera_with_spots(rng: np.random.Generator, settings: TrainingSettings) -> tuple[PinholeCamera, FloatArray]:
    """A camera and ``(N, 2)`` places on the ground where a person has a wanted size in its image."""
    count = int(rng.integers(settings.people[0], settings.people[1] + 1))
    while True:
        camera = random_camera(rng, settings.width, settings.height, settings.camera_height)
        feet = rng.uniform([-0.03, 0.05], [1.03, 1.2], (400, 2)) * [settings.width, settings.height]
        spots = camera.ground(feet)[:, :2]
        apparent = apparent_heights(camera, spots)
        low, high = settings.person_height
        good = np.flatnonzero((apparent > low) & (apparent < high))
        if len(good) >= 40:
            break
    # Few people are as near as the image is large: draw sizes evenly on a logarithmic scale.
    wanted = np.exp(rng.uniform(np.log(apparent[good].min()), np.log(apparent[good].max()), count))
    order = np.argsort(np.abs(np.log(apparent[good])[None] - np.log(wanted)[:, None]), axis=1)
    chosen = spots[good[order[np.arange(count), rng.integers(0, 12, count)]]]
    beside = rng.random(count) < 0.3
    beside[:1] = False
    angle = rng.uniform(0, 2 * np.pi, count)
    step = rng.uniform(0.35, 1.0, count)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return camera, np.where(beside[:, None], np.roll(chosen, 1, axis=0) + step, chosen)


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


def _people(rng: np.random.Generator, spots: FloatArray) -> list[Thing]:
    things = []
    for spot in spots:
        person = random_person(rng)
        pose, heading = random_pose(rng, person), float(rng.uniform(0, 2 * np.pi))
        things.append(Thing(person_solids(person, pose, spot, heading), person.look))
    return things


def _clutter(
    rng: np.random.Generator, camera: PinholeCamera, settings: TrainingSettings, people: list[Thing]
) -> list[Thing]:
    """Things at random places in view, clear of the people's own places, and buildings behind all."""
    count = int(rng.integers(settings.clutter[0], settings.clutter[1] + 1))
    feet = rng.uniform([-0.05, 0.0], [1.05, 1.3], (3 * count + 8, 2)) * [settings.width, settings.height]
    spots = camera.ground(feet)[:, :2]
    spots = spots[np.isfinite(spots).all(axis=1) & (np.linalg.norm(spots, axis=1) < 60)]
    taken = np.array([thing.solids.start[:, :2].mean(axis=0) for thing in people]).reshape(-1, 2)
    things: list[Thing] = []
    for spot in spots:
        if len(things) == count:
            break
        solids = random_clutter(rng, spot)
        reach = float(
            (np.linalg.norm(solids.start[:, :2] - spot, axis=1) + solids.scale[:, :2].max(axis=1) * 0.3).max()
        )
        clear = len(taken) == 0 or np.linalg.norm(taken - spot, axis=1).min() > 0.5 + reach
        if clear and np.linalg.norm(spot) > 2.5 + reach:
            things.append(Thing(solids))
    for _ in range(int(rng.integers(0, 3))):
        place = np.array([rng.uniform(-30, 30), rng.uniform(30, 70)])
        things.append(Thing(building(rng, place, float(rng.normal(0, 0.4)))))
    return things
