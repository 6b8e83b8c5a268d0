"""A clip from a drone: people act on a textured ground under a camera that drifts, climbs, jerks and blurs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from tsuiseki.datamodules.scenes.clip import check_settings, write_images, write_info
from tsuiseki.datamodules.scenes.people.activities import AHEAD
from tsuiseki.datamodules.scenes.people.body import place
from tsuiseki.datamodules.scenes.people.gathering import Gathering, Performer, PerformerState, gather
from tsuiseki.datamodules.scenes.people.person import person_solids
from tsuiseki.datamodules.scenes.people.props import CRATE_HEIGHT, in_hand, standing_prop
from tsuiseki.datamodules.scenes.render.degrade import random_degradation, sensor_noise, tone
from tsuiseki.datamodules.scenes.render.ground import GroundMap, ground_homography, look_down, map_ground, random_ground
from tsuiseki.datamodules.scenes.render.insertion import draw_things
from tsuiseki.datamodules.scenes.render.scene import Sighting, Thing
from tsuiseki.datamodules.scenes.render.shading import Light, hard_sun, random_light
from tsuiseki.datamodules.scenes.street_clip import FrameTruth, as_ground_truth
from tsuiseki.datamodules.scenes.things.clutter import bush, crate, reach_of
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.formats.acting_tracks import OKUTAMA_ACTIONS
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.formats.okutama import ACTIONS_FILE, actions_of, write_okutama
from tsuiseki.tracking.geometry import areas, clip_boxes
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.types.labels import ActionLabels

# Share of a person's box that lies inside the image, at least, for a row of the truth.
INSIDE = 0.1
# Metres that the view is broad at least, where the lens allows it.
BREADTH = 12.0
# Pictures of noise that the frames are grained with, each shifted by up to so many pixels.
NOISES, MARGIN = 3, 64
# Most copies of a frame that motion blur averages.
LONGEST_SMEAR = 24


@dataclass(frozen=True)
class DroneSceneSettings:
    """A clip from a drone.

    Attributes:
        width: pixels.
        height: pixels.
        frames: length of the clip.
        frame_rate: frames per second.
        people: that act in view.
        camera: how much the camera moves.
        altitude: (lowest, highest), metres.
        tilt: (flattest, steepest) view under the horizon, degrees.
        focal: (shortest, longest) focal length in widths of the image.
        look_alikes: probability of being dressed much like somebody else.
        sun: probability of a clip in a hard sun.
        clutter: bushes and boxes that stand about.
        shutter: share of the time between two frames for which the shutter is open, and motion blurs.
        blur: standard deviation of the lens's blur, pixels.
        noise: standard deviation, grey levels of 255.
        jpeg: quality of the written images.
        samples: rays along each side of a pixel.
    """

    width: int = 1280
    height: int = 720
    frames: int = 300
    frame_rate: float = 30.0
    people: int = 9
    camera: Strength = "violent"
    altitude: tuple[float, float] = (10.0, 45.0)
    tilt: tuple[float, float] = (45.0, 90.0)
    focal: tuple[float, float] = (1.0, 2.0)
    look_alikes: float = 0.3
    sun: float = 0.0
    clutter: int = 4
    shutter: float = 0.5
    blur: float = 0.6
    noise: float = 3.0
    jpeg: int = 90
    samples: int = 2

    def __post_init__(self) -> None:
        shares = (self.look_alikes, self.sun, self.shutter)
        own = (
            (self.camera in MOTIONS, f"a camera of {', '.join(MOTIONS)}", self.camera),
            (3 <= self.altitude[0] <= self.altitude[1], "altitude as (lowest, highest) from 3 m", self.altitude),
            (45 <= self.tilt[0] <= self.tilt[1] <= 90, "tilt as (flattest, steepest) within 45-90", self.tilt),
            (0 < self.focal[0] <= self.focal[1], "focal as (shortest, longest)", self.focal),
            (all(0 <= share <= 1 for share in shares), "look_alikes, sun and shutter in [0, 1]", shares),
            (self.clutter >= 0, "no negative clutter", self.clutter),
        )
        check_settings("drone", self, 64, own)


@dataclass(frozen=True)
class Flight:
    """A planned clip, of which every frame can be drawn on its own."""

    settings: DroneSceneSettings
    seed: int
    cameras: list[PinholeCamera]
    light: Light
    ground: GroundMap
    gathering: Gathering
    static: list[Thing]
    tone: FloatArray
    noise: list[NDArray[np.int16]]


@dataclass(frozen=True)
class DroneTruth:
    """What a frame shows: `street.FrameTruth` and what everybody does, one or two actions each."""

    people: FrameTruth
    actions: list[tuple[str, ...]]


def plan_flight(settings: DroneSceneSettings, seed: int) -> Flight:
    """The way of the camera, the ground and what everybody does, as ``seed`` has it."""
    rng = np.random.default_rng([seed, 7])
    view = _viewpoint(rng, settings)
    size = settings.width, settings.height
    motion = MOTIONS[settings.camera]
    cameras = fly(rng, view, motion, settings.frames, settings.frame_rate, size, settings.altitude)
    arena = _arena(settings, view)
    static, obstacles = _obstacles(rng, settings.clutter, arena)
    gathering = gather(
        rng, settings.people, settings.frames, settings.frame_rate, arena, obstacles, settings.look_alikes
    )
    # A generator of its own: the rest of a clip does not depend on the sun.
    light, of_sun = random_light(rng), np.random.default_rng([seed, 8])
    if of_sun.random() < settings.sun:
        light = hard_sun(of_sun)
    light = _exposed(light, float(np.exp(rng.normal(0, 0.2))))
    ground = map_ground(random_ground(rng), cameras, light)
    how = random_degradation(rng, 0.6)
    shape = settings.height + MARGIN, settings.width + MARGIN
    noise = [(settings.noise * sensor_noise(rng, *shape)).astype(np.int16) for _ in range(NOISES)]
    colours = tone(how)
    colours[:, 3] *= 255
    return Flight(settings, seed, cameras, light, ground, gathering, static, colours, noise)


def _viewpoint(rng: np.random.Generator, settings: DroneSceneSettings) -> Viewpoint:
    altitude = float(np.exp(rng.uniform(*np.log(settings.altitude))))
    tilt = min(float(np.radians(rng.uniform(*settings.tilt))), STEEPEST)
    # Near the ground a wider lens keeps everybody in view.
    widest = altitude / math.sin(tilt) / BREADTH
    focal = min(float(rng.uniform(*settings.focal)), max(widest, settings.focal[0]))
    return Viewpoint(altitude, tilt, math.pi / 2, focal * settings.width)


def _arena(settings: DroneSceneSettings, view: Viewpoint) -> FloatArray:
    """Centre and half axes of the ellipse that people act in: the middle of the view."""
    distance = view.altitude / math.sin(view.tilt)
    across = 0.36 * distance * settings.width / view.focal
    along = 0.34 * distance * settings.height / view.focal / math.sin(view.tilt)
    room = 1.1 * math.sqrt(settings.people)
    return np.array([[0.0, 0.0], [max(across, room), max(along, 0.75 * room)]])


def _obstacles(rng: np.random.Generator, count: int, arena: FloatArray) -> tuple[list[Thing], FloatArray]:
    """Bushes, trees and boxes about the arena, and ``(M, 3)`` where they stand and how far they reach."""
    things, rows = [], []
    for _ in range(count):
        angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(0.75, 1.5)
        spot = arena[0] + away * arena[1] * np.array([np.cos(angle), np.sin(angle)])
        solids = (bush if rng.random() < 0.6 else crate)(rng, spot, float(rng.uniform(0, 2 * np.pi)))
        things.append(Thing(solids))
        rows.append([*spot, min(reach_of(solids, spot), 0.8)])
    return things, np.array(rows, dtype=np.float64).reshape(-1, 3)


def _exposed(light: Light, exposure: float) -> Light:
    """``light`` as the camera takes it: a middle grey ground comes out as middle grey."""
    up = light.direction[2] * light.sun + light.sky
    gain = np.float32(0.8 * exposure / up.mean())
    return Light(light.direction, light.sun * gain, light.sky * gain, light.ground * gain)


def draw_flight(flight: Flight, frame: int) -> tuple[ImageArray, DroneTruth]:
    """Frame ``frame`` of a planned clip; ids count the performers of the plan from 1."""
    camera, settings = flight.cameras[frame], flight.settings
    states = [performer.states[frame] for performer in flight.gathering.performers]
    people = [_body(p, m) for p, m in zip(flight.gathering.performers, states, strict=True)]
    others = [held for p, m in zip(flight.gathering.performers, states, strict=True) for held in _held(p, m)]
    others += [
        Thing(standing_prop(t.prop, t.position, t.yaw)) for t in flight.gathering.things if t.first <= frame < t.last
    ]
    light = look_down(flight.ground, camera)
    sightings = draw_things(light, people + others + flight.static, camera, flight.light, settings.samples)
    image = _photograph(light, flight, frame)
    return image, _truth(sightings[: len(people)], states, settings)


def _body(performer: Performer, state: PerformerState) -> Thing:
    look = performer.person.look
    return Thing(person_solids(performer.person, state.pose, state.position, state.heading), look)


def _held(performer: Performer, state: PerformerState) -> list[Thing]:
    """What somebody has in hand, pushes, pulls or carries."""
    prop = state.prop
    if prop is None:
        return []
    if prop.kind not in AHEAD:
        skeleton = place(performer.person.build, state.pose, state.position, state.heading)
        return [Thing(in_hand(prop, skeleton, state.hand))]
    forward = np.array([math.cos(state.heading), math.sin(state.heading)])
    lift = CRATE_HEIGHT - 0.1 if prop.kind == "crate" else 0.0
    return [Thing(standing_prop(prop, state.position + AHEAD[prop.kind] * forward, state.heading, lift))]


def _truth(sightings: list[Sighting | None], states: list[PerformerState], settings: DroneSceneSettings) -> DroneTruth:
    found = [(i, s) for i, s in enumerate(sightings) if s is not None and s.visibility > 0]
    whole = np.array([s.box for _, s in found], dtype=np.float64).reshape(-1, 4)
    boxes = clip_boxes(whole, settings.width, settings.height)
    kept = areas(boxes) > INSIDE * areas(whole)
    found = [f for f, keep in zip(found, kept, strict=True) if keep]
    people = FrameTruth(
        np.array([i + 1 for i, _ in found], dtype=np.int64),
        boxes[kept],
        np.array([s.visibility for _, s in found], dtype=np.float64),
    )
    return DroneTruth(people, [states[i].activity.actions for i, _ in found])


def _photograph(light: ImageArray, flight: Flight, frame: int) -> ImageArray:
    """What the moving camera makes of ``light``: ``(H, W, 3)`` uint8, gamma 2."""
    settings = flight.settings
    rng = np.random.default_rng([flight.seed, 1, frame])
    image = _smeared(light, _image_motion(flight.cameras, frame) * settings.shutter)
    image = np.asarray(cv2.transform(image, flight.tone), dtype=np.uint8)
    if settings.blur > 0.2:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), settings.blur), dtype=np.uint8)
    if settings.noise > 0:
        top, left = rng.integers(0, MARGIN, 2)
        grain = flight.noise[int(rng.integers(NOISES))][top : top + settings.height, left : left + settings.width]
        image = np.asarray(cv2.add(image, grain, dtype=cv2.CV_8U), dtype=np.uint8)
    return image


def _image_motion(cameras: list[PinholeCamera], frame: int) -> FloatArray:
    """``(2,)`` pixels that the ground at the image's centre moves until the next frame."""
    if len(cameras) < 2:
        return np.zeros(2)
    before, after = cameras[frame : frame + 2] if frame + 1 < len(cameras) else cameras[-2:]
    middle = np.array([before.width / 2, before.height / 2, 1.0])
    moved = ground_homography(before, after) @ middle
    return np.asarray(moved[:2] / moved[2] - middle[:2])


def _smeared(image: ImageArray, motion: FloatArray) -> ImageArray:
    """``image`` averaged along ``motion`` ``(2,)`` pixels."""
    count = int(min(np.abs(motion).max().round() + 1, LONGEST_SMEAR))
    if count < 2:
        return image
    reach = int(np.ceil(np.abs(motion).max() / 2)) + 1
    height, width = image.shape[:2]
    padded = cv2.copyMakeBorder(image, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    total = np.zeros(image.shape, dtype=np.float32)
    for part in np.linspace(-0.5, 0.5, count):
        dx, dy = np.round(part * motion).astype(int)
        top, left = reach + dy, reach + dx
        cv2.accumulate(padded[top : top + height, left : left + width], total)
    return np.asarray(cv2.convertScaleAbs(total, alpha=1 / count), dtype=np.uint8)


Strength = Literal["still", "calm", "violent"]
STEEPEST = math.radians(89.5)


@dataclass(frozen=True)
class Motion:
    """How much a camera moves; angles in degrees.

    Attributes:
        drift: standard deviation of the slow sideways movement, in altitudes.
        climb: standard deviation of the slow change of the altitude, relative.
        pan: standard deviation of the slow turns.
        tremble: standard deviation of the quick tremble.
        jerks: a second, on average.
        jerk: standard deviation of a jerk's turn.
        jerk_frames: (fewest, most) frames that a jerk's turn takes.
    """

    drift: float
    climb: float
    pan: float
    tremble: float
    jerks: float
    jerk: float
    jerk_frames: tuple[int, int]


MOTIONS: dict[Strength, Motion] = {
    "still": Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, (1, 1)),
    "calm": Motion(0.04, 0.03, 2.0, 0.02, 0.2, 0.6, (4, 9)),
    "violent": Motion(0.08, 0.10, 4.0, 0.10, 1.2, 3.5, (1, 4)),
}


@dataclass(frozen=True)
class Viewpoint:
    """Where a flight is about: the camera looks at the origin of the ground from there.

    Attributes:
        altitude: metres.
        tilt: radians under the horizon.
        bearing: direction that the camera looks in, radians.
        focal: pixels.
    """

    altitude: float
    tilt: float
    bearing: float
    focal: float


def fly(
    rng: np.random.Generator,
    view: Viewpoint,
    motion: Motion,
    frames: int,
    frame_rate: float,
    size: tuple[int, int],
    altitudes: tuple[float, float],
) -> list[PinholeCamera]:
    """The camera of every frame.

    Args:
        rng: draws the movements.
        view: that the camera moves about.
        motion: how much.
        frames: how long.
        frame_rate: frames per second.
        size: width and height of the image, pixels.
        altitudes: lowest and highest, metres; the camera keeps within them.
    """
    slow = np.stack([_wander(rng, frames, frame_rate, 2.0) for _ in range(6)])
    fast = np.stack([_wander(rng, frames, frame_rate, 0.05) for _ in range(3)])
    turns = np.radians(motion.pan) * slow[:3] + np.radians(motion.tremble) * fast
    turns += np.radians(_jerks(rng, motion, frames, frame_rate))
    altitude = np.clip(view.altitude * (1 + motion.climb * slow[3]), *altitudes)
    drift = motion.drift * view.altitude * slow[4:6]
    cameras = []
    for t in range(frames):
        # A tremble rolls the camera less than it turns it.
        bearing = view.bearing + turns[0, t] / max(math.cos(view.tilt), 0.35)
        tilt = float(np.clip(view.tilt + turns[1, t], np.radians(45), STEEPEST))
        back = view.altitude / math.tan(view.tilt)
        position = np.array(
            [
                drift[0, t] - back * math.cos(view.bearing),
                drift[1, t] - back * math.sin(view.bearing),
                altitude[t],
            ]
        )
        forward = np.array([math.cos(tilt) * math.cos(bearing), math.cos(tilt) * math.sin(bearing), -math.sin(tilt)])
        cameras.append(PinholeCamera.look_at(position, position + forward, view.focal, *size, 0.5 * turns[2, t]))
    return cameras


def _wander(rng: np.random.Generator, frames: int, frame_rate: float, seconds: float) -> FloatArray:
    """``(frames,)`` smooth noise of unit deviation that changes within about ``seconds``."""
    sigma = max(seconds * frame_rate / 2, 0.3)
    margin = int(4 * sigma) + 1
    noise = gaussian_filter1d(rng.standard_normal(frames + 2 * margin), sigma)[margin : margin + frames]
    # Of white noise so smoothed.
    return np.asarray(noise * math.sqrt(2 * sigma * math.sqrt(math.pi)))


def _jerks(rng: np.random.Generator, motion: Motion, frames: int, frame_rate: float) -> FloatArray:
    """``(3, frames)`` degrees: sudden turns that swing back slowly, as the drone's control has it."""
    turns = np.zeros((3, frames))
    for _ in range(int(rng.poisson(motion.jerks * frames / frame_rate))):
        start, rise = int(rng.integers(frames)), int(rng.integers(motion.jerk_frames[0], motion.jerk_frames[1] + 1))
        away = motion.jerk * rng.normal(size=3) * [1.0, 1.0, 0.7]
        t = np.arange(frames - start)
        up = np.clip(t / rise, 0, 1)
        back = np.exp(-np.maximum(t - rise, 0) / (0.35 * frame_rate))
        swing = np.cos(2 * np.pi * np.maximum(t - rise, 0) / (0.8 * frame_rate))
        turns[:, start:] += away[:, None] * up * back * swing
    return turns


Drawn: TypeAlias = tuple[ImageArray, DroneTruth]
Layout = Literal["mot", "okutama"]
OKUTAMA_FRAMES = "Drone1/Morning/Extracted-Frames-1280x720"
OKUTAMA_LABELS = "Labels/SingleActionTrackingLabels/3840x2160"
# Somebody of whom less than this share shows is labelled as occluded.
OCCLUDED = 0.4


def drone_frames(settings: DroneSceneSettings, seed: int) -> Iterator[Drawn]:
    """The frames of a clip as ``(H, W, 3)`` uint8 RGB images, before JPEG, and what they show."""
    flight = plan_flight(settings, seed)
    for frame in range(settings.frames):
        yield draw_flight(flight, frame)


def write_drone(
    folder: str | Path,
    settings: DroneSceneSettings,
    seed: int,
    overwrite: bool = False,
    name: str = "",
    watch: Callable[[Iterator[Drawn]], Iterator[Drawn]] = iter,
    layout: Layout = "mot",
) -> Path:
    """Write a clip in MOTChallenge's layout with ``gt/actions.txt``, or in Okutama-Action's.

    The former is ``img1/000001.jpg``, ..., ``gt/gt.txt``, ``seqinfo.ini``; the latter
    ``Drone1/Morning/Extracted-Frames-1280x720/NAME/0.jpg``, ... and
    ``Labels/SingleActionTrackingLabels/3840x2160/NAME.txt``.

    Args:
        folder: does not exist yet or is empty, unless ``overwrite``.
        settings: of the clip.
        seed: of all chance.
        overwrite: a clip that the folder holds is replaced.
        name: of the sequence; by default the folder's, in Okutama-Action's layout ``1.1.1``.
        watch: passes the frames on as they are drawn, to show how far it is.
        layout: ``mot`` or ``okutama``.

    Raises:
        RequestError: ``folder`` is a file, holds files while ``overwrite`` is False, or cannot be made.
    """
    folder = Path(folder).resolve()
    folder.parent.mkdir(parents=True, exist_ok=True)
    with output_folder(folder, overwrite) as work:
        name = name or (folder.name if layout == "mot" else "1.1.1")
        frames = watch(drone_frames(settings, seed))
        if layout == "mot":
            truths = write_images(work / "img1", frames, settings.jpeg)
        else:
            truths = write_images(work / OKUTAMA_FRAMES / name, frames, settings.jpeg, "{}.jpg".format)
        _write_labels(work, settings, truths, name, layout)
    return folder


def _write_labels(
    work: Path, settings: DroneSceneSettings, truths: list[DroneTruth], name: str, layout: Layout
) -> None:
    rows = as_ground_truth([t.people for t in truths])
    hidden, none = rows.visibility < OCCLUDED, np.zeros(len(rows), dtype=np.bool_)
    actions = actions_of([names for t in truths for names in t.actions])
    labels = ActionLabels(rows.frames, rows.ids, rows.boxes, none, hidden, none, actions, OKUTAMA_ACTIONS)
    size = settings.width, settings.height
    if layout == "okutama":
        write_okutama(work / OKUTAMA_LABELS / f"{name}.txt", labels, size)
        return
    write_okutama(work / ACTIONS_FILE, labels, size)
    write_ground_truth(work / "gt" / "gt.txt", rows)
    write_info(work, name, settings)
