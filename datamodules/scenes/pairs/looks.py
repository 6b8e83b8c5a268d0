"""What a target of no class looks like: cut-outs of freely usable pictures, of people, and of shapes made up.

A `Look` shows one thing once or more, as in a walk. Cut-outs have colours times opacity, so that they may be warped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.pairs.in_the_round import from_some_sides, random_spread
from tsuiseki.datamodules.scenes.pairs.textures import SIDE as TEXTURE_SIDE
from tsuiseki.datamodules.scenes.pairs.textures import random_texture
from tsuiseki.datamodules.scenes.people.gait import walking
from tsuiseki.datamodules.scenes.people.person import random_person, render_person_sprite
from tsuiseki.datamodules.scenes.people.poses import draw_pose, random_name
from tsuiseki.datamodules.scenes.render.photographs import OPAQUE, Photographs
from tsuiseki.datamodules.scenes.render.shading import random_light
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.tracking.openers.images import decoded_image
from tsuiseki.tracking.types import FloatArray, ImageArray

# Longer side of a cut-out, pixels: a target fills about half of a template of 127.
SIDE = 112
# Least opaque pixels of a thing: of fewer nothing is seen.
_LEAST_PIXELS = 150
# Textures of an epoch: enough that a pair rarely shows what another did.
_TEXTURES = 64
# Things of no class, likewise.
_MADE_UP = 256
# People, likewise.
_PEOPLE = 24
# Things in the round, likewise.
_ROUND = 40
# Share of the looks that are people.
_PEOPLE_SHARE = 0.25
# Share of them that are things in the round.
_ROUND_SHARE = 0.15
# Share of them that are cut-outs of pictures, where there are some; the others are made up.
_THINGS_SHARE = 0.35
# Share of the textures that are photographs.
_PHOTOGRAPHS = 0.5
# Poses of a person, and sides of a thing in the round.
_POSES = 4
# Share of the people who do not walk: they jump, fall, crouch, sit and so on.
_ACTING = 0.4


@dataclass(frozen=True)
class Silhouette:
    """A thing without its surroundings.

    Attributes:
        pixels: ``(h, w, 4)`` uint8, colours times opacity.
        outline: ``(N, 2)`` corners of the convex hull of what is opaque, pixels from the middle.
    """

    pixels: ImageArray
    outline: FloatArray


def outlined(pixels: ImageArray) -> Silhouette:
    """The cut-out of ``pixels`` ``(h, w, 4)``, some of which must be opaque."""
    opaque = pixels[..., 3] >= OPAQUE
    rows = np.flatnonzero(opaque.any(axis=1))
    # The ends of the rows are all that a hull can touch.
    first, last = opaque[rows].argmax(axis=1), pixels.shape[1] - opaque[rows, ::-1].argmax(axis=1)
    corners = np.stack([np.concatenate([first, last] * 2), np.concatenate([rows, rows, rows + 1, rows + 1])], axis=1)
    hull = cv2.convexHull(corners.astype(np.int32))[:, 0]
    return Silhouette(pixels, hull - np.array(pixels.shape[1::-1]) / 2)


# One thing, seen several times.
Look: TypeAlias = tuple[Silhouette, ...]


class Wardrobe:
    """The looks and textures of one epoch, each made when it is first drawn; the same seed has the same ones.

    Args:
        seed: of all that is made.
        things: `read_things` of pictures; may be none.
        views: `read_views` among the textures; may be none.
    """

    def __init__(
        self, seed: Sequence[int], things: Sequence[Silhouette] = (), views: Sequence[ImageArray] = ()
    ) -> None:
        self.seed, self.things, self.views = tuple(seed), things, views
        self._textures: dict[int, ImageArray] = {}
        self._made_up: dict[int, Silhouette] = {}
        self._people: dict[int, Look] = {}
        self._round: dict[int, Look] = {}

    def texture(self, rng: np.random.Generator) -> ImageArray:
        """One at random; a share of them photographs, where there are some."""
        if self.views and rng.random() < _PHOTOGRAPHS:
            return self.views[int(rng.integers(len(self.views)))]
        index = int(rng.integers(_TEXTURES))
        if index not in self._textures:
            of_index = np.random.default_rng((*self.seed, 0, index))
            self._textures[index] = random_texture(of_index, [thing.pixels for thing in self.things])
        return self._textures[index]

    def look(self, rng: np.random.Generator) -> Look:
        """One at random."""
        kind = rng.random()
        if kind < _PEOPLE_SHARE:
            return self._person(int(rng.integers(_PEOPLE)))
        if kind < _PEOPLE_SHARE + _ROUND_SHARE:
            return self._in_the_round(int(rng.integers(_ROUND)))
        if kind < _PEOPLE_SHARE + _ROUND_SHARE + _THINGS_SHARE and self.things:
            thing = self.things[int(rng.integers(len(self.things)))]
        else:
            thing = self._made(int(rng.integers(_MADE_UP)))
        if rng.random() < 0.5:
            thing = recoloured(rng, thing)
        if rng.random() < 0.3:
            thing = textured(rng, thing, self.texture(rng), float(rng.uniform(0.2, 0.8)))
        return (thing,)

    def _person(self, index: int) -> Look:
        if index not in self._people:
            self._people[index] = walker(np.random.default_rng((*self.seed, 1, index)))
        return self._people[index]

    def _in_the_round(self, index: int) -> Look:
        if index not in self._round:
            self._round[index] = turning(np.random.default_rng((*self.seed, 3, index)))
        return self._round[index]

    def _made(self, index: int) -> Silhouette:
        if index not in self._made_up:
            pixels = make_up(np.random.default_rng((*self.seed, 2, index)), self.texture)
            self._made_up[index] = outlined(pixels)
        return self._made_up[index]

    def alike(self, rng: np.random.Generator, look: Look) -> Look:
        """Another thing of the same kind: the same outline, other colours or another texture."""
        view = look[int(rng.integers(len(look)))]
        return (recoloured(rng, view) if rng.random() < 0.6 else textured(rng, view, self.texture(rng), 1.0),)


def read_things(photographs: Photographs) -> list[Silhouette]:
    """The things among the photographs, as cut-outs of `SIDE`; what has hardly an opaque pixel is left out."""
    read = (decoded_image(path, cv2.IMREAD_UNCHANGED) for path in photographs.paths["things"])
    pictures = [x[..., [2, 1, 0, 3]] for x in read if x is not None and x.ndim == 3 and x.shape[2] == 4]
    return [outlined(cut) for picture in pictures if (cut := cut_out(picture)) is not None]


def read_views(photographs: Photographs) -> list[ImageArray]:
    """The views and surfaces among the photographs, ``(h, w, 3)`` RGB, their shorter side that of a texture."""
    pictures = []
    for path in (*photographs.paths["views"], *photographs.paths["surfaces"]):
        if (picture := decoded_image(path)) is not None:
            scale = TEXTURE_SIDE / min(picture.shape[:2])
            resized = cv2.resize(picture[..., ::-1], None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            pictures.append(np.asarray(resized, dtype=np.uint8))
    return pictures


def cut_out(picture: ImageArray) -> ImageArray | None:
    """The opaque part of ``(h, w, 4)`` straight colours as a cut-out of `SIDE`; None where there is hardly any."""
    opaque = picture[..., 3] >= OPAQUE
    if opaque.sum() < _LEAST_PIXELS:
        return None
    x, y, w, h = cv2.boundingRect(opaque.astype(np.uint8))
    part = picture[y : y + h, x : x + w].astype(np.float32)
    part[..., :3] *= part[..., 3:] / 255
    scale = SIDE / max(w, h)
    size = max(2, round(w * scale)), max(2, round(h * scale))
    return cv2.resize(part, size, interpolation=cv2.INTER_AREA).astype(np.uint8)


def walker(rng: np.random.Generator) -> Look:
    """A person in some poses, mostly of a walk."""
    person, light = random_person(rng), random_light(rng)
    heading, tilt, phase = float(rng.uniform(0, 2 * np.pi)), float(rng.uniform(0, 0.9)), float(rng.uniform(0, 1))
    poses = [walking(person.build, person.manner, phase + n / (2 * _POSES), 1.3) for n in range(_POSES)]
    if rng.random() < _ACTING:
        poses = [draw_pose(int(rng.integers(2**31)), person.build, random_name(rng)) for _ in poses]
    turns = heading + rng.normal(0, random_spread(rng), _POSES)
    drawn = [
        render_person_sprite(rng, 100, tilt, person, pose, float(turn), light)
        for pose, turn in zip(poses, turns, strict=True)
    ]
    views = tuple(outlined(view) for sprite in drawn if (view := cut_out(sprite)) is not None)
    return views or walker(rng)


def turning(rng: np.random.Generator) -> Look:
    """A thing in the round from some sides."""
    views = tuple(outlined(cut) for view in from_some_sides(rng, _POSES, SIDE) if (cut := cut_out(view)) is not None)
    return views or turning(rng)


def make_up(rng: np.random.Generator, texture: Callable[[np.random.Generator], ImageArray]) -> ImageArray:
    """A thing of one to four parts, each a smooth or square outline with a texture of its own, lit from a side."""
    canvas, parts = np.zeros((SIDE, SIDE, 4), dtype=np.float32), int(rng.integers(1, 5))
    shrink = 1 / np.sqrt(parts)
    for n in range(parts):
        middle = np.full(2, SIDE / 2) if n == 0 else rng.uniform(0.25, 0.75, 2) * SIDE
        outline = _outline(rng, middle, 0.48 * SIDE * (shrink if n else max(shrink, 0.7)))
        mask = np.zeros((SIDE, SIDE), dtype=np.float32)
        cv2.fillPoly(mask, [np.round(outline * 16).astype(np.int32)], 1.0, cv2.LINE_AA, 4)
        inside = mask[..., None]
        canvas *= 1 - inside
        canvas[..., :3] += inside * _piece(rng, texture(rng))
        canvas[..., 3:] += 255 * inside
    slope = rng.normal(0, 0.35, 2)
    y, x = np.mgrid[-1 : 1 : SIDE * 1j, -1 : 1 : SIDE * 1j].astype(np.float32)
    canvas[..., :3] *= np.clip(1 + slope[0] * x + slope[1] * y, 0.2, 1.6)[..., None]
    canvas[..., :3] = np.minimum(canvas[..., :3], canvas[..., 3:])
    made = canvas.astype(np.uint8)
    x1, y1, w, h = cv2.boundingRect((made[..., 3] >= OPAQUE).astype(np.uint8))
    return made[y1 : y1 + h, x1 : x1 + w] if min(w, h) >= 8 else make_up(rng, texture)


def _outline(rng: np.random.Generator, middle: FloatArray, radius: float) -> FloatArray:
    """``(N, 2)`` corners of a rectangle, or of a smooth and more or less wavy closed line, turned anyhow."""
    stretch = np.exp(rng.uniform(-0.8, 0.0, 2))
    if rng.random() < 0.25:
        points = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]) * 0.75
    else:
        angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)
        waves = np.arange(2, 7)
        size = rng.normal(0, 0.35, 5) / waves * rng.uniform(0, 1.5)
        reach = 1 + (size * np.cos(angles[:, None] * waves + rng.uniform(0, 2 * np.pi, 5))).sum(axis=1)
        points = np.clip(reach, 0.2, 1.6)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    turn = rng.uniform(0, 2 * np.pi) if rng.random() < 0.5 else 0.0
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return np.asarray(middle + radius * (points * stretch) @ turned.T)


def _piece(rng: np.random.Generator, texture: ImageArray) -> Float32:
    """``(SIDE, SIDE, 3)`` of a place in a ``texture``, larger or smaller than there."""
    side = int(np.exp(rng.uniform(np.log(30), np.log(min(texture.shape[:2])))))
    top, left = (int(rng.integers(n - side + 1)) for n in texture.shape[:2])
    part = texture[top : top + side, left : left + side]
    return cv2.resize(part, (SIDE, SIDE), interpolation=cv2.INTER_LINEAR).astype(np.float32)


def recoloured(rng: np.random.Generator, thing: Silhouette) -> Silhouette:
    """A cut-out with its channels mixed anew."""
    mix = np.eye(3) * rng.uniform(0.2, 1.0) + rng.dirichlet((0.7, 0.7, 0.7), 3) * rng.uniform(0.3, 1.0)
    mix = mix[rng.permutation(3)] if rng.random() < 0.5 else mix
    matrix = np.zeros((4, 4), dtype=np.float32)
    matrix[:3, :3], matrix[:3, 3], matrix[3, 3] = mix, rng.uniform(-0.3, 0.3, 3), 1
    mixed = np.asarray(cv2.transform(thing.pixels, matrix), dtype=np.uint8)
    # No colour is stronger than its opacity.
    mixed[..., :3] = np.minimum(mixed[..., :3], mixed[..., 3:])
    return replace(thing, pixels=mixed)


def textured(rng: np.random.Generator, thing: Silhouette, texture: ImageArray, strength: float) -> Silhouette:
    """A cut-out with a ``texture`` on it, by ``strength`` in [0, 1]."""
    piece = cv2.resize(_piece(rng, texture), thing.pixels.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    out = thing.pixels.astype(np.float32)
    out[..., :3] += strength * (piece * (out[..., 3:] / 255) - out[..., :3])
    return replace(thing, pixels=out.astype(np.uint8))
