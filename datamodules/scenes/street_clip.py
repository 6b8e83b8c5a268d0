"""A clip of a street: people walk before a fixed camera, among things that hide them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import NonNegativeInt, PositiveFloat, PositiveInt
from pydantic.dataclasses import dataclass as settings_dataclass
from scipy.spatial import ConvexHull

from tsuiseki.datamodules.scenes import clip
from tsuiseki.datamodules.scenes.clip import Rays, Span
from tsuiseki.datamodules.scenes.people.walkers import Motion, crowd
from tsuiseki.datamodules.scenes.render.composing import compose, darken, empty_picture
from tsuiseki.datamodules.scenes.render.degrade import Degradation, automatic_exposure, degrade
from tsuiseki.datamodules.scenes.render.ground import Ground, draw_ground
from tsuiseki.datamodules.scenes.render.shading import random_light
from tsuiseki.datamodules.scenes.things import street_things
from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray

# Cameras that are drawn at most until one sees people as large as asked for.
CAMERAS = 300
# Least share of the image in which people have the size that the settings ask for.
WALKABLE = 0.45
# Largest share of the image that one thing may cover.
LARGEST = 0.05
# Square metres of the ground in view for each person, at least.
ROOM = 5.0
# Share of a person's box that lies inside the image, at least, for a row of the truth.
INSIDE = 0.1
# (lowest, highest) camera, metres.
CAMERA_HEIGHT = (2.5, 9.0)
# Slow change of the brightness, as the amplitude of its logarithm.
EXPOSURE_DRIFT = 0.06
# Standard deviation of the lens's blur, pixels.
BLUR = 0.5
# Standard deviation of the sensor's noise, grey levels of 255.
NOISE = 3.0


@settings_dataclass(frozen=True, config=SETTINGS)
class StreetSettings(clip.ClipSettings):
    """A street clip.

    Attributes:
        people: about how many are around at a time.
        occluders: things that may hide people: poles, boxes, bushes, parked cars.
        person_height: (least, greatest) of a person where people walk, pixels.
        samples: rays along each side of a pixel.
        motion: people walk, dance in step, or play: run fast, and turn at once.
    """

    frames: PositiveInt = 200
    people: PositiveInt = 10
    occluders: NonNegativeInt = 7
    person_height: Span[PositiveFloat] = (30.0, 170.0)
    samples: Rays = 2
    motion: Motion = "walk"


class StreetClip(clip.Clip[clip.FrameTruth]):
    """Camera, light, background and everybody's way as a seed has it; every frame can be drawn on its own."""

    quality = 90

    def __init__(self, settings: StreetSettings, seed: int) -> None:
        self.settings, self.seed, rng = settings, seed, np.random.default_rng([seed, 0])
        camera, spots = _camera(rng, settings)
        self.camera, self.light = camera, (light := random_light(rng))
        ground, sunlit = draw_ground(Ground(rng), camera, light)
        static = street_things.clutter_around(rng, camera, settings.occluders, np.empty((0, 2)), LARGEST)
        middles = [t.solids.start[0, :2].astype(np.float64) for t in static]
        obstacles = [[*m, street_things.reach_of(t.solids, m)] for m, t in zip(middles, static, strict=True)]
        farthest = float(np.linalg.norm(spots, axis=1).max())
        static += street_things.buildings_behind(rng, int(rng.integers(1, 4)), farthest)
        bare, self.sunlit = darken(empty_picture(ground, settings.samples), static, camera, light, sunlit, 1.0)
        self.background, _ = compose(bare, static, camera, light)
        self.walkers = crowd(
            rng, settings, settings.people, lambda r: spots[int(r.integers(len(spots)))],
            lambda r: _out_of_view(r, camera, spots), np.array(obstacles, dtype=np.float64).reshape(-1, 3),
            settings.motion,
        )  # fmt: skip
        self.lens = Degradation(
            exposure=automatic_exposure(self.background.colour) * float(np.exp(rng.normal(0, 0.15))),
            contrast=float(np.exp(rng.normal(0.05, 0.1))),
            haze=float(max(rng.normal(-0.05, 0.08), 0)),
            saturation=float(rng.uniform(0.7, 1.15)),
            blur=BLUR,
            noise=NOISE,
        )
        seconds = np.arange(settings.frames) / settings.frame_rate
        waves = zip(rng.uniform(0.02, 0.3, 3), rng.uniform(0, 2 * np.pi, 3), strict=True)
        self.drift = np.exp(EXPOSURE_DRIFT * sum(np.sin(2 * np.pi * f * seconds + p) for f, p in waves))

    def draw_frame(self, frame: int) -> clip.Moment[clip.FrameTruth]:
        """Ids count the people of the plan from 1."""
        camera = self.camera
        there = [i for i, walker in enumerate(self.walkers) if walker.is_there(frame)]
        things = [self.walkers[i].thing(frame) for i in there]
        picture, _ = darken(self.background, things, camera, self.light, self.sunlit, 1.0)
        picture, sightings = compose(picture, things, camera, self.light)
        rng = np.random.default_rng([self.seed, 1, frame])
        image = degrade(picture.colour, replace(self.lens, exposure=self.lens.exposure * self.drift[frame]), rng)
        truth, rows = clip.people_in_view(sightings, (camera.width, camera.height), 0.0, INSIDE)
        return (image,), replace(truth, ids=np.array(there, dtype=np.int64)[rows] + 1)

    def write_truth(self, folder: Path, name: str, truths: list[clip.FrameTruth]) -> None:
        """Write ``gt/gt.txt``, with ids without gaps in the order of appearance, and ``seqinfo.ini``."""
        labels = clip.ground_truth(truths)
        self.settings.write_info(folder, name, replace(labels, ids=clip.by_appearance(labels.ids)))


def _camera(rng: np.random.Generator, settings: StreetSettings) -> tuple[PinholeCamera, FloatArray]:
    """A camera and ``(N, 2)`` places in view where people have a wanted size."""
    feet = rng.uniform([0.03, 0.05], [0.97, 1.0], (400, 2)) * [settings.width, settings.height]
    low, high = settings.person_height
    for _ in range(CAMERAS):
        camera = street_things.random_camera(rng, settings.width, settings.height, CAMERA_HEIGHT)
        spots = camera.ground(feet)[:, :2]
        apparent = street_things.apparent_heights(camera, spots)
        heads, _ = camera.project(np.nan_to_num(np.insert(spots, 2, 1.8, axis=1)))
        good = (apparent > low) & (apparent < high) & (heads[:, 1] > 0)
        if good.mean() >= WALKABLE and ConvexHull(spots[good]).volume >= ROOM * settings.people:
            return camera, spots[good]
    raise RequestError(
        f"street clip: expected a person_height that cameras {CAMERA_HEIGHT} m over the ground can show with "
        f"room for {settings.people} people, got {settings.person_height} pixels; widen one of the two or ask for fewer"
    )


def _out_of_view(rng: np.random.Generator, camera: PinholeCamera, spots: FloatArray) -> FloatArray:
    """A place ``(2,)`` beside the view, as far away as one of the ``spots`` in it."""
    spot = spots[int(rng.integers(len(spots)))]
    side = 1.0 if rng.random() < 0.5 else -1.0
    pixel, _ = camera.project(np.array([[spot[0], spot[1], 0.0]]))
    edge = -0.12 * camera.width if side < 0 else 1.12 * camera.width
    place = camera.ground(np.array([[edge, pixel[0, 1]]]))[0, :2]
    return np.asarray(place if np.isfinite(place).all() else spot + side * np.array([30.0, 0.0]))
