"""Crops of labelled people, with a margin around each box so that training can shift and stretch the box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.datamodules.readers.images import LabelledImage, labelled_images
from tsuiseki.datamodules.readers.mars import training_crops
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mars import MarsCrop, is_mars
from tsuiseki.tracking.geometry import intersections
from tsuiseki.tracking.output import whole_file
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray, IntArray

MARGIN = 0.2


@dataclass(frozen=True)
class IdentityCrops:
    """Views of people.

    Attributes:
        images: one uint8 array a view: ``(h, w, 3)`` RGB, the person's box and a margin around it, or
            ``(h, w, 4)`` RGBA, a rendered person cut out.
        boxes: ``(N, 4)`` where the person's box lies in its image; it may reach beyond it.
        ids: ``(N,)`` one number a person.
        frames: ``(N,)`` frame numbers; views of a person a few frames apart look almost the same.
        from_video: ``(N,)`` cut from video rather than rendered.
    """

    images: list[ImageArray]
    boxes: FloatArray
    ids: IntArray
    frames: IntArray
    from_video: BoolArray

    def __len__(self) -> int:
        return len(self.images)

    def select(self, which: BoolArray) -> IdentityCrops:
        """The views at a mask."""
        kept = np.flatnonzero(which)
        return IdentityCrops(
            [self.images[i] for i in kept], self.boxes[kept], self.ids[kept], self.frames[kept], self.from_video[kept]
        )


def join_crops(parts: Sequence[IdentityCrops]) -> IdentityCrops:
    """All views of ``parts``, in which no two parts share a person: ids are numbered anew from 0."""
    ids, first = [], 0
    for part in parts:
        names, numbers = np.unique(part.ids, return_inverse=True)
        ids.append(numbers + first)
        first += len(names)
    return IdentityCrops(
        [image for part in parts for image in part.images],
        np.concatenate([part.boxes for part in parts]),
        np.concatenate(ids).astype(np.int64),
        np.concatenate([part.frames for part in parts]),
        np.concatenate([part.from_video for part in parts]),
    )


def crops_from_folder(
    folder: Path, frames: tuple[int, int] | None, least_visible: float = 0.3, step: int = 1
) -> IdentityCrops:
    """Views of the labelled people of a MOTChallenge sequence, of every sequence in a folder, or of MARS.

    Args:
        folder: the sequence, the folder of sequences, or MARS or a part of it, to which only this argument applies.
        frames: first and last frame, 1-based, both included; None for all.
        least_visible: smallest visible share of a box, in [0, 1]. Where the labels do not say it, the share that no
            nearer person's box covers counts.
        step: use every ``step``-th frame.

    Raises:
        RequestError: the folder is not readable as sequences with images, or fewer than two people are left.
    """
    if is_mars(folder):
        return _from_mars(training_crops(folder))
    parts: dict[str, list[tuple[LabelledImage, BoolArray]]] = {}
    for sample in labelled_images(folder, frames):
        if sample.frame % step == 0:
            usable = ~sample.ignored & (np.minimum(sample.visibility, uncovered(sample.boxes)) >= least_visible)
            parts.setdefault(sample.sequence, []).append((sample, usable))
    crops = join_crops([_cut_sequence(samples) for samples in parts.values()])
    if len(np.unique(crops.ids)) < 2:
        raise RequestError(f"{folder}: expected at least two labelled people in frames {frames}, to tell them apart")
    return crops


def _from_mars(crops: list[MarsCrop]) -> IdentityCrops:
    """MARS's crops are their boxes; frames of another camera or tracklet count as far away."""
    images = [read_image(crop.path) for crop in crops]
    return IdentityCrops(
        images,
        np.array([[0, 0, image.shape[1], image.shape[0]] for image in images], dtype=np.float64),
        np.array([crop.person for crop in crops], dtype=np.int64),
        np.array([1_000_000 * crop.camera + 10_000 * (crop.tracklet % 100) + crop.frame for crop in crops]),
        np.ones(len(crops), dtype=np.bool_),
    )


def uncovered(boxes: FloatArray) -> FloatArray:
    """``(N,)`` share of every box that the most covering nearer box leaves free; lower feet mean nearer."""
    if len(boxes) == 0:
        return np.empty(0)
    size = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
    covered = intersections(boxes[:, None], boxes[None]) / size[:, None]
    nearer = boxes[None, :, 3] > boxes[:, None, 3]
    return np.asarray(1 - (covered * nearer).max(axis=1))


def _cut_sequence(samples: list[tuple[LabelledImage, BoolArray]]) -> IdentityCrops:
    images, boxes, ids, frames = [], [np.empty((0, 4))], [], []
    for sample, usable in samples:
        image = read_image(sample.path) if usable.any() else None
        for box, identity in zip(sample.boxes[usable], sample.ids[usable], strict=True):
            assert image is not None
            cut, inner = cut_with_margin(image, box)
            images.append(cut)
            boxes.append(inner[None])
            ids.append(identity)
            frames.append(sample.frame)
    return IdentityCrops(
        images,
        np.concatenate(boxes),
        np.array(ids, dtype=np.int64),
        np.array(frames, dtype=np.int64),
        np.ones(len(images), dtype=np.bool_),
    )


def cut_with_margin(image: ImageArray, box: FloatArray) -> tuple[ImageArray, FloatArray]:
    """The part of an image around ``box`` ``(4,)``, and where the box lies in it."""
    margin = MARGIN * np.tile(box[2:] - box[:2], 2) * [-1, -1, 1, 1]
    height, width = image.shape[:2]
    limits = np.array([width, height])
    low = np.clip(np.floor((box + margin)[:2]), 0, limits - 1).astype(int)
    high = np.clip(np.ceil((box + margin)[2:]), low + 1, limits).astype(int)
    return image[low[1] : high[1], low[0] : high[0]].copy(), box - np.tile(low, 2)


def read_image(path: Path) -> ImageArray:
    """``(H, W, 3)`` uint8 RGB.

    Raises:
        RequestError: the file is no readable image.
    """
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise RequestError(f"{path}: expected an image, got something unreadable")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def write_crops(path: Path, crops: IdentityCrops) -> None:
    """Keep ``crops`` in one compressed file."""
    shapes = np.array([image.shape for image in crops.images], dtype=np.int64).reshape(-1, 3)
    pixels = np.concatenate([image.ravel() for image in crops.images])
    with whole_file(path) as file:
        np.savez_compressed(
            file,
            pixels=pixels,
            shapes=shapes,
            boxes=crops.boxes,
            ids=crops.ids,
            frames=crops.frames,
            from_video=crops.from_video,
        )


def read_crops(path: Path) -> IdentityCrops:
    """What `write_crops` wrote.

    Raises:
        RequestError: the file is missing or no such file.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            shapes = file["shapes"]
            pieces = np.split(file["pixels"], np.cumsum(shapes.prod(axis=1))[:-1])
            images = [piece.reshape(shape) for piece, shape in zip(pieces, shapes.tolist(), strict=True)]
            return IdentityCrops(images, file["boxes"], file["ids"], file["frames"], file["from_video"])
    except (OSError, ValueError, KeyError) as error:
        raise RequestError(
            f"{path}: expected a cache of identity crops, got {error}; delete it to render anew"
        ) from error
