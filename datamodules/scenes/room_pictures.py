"""Pictures of people in rooms in the views that a ceiling camera's picture is unrolled into, to train detectors.

People stand, walk and sit, at tables and elsewhere, among furniture; the camera hangs anywhere.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.clip import people_in_view
from tsuiseki.datamodules.scenes.figures.library import SpriteLibrary
from tsuiseki.datamodules.scenes.figures.standing_sprites import Standing, dressed, tilt_of
from tsuiseki.datamodules.scenes.people.person import Person, person_thing, random_person, random_pose
from tsuiseki.datamodules.scenes.people.poses import draw_pose
from tsuiseki.datamodules.scenes.people.posture import Pose
from tsuiseki.datamodules.scenes.render.composing import OCCLUSION, Thing, both_shadows, compose, empty_picture
from tsuiseki.datamodules.scenes.render.degrade import automatic_exposure, degrade, random_degradation
from tsuiseki.datamodules.scenes.render.solids import along
from tsuiseki.datamodules.scenes.room_clip import lamps
from tsuiseki.datamodules.scenes.things import room as rooms
from tsuiseki.datamodules.scenes.training_pictures import LEAST_VISIBLE
from tsuiseki.tracking.cameras.panorama import CylinderView, DownwardView
from tsuiseki.tracking.types import FloatArray, ImageArray

# Distance that people keep from each other, metres.
APART = 0.55
# Distance that people keep from the camera's foot, metres.
NEAREST = 0.3
# Places that are drawn at most until one is free; then there is none.
TRIES = 40
# (shortest, longest) side of the floor, metres.
FLOOR = (3.5, 18.0)
# (lowest, highest) ceiling, metres.
CEILING = (2.4, 4.5)
# (least, greatest) radius of the cylinder, shares of the height.
SCALE = (0.25, 0.7)
# Share of the people who sit.
SEATED = 0.45
# Share of the pictures that look straight down.
DOWNWARD = 0.15
# Share of the people who are rendered, where there is a library of them.
RENDERED = 0.9
# (fewest, most) people in a picture.
PEOPLE = (0, 12)
# Rays along each side of a pixel.
SAMPLES = 2


class _Room:
    """A room that is filled with people and things.

    Attributes:
        rng: draws everything.
        size: ``(3,)`` metres.
        camera: on the ceiling.
        people: dressed solids so far.
        things: drawn so far.
        taken: x, y and radius of what is occupied so far, metres.
        placed: where each of ``people`` is, and the pose: "sitting", or "" for who stands or walks.
    """

    def __init__(self, rng: np.random.Generator, size: FloatArray, camera: CylinderView | DownwardView) -> None:
        self.rng, self.size, self.camera = rng, size, camera
        self.people, self.things = list[Thing](), rooms.panels(rng, size, int(rng.integers(2, 10)))
        self.taken, self.placed = list[tuple[float, float, float]](), list[tuple[FloatArray, str]]()
        count = int(rng.integers(PEOPLE[0], PEOPLE[1] + 1))
        seated = int(rng.binomial(count, SEATED))
        while seated > 0:
            seated -= self._group(seated)
        for _ in range(count - len(self.people)):
            spot = self.spot(APART / 2)
            if spot is not None:
                person = random_person(rng)
                self.add(person, random_pose(rng, person), spot, float(rng.uniform(0, 2 * np.pi)))
        for _ in range(int(rng.integers(0, 7))):
            spot = self.spot(0.4)
            if spot is not None:
                heading = float(rng.uniform(0, 2 * np.pi))
                self.things.append(rooms.chair(rng, spot, heading))
                if rng.random() < 0.4:
                    self.things.append(rooms.table(rng, spot + 0.6 * along(heading)[:2], heading, (0.4, 0.6)))
        for _ in range(int(rng.integers(0, 9))):
            share, side = rng.uniform(0.05, 0.95), int(rng.integers(4))
            spot, yaw = rooms.at_wall(size, side, share, 0.3)
            if rng.random() < 0.2:
                self.things.append(rooms.plant(rng, spot))
            elif self.free(spot, 0.5):
                self.things.append(rooms.cabinet(rng, spot, yaw + rng.normal(0, 0.05)))

    def free(self, spot: FloatArray, radius: float) -> bool:
        """Whether nothing stands within ``radius`` of a place."""
        return all(np.hypot(spot[0] - x, spot[1] - y) > radius + r for x, y, r in self.taken)

    def add(self, person: Person, pose: Pose, spot: FloatArray, heading: float, name: str = "") -> None:
        """Put a person there, and keep the place free of others."""
        self.placed.append((spot, name))
        self.people.append(person_thing(person, pose, spot, heading))
        self.taken.append((float(spot[0]), float(spot[1]), APART / 2))

    def spot(self, radius: float) -> FloatArray | None:
        """A free place in view; distances are even on a logarithmic scale, for few would be near otherwise."""
        rng, camera = self.rng, self.camera
        below = isinstance(camera, DownwardView)
        near, far = (0.05, 1.6) if below else (NEAREST, float(np.linalg.norm(self.size[:2])))
        for _ in range(TRIES):
            middle = rng.uniform(0, 2 * np.pi)
            if isinstance(camera, CylinderView):
                half = min(camera.width / 2 / camera.scale, 2.6)
                middle = camera.middle + rng.uniform(-half, half)
            spot = camera.position[:2] + np.exp(rng.uniform(np.log(near), np.log(far))) * along(float(middle))[:2]
            if ((spot > 0.35) & (spot < self.size[:2] - 0.35)).all() and self.free(spot, radius):
                return np.asarray(spot)
        return None

    def _group(self, size: int) -> int:
        """Up to ``size`` people on chairs, side by side at a table or without one; at least 1 counts as placed."""
        spot, rng = self.spot(0.5), self.rng
        if spot is None:
            return size
        heading, members = float(rng.uniform(0, 2 * np.pi)), int(rng.integers(1, min(size, 4) + 1))
        ahead, aside = along(heading)[:2], along(heading + np.pi / 2)[:2]
        with_table, spacing = rng.random() < 0.7, rng.uniform(0.65, 0.95)
        for k in range(members):
            seat = spot + (k - (members - 1) / 2) * spacing * aside + rng.normal(0, 0.04, 2)
            if not ((seat > 0.3) & (seat < self.size[:2] - 0.3)).all() or not self.free(seat, 0.2):
                continue
            person, facing = random_person(rng), heading + float(rng.normal(0, 0.25))
            pose = draw_pose(int(rng.integers(1 << 31)), person.build, "sitting")
            self.things.append(rooms.chair(rng, seat, facing))
            self.add(person, pose, seat - 0.05 * along(facing)[:2], facing, "sitting")
        if with_table:
            middle = spot + rng.uniform(0.6, 0.75) * ahead
            self.things.append(rooms.table(rng, middle, heading, (0.38, 0.5 * members * spacing + 0.2)))
            self.taken.append((float(middle[0]), float(middle[1]), 0.5))
        return members


def panorama_picture(
    rng: np.random.Generator, width: int = 512, height: int = 384, sprites: SpriteLibrary | None = None
) -> tuple[ImageArray, FloatArray, FloatArray]:
    """A picture ``(H, W, 3)`` uint8 RGB, boxes ``(N, 4)`` of whole silhouettes cut off at the border, visibilities.

    With ``sprites`` most people are rendered.
    """
    size = np.array([*rng.uniform(*FLOOR, 2), rng.uniform(*CEILING)])
    spot = size * [*rng.uniform(0.25, 0.75, 2), 1.0] - [0, 0, rng.uniform(0.03, 0.25)]
    turn = float(rng.uniform(0, 2 * np.pi))
    camera: CylinderView | DownwardView
    if rng.random() < DOWNWARD:
        camera = DownwardView(spot, turn, float(rng.uniform(0.6, 1.3)) * height, width, height)
    else:
        scale = float(np.exp(rng.uniform(*np.log(SCALE)))) * height
        camera = CylinderView(spot, turn, scale, float(rng.uniform(-0.1, 0.12)) * height, width, height)
    room = _Room(rng, size, camera)
    for k, (spot, pose) in enumerate(room.placed if sprites is not None else ()):
        # Mostly a rendered person is shown in the place of the drawn one.
        if sprites is not None and rng.random() < RENDERED:
            sprite = dressed(rng, sprites.near(rng, tilt_of(camera, spot), pose))
            room.people[k] = Standing(sprite, spot, room.people[k].solids, room.people[k].outfit)
    light = lamps(rng)
    # Walls have few edges: one ray a pixel will do.
    walls, direct = rooms.draw_shell(rooms.random_shell(rng, size), camera, light, [], 1)
    everything = room.people + room.things
    sun, under = both_shadows(everything, camera, light, 2.0)
    darker = direct * sun[:, :, None] + walls.colour * (OCCLUSION * under)[:, :, None]
    empty = empty_picture(walls.colour - darker, SAMPLES)
    picture, sightings = compose(empty, everything, camera, light)
    sightings = sightings[: len(room.people)]
    how, colour = random_degradation(rng), picture.colour
    exposed = replace(how, exposure=how.exposure * automatic_exposure(colour))
    if rng.random() >= 0.45:
        # Softer towards the horizon or all over, as where a fisheye picture has few pixels to unroll.
        soft = cv2.GaussianBlur(colour, (0, 0), float(rng.uniform(0.6, 2.2)))
        share = np.linspace(1, 0, height, dtype=np.float32)[:, None, None] ** float(rng.uniform(0, 2))
        colour = np.asarray(colour + share * (soft - colour), dtype=np.float32)
    image = degrade(colour, exposed, rng)
    if isinstance(camera, CylinderView) and rng.random() < 0.4:
        # The end of the image circle.
        image[: max(round(camera.horizon + height * rng.uniform(-0.03, 0.05)), 0)] = rng.integers(0, 25)
    truth, _ = people_in_view(sightings, (width, height), LEAST_VISIBLE, 0.0)
    return image, truth.boxes, truth.visibility
