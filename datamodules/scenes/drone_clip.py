"""A clip from a drone: people act on a textured ground under a camera that drifts, climbs, jerks and blurs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from pydantic import Field, NonNegativeInt, PositiveFloat, PositiveInt
from pydantic.dataclasses import dataclass as settings_dataclass
from scipy.ndimage import gaussian_filter1d

from tsuiseki.datamodules.scenes import clip
from tsuiseki.datamodules.scenes.clip import Rays, Side, Span
from tsuiseki.datamodules.scenes.people.activities import CRATE_HEIGHT, in_hand, standing_prop
from tsuiseki.datamodules.scenes.people.gathering import Gathering, facing
from tsuiseki.datamodules.scenes.people.person import person_thing
from tsuiseki.datamodules.scenes.people.posture import PersonSkeleton
from tsuiseki.datamodules.scenes.render.composing import Thing, draw_things
from tsuiseki.datamodules.scenes.render.degrade import grains, photographed, random_degradation, tone
from tsuiseki.datamodules.scenes.render.ground import Ground, GroundMap, ground_homography, look_down
from tsuiseki.datamodules.scenes.render.shading import Light, hard_sun, random_light
from tsuiseki.datamodules.scenes.things.street_things import bush, crate, reach_of
from tsuiseki.datamodules.scenes.things.town import made
from tsuiseki.tracking.bounds import SETTINGS, Share
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.formats.acting_tracks import OKUTAMA_ACTIONS
from tsuiseki.tracking.formats.okutama import ACTIONS_FILE, actions_of, write_okutama
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.types.labels import ActionLabels

# Share of a person's box that lies inside the image, at least, for a row of the truth.
INSIDE = 0.1
# Metres that the view is broad at least, where the lens allows it.
BREADTH = 12.0
# Share of the time between two frames for which the shutter is open, and motion blurs.
SHUTTER = 0.5
# Standard deviation of the lens's blur, pixels.
BLUR = 0.6
# Standard deviation of the sensor's noise, grey levels of 255.
NOISE = 3.0
# Most copies of a frame that motion blur averages.
LONGEST_SMEAR = 24
Layout = Literal["mot", "okutama"]
# Clips of several seeds may lie in one folder, as those of the data set do.
OKUTAMA_FRAMES = "Drone1/Morning/Extracted-Frames-1280x720/1.1.{seed}/{{frame}}.jpg"
OKUTAMA_LABELS = "Labels/SingleActionTrackingLabels/3840x2160/1.1.{seed}.txt"
# Somebody of whom less than this share shows is labelled as occluded.
OCCLUDED = 0.4
Strength = Literal["still", "calm", "violent"]
# Steepest view under the horizon, radians: straight down has no direction.
STEEPEST = math.radians(89.5)
# Direction on the ground that the camera looks in, radians.
BEARING = math.pi / 2


@dataclass(frozen=True)
class FlightMotion:
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


# How much a camera of each strength moves; the units are those of `FlightMotion`.
MOTIONS: dict[Strength, FlightMotion] = {
    "still": FlightMotion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, (1, 1)),
    "calm": FlightMotion(0.04, 0.03, 2.0, 0.02, 0.2, 0.6, (4, 9)),
    "violent": FlightMotion(0.08, 0.10, 4.0, 0.10, 1.2, 3.5, (1, 4)),
}


@settings_dataclass(frozen=True, config=SETTINGS)
class DroneSceneSettings(clip.ClipSettings):
    """A clip from a drone.

    Attributes:
        people: that act in view.
        camera: how much the camera moves.
        altitude: (lowest, highest), metres.
        tilt: (flattest, steepest) view under the horizon, degrees.
        focal: (shortest, longest) focal length in widths of the image.
        look_alikes: probability of being dressed much like somebody else.
        sun: probability of a clip in a hard sun.
        clutter: bushes and boxes that stand about.
        samples: rays along each side of a pixel.
        layout: ``mot`` is MOTChallenge's with ``gt/actions.txt``; ``okutama`` is Okutama-Action's.
    """

    width: Side = 1280
    height: Side = 720
    frames: PositiveInt = 300
    frame_rate: PositiveFloat = 30.0
    people: PositiveInt = 9
    camera: Strength = "violent"
    altitude: Span[Annotated[float, Field(ge=3)]] = (10.0, 45.0)
    tilt: Span[Annotated[float, Field(ge=45, le=90)]] = (45.0, 90.0)
    focal: Span[PositiveFloat] = (1.0, 2.0)
    look_alikes: Share = 0.3
    sun: Share = 0.0
    clutter: NonNegativeInt = 4
    samples: Rays = 2
    layout: Layout = "mot"


class DroneClip(clip.Clip[clip.FrameTruth]):
    """The camera's way, the ground and what everybody does as a seed has it; every frame can be drawn on its own."""

    quality = 90

    def __init__(self, settings: DroneSceneSettings, seed: int) -> None:
        self.settings, self.seed, rng = settings, seed, np.random.default_rng([seed, 7])
        altitude = float(np.exp(rng.uniform(*np.log(settings.altitude))))
        tilt = min(float(np.radians(rng.uniform(*settings.tilt))), STEEPEST)
        away = altitude / math.sin(tilt)
        # Near the ground a wider lens keeps everybody in view.
        focal = min(float(rng.uniform(*settings.focal)), max(away / BREADTH, settings.focal[0])) * settings.width
        self.cameras = fly(rng, settings, altitude, tilt, focal)
        # Centre and half axes of the ellipse that people act in: the middle of the view.
        across, along = 0.36 * away * settings.width / focal, 0.34 * away * settings.height / focal / math.sin(tilt)
        room = 1.1 * math.sqrt(settings.people)
        arena = np.array([[0.0, 0.0], [max(across, room), max(along, 0.75 * room)]])
        # Bushes, trees and boxes stand about it.
        self.static, rows = list[Thing](), []
        for _ in range(settings.clutter):
            angle, apart = rng.uniform(0, 2 * np.pi), rng.uniform(0.75, 1.5)
            spot = arena[0] + apart * arena[1] * np.array([np.cos(angle), np.sin(angle)])
            make = bush if rng.random() < 0.6 else crate
            self.static.append(made(rng, make, spot, float(rng.uniform(0, 2 * np.pi))))
            rows.append([*spot, min(reach_of(self.static[-1].solids, spot), 0.8)])
        obstacles = np.array(rows, dtype=np.float64).reshape(-1, 3)
        self.gathering = Gathering(rng, settings, settings.people, arena, obstacles, settings.look_alikes)
        # A generator of its own: the rest of a clip does not depend on the sun.
        light, of_sun = random_light(rng), np.random.default_rng([seed, 8])
        if of_sun.random() < settings.sun:
            light = hard_sun(of_sun)
        # As the camera takes it: a middle grey ground comes out as middle grey.
        up = light.direction[2] * light.sun + light.sky
        gain = np.float32(0.8 * float(np.exp(rng.normal(0, 0.2))) / up.mean())
        self.light = Light(light.direction, light.sun * gain, light.sky * gain, light.ground * gain)
        self.ground = GroundMap(Ground(rng), self.cameras, self.light)
        self.tone = tone(random_degradation(rng, 0.6))
        self.grains = grains(rng, NOISE, settings.width, settings.height)

    @property
    def views(self) -> tuple[str, ...]:
        return (clip.IMAGES if self.settings.layout == "mot" else OKUTAMA_FRAMES.format(seed=self.seed),)

    def draw_frame(self, frame: int) -> clip.Moment[clip.FrameTruth]:
        """Ids count the performers of the plan from 1."""
        camera, settings = self.cameras[frame], self.settings
        states = [performer.states[frame] for performer in self.gathering.performers]
        people = [person_thing(m.person, m.pose, m.position, m.heading) for m in states]
        others = list[Thing]()
        for m in states:
            if m.prop is not None and m.prop.ahead:
                lift, place = CRATE_HEIGHT - 0.1, m.position + m.prop.ahead * facing(m.heading)
                others.append(standing_prop(m.prop, place, m.heading, lift if m.prop.kind == "crate" else 0.0))
            elif m.prop is not None:
                skeleton = PersonSkeleton(m.person.build, m.pose, m.position, m.heading)
                others.append(in_hand(m.prop, skeleton, m.hand))
        others += [standing_prop(t.prop, t.position, t.yaw) for t in self.gathering.things if t.first <= frame < t.last]
        image = look_down(self.ground, camera)
        sightings = draw_things(image, people + others + self.static, camera, self.light, settings.samples)
        image = _smeared(image, self.cameras, frame)
        rng = np.random.default_rng([self.seed, 1, frame])
        image = photographed(image, self.tone, BLUR, self.grains, rng)
        truth, rows = clip.people_in_view(sightings[: len(people)], (camera.width, camera.height), 1e-9, INSIDE)
        return (image,), replace(truth, actions=tuple(states[i].activity.actions for i in rows))

    def write_truth(self, folder: Path, name: str, truths: list[clip.FrameTruth]) -> None:
        """Write ``gt/gt.txt``, ``gt/actions.txt`` and ``seqinfo.ini``, or the labels of Okutama-Action's layout."""
        settings, rows = self.settings, clip.ground_truth(truths)
        rows = replace(rows, ids=clip.by_appearance(rows.ids))
        hidden, none = rows.visibility < OCCLUDED, np.zeros(len(rows), dtype=np.bool_)
        actions = actions_of([names for t in truths for names in t.actions])
        labels = ActionLabels(rows.frames, rows.ids, rows.boxes, none, hidden, none, actions, OKUTAMA_ACTIONS)
        mot = settings.layout == "mot"
        place = ACTIONS_FILE if mot else OKUTAMA_LABELS.format(seed=self.seed)
        write_okutama(folder / place, labels, (settings.width, settings.height))
        if mot:
            settings.write_info(folder, name, rows)


def fly(
    rng: np.random.Generator, settings: DroneSceneSettings, high: float, down: float, focal: float
) -> list[PinholeCamera]:
    """The camera of every frame, which looks at the origin of the ground within the altitudes of the settings.

    It moves about a place ``high`` metres up and looks ``down`` radians under the horizon; ``focal`` is in pixels.
    """
    motion, frames, frame_rate = MOTIONS[settings.camera], settings.frames, settings.frame_rate
    slow = np.stack([_wander(rng, frames, frame_rate, 2.0) for _ in range(6)])
    fast = np.stack([_wander(rng, frames, frame_rate, 0.05) for _ in range(3)])
    turns = np.radians(motion.pan) * slow[:3] + np.radians(motion.tremble) * fast
    # Sudden turns that swing back slowly, as the drone's control has it.
    jerks = np.zeros((3, frames))
    for _ in range(int(rng.poisson(motion.jerks * frames / frame_rate))):
        start, rise = int(rng.integers(frames)), int(rng.integers(motion.jerk_frames[0], motion.jerk_frames[1] + 1))
        away = motion.jerk * rng.normal(size=3) * [1.0, 1.0, 0.7]
        since = np.arange(frames - start)
        since_rise = np.maximum(since - rise, 0)
        swing = np.exp(-since_rise / (0.35 * frame_rate)) * np.cos(2 * np.pi * since_rise / (0.8 * frame_rate))
        jerks[:, start:] += away[:, None] * np.clip(since / rise, 0, 1) * swing
    turns += np.radians(jerks)
    altitude = np.clip(high * (1 + motion.climb * slow[3]), *settings.altitude)
    drift = motion.drift * high * slow[4:6]
    back = high / math.tan(down)
    cameras = []
    for t in range(frames):
        # A tremble rolls the camera less than it turns it.
        bearing = BEARING + turns[0, t] / max(math.cos(down), 0.35)
        tilt = float(np.clip(down + turns[1, t], np.radians(45), STEEPEST))
        behind = drift[:, t] - [back * math.cos(BEARING), back * math.sin(BEARING)]
        position = np.array([*behind, altitude[t]])
        forward = np.array([math.cos(tilt) * math.cos(bearing), math.cos(tilt) * math.sin(bearing), -math.sin(tilt)])
        size = settings.width, settings.height
        cameras.append(PinholeCamera.look_at(position, position + forward, focal, *size, 0.5 * turns[2, t]))
    return cameras


def _wander(rng: np.random.Generator, frames: int, frame_rate: float, seconds: float) -> FloatArray:
    """``(frames,)`` smooth noise of unit deviation that changes within about ``seconds``."""
    sigma = max(seconds * frame_rate / 2, 0.3)
    margin = int(4 * sigma) + 1
    noise = gaussian_filter1d(rng.standard_normal(frames + 2 * margin), sigma)[margin : margin + frames]
    # Of white noise so smoothed.
    return np.asarray(noise * math.sqrt(2 * sigma * math.sqrt(math.pi)))


def _smeared(image: ImageArray, cameras: list[PinholeCamera], frame: int) -> ImageArray:
    """``image`` averaged along the way of the ground at its centre while the shutter is open."""
    start, end = cameras[frame : frame + 2] if frame + 1 < len(cameras) else (cameras[-2:] * 2)[:2]
    middle = np.array([start.width / 2, start.height / 2, 1.0])
    moved = ground_homography(start, end) @ middle
    motion = (moved[:2] / moved[2] - middle[:2]) * SHUTTER
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
