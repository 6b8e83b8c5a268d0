"""What shows people and is nobody: statues, dolls, posters, pictograms; and chairs and screens about people."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.figures.library import SpriteLibrary
from tsuiseki.datamodules.scenes.figures.standing_sprites import Standing, away_from, dressed, tilt_of
from tsuiseki.datamodules.scenes.people.gait import random_manner
from tsuiseki.datamodules.scenes.people.outfit import BRIGHT, DARK, LIGHT, MIDDLE, Outfit, any_colour, colour_of
from tsuiseki.datamodules.scenes.people.person import Person, paste, person_thing, random_backdrop
from tsuiseki.datamodules.scenes.people.poses import draw_pose
from tsuiseki.datamodules.scenes.people.posture import Build, Pose
from tsuiseki.datamodules.scenes.render.composing import Thing
from tsuiseki.datamodules.scenes.render.photographs import Facade
from tsuiseki.datamodules.scenes.render.solids import Colour, Parts, Pattern, Surface, pattern_of
from tsuiseki.datamodules.scenes.things.room import chair
from tsuiseki.datamodules.scenes.things.street_things import clutter_around
from tsuiseki.tracking.cameras.camera_files import AnyCamera
from tsuiseki.tracking.types import FloatArray, ImageArray

# Share of the picture that one likeness may cover.
_LARGEST = 0.1
# Stone, sandstone, bronze, verdigris, plaster, iron: sRGB.
_STATUARY = np.array([
    [0.62, 0.61, 0.58], [0.70, 0.60, 0.45], [0.25, 0.19, 0.12], [0.35, 0.50, 0.44], [0.88, 0.87, 0.84],
    [0.15, 0.15, 0.16],
])  # fmt: skip
# (lowest, highest) plinth of a statue, metres.
_PLINTH = (0.35, 1.8)
# (smallest, tallest) doll, metres.
_DOLL = (0.25, 0.75)
# Height and width of the picture on a poster, pixels.
_POSTER = (240, 160)
# A chair stands so far behind who faces the camera, metres: a sprite has no depth of its own.
_CHAIR = 0.22


def likenesses(
    rng: np.random.Generator, camera: AnyCamera, count: int, occupied: FloatArray, sprites: SpriteLibrary | None
) -> list[Thing]:
    """Up to ``count``, clear of the ``occupied`` places ``(N, 2)``; without sprites dolls and pictograms alone."""

    def any_of_them(rng: np.random.Generator, spot: FloatArray) -> Thing:
        kind = rng.random()
        if kind < 0.3:
            return doll(rng, spot)
        if kind < 0.45 or sprites is None:
            return upright(rng, spot, pictogram(rng))
        if kind < 0.75:
            return upright(rng, spot, poster(rng, sprites))
        return statue(rng, sprites, camera, spot)

    things = clutter_around(rng, camera, count, occupied, _LARGEST, any_of_them)
    plinths = [plinth(rng, thing) for thing in things if isinstance(thing, Standing)]
    return things + plinths


def statue(rng: np.random.Generator, sprites: SpriteLibrary, camera: AnyCamera, spot: FloatArray) -> Standing:
    """Somebody of one stone or metal, life-size or half as large again, raised for a `plinth`."""
    sprite = sprites.near(rng, tilt_of(camera, spot), "")
    colour = _STATUARY[int(rng.integers(len(_STATUARY)))] * rng.uniform(0.75, 1.2)
    grey = sprite.albedo.astype(np.float32).mean(axis=2) / np.float32(255)
    mean = max(float(grey[sprite.label > 0].mean()), 0.05)
    # Folds and features show little on stone.
    relief = (grey / mean) ** np.float32(rng.uniform(0.05, 0.4))
    stains = cv2.resize(
        rng.normal(1, 0.12, (12, 8)).astype(np.float32), grey.shape[::-1], interpolation=cv2.INTER_CUBIC
    )
    albedo = np.clip(255 * (relief * stains)[..., None] * colour, 0, 255) * (sprite.label > 0)[..., None]
    larger = float(rng.uniform(0.8, 1.6))
    carved = replace(
        sprite, albedo=albedo.astype(np.uint8), height=larger * sprite.height, middle=larger * sprite.middle
    )
    solids = person_thing(Person(Build(carved.height), Outfit(rng), random_manner(rng)), Pose(), spot, 0.0).solids
    return Standing(carved, spot, solids, base=float(rng.uniform(*_PLINTH)))


def plinth(rng: np.random.Generator, figure: Standing) -> Thing:
    """A block of stone under a raised ``figure``."""
    parts = Parts(figure.spot, float(rng.uniform(0, np.pi)))
    half, wide = figure.base / 2, float(rng.uniform(0.3, 0.6))
    stone = Surface(colour_of(rng, MIDDLE[:2] + LIGHT[:3]), pattern=pattern_of(rng, Pattern.PLAIN, Pattern.SPECKLE))
    parts.box(parts.at(up=half), (wide, wide, half), stone)
    parts.box(parts.at(up=0.08), (1.2 * wide, 1.2 * wide, 0.08), stone)
    return Thing(parts.solids())


def doll(rng: np.random.Generator, spot: FloatArray) -> Thing:
    """A doll on the ground, with a head so large and limbs so short that it is nobody's child."""
    build = Build(
        height=float(rng.uniform(*_DOLL)), girth=float(rng.uniform(1.4, 2.2)), legs=float(rng.uniform(0.45, 0.7)),
        head=float(rng.uniform(2.4, 3.4)), shoulders=float(rng.uniform(0.8, 1.1)),
    )  # fmt: skip
    kind = rng.random()
    pose = Pose(spread=(0.5, 0.5), straddle=(0.15, 0.15))
    if kind > 0.4:
        name = "seated on the ground" if kind < 0.8 else "lying"
        pose = draw_pose(int(rng.integers(1 << 31)), build, name)
    person = Person(build, Outfit(rng), random_manner(rng))
    # What has no outfit of its own counts as a thing.
    return Thing(person_thing(person, pose, spot, float(rng.uniform(0, 2 * np.pi))).solids)


def poster(rng: np.random.Generator, sprites: SpriteLibrary) -> ImageArray:
    """``(h, w, 3)`` uint8 RGB: people on a printed sheet, whole or cut off, among blocks of colour and text."""
    height, width = _POSTER
    canvas = random_backdrop(rng, height, width)
    for _ in range(int(rng.integers(1, 4))):
        sprite = dressed(rng, sprites.near(rng, 0.0, ""))
        tall = height * float(np.exp(rng.uniform(np.log(0.5), np.log(2.2))))
        factor = tall / max(sprite.label.shape[0], 1)
        size = max(round(sprite.label.shape[1] * factor), 2), max(round(tall), 2)
        cut = np.dstack([sprite.albedo, np.where(sprite.label > 0, 255, 0).astype(np.uint8)])
        cut = np.asarray(
            cv2.resize(cut, size, interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR), np.uint8
        )
        left = round(rng.uniform(0.1, 0.9) * width - 0.5 * size[0])
        top = round(height * rng.uniform(0.0, 0.3)) if tall > height else round((height - tall) * rng.uniform(0.3, 1.0))
        paste(canvas, cut, left, top)
    sheet = np.clip(canvas, 0, 255).astype(np.uint8)
    _print(sheet, rng)
    cv2.rectangle(
        sheet, (0, 0), (width - 1, height - 1), _bytes(colour_of(rng, DARK + LIGHT)), int(rng.integers(4, 20))
    )
    return sheet


def pictogram(rng: np.random.Generator) -> ImageArray:
    """``(h, w, 3)`` uint8 RGB: a flat figure of round head and straight limbs on a sign."""
    height, width = _POSTER
    canvas = np.full((height, width, 3), _bytes(colour_of(rng, BRIGHT + LIGHT[:2])), np.uint8)
    colour, middle = _bytes(colour_of(rng, LIGHT[:2] + DARK[:3])), np.array([width / 2, 0.24 * height])
    hip, thick = np.array([width / 2, 0.55 * height]), int(rng.integers(12, 26))
    cv2.circle(canvas, (width // 2, int(0.12 * height)), int(rng.integers(14, 24)), colour, -1, cv2.LINE_AA)
    cv2.line(canvas, middle.astype(int).tolist(), hip.astype(int).tolist(), colour, int(1.6 * thick), cv2.LINE_AA)
    for start, length, angles in ((middle, 0.3, rng.uniform(-1.0, 1.0, 2)), (hip, 0.36, rng.uniform(-0.6, 0.6, 2))):
        for angle in angles:
            end = start + length * height * np.array([np.sin(angle), np.cos(angle)])
            cv2.line(canvas, start.astype(int).tolist(), end.astype(int).tolist(), colour, thick, cv2.LINE_AA)
    return canvas


def _bytes(colour: Colour) -> tuple[int, ...]:
    """Of 255."""
    return tuple(round(255 * part) for part in colour)


def _print(canvas: ImageArray, rng: np.random.Generator) -> None:
    """Blocks of colour and lines of text over ``canvas``, in place."""
    height, width = canvas.shape[:2]
    for _ in range(int(rng.integers(0, 3))):
        top, high = rng.uniform(0, 0.9) * height, rng.uniform(0.05, 0.25) * height
        canvas[int(top) : int(top + high)] = _bytes(any_colour(rng))
    for row in range(int(rng.integers(0, 4))):
        at = int(width * 0.05), int(height * (0.15 + 0.2 * row + rng.uniform(0, 0.1)))
        text = "".join(rng.choice(list("ABEKLMNORSTUX  "), int(rng.integers(3, 9))))
        size = float(rng.uniform(0.5, 1.3))
        cv2.putText(canvas, text, at, cv2.FONT_HERSHEY_DUPLEX, size, _bytes(any_colour(rng)), 2, cv2.LINE_AA)


def upright(rng: np.random.Generator, spot: FloatArray, picture: ImageArray) -> Facade:
    """A ``picture`` on a board that stands on the ground."""
    high = float(np.exp(rng.uniform(np.log(0.6), np.log(3.2))))
    wide = high * picture.shape[1] / picture.shape[0] * float(rng.uniform(0.8, 1.4))
    angle = float(rng.normal(0, 0.6)) if rng.random() < 0.7 else float(rng.uniform(0, np.pi))
    return Facade(spot, angle, (wide, high), picture)


def chair_under(rng: np.random.Generator, spot: FloatArray, camera: AnyCamera, heading: float) -> Thing:
    """A chair or a bench for who sits at ``spot`` ``(2,)``; ``heading`` is to the left of away from the camera."""
    away = away_from(camera, spot)
    facing = float(np.arctan2(away[1], away[0])) + heading
    # Behind who faces the camera, before who turns the back to it, and a little behind who is seen from the side.
    shift = 0.08 - _CHAIR * float(np.cos(heading))
    return chair(rng, spot + shift * away, facing)


def screen_before(rng: np.random.Generator, spot: FloatArray, camera: AnyCamera) -> Thing:
    """A wall, counter, hedge or pillar that hides a part of who stands at ``spot`` ``(2,)``."""
    away = away_from(camera, spot)
    aside = np.array([-away[1], away[0]])
    low = rng.random() < 0.65
    half = rng.uniform([0.5, 0.05, 0.25], [1.4, 0.3, 0.65]) if low else rng.uniform([0.1, 0.1, 0.7], [0.28, 0.2, 1.4])
    shift = float(rng.normal(0, 0.5)) if low else float(rng.choice([-1, 1]) * rng.uniform(0.05, 0.35))
    parts = Parts(spot - rng.uniform(0.45, 1.1) * away + shift * aside, float(np.arctan2(aside[1], aside[0])))
    kinds = (Pattern.ACROSS, Pattern.ALONG, Pattern.CHECKS, Pattern.BRICKS, Pattern.LEAVES, Pattern.WINDOWS)
    cloth = Surface(
        any_colour(rng), any_colour(rng), pattern_of(rng, Pattern.PLAIN, *kinds), float(rng.uniform(0.1, 0.6))
    )
    parts.box(parts.at(up=half[2]), half, cloth)
    return Thing(parts.solids())
