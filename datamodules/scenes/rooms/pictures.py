"""Pictures of people in random rooms under random fisheye lenses, to train detectors that look down from a ceiling."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.rooms.ceiling import (
    CAMERAS,
    FIELD,
    RADIUS,
    RoomSettings,
    RoomTruth,
    draw_room_frame,
    plan_room,
    view_room,
)
from tsuiseki.tracking.cameras.lens_fitting import EquidistantLens, fit_omnidirectional
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalLens
from tsuiseki.tracking.types import ImageArray

# Seconds between two pictures of a room, and pictures of each of its cameras.
APART, EACH = 4, 4
TOGETHER = CAMERAS * EACH


@dataclass(frozen=True)
class RoomPictures:
    """What random pictures show.

    Attributes:
        side: of the square pictures, pixels; the lens's circle fills them.
        people: (fewest, most) in a room.
        floor: (shortest, longest) side, metres.
        ceiling: (lowest, highest), metres.
    """

    side: int = 768
    people: tuple[int, int] = (3, 12)
    floor: tuple[float, float] = (3.5, 12.0)
    ceiling: tuple[float, float] = (2.4, 4.0)


def random_lens(rng: np.random.Generator, side: int) -> OmnidirectionalLens:
    """Between the equidistant lens and those that squeeze or stretch the rim."""
    bent = rng.uniform(-0.06, 0.03)
    focal = RADIUS * side / (np.pi / 2 * (1 + bent * (np.pi / 2) ** 2))
    middle = side / 2 + rng.normal(0, 0.01 * side, 2)
    flat = EquidistantLens(side, side, np.full(2, focal), middle, np.array([bent, 0.0, 0.0, 0.0]))
    return replace(fit_omnidirectional(flat, degree=6), field=FIELD)


def room_pictures(settings: RoomPictures, seed: int) -> Iterator[tuple[ImageArray, RoomTruth]]:
    """`TOGETHER` pictures of one room, ``(side, side, 3)`` uint8 RGB, with what they show."""
    rng = np.random.default_rng([seed, 40])
    size = rng.uniform(*settings.floor), rng.uniform(*settings.floor)
    clip = plan_room(
        RoomSettings(
            size=size,
            frames=1 + APART * (EACH - 1),
            frame_rate=1.0,
            people=int(rng.integers(settings.people[0], settings.people[1] + 1)),
            repeated=0.2,
            width=settings.side,
            height=settings.side,
            ceiling=settings.ceiling,
            furniture=float(rng.uniform(0.5, 2.5)),
            noise=float(rng.uniform(0, 6)),
            blur=float(rng.uniform(0, 1.0)),
        ),
        seed,
        random_lens(rng, settings.side),
    )
    for number in range(CAMERAS):
        view = view_room(clip, number)
        for k in range(EACH):
            image, truth = draw_room_frame(clip, view, k * APART)
            yield _developed(rng, image), truth


def _developed(rng: np.random.Generator, image: ImageArray) -> ImageArray:
    """Now and then night mode: grey, as ceiling cameras turn in the dark."""
    if rng.random() > 0.06:
        return image
    return np.repeat(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)[:, :, None], 3, axis=2)
