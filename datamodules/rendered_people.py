"""People rendered one by one and cut out, to be put on another ground every time they are drawn."""

from __future__ import annotations

import cv2
import numpy as np

from tsuiseki.datamodules.identity_crops import MARGIN, IdentityCrops
from tsuiseki.datamodules.scenes.people.identities import paste, random_backdrop, random_identities
from tsuiseki.datamodules.scenes.people.person import Person
from tsuiseki.datamodules.scenes.people.sprites import render_person_sprite
from tsuiseki.datamodules.scenes.render.shading import random_light
from tsuiseki.tracking.types import FloatArray, ImageArray

LOOK_ALIKES = 0.5
STEEPEST = 0.8


def render_people(seed: int, identities: int, views: int, height: int = 96) -> IdentityCrops:
    """Cut-out views of random people, RGBA.

    Half of the people are dressed much like the one before them: those are what a tracker confuses. The light and
    the tilt of the camera stay for half of a person's views and then change.

    Args:
        seed: of all chance.
        identities: number of people.
        views: of each, in other poses and from other sides.
        height: of a person, pixels.
    """
    rng = np.random.default_rng(seed)
    people = random_identities(rng, identities, LOOK_ALIKES)
    images = [image for person in people for image in _views(rng, person, views, height)]
    boxes = np.array([[0, 0, image.shape[1], image.shape[0]] for image in images], dtype=np.float64)
    return IdentityCrops(
        images,
        boxes.reshape(-1, 4),
        np.repeat(np.arange(identities), views),
        # A moment apart from each other, as far as anybody asks.
        np.tile(np.arange(views) * 1000, identities),
        np.zeros(len(images), dtype=np.bool_),
    )


def _views(rng: np.random.Generator, person: Person, views: int, height: int) -> list[ImageArray]:
    images: list[ImageArray] = []
    for view in range(views):
        if view in (0, (views + 1) // 2):
            light, tilt = random_light(rng), float(rng.uniform(0, STEEPEST))
        around = float(np.clip(tilt + rng.normal(0, 0.08), 0, 1))
        images.append(render_person_sprite(rng, height, around, person, light=light))
    return images


def put_on_ground(
    rng: np.random.Generator, cut_out: ImageArray, behind: ImageArray | None
) -> tuple[ImageArray, FloatArray]:
    """A cut-out person on a random ground, with a margin, and where the person's box lies in it.

    Args:
        rng: draws the ground.
        cut_out: ``(h, w, 4)`` RGBA.
        behind: ``(h', w', 4)`` somebody who stands farther back, or None.
    """
    height, width = cut_out.shape[:2]
    top, left = int(np.ceil(MARGIN * height)), int(np.ceil(MARGIN * width))
    image = random_backdrop(rng, height + 2 * top, width + 2 * left)
    if behind is not None:
        other = resized(behind, height * float(rng.uniform(0.75, 1.05)) / behind.shape[0])
        paste(image, other, left + int(rng.uniform(-1, 1) * width), top + int(rng.uniform(-0.3, 0.1) * height))
    paste(image, cut_out, left, top)
    return image.astype(np.uint8), np.array([left, top, left + width, top + height], dtype=np.float64)


def put_before(rng: np.random.Generator, image: ImageArray, cut_out: ImageArray) -> ImageArray:
    """``image`` of a person with a cut-out ``(h, w, 4)`` of somebody passing at one side, nearer to the camera."""
    height, width = image.shape[:2]
    passer = resized(cut_out, height * float(rng.uniform(0.7, 1.1)) / cut_out.shape[0])
    side = float(rng.choice([-1, 1]) * rng.uniform(0.35, 0.9)) * width
    canvas = image.astype(np.float32)
    paste(canvas, passer, round((width - passer.shape[1]) / 2 + side), round(height * rng.uniform(-0.05, 0.4)))
    return canvas.astype(np.uint8)


def resized(image: ImageArray, scale: float) -> ImageArray:
    """``image`` scaled, at least one pixel each way."""
    size = max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale))
    shrunk = cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    return np.asarray(shrunk, dtype=np.uint8)
