"""People on one floor before cameras on its walls and under fisheye cameras on its ceiling, with exact places."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.scenes import room_clip
from tsuiseki.datamodules.scenes.clip import FrameTruth
from tsuiseki.datamodules.scenes.people.walkers import dressed, wander
from tsuiseki.datamodules.scenes.render.degrade import level_tone, random_degradation
from tsuiseki.datamodules.scenes.render.scene import Thing
from tsuiseki.datamodules.scenes.render.solids import Surface, as_colour, boxes
from tsuiseki.datamodules.scenes.things.room import random_furniture
from tsuiseki.tracking.cameras.camera_files import AnyCamera
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray

TRUTH_FILE = "truth.csv"
# Which cameras hang from the ceiling, from 0. The others stand at these shares of width and length, in this order.
OVERHEAD = (1, 3)
STANDS = ((0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0), (0.0, 0.5))
# Horizontal field of a wall camera, radians, its distance from walls and ceiling, and the height it aims at, metres.
FIELD, AWAY, AIM = np.deg2rad(80.0), 0.25, 0.5
# Pillars, which end below the cameras, and (lowest, highest) of their heights, metres.
PILLARS, TALL = 3, (1.9, 2.1)


@dataclass(frozen=True)
class FloorClipSettings(room_clip.RoomSettings):
    """A clip of several cameras over one floor.

    Attributes:
        cameras: how many, 3 to 7. The second and the fourth are fisheye cameras on the ceiling.
    """

    size: tuple[float, float] = (9.0, 12.0)
    cameras: int = 4

    def __post_init__(self) -> None:
        most = len(OVERHEAD) + len(STANDS)
        own = (
            (3 <= self.cameras <= most, f"3 to {most} cameras", self.cameras),
            (0 <= self.repeated <= 1, "look_alikes in [0, 1]", self.repeated),
        )
        self.expect("floor", 64, *own)
        super().__post_init__()


class FloorClip(room_clip.RoomClip[AnyCamera]):
    """A planned clip of cameras of both kinds."""

    # Before a wall camera a head alone may be a good part of the picture.
    inside = 0.0

    def write_truth(self, folder: Path, name: str, truths: list[list[FrameTruth]]) -> None:
        """See `RoomClip.write_truth`; besides ``truth.csv`` with time, id, x, y of everybody, seen or not."""
        super().write_truth(folder, name, truths)
        rows = [
            f"{frame / self.settings.frame_rate:.6f},{number},{x:.4f},{y:.4f}\n"
            for frame in range(self.settings.frames)
            for number, walker in enumerate(self.walkers, 1)
            for x, y in [walker.positions[frame - walker.first].tolist()]
        ]
        (folder / TRUTH_FILE).write_text("time,id,x,y\n" + "".join(rows), encoding="utf-8")


def plan_floor(settings: FloorClipSettings, seed: int) -> FloorClip:
    """The place, its cameras and everybody's way, as ``seed`` has it."""
    rng = np.random.default_rng([seed, 7])
    size, ceiling = np.array(settings.size), float(rng.uniform(*room_clip.CEILING))
    furniture, low = random_furniture(rng, size, round(room_clip.FURNITURE * size.prod() / 10))
    pillars, high = _pillars(rng, size)
    cameras = _cameras(rng, settings, size, ceiling)
    people = dressed(rng, settings.people, settings.repeated)
    walkers = wander(rng, people, settings, size, np.concatenate([low, high]))
    tone = level_tone(random_degradation(rng, 0.5))
    return FloorClip(settings, seed, cameras, room_clip.lamps(rng), walkers, [*furniture, *pillars], tone)


def _cameras(
    rng: np.random.Generator, settings: FloorClipSettings, size: FloatArray, ceiling: float
) -> list[AnyCamera]:
    """Cameras on the ceiling share its length; those on walls and in corners look across the middle."""
    lens = room_clip.ceiling_lens(None, settings.width, settings.height)
    focal = settings.width / 2 / np.tan(FIELD / 2)
    overhead = [k for k in OVERHEAD if k < settings.cameras]
    stands = iter(STANDS)
    cameras: list[AnyCamera] = []
    for k in range(settings.cameras):
        if k in overhead:
            share = (overhead.index(k) + 0.5) / len(overhead)
            cameras.append(room_clip.ceiling_camera(rng, lens, size, share, ceiling - 0.1))
            continue
        spot = AWAY + np.array(next(stands)) * (size - 2 * AWAY)
        aim = size / 2 + rng.normal(0, 0.4, 2)
        place, target = np.array([*spot, ceiling - AWAY]), np.array([*aim, AIM])
        cameras.append(
            PinholeCamera.look_at(place, target, focal, settings.width, settings.height, float(rng.normal(0, 0.01)))
        )
    return cameras


def _pillars(rng: np.random.Generator, size: FloatArray) -> tuple[list[Thing], FloatArray]:
    """Pillars in the room that hide people, and ``(M, 3)`` where they stand and how far they reach."""
    half = np.column_stack([rng.uniform(0.12, 0.22, (PILLARS, 2)), rng.uniform(*TALL, PILLARS) / 2])
    # Along the length, in turns left and right of the middle, where the ceiling cameras hang.
    along = (np.arange(PILLARS) + rng.uniform(0.3, 0.7, PILLARS)) / PILLARS
    aside = 0.5 + rng.choice([-1, 1]) * (-1) ** np.arange(PILLARS) * rng.uniform(0.15, 0.3, PILLARS)
    spots = np.column_stack([aside, along]) * size
    things = []
    for spot, sides in zip(spots, half, strict=True):
        surface = Surface(as_colour(rng.uniform(0.3, 0.8, 3)), None)
        things.append(Thing(boxes(np.array([[*spot, sides[2]]]), sides[None], np.zeros(1), [surface])))
    return things, np.column_stack([spots, np.hypot(half[:, 0], half[:, 1])])
