"""Generated clips of one thing that is out of sight for a while, among things that look like it, with exact boxes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.pairs.looks import Look, Silhouette, Wardrobe
from tsuiseki.datamodules.scenes.pairs.textures import paste_at
from tsuiseki.tracking.types import FloatArray, ImageArray

Kind = Literal["covered", "leaves", "black", "partly"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""Why it is out of sight: something is in front of it, the camera turns away, or the picture is black; or half of it is
covered, and it stays in sight."""
HIGH, WIDE = 240, 320
FRAMES = 90
# First frames that are not disturbed.
CALM = 25
# Range of the frames out of sight.
AWAY = (8, 25)
# Range of the target's larger side, pixels.
SIDES = (28, 80)


@dataclass(frozen=True)
class Disappearance:
    """A clip.

    Attributes:
        kind: why the target is out of sight.
        images: ``(T, H, W, 3)`` uint8.
        boxes: ``(T, 4)`` of the whole target, hidden or not.
        visible: ``(T,)`` share of it that can be seen, in [0, 1].
    """

    kind: Kind
    images: ImageArray
    boxes: FloatArray
    visible: FloatArray


def drawn(seed: int) -> Disappearance:
    """The clip of a seed; kinds take turns."""
    rng, kind = np.random.default_rng((60, seed)), KINDS[seed % len(KINDS)]
    wardrobe = Wardrobe((60, seed))
    look, t = wardrobe.look(rng), np.arange(FRAMES)
    world = cv2.resize(wardrobe.texture(rng), (3 * WIDE, 2 * HIGH)).astype(np.float32)
    side = float(np.exp(rng.uniform(*np.log(SIDES))))
    path = _walk(rng, side) + np.array([1.5 * WIDE, HIGH])
    begin = int(rng.integers(CALM, FRAMES - AWAY[1] - 25))
    end = begin + int(rng.integers(*AWAY))
    away = np.interp(t, [begin - 6, begin, end, end + 6], [0, 1, 1, 0]) if kind == "leaves" else np.zeros(FRAMES)
    camera = path + 0.4 * _walk(rng, side) - np.array([WIDE / 2, HIGH / 2])
    camera[:, 0] += away * rng.choice([-1, 1]) * 0.85 * WIDE
    camera = np.clip(np.round(camera), 0, [2 * WIDE, HIGH]).astype(int)
    others = [(wardrobe.alike(rng, look), path[begin] + rng.normal(0, 1.5 * side, 2) + _walk(rng, side)) for _ in "ab"]
    growth, turn = np.exp(np.cumsum(rng.normal(0, 0.008, FRAMES))), np.cumsum(rng.normal(0, 1.5, FRAMES))
    cover = wardrobe.texture(rng)[: int(1.6 * side), : int((1.6 if kind == "covered" else 0.6) * side)]
    light = 1 + 0.15 * np.sin(t / rng.uniform(8, 20))
    images, boxes, visible = [], [], []
    for n in range(FRAMES):
        x, y = camera[n]
        view = world[y : y + HIGH, x : x + WIDE].copy()
        for other, places in others:
            paste_at(view, other[n % len(other)].pixels, places[n] - camera[n], side / max(other[0].pixels.shape[:2]))
        thing, box = _turned(look, n, float(turn[n]), side * float(growth[n]))
        middle = path[n] - camera[n]
        paste_at(view, thing, middle, 1.0)
        share = _inside(box + np.tile(middle, 2)) / float(np.prod(box[2:] - box[:2]))
        if kind in ("covered", "partly") and begin <= n < end:
            beside = 0 if kind == "covered" else side * 0.3
            high, wide = cover.shape[:2]
            left, top = (np.round(middle - np.array([wide / 2 - beside, high / 2]))).astype(int)
            x1, y1, x2, y2 = max(left, 0), max(top, 0), min(left + wide, WIDE), min(top + high, HIGH)
            if x2 > x1 and y2 > y1:
                view[y1:y2, x1:x2] = cover[y1 - top : y2 - top, x1 - left : x2 - left]
            share = 0.0 if kind == "covered" else share / 2
        if kind == "black" and begin <= n < end:
            view[:], share = 0, 0.0
        images.append(np.clip(view * light[n] + rng.normal(0, 3, view.shape), 0, 255).astype(np.uint8))
        boxes.append(box + np.tile(middle, 2))
        visible.append(share)
    return Disappearance(kind, np.array(images), np.array(boxes), np.array(visible))


def _walk(rng: np.random.Generator, side: float) -> FloatArray:
    """``(T, 2)`` places of a smooth walk from 0, 0."""
    directions = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.normal(0, 0.15, FRAMES))
    steps = side * rng.uniform(0.01, 0.06) * np.stack([np.cos(directions), np.sin(directions)], axis=1)
    return np.asarray(np.cumsum(steps, axis=0) - steps[0])


def _turned(look: Look, n: int, degrees: float, side: float) -> tuple[ImageArray, FloatArray]:
    """The cut-out of frame ``n``, turned and of a larger side, and its box ``(4,)`` about its middle."""
    silhouette: Silhouette = look[n % len(look)]
    pixels = silhouette.pixels
    high, wide = pixels.shape[:2]
    scale, room = side / max(high, wide), int(1.5 * side) + 4
    matrix = np.asarray(cv2.getRotationMatrix2D((wide / 2, high / 2), degrees, scale), dtype=np.float64)
    matrix[:, 2] += room / 2 - np.array([wide / 2, high / 2])
    turned = np.asarray(cv2.warpAffine(pixels, matrix, (room, room), flags=cv2.INTER_AREA), dtype=np.uint8)
    x, y, w, h = cv2.boundingRect((turned[..., 3] >= 128).astype(np.uint8))
    return turned, np.array([x, y, x + w, y + h], dtype=np.float64) - room / 2


def _inside(box: FloatArray) -> float:
    """Area of the part of a box that is in the picture."""
    inner = np.clip(box, 0, [WIDE, HIGH, WIDE, HIGH])
    return float(np.prod(np.maximum(inner[2:] - inner[:2], 0)))
