"""Crops of labelled people, with a margin around each box so that training can shift and stretch the box."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.datamodules.labelled_images import LabelledFrame, Part, labelled_images
from tsuiseki.datamodules.scenes.people.person import (
    Person,
    paste,
    random_backdrop,
    random_identities,
    render_person_sprite,
)
from tsuiseki.datamodules.scenes.render.shading import random_light
from tsuiseki.datamodules.video_pictures import read_image
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.person_crops import (
    GALLERY,
    TRAIN,
    PersonCrop,
    is_market,
    is_mars,
    read_market,
    read_mars,
)
from tsuiseki.tracking.geometry import intersections
from tsuiseki.tracking.openers.arrays import read_arrays
from tsuiseki.tracking.output import whole_file
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray, IntArray

# Of a view around the person's box, in box sizes, so that a shifted or larger box still lies in it.
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
        rows = np.flatnonzero(which)
        return IdentityCrops(
            [self.images[i] for i in rows], self.boxes[rows], self.ids[rows], self.frames[rows], self.from_video[rows]
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
    folder: Path, frames: tuple[int, int] | None, least_visible: float = 0.3, part: Part = (0.0, 1.0)
) -> IdentityCrops:
    """Views of the labelled people of a MOTChallenge sequence, of every sequence in a folder, of MARS or Market-1501.

    Args:
        folder: the sequence, the folder of sequences, or MARS, Market-1501 or a part of it, to which only this
            argument applies.
        frames: first and last frame, 1-based, both included; None for all.
        least_visible: smallest visible share of a box, in [0, 1]. Where the labels do not say it, the share that no
            nearer person's box covers counts.
        part: of each sequence, in shares of its length.

    Raises:
        RequestError: the folder is not readable as sequences with images, or fewer than two people are left.
    """
    root, subset = (folder.parent, folder.name) if folder.name in (TRAIN, GALLERY) else (folder, TRAIN)
    if is_market(root):
        return _from_mars([crop for crop in read_market(root, subset) if crop.person > 0])
    if is_mars(folder):
        return _from_mars(training_crops(folder))
    parts: dict[str, list[tuple[LabelledFrame, BoolArray]]] = {}
    for sample in labelled_images(folder, frames, part, single=False):
        usable = ~sample.ignored & (np.minimum(sample.visibility, uncovered(sample.boxes)) >= least_visible)
        parts.setdefault(sample.sequence, []).append((sample, usable))
    crops = join_crops([_cut_sequence(samples) for samples in parts.values()])
    if len(np.unique(crops.ids)) < 2:
        raise RequestError(f"{folder}: expected at least two labelled people in frames {frames}, to tell them apart")
    return crops


def _from_mars(crops: list[PersonCrop]) -> IdentityCrops:
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


def _cut_sequence(samples: list[tuple[LabelledFrame, BoolArray]]) -> IdentityCrops:
    images, boxes, ids, frames = [], [np.empty((0, 4))], [], []
    for sample, usable in samples:
        image = read_image(sample.picture) if usable.any() else None
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
        arrays = read_arrays(path, "a cache of identity crops")
        shapes = arrays["shapes"]
        pieces = np.split(arrays["pixels"], np.cumsum(shapes.prod(axis=1))[:-1])
        images = [piece.reshape(shape) for piece, shape in zip(pieces, shapes.tolist(), strict=True)]
        return IdentityCrops(images, arrays["boxes"], arrays["ids"], arrays["frames"], arrays["from_video"])
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise RequestError(
            f"{path}: expected a cache of identity crops, got {error}; delete it to render anew"
        ) from error


# Crops taken of a tracklet: neighbouring frames look almost the same, and all half a million fit into no memory.
PER_TRACKLET = 8


def training_crops(folder: str | Path) -> list[PersonCrop]:
    """Up to `PER_TRACKLET` crops of every tracklet, spread over it, without distractors and junk.

    Raises:
        RequestError: fewer than two people are left, or see `read_mars`.
    """
    chosen: list[PersonCrop] = []
    people = [crop for crop in read_mars(folder) if crop.person > 0]
    for _, group in itertools.groupby(people, key=lambda crop: (crop.person, crop.camera, crop.tracklet)):
        tracklet = list(group)
        count = min(PER_TRACKLET, len(tracklet))
        chosen += [tracklet[i] for i in np.unique(np.linspace(0, len(tracklet) - 1, count).round().astype(int))]
    if len({crop.person for crop in chosen}) < 2:
        raise RequestError(f"{folder}: expected crops of at least two people, to tell them apart")
    return chosen


# Probability that a person is dressed much like the one before: those are what a tracker confuses.
LOOK_ALIKES = 0.5
# Steepest tilt of the camera under the horizon, radians.
STEEPEST = 0.8


def render_people(seed: int, identities: int, views: int, height: int = 96) -> IdentityCrops:
    """Cut-out views of random people, RGBA.

    Half of the people are dressed much like the one before them: those are what a tracker confuses. The light and
    the tilt of the camera stay for half of a person's views and then change.

    Args:
        seed: of all random numbers.
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
        neighbour = resized(behind, height * float(rng.uniform(0.75, 1.05)) / behind.shape[0])
        paste(image, neighbour, left + int(rng.uniform(-1, 1) * width), top + int(rng.uniform(-0.3, 0.1) * height))
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
