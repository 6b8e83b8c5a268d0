"""A clip of a street: people walk before a fixed camera, among things that hide them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from scipy.spatial import ConvexHull

from tsuiseki.datamodules.scenes.clip import check_settings, ground_truth, write_images, write_info
from tsuiseki.datamodules.scenes.people.person import person_solids
from tsuiseki.datamodules.scenes.people.walkers import CrowdSettings, Walker, crowd
from tsuiseki.datamodules.scenes.render.degrade import Degradation, automatic_exposure, degrade
from tsuiseki.datamodules.scenes.render.ground import draw_ground, random_ground
from tsuiseki.datamodules.scenes.render.scene import Picture, Thing, compose, darken, empty_picture
from tsuiseki.datamodules.scenes.render.shading import Light, random_light
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.datamodules.scenes.things.clutter import (
    apparent_heights,
    buildings_behind,
    clutter_around,
    random_camera,
    reach_of,
)
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.geometry import areas, clip_boxes
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray
from tsuiseki.tracking.types.labels import GroundTruth

CAMERAS = 300
# Share of the image in which people have a wanted size, at least.
WALKABLE = 0.45
LARGEST = 0.05
# Square metres of the ground in view for each person, at least.
ROOM = 5.0
# Share of a person's box that lies inside the image, at least, for a row of the truth.
INSIDE = 0.1


@dataclass(frozen=True)
class StreetSettings:
    """A street clip.

    Attributes:
        width: pixels.
        height: pixels.
        frames: length of the clip.
        frame_rate: frames per second.
        people: about how many are around at a time.
        occluders: things that may hide people: poles, boxes, bushes, parked cars.
        camera_height: (lowest, highest), metres.
        person_height: (least, greatest) of a person where people walk, pixels.
        groups: probability that somebody walks in company.
        pauses: probability of standing still where the way turns.
        look_alikes: probability of being dressed much like somebody else around.
        speed: (mean, standard deviation), m/s.
        exposure_drift: slow change of the brightness, share.
        blur: standard deviation, pixels.
        noise: standard deviation, grey levels of 255.
        jpeg: quality of the written images.
        samples: rays along each side of a pixel.
    """

    width: int = 640
    height: int = 480
    frames: int = 200
    frame_rate: float = 25.0
    people: int = 10
    occluders: int = 7
    camera_height: tuple[float, float] = (2.5, 9.0)
    person_height: tuple[float, float] = (30.0, 170.0)
    groups: float = 0.35
    pauses: float = 0.25
    look_alikes: float = 0.15
    speed: tuple[float, float] = (1.3, 0.2)
    exposure_drift: float = 0.06
    blur: float = 0.5
    noise: float = 3.0
    jpeg: int = 90
    samples: int = 2

    def __post_init__(self) -> None:
        shares = (self.groups, self.pauses, self.look_alikes)
        own = (
            (self.occluders >= 0, "occluders >= 0", self.occluders),
            (0 < self.camera_height[0] <= self.camera_height[1], "camera_height as (low, high)", self.camera_height),
            (0 < self.person_height[0] < self.person_height[1], "person_height as (low, high)", self.person_height),
            (all(0 <= p <= 1 for p in shares), "groups, pauses and look_alikes in [0, 1]", shares),
            (self.speed[0] > 0 and self.speed[1] >= 0, "a positive mean speed", self.speed),
            (self.exposure_drift >= 0, "no negative exposure_drift", self.exposure_drift),
        )
        check_settings("street", self, 32, own)


@dataclass(frozen=True)
class FrameTruth:
    """What a frame shows.

    Attributes:
        ids: ``(N,)`` from 1.
        boxes: ``(N, 4)`` pixels: the whole silhouette, hidden parts included, clipped to the image.
        visibility: ``(N,)`` visible share of the silhouette, what lies outside the image included, [0, 1].
    """

    ids: IntArray
    boxes: FloatArray
    visibility: FloatArray


@dataclass(frozen=True)
class Street:
    """A planned clip, of which every frame can be drawn on its own."""

    settings: StreetSettings
    seed: int
    camera: PinholeCamera
    light: Light
    background: Picture
    sunlit: Float32
    walkers: list[Walker]
    lens: Degradation
    drift: FloatArray


def plan_street(settings: StreetSettings, seed: int) -> Street:
    """Camera, light, background and everybody's way, as ``seed`` has it."""
    rng = np.random.default_rng([seed, 0])
    camera, spots = _camera(rng, settings)
    light = random_light(rng)
    ground, sunlit = draw_ground(random_ground(rng), camera, light)
    static = clutter_around(rng, camera, settings.occluders, np.empty((0, 2)), LARGEST)
    middles = [t.solids.start[0, :2].astype(np.float64) for t in static]
    obstacles = [[*m, reach_of(t.solids, m)] for m, t in zip(middles, static, strict=True)]
    static += buildings_behind(rng, int(rng.integers(1, 4)), float(np.linalg.norm(spots, axis=1).max()))
    bare, sunlit = darken(empty_picture(ground, settings.samples), static, camera, light, sunlit, 1.0)
    background, _ = compose(bare, static, camera, light)
    walkers = crowd(
        rng,
        CrowdSettings(settings.people, settings.groups, settings.pauses, settings.speed, settings.look_alikes),
        settings.frames,
        settings.frame_rate,
        lambda r: np.asarray(spots[int(r.integers(len(spots)))]),
        lambda r: _out_of_view(r, camera, spots),
        np.array(obstacles, dtype=np.float64).reshape(-1, 3),
    )
    lens = Degradation(
        exposure=automatic_exposure(background.colour) * float(np.exp(rng.normal(0, 0.15))),
        contrast=float(np.exp(rng.normal(0.05, 0.1))),
        haze=float(max(rng.normal(-0.05, 0.08), 0)),
        saturation=float(rng.uniform(0.7, 1.15)),
        blur=settings.blur,
        noise=settings.noise,
    )
    seconds = np.arange(settings.frames) / settings.frame_rate
    waves = zip(rng.uniform(0.02, 0.3, 3), rng.uniform(0, 2 * np.pi, 3), strict=True)
    drift = np.exp(settings.exposure_drift * sum(np.sin(2 * np.pi * f * seconds + p) for f, p in waves))
    return Street(settings, seed, camera, light, background, sunlit, walkers, lens, np.asarray(drift))


def draw_street(street: Street, frame: int) -> tuple[ImageArray, FrameTruth]:
    """Frame ``frame`` of a planned clip; ids count the people of the plan from 1."""
    settings, camera = street.settings, street.camera
    there = [i for i, walker in enumerate(street.walkers) if walker.is_there(frame)]
    things = []
    for walker in (street.walkers[i] for i in there):
        t = frame - walker.first
        solids = person_solids(walker.person, walker.pose(frame), walker.positions[t], float(walker.headings[t]))
        things.append(Thing(solids, walker.person.look))
    picture, _ = darken(street.background, things, camera, street.light, street.sunlit, 1.0)
    picture, sightings = compose(picture, things, camera, street.light)
    rng = np.random.default_rng([street.seed, 1, frame])
    image = degrade(picture.colour, replace(street.lens, exposure=street.lens.exposure * street.drift[frame]), rng)
    found = [(i + 1, s.box, s.visibility) for i, s in zip(there, sightings, strict=True) if s is not None]
    ids = np.array([f[0] for f in found], dtype=np.int64)
    whole = np.array([f[1] for f in found], dtype=np.float64).reshape(-1, 4)
    boxes = clip_boxes(whole, settings.width, settings.height)
    kept = areas(boxes) > INSIDE * areas(whole)
    return image, FrameTruth(ids[kept], boxes[kept], np.array([f[2] for f in found], dtype=np.float64)[kept])


def street_frames(settings: StreetSettings, seed: int) -> Iterator[tuple[ImageArray, FrameTruth]]:
    """The frames of a clip as ``(H, W, 3)`` uint8 RGB images, before JPEG, and what they show."""
    street = plan_street(settings, seed)
    for frame in range(settings.frames):
        yield draw_street(street, frame)


Drawn: TypeAlias = tuple[ImageArray, FrameTruth]


def write_street(
    folder: str | Path,
    settings: StreetSettings,
    seed: int,
    overwrite: bool = False,
    name: str = "",
    watch: Callable[[Iterator[Drawn]], Iterator[Drawn]] = iter,
) -> Path:
    """Write a clip in the MOTChallenge layout: ``img1/000001.jpg``, ..., ``gt/gt.txt``, ``seqinfo.ini``.

    It is written beside and renamed: an interrupted run leaves nothing under the final name.

    Args:
        folder: does not exist yet or is empty, unless ``overwrite``.
        settings: of the clip.
        seed: of all chance.
        overwrite: a clip that the folder holds is replaced, and its other files stay.
        name: of the sequence; by default the folder's.
        watch: passes the frames on as they are drawn, to show how far it is.

    Raises:
        RequestError: ``folder`` is a file, holds files while ``overwrite`` is False, or cannot be made.
    """
    folder = Path(folder).resolve()
    with output_folder(folder, overwrite) as work:
        truths = write_images(work / "img1", watch(street_frames(settings, seed)), settings.jpeg)
        write_ground_truth(work / "gt" / "gt.txt", as_ground_truth(truths))
        write_info(work, name or folder.name, settings)
    return folder


def as_ground_truth(truths: list[FrameTruth]) -> GroundTruth:
    """All rows of a clip, every one evaluated, with ids without gaps in the order of appearance."""
    truth = ground_truth(truths)
    _, first, inverse = np.unique(truth.ids, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return replace(truth, ids=(rank[inverse] + 1).astype(np.int64))


def _camera(rng: np.random.Generator, settings: StreetSettings) -> tuple[PinholeCamera, FloatArray]:
    """A camera and ``(N, 2)`` places in view where people have a wanted size."""
    feet = rng.uniform([0.03, 0.05], [0.97, 1.0], (400, 2)) * [settings.width, settings.height]
    low, high = settings.person_height
    for _ in range(CAMERAS):
        camera = random_camera(rng, settings.width, settings.height, settings.camera_height)
        spots = camera.ground(feet)[:, :2]
        apparent = apparent_heights(camera, spots)
        heads, _ = camera.project(np.nan_to_num(np.insert(spots, 2, 1.8, axis=1)))
        good = (apparent > low) & (apparent < high) & (heads[:, 1] > 0)
        if good.mean() >= WALKABLE and ConvexHull(spots[good]).volume >= ROOM * settings.people:
            return camera, spots[good]
    raise RequestError(
        f"street clip: expected a person_height that cameras {settings.camera_height} m over the ground can show with "
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
