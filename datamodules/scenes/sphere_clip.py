"""The sphere paper's experiment as a scene: a person carries a ball through a room before calibrated cameras.

The ball's centre is the exact truth. The person's whole body is in view, hands and feet too, so that not only the ball
differs from the empty room (figure 5 of the paper).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt
from pydantic.dataclasses import dataclass as settings_dataclass

from tsuiseki.datamodules.scenes.clip import Clip, Moment, write_image
from tsuiseki.datamodules.scenes.people.gait import stride_length, walking
from tsuiseki.datamodules.scenes.people.person import person_thing, random_person
from tsuiseki.datamodules.scenes.people.posture import PersonSkeleton
from tsuiseki.datamodules.scenes.render.composing import Thing, compose, shadows
from tsuiseki.datamodules.scenes.render.shading import Light
from tsuiseki.datamodules.scenes.render.solids import Float32, Parts, Pattern, Surface, as_colour
from tsuiseki.datamodules.scenes.things.room import draw_hall, hall_furniture
from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.cameras.camera_files import PlacedCamera, write_cameras
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.formats.world_tables import write_path3d
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.types.tracks import Path3D

# Of an image, pixels.
WIDTH = 800
# Of an image, pixels.
HEIGHT = 600
# Horizontal field of view, radians.
FIELD = np.deg2rad(60.0)
# Where the cameras stand, seen from the room's middle, in the order in which they are used: degrees, metres away,
# metres high.
STANDS = (
    (-38.0, 4.0, 1.5),
    (38.0, 4.0, 1.7),
    (100.0, 3.9, 2.0),
    (-100.0, 3.85, 2.0),
    (0.0, 3.9, 2.3),
    (180.0, 4.1, 2.2),
)
# The place that all cameras look at, metres.
AIM = (0.0, 0.0, 0.95)
# Of the person, m/s.
SPEED = 0.30
# Instants whose mean stands for a smeared picture.
EXPOSURE_BLINKS = 4

# Direction to the lamp; colours of its light, of the light from above and of that from below.
LIGHT = Light(
    np.array([0.24, -0.31, 0.92], dtype=np.float32) / np.float32(1.0001),
    np.array([0.62, 0.60, 0.56], dtype=np.float32),
    np.array([0.55, 0.57, 0.60], dtype=np.float32),
    np.array([0.30, 0.29, 0.27], dtype=np.float32),
)


@settings_dataclass(frozen=True, config=SETTINGS)
class CarriedBallSettings:
    """What is shot.

    Attributes:
        cameras: 2 to 6.
        frames: of each camera.
        frame_rate: frames/s.
        radius: of the ball, m.
        noise: standard deviation, grey levels of 255.
        samples: rays along each side of a pixel.
        covers: (camera, first frame, last frame), all from 0, of boards before cameras.
        exposure: time for which light falls on a pixel, s: what moves is smeared.
        defocus: standard deviation of the lens's blur, pixels.
        lateness: time by which each camera takes its frames later than it says, s; none for all by default.
    """

    cameras: Annotated[int, Field(ge=2, le=len(STANDS))] = 2
    frames: PositiveInt = 100
    frame_rate: PositiveFloat = 15.0
    radius: PositiveFloat = 0.10
    noise: NonNegativeFloat = 3.0
    samples: PositiveInt = 3
    covers: tuple[tuple[int, int, int], ...] = ()
    exposure: NonNegativeFloat = 0.0
    defocus: NonNegativeFloat = 0.0
    lateness: tuple[float, ...] = ()


class SphereClip(Clip[FloatArray]):
    """The clip of a seed; its truth is the ball's centre, m.

    Attributes:
        cameras: C cameras.
        times: ``(T,)`` seconds.
        truth: ``(T, 3)`` centre of the ball, m.
    """

    quality = 95

    def __init__(self, settings: CarriedBallSettings, seed: int) -> None:
        self.settings, self.seed, rng = settings, seed, np.random.default_rng(seed)
        furniture = hall_furniture(rng)
        person = random_person(rng)
        # Bags and coats would hide the ball; the paper's scene has a person in plain clothes.
        outfit = person.outfit.but(bag="none", lower_style="trousers")
        self._person = replace(person, outfit=outfit, manner=replace(person.manner, stride=1.0))
        hue = rng.uniform(0, 2 * np.pi) + np.array([0, 2.1, 4.2])
        ball = 0.5 + 0.38 * np.cos(hue)
        # Of the ball and of its band.
        self._colours = as_colour(ball), as_colour(np.clip(ball + rng.choice([-0.25, 0.25]), 0.05, 0.95))
        self.cameras = ball_cameras(settings.cameras)
        # What each sees of the empty room, and the light ``(H, W, 3)`` on its floor that shadows take away.
        self._rooms = [draw_hall(camera, LIGHT, furniture, settings.samples) for camera in self.cameras]
        self.times = np.arange(settings.frames) / settings.frame_rate
        self.truth = np.stack([self._carried(float(t))[1] for t in self.times])

    @property
    def views(self) -> tuple[str, ...]:
        return tuple(f"camera{k + 1}/{{number:06d}}.jpg" for k in range(len(self.cameras)))

    def frames(self) -> Iterator[Moment[FloatArray]]:
        """Images ``(600, 800, 3)`` uint8 of all cameras at each time."""
        rng = np.random.default_rng((self.seed, 1))
        late = self.settings.lateness or (0.0,) * len(self.cameras)
        for index, time in enumerate(self.times):
            images = []
            for k in range(len(self.cameras)):
                if any(c == k and first <= index <= last for c, first, last in self.settings.covers):
                    images.append(self.covered_image(k, rng))
                else:
                    images.append(expose(self._shot(k, float(time) + late[k]), self.settings.noise, rng))
            yield images, self.truth[index]

    def _shot(self, k: int, time: float) -> Float32:
        """Linear light ``(H, W, 3)`` that camera ``k`` gathers about ``time``: smeared, out of focus."""
        settings, camera, (room, direct) = self.settings, self.cameras[k], self._rooms[k]
        blinks = EXPOSURE_BLINKS if settings.exposure else 1
        colour = np.zeros((HEIGHT, WIDTH, 3), dtype=np.float32)
        for blink in range(blinks):
            moment = time + settings.exposure * ((blink + 0.5) / blinks - 0.5)
            things, _ = self._carried(moment)
            dark = shadows(things, camera, LIGHT.direction, softness=2.5)
            lit = replace(room, colour=room.colour - direct * dark[:, :, None])
            colour += compose(lit, things, camera, LIGHT)[0].colour / np.float32(blinks)
        return np.asarray(cv2.GaussianBlur(colour, (0, 0), settings.defocus)) if settings.defocus else colour

    def covered_image(self, k: int, rng: np.random.Generator) -> ImageArray:
        """What camera ``k`` shows while a board, half a metre before it, covers its view: nothing of the scene."""
        camera = self.cameras[k]
        forward = camera.rotation[2]
        board = Parts(yaw=float(np.arctan2(forward[1], forward[0])))
        paint = Surface((0.35, 0.30, 0.28), (0.5, 0.45, 0.4), Pattern.ACROSS, 0.09, 0.1)
        board.box(camera.position + 0.55 * forward, [0.02, 1.0, 1.0], paint)
        picture, _ = compose(self._rooms[k][0], [Thing(board.solids())], camera, LIGHT)
        return expose(picture.colour, self.settings.noise, rng)

    def backgrounds(self) -> list[ImageArray]:
        """One image a camera of the empty room, with noise of its own."""
        rng = np.random.default_rng((self.seed, 2))
        return [expose(room.colour, self.settings.noise, rng) for room, _ in self._rooms]

    def write_truth(self, folder: Path, name: str, truths: list[FloatArray]) -> None:
        """Write ``background1.png`` ..., ``cameras.yaml`` and ``truth.csv``."""
        del name, truths
        for k, image in enumerate(self.backgrounds()):
            write_image(folder / f"background{k + 1}.png", image)
        placed = [PlacedCamera(f"camera{k + 1}", c, self.settings.frame_rate) for k, c in enumerate(self.cameras)]
        write_cameras(folder / "cameras.yaml", placed)
        write_path3d(folder / "truth.csv", Path3D(self.times, self.truth))

    def _carried(self, time: float) -> tuple[list[Thing], FloatArray]:
        """The person with the ball, and the ball's centre."""
        person, settings = self._person, self.settings
        length = SPEED * settings.frames / settings.frame_rate
        along = SPEED * time - 0.5 * length
        # An S through the middle of the room, walked sideways before the first two cameras.
        bend = 0.30 * np.sin(2.2 * along)
        heading = np.pi / 2 - np.arctan(0.30 * 2.2 * np.cos(2.2 * along)) * 0.8
        position = np.array([bend - 0.25, along - 0.72])
        phase = SPEED * time / stride_length(person.build, person.manner, SPEED)
        pose = walking(person.build, person.manner, phase, SPEED)
        raised = 0.75 + 0.28 * np.sin(2 * np.pi * time / 4.6)
        pose = replace(
            pose, shoulder=(pose.shoulder[0], raised), elbow=(pose.elbow[0], 0.55), spread=(pose.spread[0], 0.30),
            inward=(0.0, 0.0),
        )  # fmt: skip
        skeleton = PersonSkeleton(person.build, pose, position, heading)
        forearm, radius, ball = skeleton.fingers[1] - skeleton.wrist[1], settings.radius, Parts()
        grip = skeleton.fingers[1] + forearm / np.linalg.norm(forearm) * (0.88 * radius)
        paint = Surface(*self._colours, Pattern.ACROSS, 0.8 * radius, 0.03)
        ball.cone(grip, grip, (radius, radius), paint, front=np.array([0.0, 1.0, 0.0]))
        return [person_thing(person, pose, position, heading), Thing(ball.solids())], grip


def ball_cameras(count: int) -> tuple[PinholeCamera, ...]:
    """``count`` cameras, 3 to 5 m from the ball, 800x600, horizontal field 60 degrees."""
    focal = 0.5 * WIDTH / np.tan(0.5 * FIELD)
    turned = ((np.deg2rad(angle), away, high) for angle, away, high in STANDS[:count])
    stands = (np.array([away * np.cos(angle), away * np.sin(angle), high]) for angle, away, high in turned)
    return tuple(PinholeCamera.look_at(s, np.array(AIM), float(focal), WIDTH, HEIGHT) for s in stands)


def expose(colour: Float32, noise: float, rng: np.random.Generator) -> ImageArray:
    """Linear light as an image: gamma 2, sensor noise, 256 levels."""
    grey = 255 * np.sqrt(np.clip(colour, 0, 1))
    grey += noise * rng.standard_normal(grey.shape, dtype=np.float32)
    return np.asarray(np.clip(grey + 0.5, 0, 255), dtype=np.uint8)
