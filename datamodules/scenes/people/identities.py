"""Crops of people as a detector cuts them out, several of each identity, to train appearance features."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.people.gait import random_manner
from tsuiseki.datamodules.scenes.people.look import look_alike, random_build
from tsuiseki.datamodules.scenes.people.person import Person, random_person
from tsuiseki.datamodules.scenes.people.sprites import random_pose, render_person_sprite
from tsuiseki.datamodules.scenes.render.degrade import Degradation, finish
from tsuiseki.datamodules.scenes.render.shading import NOISE, NOISE_SIZE, random_light
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.tracking.types import ImageArray, IntArray


@dataclass(frozen=True)
class CropSettings:
    """How crops of one identity differ from each other.

    Attributes:
        person_height: (least, greatest) height at which a person is drawn before resizing, pixels.
        tilt: (least, greatest) of the camera, radians downward; the views of one identity share it up to 0.15.
        look_alikes: share of the identities that are dressed much like the one before.
        jitter: standard deviation of the box's borders, share of its size.
        occluded: probability that something hides a part.
        lighting: how far the light and the colours differ between views; 0 is the same, 1 strongly.
    """

    person_height: tuple[float, float] = (40.0, 120.0)
    tilt: tuple[float, float] = (0.0, 0.8)
    look_alikes: float = 0.3
    jitter: float = 0.05
    occluded: float = 0.3
    lighting: float = 0.6


def random_identities(rng: np.random.Generator, count: int, look_alikes: float) -> list[Person]:
    """People of whom a share is dressed much like the one before."""
    people: list[Person] = []
    for _ in range(count):
        if people and rng.random() < look_alikes:
            look = look_alike(rng, people[-1].look)
            people.append(Person(random_build(rng), look, random_manner(rng)))
        else:
            people.append(random_person(rng))
    return people


def render_identity_crops(
    rng: np.random.Generator,
    identities: int,
    views: int,
    size: tuple[int, int] = (128, 64),
    settings: CropSettings | None = None,
) -> tuple[ImageArray, IntArray]:
    """Crops of random people, each seen several times in other poses, from other sides, in other light.

    Args:
        rng: draws everything.
        identities: how many people.
        views: crops of each.
        size: (height, width) of the crops, pixels; boxes are stretched to it.
        settings: how crops differ.

    Returns:
        Crops ``(identities, views, H, W, 3)`` uint8 RGB and labels ``(identities, views)``, 0-based.
    """
    if identities < 1 or views < 1 or min(size) < 8:
        raise ValueError(f"expected at least one identity, one view and 8 pixels, got {identities}, {views}, {size}")
    settings = CropSettings() if settings is None else settings
    people = random_identities(rng, identities, settings.look_alikes)
    crops = np.empty((identities, views, *size, 3), dtype=np.uint8)
    for i, person in enumerate(people):
        tilt = float(rng.uniform(*settings.tilt))
        heading = float(rng.uniform(0, 2 * np.pi))
        light, cast = random_light(rng), rng.normal(1, 0.05, 3)
        for j in range(views):
            # Views of one track often share the side; views from elsewhere do not.
            turned = heading + rng.normal(0, 0.5) if rng.random() < 0.4 else rng.uniform(0, 2 * np.pi)
            if rng.random() < settings.lighting:
                light = random_light(rng)
            here = float(np.clip(tilt + rng.normal(0, 0.08), 0, 1.4))
            sprite = render_person_sprite(
                rng, float(rng.uniform(*settings.person_height)), here, person,
                random_pose(rng, person), float(turned), light,
            )  # fmt: skip
            colour = np.exp(rng.normal(0, 0.18 * settings.lighting)) * (
                cast + rng.normal(0, 0.05 * settings.lighting, 3)
            )
            crop = _crop(rng, sprite, settings, here)
            how = replace(_random_finish(rng), exposure=1.0)
            finished = finish(crop * colour.astype(np.float32), how, rng)
            shrinks = finished.shape[0] > size[0]
            crops[i, j] = cv2.resize(
                finished, (size[1], size[0]), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
            )
    return crops, np.repeat(np.arange(identities)[:, None], views, axis=1)


def _random_finish(rng: np.random.Generator) -> Degradation:
    return Degradation(
        blur=float(rng.uniform(0.2, 0.9)) if rng.random() < 0.6 else 0.0,
        sharpen=float(rng.uniform(0.2, 1.2)) if rng.random() < 0.4 else 0.0,
        noise=float(rng.uniform(0, 6)),
        jpeg=int(rng.integers(40, 96)) if rng.random() < 0.6 else 0,
    )


def _crop(rng: np.random.Generator, sprite: ImageArray, settings: CropSettings, tilt: float) -> Float32:
    """The jittered box about a sprite over a random background, ``(h, w, 3)`` in [0, 255]."""
    height, width = sprite.shape[:2]
    left, top, right, bottom = rng.normal(0.02, settings.jitter, 4) * [width, height, width, height]
    left, right = (max(v, -0.3 * width) for v in (left, right))
    top, bottom = (max(v, -0.25 * height) for v in (top, bottom))
    h, w = max(round(height + top + bottom), 8), max(round(width + left + right), 4)
    canvas = random_backdrop(rng, h, w)
    if rng.random() < 0.5:
        _soft_shadow(rng, canvas, height + top)
    if rng.random() < 0.25:
        behind = render_person_sprite(rng, float(rng.uniform(0.8, 1.0) * height), tilt)
        paste(canvas, behind, int(rng.uniform(-0.8, 0.8) * w), int(top + rng.normal(0, 0.1) * h))
    paste(canvas, sprite, round(left), round(top))
    if rng.random() < settings.occluded:
        _occlude(rng, canvas, tilt)
    return canvas


def paste(canvas: Float32, sprite: ImageArray, left: int, top: int) -> None:
    """Lays a sprite ``(h, w, 4)`` over ``canvas`` ``(H, W, 3)``, in place; what leaves the canvas is cut off."""
    height, width = canvas.shape[:2]
    x1, y1 = max(left, 0), max(top, 0)
    x2, y2 = min(left + sprite.shape[1], width), min(top + sprite.shape[0], height)
    if x1 >= x2 or y1 >= y2:
        return
    part = sprite[y1 - top : y2 - top, x1 - left : x2 - left].astype(np.float32)
    alpha = part[:, :, 3:] / np.float32(255)
    canvas[y1:y2, x1:x2] += alpha * (part[:, :, :3] - canvas[y1:y2, x1:x2])


def random_backdrop(rng: np.random.Generator, height: int, width: int) -> Float32:
    """``(height, width, 3)`` in [0, 255]: pieces of ground, walls and things out of focus, as behind people."""
    base = rng.uniform(40, 215) + rng.normal(0, 14, 3)
    slope = rng.normal(0, 25)
    canvas = (base + slope * np.linspace(-1, 1, height)[:, None, None] * np.ones((1, width, 1))).astype(np.float32)
    for _ in range(int(rng.integers(0, 4))):
        colour = rng.uniform(20, 230) + rng.normal(0, 22, 3)
        corner = rng.uniform(-0.5, 1.2, 2) * [width, height]
        reach = rng.uniform(0.1, 1.5, 2) * [width, height]
        box = cv2.boxPoints((corner.tolist(), reach.tolist(), float(rng.choice([0, 0, rng.uniform(-45, 45)]))))
        cv2.fillConvexPoly(canvas, np.round(box * 16).astype(np.int32), colour.tolist(), cv2.LINE_AA, 4)
    for _ in range(2):
        zoom, strength = rng.uniform(0.3, 6), rng.uniform(0, 0.18)
        rows = (np.arange(height) * zoom + rng.uniform(0, NOISE_SIZE)).astype(np.int64) % NOISE_SIZE
        columns = (np.arange(width) * zoom + rng.uniform(0, NOISE_SIZE)).astype(np.int64) % NOISE_SIZE
        canvas *= (1 + np.float32(strength) * (NOISE[rows[:, None], columns[None]] * 2 - 1))[:, :, None]
    return np.clip(canvas, 0, 255)


def _soft_shadow(rng: np.random.Generator, canvas: Float32, foot: float) -> None:
    height, width = canvas.shape[:2]
    mask = np.zeros((height, width), dtype=np.float32)
    end = (width / 2 + rng.normal(0, 1) * width, foot + rng.uniform(-0.4, 0.2) * height)
    cv2.line(mask, (width // 2, int(foot)), (int(end[0]), int(end[1])), 1.0, max(width // 3, 2))
    blurred = cv2.GaussianBlur(mask, (0, 0), max(width / 12, 1.0))
    canvas *= (1 - np.float32(rng.uniform(0.2, 0.6)) * blurred)[:, :, None]


def _occlude(rng: np.random.Generator, canvas: Float32, tilt: float) -> None:
    """A person, a pole or a box before a part of the crop."""
    height, width = canvas.shape[:2]
    kind = rng.integers(3)
    if kind == 0:
        other = render_person_sprite(rng, float(rng.uniform(0.85, 1.1) * height), tilt)
        side = rng.choice([-1, 1]) * rng.uniform(0.45, 0.9) * width
        paste(canvas, other, int(side), int(rng.uniform(0.0, 0.35) * height))
        return
    colour = (rng.uniform(20, 230) + rng.normal(0, 20, 3)).astype(np.float32)
    if kind == 1:
        thick, x = max(int(rng.uniform(0.06, 0.22) * width), 1), int(rng.uniform(0, 1) * width)
        canvas[:, max(x, 0) : x + thick] = colour
    else:
        canvas[int(rng.uniform(0.5, 0.9) * height) :, :] = colour
