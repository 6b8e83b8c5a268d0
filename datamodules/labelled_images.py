"""Labelled video of any layout as training samples: one labelled image a frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.labelled import LabelledVideo, open_labelled
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray, IntArray

# Shares of a video in [0, 1]: where a part begins, and where it ends.
Part: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class LabelledFrame:
    """One image and the people labelled in it.

    Attributes:
        path: of the image.
        sequence: name of the sequence it belongs to.
        frame: 0-based.
        boxes: ``(N, 4)`` pixels, of evaluated and ignored people.
        ids: ``(N,)`` one number a person within the sequence.
        ignored: ``(N,)`` boxes that are neither an example nor a counter-example.
        visibility: ``(N,)`` visible share in [0, 1].
    """

    path: Path
    sequence: str
    frame: int
    boxes: FloatArray
    ids: IntArray
    ignored: BoolArray
    visibility: FloatArray


def labelled_images(
    folder: str | Path, frames: tuple[int, int] | None = None, part: Part = (0.0, 1.0), single: bool = True
) -> list[LabelledFrame]:
    """The labelled images of every video in ``folder``.

    Args:
        folder: see `open_labelled`.
        frames: first and last frame of each video, 1-based and both included as the files count; by default all.
        part: of each video, in shares of its length.
        single: boxes need no ids, as in pictures that were labelled one by one.

    Raises:
        RequestError: there is no video, one has no images or no usable label, or no frame is left.
    """
    samples = [sample for video in open_labelled(Path(folder)) for sample in _images_of(video, frames, part, single)]
    if not samples:
        within = f"{part[0]:.0%} to {part[1]:.0%} of a video" if frames is None else f"{frames}; frames count from 1"
        raise RequestError(f"{folder}: no frame lies within {within}")
    return samples


def _images_of(
    video: LabelledVideo, frames: tuple[int, int] | None, part: Part, single: bool
) -> Iterator[LabelledFrame]:
    if video.length is None or len(video.files) != video.length:
        raise RequestError(f"{video.name}: expected images in img1/ or images/, found none; training needs them")
    truth = video.people(single=single)
    truth = truth.select(truth.evaluated | truth.ignored)
    first, last = frames or (1, video.length)
    start, end = (round(share * video.length) for share in part)
    for frame in range(max(first - 1, start), min(last, end)):
        rows = truth.between(frame, frame)
        yield LabelledFrame(video.files[frame], video.name, frame, rows.boxes, rows.ids, rows.ignored, rows.visibility)


def read_image(path: Path) -> ImageArray:
    """``(H, W, 3)`` uint8 RGB.

    Raises:
        RequestError: the file is no image.
    """
    image = cv2.imread(str(path))
    if image is None:
        raise RequestError(f"{path}: expected an image, got something that cannot be decoded; replace or remove it")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)
