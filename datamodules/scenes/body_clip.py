"""Clips of bodies: images, exact states, silhouettes; what goldfish and bouncing balls have in common."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.clip import IMAGES, QUALITY, ClipSettings, Moment
from tsuiseki.datamodules.scenes.render.solids import Float32, Window, overlap
from tsuiseki.tracking.formats.body_states import FOLDER, write_states
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray, IntArray
from tsuiseki.tracking.types.tracks import exact_track

MOST_BODIES = 5
# The noise of the camera is drawn once, somewhat larger than an image: drawing it anew would cost more than the scene.
_SHIFT = 64


@dataclass(frozen=True)
class Drawn:
    """A body on its part of the image.

    Attributes:
        left: column of the part.
        top: row of the part.
        colour: ``(h, w, 3)`` float32 in [0, 255].
        opacity: ``(h, w)`` in [0, 1].
    """

    left: int
    top: int
    colour: Float32
    opacity: Float32

    @property
    def silhouette(self) -> BoolArray:
        """Pixels ``(h, w)`` that the body covers."""
        return np.asarray(self.opacity > 0.3)

    def within(self, shape: tuple[int, ...]) -> tuple[Window, Window]:
        """See `solids.overlap`."""
        return overlap(shape, (self.top, self.left), self.opacity.shape)


def around(a: float, b: float, reach: int) -> tuple[int, int, Float32, Float32]:
    """Left column and top row of what lies within ``reach`` pixels of a place, and the places x, y of it from there."""
    left, top = math.floor(a) - reach, math.floor(b) - reach
    x = np.arange(left, left + 2 * reach + 1, dtype=np.float32) + np.float32(0.5 - a)
    return left, top, x, np.arange(top, top + 2 * reach + 1, dtype=np.float32)[:, None] + np.float32(0.5 - b)


def paint(image: Float32, body: Drawn) -> None:
    """Lay a drawn body over ``image``."""
    part, own = body.within(image.shape)
    cover = body.opacity[own][..., None]
    image[part] = (1 - cover) * image[part] + cover * body.colour[own]


@dataclass(frozen=True)
class BodyFrame:
    """One frame of a clip of bodies.

    Attributes:
        image: ``(H, W, 3)`` uint8 RGB.
        states: ``(K, D)`` exact states; body ``k`` has the id ``k + 1``.
        silhouettes: ``(H, W)`` uint8 whose bit ``k`` says that body ``k`` lies there, covered by another or not.
    """

    image: ImageArray
    states: FloatArray
    silhouettes: ImageArray


@dataclass(frozen=True)
class BodyClip:
    """A planned clip, of which every frame can be drawn on its own; see `clip.Clip`.

    Attributes:
        settings: of the clip.
        fields: names of the D numbers of a state.
        states: ``(T, K, D)`` exact states.
        picture: draws a frame: the image ``(H, W, 3)`` in [0, 255] without noise, and its K bodies.
        grain: noise of the camera, from `camera_grain`.
    """

    settings: ClipSettings
    fields: tuple[str, ...]
    states: FloatArray
    picture: Callable[[int], tuple[Float32, Sequence[Drawn]]]
    grain: tuple[Float32, IntArray]

    views: ClassVar[tuple[str, ...]] = (IMAGES, f"{FOLDER}/{{number:06d}}.png")
    quality: ClassVar[int] = QUALITY

    def frames(self) -> Iterator[Moment[FloatArray]]:
        """See `clip.Clip`: the image and the silhouettes, and the states ``(K, D)``."""
        for number in range(len(self.states)):
            frame = self.draw_frame(number)
            yield (frame.image, frame.silhouettes), frame.states

    def draw_frame(self, frame: int) -> BodyFrame:
        """Frame ``frame`` of the clip."""
        image, bodies = self.picture(frame)
        height, width = image.shape[:2]
        silhouettes = np.zeros((height, width), np.uint8)
        for bit, body in enumerate(bodies):
            part, own = body.within((height, width))
            silhouettes[part] |= np.where(body.silhouette[own], np.uint8(1 << bit), np.uint8(0))
        (top, left), noise = self.grain[1][frame], self.grain[0]
        noisy = cv2.add(image, noise[top : top + height, left : left + width], dtype=cv2.CV_8U)
        return BodyFrame(np.asarray(noisy, np.uint8), self.states[frame], silhouettes)

    def write_truth(self, folder: Path, name: str, truths: list[FloatArray]) -> None:
        """Write ``states.csv`` and ``seqinfo.ini``."""
        numbers = np.arange(len(truths))
        tracks = [exact_track(k + 1, numbers, way) for k, way in enumerate(np.stack(truths, axis=1))]
        write_states(folder / "states.csv", tracks, self.fields)
        self.settings.write_info(folder, name)


def camera_grain(settings: ClipSettings, level: float, rng: np.random.Generator) -> tuple[Float32, IntArray]:
    """Noise of ``level`` grey levels on more than an image, and which part of it ``(T, 2)`` each frame has."""
    size = (settings.height + _SHIFT, settings.width + _SHIFT, 3)
    noise = np.float32(level) * rng.standard_normal(size, dtype=np.float32)
    return noise, rng.integers(_SHIFT + 1, size=(settings.frames, 2))
