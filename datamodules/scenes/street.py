"""A clip of a street: people walk before a fixed camera, among things that hide them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.degrade import Degradation, automatic_exposure, degrade
from tsuiseki.datamodules.scenes.ground import draw_ground, random_ground
from tsuiseki.datamodules.scenes.person import person_solids
from tsuiseki.datamodules.scenes.scene import Picture, Thing, compose, empty_picture, shadows
from tsuiseki.datamodules.scenes.shading import Light, random_light
from tsuiseki.datamodules.scenes.solids import Float32
from tsuiseki.datamodules.scenes.staging import (
    apparent_heights,
    buildings_behind,
    clutter_around,
    random_camera,
    reach_of,
)
from tsuiseki.datamodules.scenes.walkers import CrowdSettings, Walker, crowd
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import GroundTruth, write_ground_truth, write_sequence_info
from tsuiseki.tracking.geometry import areas, clip_boxes
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray

CAMERAS = 300
# Share of the image in which people have a wanted size, at least.
WALKABLE = 0.35
LARGEST = 0.05
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
    person_height: tuple[float, float] = (30.0, 220.0)
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
        expected = (
            (min(self.width, self.height) >= 32, "at least 32x32 pixels", f"{self.width}x{self.height}"),
            (self.frames >= 1, "at least one frame", self.frames),
            (np.isfinite(self.frame_rate) and self.frame_rate > 0, "a positive frame_rate", self.frame_rate),
            (self.people >= 1 and self.occluders >= 0, "people >= 1, occluders >= 0", (self.people, self.occluders)),
            (0 < self.camera_height[0] <= self.camera_height[1], "camera_height as (low, high)", self.camera_height),
            (0 < self.person_height[0] < self.person_height[1], "person_height as (low, high)", self.person_height),
            (1 <= self.jpeg <= 100 and 1 <= self.samples <= 8, "jpeg 1-100, samples 1-8", (self.jpeg, self.samples)),
            (self.speed[0] > 0 and self.speed[1] >= 0, "a positive mean speed", self.speed),
            (min(self.noise, self.blur, self.exposure_drift) >= 0, "no negative noise, blur or drift", "one"),
        )
        for holds, what, got in expected:
            if not holds:
                raise RequestError(f"street clip: expected {what}, got {got}")


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
    dark = shadows(static, camera, light, 1.0)
    background, _ = compose(
        empty_picture(ground * (1 - dark * sunlit)[:, :, None], settings.samples), static, camera, light
    )
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
    open_sun = sunlit * (1 - dark) * background.open_ground
    return Street(settings, seed, camera, light, background, open_sun, walkers, lens, np.asarray(drift))


def draw_street(street: Street, frame: int) -> tuple[ImageArray, FrameTruth]:
    """Frame ``frame`` of a planned clip; ids count the people of the plan from 1."""
    settings, camera = street.settings, street.camera
    there = [i for i, walker in enumerate(street.walkers) if walker.is_there(frame)]
    things = []
    for walker in (street.walkers[i] for i in there):
        t = frame - walker.first
        solids = person_solids(walker.person, walker.pose(frame), walker.positions[t], float(walker.headings[t]))
        things.append(Thing(solids, walker.person.look))
    dark = shadows(things, camera, street.light, 1.0)
    picture = replace(street.background, colour=street.background.colour * (1 - dark * street.sunlit)[:, :, None])
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


def write_street(folder: str | Path, settings: StreetSettings, seed: int, overwrite: bool = False) -> Path:
    """Write a clip in the MOTChallenge layout: ``img1/000001.jpg``, ..., ``gt/gt.txt``, ``seqinfo.ini``.

    An interrupted run leaves nothing under the final name.

    Raises:
        RequestError: ``folder`` is a file, or holds files while ``overwrite`` is False.
    """
    folder = Path(folder)
    truths = []
    with output_folder(folder, overwrite) as work:
        (work / "img1").mkdir()
        for frame, (image, truth) in enumerate(street_frames(settings, seed)):
            truths.append(truth)
            data = cv2.imencode(".jpg", image[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, settings.jpeg])[1]
            (work / "img1" / f"{frame + 1:06d}.jpg").write_bytes(data.tobytes())
        write_ground_truth(work / "gt" / "gt.txt", as_ground_truth(truths))
        write_sequence_info(work, folder.name, settings.frame_rate, settings.frames, settings.width, settings.height)
    return folder


def as_ground_truth(truths: list[FrameTruth]) -> GroundTruth:
    """All rows of a clip, every one evaluated, with ids without gaps in the order of appearance."""
    frames = np.repeat(np.arange(len(truths)), [len(t.ids) for t in truths])
    ids = np.concatenate([t.ids for t in truths])
    _, first, inverse = np.unique(ids, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return GroundTruth(
        frames=frames.astype(np.int64),
        ids=(rank[inverse] + 1).astype(np.int64),
        boxes=np.concatenate([t.boxes for t in truths]),
        evaluated=np.ones(len(ids), dtype=np.bool_),
        ignored=np.zeros(len(ids), dtype=np.bool_),
        visibility=np.concatenate([t.visibility for t in truths]),
    )


def _camera(rng: np.random.Generator, settings: StreetSettings) -> tuple[PinholeCamera, FloatArray]:
    """A camera and ``(N, 2)`` places in view where people have a wanted size."""
    feet = rng.uniform([0.03, 0.05], [0.97, 1.0], (400, 2)) * [settings.width, settings.height]
    low, high = settings.person_height
    for _ in range(CAMERAS):
        camera = random_camera(rng, settings.width, settings.height, settings.camera_height)
        spots = camera.ground(feet)[:, :2]
        apparent = apparent_heights(camera, spots)
        good = (apparent > low) & (apparent < high)
        if good.mean() >= WALKABLE:
            return camera, spots[good]
    raise RequestError(
        f"expected a person_height that cameras {settings.camera_height} m over the ground can show, "
        f"got {settings.person_height} pixels; widen one of the two"
    )


def _out_of_view(rng: np.random.Generator, camera: PinholeCamera, spots: FloatArray) -> FloatArray:
    """A place ``(2,)`` beside the view, as far away as one of the ``spots`` in it."""
    spot = spots[int(rng.integers(len(spots)))]
    side = 1.0 if rng.random() < 0.5 else -1.0
    pixel, _ = camera.project(np.array([[spot[0], spot[1], 0.0]]))
    edge = -0.12 * camera.width if side < 0 else 1.12 * camera.width
    place = camera.ground(np.array([[edge, pixel[0, 1]]]))[0, :2]
    return np.asarray(place if np.isfinite(place).all() else spot + side * np.array([30.0, 0.0]))
