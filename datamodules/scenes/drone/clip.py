"""A clip from a drone: people act on a textured ground under a camera that drifts, climbs, jerks and blurs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.datamodules.scenes.clip_files import check_settings
from tsuiseki.datamodules.scenes.drone.actors import Performer, PerformerState
from tsuiseki.datamodules.scenes.drone.flight import MOTIONS, STEEPEST, Strength, Viewpoint, fly, ground_homography
from tsuiseki.datamodules.scenes.drone.gathering import Gathering, gather
from tsuiseki.datamodules.scenes.drone.ground_map import GroundMap, look_down, map_ground
from tsuiseki.datamodules.scenes.people.activities import AHEAD
from tsuiseki.datamodules.scenes.people.body import place
from tsuiseki.datamodules.scenes.people.person import person_solids
from tsuiseki.datamodules.scenes.people.props import CRATE_HEIGHT, in_hand, standing_prop
from tsuiseki.datamodules.scenes.render.degrade import random_degradation, sensor_noise, tone
from tsuiseki.datamodules.scenes.render.ground import random_ground
from tsuiseki.datamodules.scenes.render.insertion import draw_things
from tsuiseki.datamodules.scenes.render.scene import Sighting, Thing
from tsuiseki.datamodules.scenes.render.shading import Light, hard_sun, random_light
from tsuiseki.datamodules.scenes.street.clutter import bush, crate
from tsuiseki.datamodules.scenes.street.staging import reach_of
from tsuiseki.datamodules.scenes.street.street import FrameTruth
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.geometry import areas, clip_boxes
from tsuiseki.tracking.types import FloatArray, ImageArray

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
