"""A clip of bodies on disk: images, exact states, silhouettes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.formats.mot import write_sequence_info
from tsuiseki.tracking.formats.silhouettes import FOLDER, write_silhouettes
from tsuiseki.tracking.formats.states import exact_track, write_states
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.types import FloatArray, ImageArray

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
            name = work / "img1" / f"{index + 1:06d}.jpg"
            cv2.imwrite(str(name), frame.image[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])
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


def another_part(noise: NDArray[np.float32], shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    """One frame's noise, cut from the larger picture of it: drawing it anew would cost more than the scene."""
    top, left = rng.integers(GRAIN_SHIFT + 1, size=2)
    return noise[top : top + shape[0], left : left + shape[1]]
