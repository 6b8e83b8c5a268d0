"""A clip of bodies on disk: images, exact states, silhouettes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.datamodules.scenes.clip import ClipSettings, numbered, write_image
from tsuiseki.datamodules.scenes.fish_drawing import Drawn, within
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.body_states import write_states
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.formats.silhouettes import FOLDER, write_silhouettes
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.types.tracks import exact_track

GRAIN_SHIFT = 64


@dataclass(frozen=True)
class SceneFrame:
    """One frame of a generated clip of bodies.

    Attributes:
        image: ``(H, W, 3)`` uint8 RGB.
        states: ``(K, D)`` exact states; body ``k`` has the id ``k + 1``.
        silhouettes: ``(H, W)`` uint8 whose bit ``k`` says that body ``k`` lies there, covered by another or not.
    """

    image: ImageArray
    states: FloatArray
    silhouettes: ImageArray


def check_clip(names: tuple[str, str], count: int, largest: int, length: float, settings: ClipSettings) -> None:
    """Whether a clip can be made of ``count`` bodies.

    Args:
        names: what one body and several are called.
        count: of bodies.
        largest: number of bodies that there may be.
        length: of a body, pixels.
        settings: of the clip.

    Raises:
        RequestError: it cannot.
    """
    one, several = names
    if not 1 <= count <= largest or settings.frames < 1 or not settings.frame_rate > 0:
        raise RequestError(
            f"expected 1 to {largest} {several}, at least one frame and a frame rate above 0, "
            f"got {count}, {settings.frames} and {settings.frame_rate:g}"
        )
    if min(settings.width, settings.height) < 4 * length:
        raise RequestError(
            f"expected an image four times as large as a {one}, which is {length:g} pixels long, "
            f"got {settings.width}x{settings.height}"
        )


def paint(image: NDArray[np.float32], body: Drawn) -> None:
    """Lays a drawn body over ``image``."""
    part, own = within(image.shape[:2], body)
    cover = body.opacity[own][..., None]
    image[part] = (1 - cover) * image[part] + cover * body.colour[own]


def seen_by_camera(
    image: NDArray[np.float32],
    states: FloatArray,
    bodies: Sequence[Drawn],
    grain: NDArray[np.float32],
    rng: np.random.Generator,
) -> SceneFrame:
    """The frame of a finished ``image`` with noise of the camera, and the silhouettes of its bodies.

    Args:
        image: ``(H, W, 3)`` in [0, 255].
        states: ``(K, D)``.
        bodies: K, as drawn.
        grain: of `larger_noise`.
        rng: chooses the part of it.
    """
    silhouettes = np.zeros(image.shape[:2], np.uint8)
    for bit, body in enumerate(bodies):
        part, own = within(image.shape[:2], body)
        silhouettes[part] |= np.where(body.silhouette[own], np.uint8(1 << bit), np.uint8(0))
    noisy = cv2.add(image, _another_part(grain, image.shape, rng), dtype=cv2.CV_8U)
    return SceneFrame(np.asarray(noisy, np.uint8), states, silhouettes)


def write_body_clip(
    folder: Path, frames: Iterable[SceneFrame], fields: Sequence[str], frame_rate: float, overwrite: bool = False
) -> Path:
    """Writes ``img1/000001.jpg`` ..., ``states.csv``, ``silhouettes/000001.png`` ... and ``seqinfo.ini``.

    Raises:
        RequestError: ``folder`` is a file, or holds files while ``overwrite`` is False.
    """
    states, size = [], (0, 0)
    with output_folder(folder, overwrite) as work:
        (work / "img1").mkdir()
        (work / FOLDER).mkdir()
        for index, frame in enumerate(frames):
            write_image(work / "img1" / numbered(index), frame.image)
            write_silhouettes(work, index, frame.silhouettes)
            states.append(frame.states)
            size = frame.image.shape[1], frame.image.shape[0]
        numbers = np.arange(len(states))
        tracks = [exact_track(k + 1, numbers, way) for k, way in enumerate(np.stack(states, axis=1))]
        write_states(work / "states.csv", tracks, fields)
        write_sequence_info(work, folder.name, frame_rate, len(states), *size)
    return folder


def larger_noise(height: int, width: int, level: float, rng: np.random.Generator) -> NDArray[np.float32]:
    """The noise of a camera in grey levels, on somewhat more than an image of three channels."""
    size = (height + GRAIN_SHIFT, width + GRAIN_SHIFT, 3)
    return np.float32(level) * rng.standard_normal(size, dtype=np.float32)


def _another_part(noise: NDArray[np.float32], shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    """One frame's noise, cut from the larger picture of it: drawing it anew would cost more than the scene."""
    top, left = rng.integers(GRAIN_SHIFT + 1, size=2)
    return noise[top : top + shape[0], left : left + shape[1]]
