"""People in a room before fisheye cameras on its ceiling, and perhaps others on its walls, with boxes and places."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import cv2
import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt
from pydantic.dataclasses import dataclass as settings_dataclass

from tsuiseki.datamodules.scenes import clip
from tsuiseki.datamodules.scenes.clip import Side
from tsuiseki.datamodules.scenes.people.walkers import dressed, wander
from tsuiseki.datamodules.scenes.render import degrade
from tsuiseki.datamodules.scenes.render.composing import OCCLUSION, Picture, Thing, both_shadows, draw_clusters, encoded
from tsuiseki.datamodules.scenes.render.shading import Light
from tsuiseki.datamodules.scenes.render.solids import Surface, as_colour, boxes
from tsuiseki.datamodules.scenes.render.tracing import RayCamera, extents
from tsuiseki.datamodules.scenes.things.room import draw_shell, random_furniture, random_shell
from tsuiseki.tracking.bounds import SETTINGS, Share
from tsuiseki.tracking.cameras.camera_files import AnyCamera, CameraOverFloor, write_cameras
from tsuiseki.tracking.cameras.lens_fitting import EquidistantLens, fit_omnidirectional
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera, OmnidirectionalLens
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, ImageArray

Room = Literal["large", "small"]
# Width and length of the thesis's rooms (4.3.1), metres.
SIZES: dict[Room, tuple[float, float]] = {"large": (8.0, 16.0), "small": (4.0, 9.0)}
# On the ceiling of a room (thesis 4.3.1).
CAMERAS = 2
# Of a right angle to the camera's axis, as a share of the image's height.
RADIUS = 0.475
# Greatest angle to the axis that a ceiling camera sees, radians: a little more than half a space.
FIELD = 1.6
# Share of a person's silhouette that shows, at least, for a row of the truth.
SHOWN = 0.12
# Share of a person's box that lies in the image, at least, for a row of the truth.
INSIDE = 0.3
# (lowest, highest) ceiling, metres; the cameras hang 10 cm below.
CEILING = (2.7, 3.3)
# Pieces of furniture in 10 square metres.
FURNITURE = 1.2
# Standard deviation of the sensor's noise, grey levels.
NOISE = 3.0
# Standard deviation of the lens's blur, pixels.
BLUR = 0.6
# Rays along a pixel's side.
SAMPLES = 2
CAMERAS_FILE = "cameras.yaml"
PLACES_FILE = "gt/world.csv"
TRUTH_FILE = "truth.csv"
# Of cameras of both kinds those that hang from the ceiling, from 0.
OVERHEAD = (1, 3)
# At which shares of width and length the others stand, in the order in which they are used.
STANDS = ((0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0), (0.0, 0.5))
# Horizontal field of a wall camera, radians.
WALL_FIELD = np.deg2rad(80.0)
# Distance of a wall camera from walls and ceiling, metres.
AWAY = 0.25
# Height that a wall camera aims at, metres.
AIM = 0.5
# Of a room; they end below the cameras.
PILLARS = 3
# (lowest, highest) pillar, metres.
TALL = (1.9, 2.1)


# Of a side of the floor; there must be room to walk.
Metres: TypeAlias = Annotated[float, Field(ge=2)]


@settings_dataclass(frozen=True, config=SETTINGS)
class RoomSettings(clip.ClipSettings):
    """A clip of a room.

    Attributes:
        size: width and length of the floor, metres.
        people: who wander about.
        repeated: probability of wearing the clothes of another, or nearly.
    """

    size: tuple[Metres, Metres] = SIZES["large"]
    frames: PositiveInt = 900
    frame_rate: PositiveFloat = 15.0
    people: PositiveInt = 6
    repeated: Share = 0.5
    width: Side = 1280
    height: Side = 960


@settings_dataclass(frozen=True, config=SETTINGS)
class FloorClipSettings(RoomSettings):
    """A clip of cameras of both kinds over one floor.

    Attributes:
        cameras: how many, 3 to 7. The second and the fourth are fisheye cameras on the ceiling.
    """

    size: tuple[Metres, Metres] = (9.0, 12.0)
    cameras: Annotated[int, Field(ge=3, le=len(OVERHEAD) + len(STANDS))] = 4


class RoomClip(clip.Clip[list[clip.FrameTruth]]):
    """The room and everybody's way as a seed has it; every frame of every camera can be drawn on its own.

    Args:
        settings: of the clip; those of a floor ask for pillars, and for cameras of both kinds.
        seed: of all random numbers.
        lens: of the cameras on the ceiling, see `ceiling_lens`.
    """

    quality = 90

    def __init__(self, settings: RoomSettings, seed: int, lens: OmnidirectionalLens | None = None) -> None:
        self.settings, self.seed, both = settings, seed, isinstance(settings, FloorClipSettings)
        rng, size = np.random.default_rng([seed, 7 if both else 4]), np.array(settings.size)
        ceiling = float(rng.uniform(*CEILING))
        self.furniture, obstacles = random_furniture(rng, size, round(FURNITURE * size.prod() / 10))
        if both:
            # Pillars hide people: along the length, in turns left and right of the middle, where ceiling cameras hang.
            half = np.column_stack([rng.uniform(0.12, 0.22, (PILLARS, 2)), rng.uniform(*TALL, PILLARS) / 2])
            along = (np.arange(PILLARS) + rng.uniform(0.3, 0.7, PILLARS)) / PILLARS
            aside = 0.5 + rng.choice([-1, 1]) * (-1) ** np.arange(PILLARS) * rng.uniform(0.15, 0.3, PILLARS)
            spots = np.column_stack([aside, along]) * size
            paints = [Surface(as_colour(rng.uniform(0.3, 0.8, 3))) for _ in range(PILLARS)]
            middles = np.column_stack([spots, half[:, 2]])
            self.furniture += [Thing(boxes(middles, half, np.zeros(PILLARS), paints))]
            obstacles = np.concatenate([obstacles, np.column_stack([spots, np.hypot(half[:, 0], half[:, 1])])])
        self.cameras = _cameras(rng, settings, ceiling, ceiling_lens(lens, settings.width, settings.height))
        people = dressed(rng, settings.people, settings.repeated)
        self.walkers = wander(rng, people, settings, size, obstacles)
        self.tone = degrade.tone(degrade.random_degradation(rng, 0.5))
        self.light = lamps(rng)

    @property
    def floor(self) -> FloatArray:
        """``(4,)`` x1, y1, x2, y2, metres."""
        return np.array([0.0, 0.0, *self.settings.size])

    @property
    def views(self) -> tuple[str, ...]:
        return tuple(f"camera{k + 1}/{clip.IMAGES}" for k in range(len(self.cameras)))

    def frames(self) -> Iterator[clip.Moment[list[clip.FrameTruth]]]:
        views = [RoomView(self, number) for number in range(len(self.cameras))]
        for frame in range(self.settings.frames):
            images, truths = zip(*(self.draw_frame(view, frame) for view in views), strict=True)
            yield images, list(truths)

    def draw_frame(self, view: RoomView, frame: int) -> tuple[ImageArray, clip.FrameTruth]:
        """Frame ``frame`` as a camera sees it, ``(H, W, 3)`` uint8 RGB before JPEG, and what it shows.

        Ids count the people of the plan from 1, the same for all cameras.
        """
        things = [walker.thing(frame) for walker in self.walkers]
        image, camera = view.photograph.copy(), view.camera
        sun, under = both_shadows(things, camera, self.light, 2.0)

        def below(rows: slice, columns: slice) -> Picture:
            n = view.empty.samples
            fine = slice(rows.start * n, rows.stop * n), slice(columns.start * n, columns.stop * n)
            part = Picture(view.empty.colour[rows, columns], view.empty.distance[fine], n)
            darker = view.direct[rows, columns] * sun[rows, columns, None]
            darker += part.colour * (OCCLUSION * part.open_ground * under[rows, columns])[:, :, None]
            return replace(part, colour=part.colour - darker)

        rects = np.array([_rectangle(thing, camera) for thing in things]).reshape(-1, 4)
        sightings = draw_clusters(image, things, rects, camera, self.light, below, view.exposure)
        image = degrade.photographed(image, self.tone, BLUR, view.grains, np.random.default_rng([self.seed, 1, frame]))
        # Before a wall camera a head alone may be a good part of the picture.
        inside = 0.0 if isinstance(self.settings, FloorClipSettings) else INSIDE
        truth, rows = clip.people_in_view(sightings, (camera.width, camera.height), SHOWN, inside)
        return image, replace(truth, places=np.array([walker.positions[frame] for walker in self.walkers])[rows])

    def write_truth(self, folder: Path, name: str, truths: list[list[clip.FrameTruth]]) -> None:
        """Write ``gt/gt.txt``, ``gt/world.csv`` and ``seqinfo.ini`` of each camera, and ``cameras.yaml``.

        ``gt/world.csv`` has frame (from 1), id, x, y in metres of those in ``gt.txt``. Cameras of both kinds also have
        ``truth.csv`` with time, id, x, y of everybody, seen or not.
        """
        del name
        ways = np.stack([walker.positions for walker in self.walkers])
        for number, of_camera in enumerate(zip(*truths, strict=True), 1):
            home, labels = folder / f"camera{number}", clip.ground_truth(of_camera)
            self.settings.write_info(home, home.name, labels)
            rows = np.column_stack([labels.frames + 1, labels.ids, ways[labels.ids - 1, labels.frames]])
            np.savetxt(home / PLACES_FILE, rows, "%d,%d,%.4f,%.4f", header="frame,id,x,y", comments="")
        named, rate = enumerate(self.cameras, 1), self.settings.frame_rate
        cameras = [CameraOverFloor(f"camera{k}", camera, rate, floor=self.floor) for k, camera in named]
        write_cameras(folder / CAMERAS_FILE, cameras)
        if isinstance(self.settings, FloorClipSettings):
            frames, people = np.indices(ways.shape[1::-1]).reshape(2, -1)
            rows = np.column_stack([frames / rate, people + 1, ways[people, frames]])
            np.savetxt(folder / TRUTH_FILE, rows, "%.6f,%d,%.4f,%.4f", header="time,id,x,y", comments="")


class RoomView:
    """One camera and what it sees of the empty room: linear light, and the part of it that shadows take away."""

    def __init__(self, room: RoomClip, number: int) -> None:
        rng, settings = np.random.default_rng([room.seed, 5]), room.settings
        self.camera, highest = room.cameras[number], max(float(camera.position[2]) for camera in room.cameras)
        width, height = self.camera.width, self.camera.height
        shell = random_shell(rng, np.array([*settings.size, highest + 0.1]))
        self.empty, self.direct = draw_shell(shell, self.camera, room.light, room.furniture, SAMPLES)
        self.grains = degrade.grains(np.random.default_rng([room.seed, 6, number]), NOISE, width, height)
        colour = self.empty.colour
        lit = colour[colour.max(axis=2) > 0.004]
        exposed = np.broadcast_to(lit[:, None], (len(lit), 1, 3))[::8].repeat(8, axis=0)
        self.exposure = degrade.automatic_exposure(exposed)
        self.photograph = encoded(colour, self.exposure)


def ceiling_lens(lens: OmnidirectionalLens | None, width: int, height: int) -> OmnidirectionalLens:
    """``lens``, by default an equidistant one, so large that a half space fits into an image of this size."""
    if lens is None:
        focal = np.full(2, RADIUS * height / (np.pi / 2))
        middle = np.array([width, height]) / 2
        return replace(fit_omnidirectional(EquidistantLens(width, height, focal, middle, np.zeros(4))), field=FIELD)
    across = lens.project(np.array([[1.0, 0.0, 1e-9], [-1.0, 0.0, 1e-9]]))
    if np.isnan(across).any():
        raise RequestError("expected a calibration that describes a right angle to the axis, got a narrower lens")
    scale = RADIUS * height / (np.linalg.norm(across[0] - across[1]) / 2)
    powers = scale ** (1.0 - np.arange(len(lens.direct)))
    # Where the axis met the old image matters little; here it is a little off the middle, as in life.
    off = (lens.centre - [lens.width / 2, lens.height / 2]) / lens.width * 0.3 * height
    return OmnidirectionalLens(
        width, height, lens.direct * powers, np.array([width, height]) / 2 + off, lens.stretch, np.empty(0), FIELD
    )


def _cameras(
    rng: np.random.Generator, settings: RoomSettings, ceiling: float, lens: OmnidirectionalLens
) -> list[AnyCamera]:
    """Cameras on the ceiling share its length; those on walls and in corners look across the middle."""
    size, width, height = np.array(settings.size), settings.width, settings.height
    count, overhead = CAMERAS, tuple(range(CAMERAS))
    if isinstance(settings, FloorClipSettings):
        count, overhead = settings.cameras, tuple(k for k in OVERHEAD if k < settings.cameras)
    cameras, stands = list[AnyCamera](), iter(STANDS)
    for k in range(count):
        if k in overhead:
            # Turned anyhow and hung a little askew.
            along = (overhead.index(k) + 0.5) / len(overhead) * size[1] + rng.normal(0, 0.2)
            spot = np.array([size[0] / 2 + rng.normal(0, 0.3), along, ceiling - 0.1])
            turned = looking_down(float(rng.uniform(0, 2 * np.pi)), *rng.normal(0, 0.02, 2))
            cameras.append(OmnidirectionalCamera(lens, turned, spot))
        else:
            place = np.array([*(AWAY + np.array(next(stands)) * (size - 2 * AWAY)), ceiling - AWAY])
            aim, focal = np.array([*(size / 2 + rng.normal(0, 0.4, 2)), AIM]), width / 2 / np.tan(WALL_FIELD / 2)
            cameras.append(PinholeCamera.look_at(place, aim, focal, width, height, float(rng.normal(0, 0.01))))
    return cameras


def looking_down(turn: float, tilt_x: float = 0.0, tilt_y: float = 0.0) -> FloatArray:
    """``(3, 3)`` rotation of a camera that looks down, turned about its axis and then tilted about x and y; radians."""
    down = np.diag([1.0, -1.0, -1.0])
    cos, sin = np.cos(turn), np.sin(turn)
    about = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    askew = cv2.Rodrigues(np.array([tilt_x, tilt_y, 0.0]))[0]
    return np.asarray(askew @ about @ down)


def lamps(rng: np.random.Generator) -> Light:
    """Light from the ceiling, more or less from everywhere."""
    angle, off = rng.uniform(0, 2 * np.pi), rng.uniform(0.0, 0.45)
    direction = np.array([np.sin(off) * np.cos(angle), np.sin(off) * np.sin(angle), np.cos(off)])
    warm = np.array([1 + rng.uniform(-0.04, 0.08), 1, 1 + rng.uniform(-0.08, 0.04)])
    sun, sky = rng.uniform(0.15, 0.5) * warm, rng.uniform(0.5, 0.8) * warm
    return Light(*(np.asarray(v, dtype=np.float32) for v in (direction, sun, sky, sky * rng.uniform(0.45, 0.75))))


def _rectangle(thing: Thing, camera: RayCamera) -> FloatArray:
    """``(4,)`` pixels that hold ``thing`` and its shadow's near part; NaN where no solid of it is in view."""
    rects = extents(thing.solids, camera)
    rects = rects[np.isfinite(rects).all(axis=1)]
    if not len(rects):
        return np.full(4, np.nan)
    low, high = rects[:, :2].min(axis=0), rects[:, 2:].max(axis=0)
    margin = 0.15 * (high - low).max() + 4
    return np.concatenate([low - margin, high + margin])
