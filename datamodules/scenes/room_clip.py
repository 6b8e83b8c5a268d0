"""People in a room under fisheye cameras on its ceiling, with exact boxes and places."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.datamodules.scenes.clip import check_settings, ground_truth, write_images, write_info
from tsuiseki.datamodules.scenes.people.person import person_solids
from tsuiseki.datamodules.scenes.people.walkers import Walker, dressed, wander
from tsuiseki.datamodules.scenes.render.degrade import automatic_exposure, random_degradation, sensor_noise, tone
from tsuiseki.datamodules.scenes.render.insertion import clusters
from tsuiseki.datamodules.scenes.render.scene import Picture, Sighting, Thing, compose, shadows
from tsuiseki.datamodules.scenes.render.shading import Light
from tsuiseki.datamodules.scenes.render.solids import Float32, RayCamera, extents
from tsuiseki.datamodules.scenes.things.room import draw_shell, random_furniture, random_shell
from tsuiseki.tracking.cameras.camera_files import CameraOverFloor, write_cameras
from tsuiseki.tracking.cameras.lens_fitting import EquidistantLens, fit_omnidirectional
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera, OmnidirectionalLens
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.geometry import areas, clip_boxes
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray

Room = Literal["large", "small"]
# Width and length of the thesis's rooms (4.3.1), metres.
SIZES: dict[Room, tuple[float, float]] = {"large": (8.0, 16.0), "small": (4.0, 9.0)}
CAMERAS = 2
# Share of the image's height that is the radius of a right angle to the axis, and the field, radians.
RADIUS, FIELD = 0.475, 1.6
# Pictures of noise that frames are grained with, each shifted by up to so many pixels.
NOISES, SHIFT = 3, 64
# Share of a person's silhouette that shows, at least, and of its box that lies in the image, for a row of the truth.
SHOWN, INSIDE = 0.12, 0.3
OCCLUSION = 0.3


@dataclass(frozen=True)
class RoomSettings:
    """A clip of a room.

    Attributes:
        size: width and length of the floor, metres.
        frames: length of the clip.
        frame_rate: frames per second.
        people: who wander about.
        repeated: probability of wearing the clothes of another, or nearly.
        width: pixels.
        height: pixels.
        ceiling: (lowest, highest), metres; the cameras hang 10 cm below.
        furniture: pieces in 10 square metres.
        pauses: probability of a halt where the way turns.
        speed: (mean, standard deviation), m/s.
        noise: standard deviation, grey levels of 255.
        blur: standard deviation, pixels.
        jpeg: quality of the written images.
        samples: rays along each side of a pixel.
    """

    size: tuple[float, float] = SIZES["large"]
    frames: int = 900
    frame_rate: float = 15.0
    people: int = 6
    repeated: float = 0.5
    width: int = 1280
    height: int = 960
    ceiling: tuple[float, float] = (2.7, 3.3)
    furniture: float = 1.2
    pauses: float = 0.35
    speed: tuple[float, float] = (1.1, 0.25)
    noise: float = 3.0
    blur: float = 0.6
    jpeg: int = 90
    samples: int = 2

    def __post_init__(self) -> None:
        own = (
            (min(self.size) >= 2, "a floor of at least 2 by 2 m", self.size),
            (2.3 <= self.ceiling[0] <= self.ceiling[1], "a ceiling as (lowest, highest) from 2.3 m", self.ceiling),
            (0 <= self.repeated <= 1 and 0 <= self.pauses <= 1, "shares in [0, 1]", (self.repeated, self.pauses)),
            (self.furniture >= 0, "no negative furniture", self.furniture),
        )
        check_settings("room", self, 64, own)


@dataclass(frozen=True)
class View:
    """One camera and what it sees of the empty room: linear light, and the part of it that shadows take away."""

    camera: OmnidirectionalCamera
    empty: Picture
    direct: Float32
    photograph: ImageArray
    exposure: float
    noise: list[NDArray[np.int16]]


@dataclass(frozen=True)
class RoomClip:
    """A planned clip, of which every frame of every camera can be drawn on its own."""

    settings: RoomSettings
    seed: int
    cameras: list[OmnidirectionalCamera]
    light: Light
    walkers: list[Walker]
    furniture: list[Thing]
    tone: FloatArray

    @property
    def floor(self) -> FloatArray:
        """``(4,)`` x1, y1, x2, y2, metres."""
        return np.array([0.0, 0.0, *self.settings.size])


@dataclass(frozen=True)
class RoomTruth:
    """What a frame shows.

    Attributes:
        ids: ``(N,)`` from 1, the same for all cameras.
        boxes: ``(N, 4)`` pixels: the whole silhouette, hidden parts included, clipped to the image.
        visibility: ``(N,)`` share of the silhouette that shows.
        places: ``(N, 2)`` where they stand, metres.
    """

    ids: IntArray
    boxes: FloatArray
    visibility: FloatArray
    places: FloatArray


@dataclass(frozen=True)
class _Window:
    """A part of a camera's image as a camera of its own."""

    camera: RayCamera
    left: int
    top: int
    width: int
    height: int

    @property
    def position(self) -> FloatArray:
        return self.camera.position

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        pixels, depth = self.camera.project(points)
        return pixels - [self.left, self.top], depth

    def rays(self, pixels: NDArray[Any]) -> NDArray[Any]:
        return self.camera.rays(pixels + np.array([self.left, self.top], dtype=pixels.dtype))


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


def plan_room(settings: RoomSettings, seed: int, lens: OmnidirectionalLens | None = None) -> RoomClip:
    """The room, its cameras and everybody's way, as ``seed`` has it."""
    rng = np.random.default_rng([seed, 4])
    size = np.array(settings.size)
    ceiling = float(rng.uniform(*settings.ceiling))
    pieces = round(settings.furniture * size.prod() / 10)
    furniture, obstacles = random_furniture(rng, size, pieces)
    fitted = ceiling_lens(lens, settings.width, settings.height)
    cameras = [_camera(rng, fitted, size, k, ceiling - 0.1) for k in range(CAMERAS)]
    people = dressed(rng, settings.people, settings.repeated)
    walkers = wander(
        rng, people, settings.frames, settings.frame_rate, size, obstacles, settings.pauses, settings.speed
    )
    how = random_degradation(rng, 0.5)
    colours = tone(how)
    colours[:, 3] *= 255
    return RoomClip(settings, seed, cameras, lamps(rng), walkers, furniture, colours)


def _camera(
    rng: np.random.Generator, lens: OmnidirectionalLens, size: FloatArray, number: int, height: float
) -> OmnidirectionalCamera:
    """A camera that looks down, turned anyhow and hung a little askew, over its part of the room's length."""
    along = (number + 0.5) / CAMERAS * size[1] + rng.normal(0, 0.2)
    spot = np.array([size[0] / 2 + rng.normal(0, 0.3), along, height])
    return OmnidirectionalCamera(lens, looking_down(float(rng.uniform(0, 2 * np.pi)), *rng.normal(0, 0.02, 2)), spot)


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


def view_room(clip: RoomClip, number: int) -> View:
    """What camera ``number`` sees of the empty room."""
    rng = np.random.default_rng([clip.seed, 5])
    settings, camera = clip.settings, clip.cameras[number]
    height = float(camera.position[2]) + 0.1
    shell = random_shell(rng, np.array([*settings.size, height]))
    empty, direct = draw_shell(shell, camera, clip.light, clip.furniture, settings.samples)
    noisy = np.random.default_rng([clip.seed, 6, number])
    shape = settings.height + SHIFT, settings.width + SHIFT
    noise = [(settings.noise * sensor_noise(noisy, *shape)).astype(np.int16) for _ in range(NOISES)]
    seen = empty.colour[empty.colour.max(axis=2) > 0.004]
    exposure = automatic_exposure(np.broadcast_to(seen[:, None], (len(seen), 1, 3))[::8].repeat(8, axis=0))
    return View(camera, empty, direct, _encoded(empty.colour, exposure), exposure, noise)


def draw_room_frame(clip: RoomClip, view: View, frame: int) -> tuple[ImageArray, RoomTruth]:
    """Frame ``frame`` as a camera sees it, ``(H, W, 3)`` uint8 RGB before JPEG, and what it shows."""
    there = [i for i, walker in enumerate(clip.walkers) if walker.is_there(frame)]
    things, places = [], []
    for walker in (clip.walkers[i] for i in there):
        t = frame - walker.first
        place = walker.positions[t]
        solids = person_solids(walker.person, walker.pose(frame), place, float(walker.headings[t]))
        things.append(Thing(solids, walker.person.look))
        places.append(place)
    image, sightings = _with_people(clip, view, things)
    truth = _truth(sightings, np.array(there) + 1, np.array(places).reshape(-1, 2), clip.settings)
    return _photograph(image, clip, view, frame), truth


def _with_people(clip: RoomClip, view: View, things: list[Thing]) -> tuple[ImageArray, list[Sighting | None]]:
    image, camera = view.photograph.copy(), view.camera
    sun = shadows(things, camera, clip.light.direction, 2.0)
    under = shadows(things, camera, np.array([0, 0, 1], dtype=np.float32), 4.0)
    rects = np.array([_rectangle(thing, camera) for thing in things]).reshape(-1, 4)
    sightings: list[Sighting | None] = [None] * len(things)
    for (x1, y1, x2, y2), members in clusters(rects, camera.width, camera.height):
        rows, columns = slice(y1, y2), slice(x1, x2)
        part = _part_of(view.empty, rows, columns)
        darker = view.direct[rows, columns] * sun[rows, columns, None]
        darker += part.colour * (OCCLUSION * part.open_ground * under[rows, columns])[:, :, None]
        window = _Window(camera, x1, y1, x2 - x1, y2 - y1)
        people = [things[i] for i in members]
        picture, seen = compose(replace(part, colour=part.colour - darker), people, window, clip.light)
        image[rows, columns] = _encoded(picture.colour, view.exposure)
        for i, sighting in zip(members, seen, strict=True):
            if sighting is not None:
                sightings[i] = Sighting(sighting.box + np.array([x1, y1, x1, y1]), sighting.visibility)
    return image, sightings


def _part_of(picture: Picture, rows: slice, columns: slice) -> Picture:
    n = picture.samples
    fine = slice(rows.start * n, rows.stop * n), slice(columns.start * n, columns.stop * n)
    return Picture(picture.colour[rows, columns], picture.distance[fine], n, picture.owner[fine])


def _rectangle(thing: Thing, camera: RayCamera) -> FloatArray:
    """``(4,)`` pixels that hold ``thing`` and its shadow's near part; NaN where no solid of it is in view."""
    rects = extents(thing.solids, camera)
    rects = rects[np.isfinite(rects).all(axis=1)]
    if not len(rects):
        return np.full(4, np.nan)
    low, high = rects[:, :2].min(axis=0), rects[:, 2:].max(axis=0)
    margin = 0.15 * (high - low).max() + 4
    return np.concatenate([low - margin, high + margin])


def _encoded(colour: Float32, exposure: float) -> ImageArray:
    return np.asarray(255 * np.sqrt(np.clip(colour * np.float32(exposure), 0, 1)) + 0.5).astype(np.uint8)


def _photograph(image: ImageArray, clip: RoomClip, view: View, frame: int) -> ImageArray:
    settings = clip.settings
    rng = np.random.default_rng([clip.seed, 1, frame])
    image = np.asarray(cv2.transform(image, clip.tone), dtype=np.uint8)
    if settings.blur > 0.2:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), settings.blur), dtype=np.uint8)
    if settings.noise > 0:
        top, left = rng.integers(0, SHIFT, 2)
        grain = view.noise[int(rng.integers(NOISES))][top : top + settings.height, left : left + settings.width]
        image = np.asarray(cv2.add(image, grain, dtype=cv2.CV_8U), dtype=np.uint8)
    return image


def _truth(sightings: list[Sighting | None], ids: IntArray, places: FloatArray, settings: RoomSettings) -> RoomTruth:
    at = [k for k, s in enumerate(sightings) if s is not None and s.visibility >= SHOWN]
    found = [s for k in at if (s := sightings[k]) is not None]
    whole = np.array([s.box for s in found], dtype=np.float64).reshape(-1, 4)
    boxes = clip_boxes(whole, settings.width, settings.height)
    kept = areas(boxes) > INSIDE * areas(whole)
    chosen = np.array(at, dtype=np.int64)[kept]
    visibility = np.array([s.visibility for s in found], dtype=np.float64)
    return RoomTruth(ids[chosen], boxes[kept], visibility[kept], places[chosen])


Drawn: TypeAlias = tuple[ImageArray, RoomTruth]
CAMERAS_FILE, PLACES_FILE = "cameras.yaml", "gt/world.csv"


def write_room(
    folder: str | Path,
    settings: RoomSettings,
    seed: int,
    lens: OmnidirectionalLens | None = None,
    overwrite: bool = False,
    watch: Callable[[Iterator[Drawn]], Iterator[Drawn]] = iter,
) -> Path:
    """Write a clip: ``camera1``, ``camera2`` (``img1``, ``gt/gt.txt``, ``gt/world.csv``) and ``cameras.yaml``.

    Ids are the same in all cameras. ``gt/world.csv`` has frame (from 1), id, x, y in metres of those in ``gt.txt``.

    Args:
        folder: does not exist yet or is empty, unless ``overwrite``.
        settings: of the clip.
        seed: of all chance.
        lens: of the cameras, of any size; by default an equidistant one.
        overwrite: a clip that the folder holds is replaced.
        watch: passes the frames of a camera on as they are drawn, to show how far it is.

    Raises:
        RequestError: ``folder`` is a file, holds files while ``overwrite`` is False, or cannot be made.
    """
    folder = Path(folder).resolve()
    clip = plan_room(settings, seed, lens)
    with output_folder(folder, overwrite) as work:
        for number in range(len(clip.cameras)):
            _write_view(work / f"camera{number + 1}", clip, number, watch)
        write_cameras(work / CAMERAS_FILE, cameras_of(clip))
    return folder


def cameras_of(clip: RoomClip) -> list[CameraOverFloor]:
    """The clip's cameras as `cameras.yaml` has them."""
    rate = clip.settings.frame_rate
    return [CameraOverFloor(f"camera{k + 1}", camera, rate, floor=clip.floor) for k, camera in enumerate(clip.cameras)]


def _write_view(folder: Path, clip: RoomClip, number: int, watch: Callable[[Iterator[Drawn]], Iterator[Drawn]]) -> None:
    settings = clip.settings
    view = view_room(clip, number)
    frames = (draw_room_frame(clip, view, frame) for frame in range(settings.frames))
    truths = write_images(folder / "img1", watch(frames), settings.jpeg)
    write_ground_truth(folder / "gt" / "gt.txt", ground_truth(truths))
    write_places(folder / PLACES_FILE, truths)
    write_info(folder, folder.name, settings)


def write_places(path: Path, truths: list[RoomTruth]) -> None:
    """Write frame (from 1), id, x, y (metres) a row."""
    rows = [
        f"{frame + 1},{number},{x:.4f},{y:.4f}\n"
        for frame, truth in enumerate(truths)
        for number, (x, y) in zip(truth.ids.tolist(), truth.places.tolist(), strict=True)
    ]
    path.write_text("frame,id,x,y\n" + "".join(rows), encoding="utf-8")
