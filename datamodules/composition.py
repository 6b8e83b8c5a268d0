"""People pasted into images: generated ones, and real ones cut out of a fixed camera's frames. No torch.

A network trained on one short sequence learns its few people and where they walk. Pasting hundreds of others, and
its own people in other clothes, at other places, leaves it only what all people have in common.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.datamodules.augmentation import Example
from tsuiseki.datamodules.scenes.people.person import render_person_sprite
from tsuiseki.tracking.geometry import areas, clip_boxes, intersections
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray

# Change against the background up to which a pixel surely shows the background, grey levels.
_NOISE = 10.0
# Change from which a pixel surely shows a person, grey levels.
_CERTAIN = 28.0
# Share of its size that a box is larger than a generated silhouette: labellers leave a little room about people.
_LABEL_MARGIN = 0.04
# Least width of a generated person's box, in its height.
_SMALLEST_ASPECT = 0.28
# Height in pixels at which people are rendered.
_HEIGHT = 110


@dataclass(frozen=True)
class Cutout:
    """A person cut out of an image.

    Attributes:
        pixels: ``(h, w, 4)`` uint8 RGBA.
        box: ``(4,)`` the label in pixels of the cutout.
    """

    pixels: ImageArray
    box: FloatArray


@dataclass(frozen=True)
class SizeByRow:
    """How tall people are by where their feet stand: ``height = slope * row + intercept``, give or take ``spread``.

    Attributes:
        slope: pixels of height a row.
        intercept: height at row 0.
        spread: standard deviation of the relative difference.
        rows: highest and lowest row of feet.
    """

    slope: float
    intercept: float
    spread: float
    rows: tuple[float, float]

    def draw(self, rng: np.random.Generator, row: float) -> float:
        """A height for feet at ``row``, at least 8 pixels."""
        return max(8.0, (self.slope * row + self.intercept) * math.exp(rng.normal(0, self.spread)))


def fit_size_by_row(boxes: FloatArray) -> SizeByRow:
    """Least squares over labelled boxes ``(N, 4)``; fewer than 3 boxes or one row give a constant."""
    feet, heights = boxes[:, 3], boxes[:, 3] - boxes[:, 1]
    slope, intercept = 0.0, float(heights.mean())
    if len(boxes) >= 3 and np.ptp(feet) > 1:
        slope, intercept = (float(v) for v in np.polyfit(feet, heights, 1))
    expected = np.maximum(slope * feet + intercept, 1)
    spread = float(np.clip(np.std(heights / expected), 0.05, 0.5))
    return SizeByRow(slope, intercept, spread, (float(feet.min()), float(feet.max())))


def empty_view(examples: Sequence[Example], max_frames: int = 60) -> Example:
    """A fixed camera's view without people: the per-pixel median over up to ``max_frames`` frames outside all labels.

    What labels cover in every frame keeps its people; boxes about those places are returned as ignored.
    """
    chosen = [examples[i] for i in np.unique(np.linspace(0, len(examples) - 1, max_frames).astype(int))]
    covered = np.stack([_inside(e) for e in chosen])
    images = np.stack([e.image for e in chosen])
    always = np.asarray(covered.all(axis=0))
    # Labelled pixels go to the end of the order, from where the middle of the others never reaches them.
    order = np.sort(np.where(covered[..., None] & ~always[..., None], 256, images.astype(np.int16)), axis=0)
    count = np.where(always, len(chosen), (~covered).sum(axis=0))
    middle = np.take_along_axis(order, ((count - 1) // 2)[None, ..., None], axis=0)[0]
    _, _, statistics, _ = cv2.connectedComponentsWithStats(np.asarray(always, dtype=np.uint8))
    x, y, width, height = statistics[1:, :4].astype(np.float64).T
    boxes = np.stack([x, y, x + width, y + height], axis=1)
    return Example(middle.astype(np.uint8), boxes, np.ones(len(boxes), dtype=np.bool_))


def _inside(example: Example) -> BoolArray:
    """``(H, W)`` pixels within a label."""
    mask = np.zeros(example.image.shape[:2], dtype=np.bool_)
    for x1, y1, x2, y2 in example.boxes.round().astype(int).clip(0):
        mask[y1:y2, x1:x2] = True
    return mask


def cut_out_people(example: Example, background: ImageArray) -> list[Cutout | None]:
    """Every labelled person of a fixed camera's frame as a cutout, None where others or too little of it show."""
    difference = cv2.absdiff(cv2.GaussianBlur(example.image, (0, 0), 0.8), cv2.GaussianBlur(background, (0, 0), 0.8))
    change = difference.max(axis=2).astype(np.float32)
    alpha = np.clip((change - _NOISE) / (_CERTAIN - _NOISE), 0, 1)
    alpha = np.asarray(cv2.morphologyEx(alpha, cv2.MORPH_CLOSE, np.ones((5, 3), np.uint8)), dtype=np.float32)
    shared = intersections(example.boxes[:, None], example.boxes[None])
    np.fill_diagonal(shared, 0)
    alone = shared.sum(axis=1) < 0.03 * areas(example.boxes)
    return [
        _cut_out(example.image, alpha, box) if ok and not ignored else None
        for box, ok, ignored in zip(example.boxes, alone, example.ignored, strict=True)
    ]


def _cut_out(image: ImageArray, alpha: NDArray[np.float32], box: FloatArray) -> Cutout | None:
    margin = 0.1 * (box[2:] - box[:2])
    region = np.concatenate([box[:2] - margin, box[2:] + margin])
    x1, y1, x2, y2 = clip_boxes(region, image.shape[1], image.shape[0]).round().astype(int)
    local = np.ascontiguousarray(alpha[y1:y2, x1:x2])
    count, labels, statistics, _ = cv2.connectedComponentsWithStats((local > 0.3).astype(np.uint8))
    if count < 2:
        return None
    largest = 1 + int(np.argmax(statistics[1:, cv2.CC_STAT_AREA]))
    body = cv2.dilate((labels == largest).astype(np.float32), np.ones((3, 3), dtype=np.uint8))
    box_width, box_height = box[2] - box[0], box[3] - box[1]
    filled = statistics[largest, cv2.CC_STAT_AREA] / (box_width * box_height)
    if statistics[largest, cv2.CC_STAT_HEIGHT] < 0.8 * box_height or not 0.25 < filled < 0.95:
        return None
    mask = (255 * local * body).astype(np.uint8)
    offset = np.array([x1, y1, x1, y1], dtype=np.float64)
    return Cutout(np.dstack([image[y1:y2, x1:x2], mask]), box - offset)


def generate_people(rng: np.random.Generator, count: int, tilt: tuple[float, float] = (0.0, 0.7)) -> list[Cutout]:
    """``count`` generated people, seen from cameras that look down by ``tilt`` radians."""
    people: list[Cutout] = []
    while len(people) < count:
        pixels = render_person_sprite(rng, _HEIGHT, tilt=float(rng.uniform(*tilt)))
        height, width = pixels.shape[:2]
        if width / height > 0.75:
            continue
        middle, half = width / 2, max(width * (1 + _LABEL_MARGIN), _SMALLEST_ASPECT * height) / 2
        extra = _LABEL_MARGIN / 2 * height
        people.append(Cutout(pixels, np.array([middle - half, -extra, middle + half, height + extra])))
    return people


def change_clothes(rng: np.random.Generator, person: Cutout) -> Cutout:
    """The same person with head, upper and lower body in other colours; folds and shading stay."""
    pixels = person.pixels.astype(np.float32)
    height = person.box[3] - person.box[1]
    rows = (np.arange(len(pixels)) + 0.5 - person.box[1]) / height
    borders = [-1.0, rng.uniform(0.12, 0.2), rng.uniform(0.45, 0.65), 2.0]
    for part, (top, bottom) in enumerate(itertools.pairwise(borders)):
        if rng.random() < (0.6 if part == 0 else 0.2):
            continue
        inside = 1 / (1 + np.exp(-(np.minimum(rows - top, bottom - rows)) * height / 1.0))
        weight = inside.astype(np.float32)[:, None, None]
        pixels[..., :3] += weight * (_dyed(rng, pixels) - pixels[..., :3])
    return Cutout(np.clip(pixels, 0, 255).astype(np.uint8), person.box)


def _dyed(rng: np.random.Generator, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """``(h, w, 3)`` of the cutout in another colour or brightness."""
    colours, solid = pixels[..., :3], pixels[..., 3] > 128
    if not solid.any() or rng.random() < 0.3:
        return colours * np.float32(np.exp(rng.normal(0, 0.5))) + np.float32(rng.normal(0, 20))
    luminance = colours @ np.array([0.299, 0.587, 0.114], dtype=np.float32)
    folds = np.clip(luminance / max(float(np.median(luminance[solid])), 12.0), 0.4, 2.2)
    hue, saturation, value = rng.uniform(0, 360), rng.beta(1.0, 1.6), rng.beta(1.0, 1.1)
    dye = cv2.cvtColor(np.array([[[hue, saturation, 0.05 + 0.9 * value]]], dtype=np.float32), cv2.COLOR_HSV2RGB)
    return np.asarray(255 * dye[0, 0] * (1 + rng.uniform(0.4, 1.0) * (folds - 1))[..., None], dtype=np.float32)


class Canvas:
    """An image that people are pasted into, keeping count of how much of each stays visible."""

    def __init__(self, example: Example) -> None:
        self.image = example.image.copy()
        self.boxes = list(example.boxes)
        self.ignored = list(example.ignored)
        self.hidden = [0.0] * len(self.boxes)

    def paste(self, person: Cutout, box: FloatArray, soften: float = 0.0) -> None:
        """Put ``person`` so that its label falls on ``box``; what reaches beyond the image is cut off."""
        scale = (box[2:] - box[:2]) / (person.box[2:] - person.box[:2])
        size = np.maximum(np.round(scale * person.pixels.shape[1::-1]), 2).astype(int)
        pixels = np.asarray(
            cv2.resize(_premultiplied(person.pixels), size.tolist(), interpolation=cv2.INTER_AREA), np.float32
        )
        if soften > 0:
            pixels = np.asarray(cv2.GaussianBlur(pixels, (0, 0), soften), dtype=np.float32)
        left, top = np.round(box[:2] - scale * person.box[:2]).astype(int)
        self._blend(pixels, int(left), int(top))
        self.boxes.append(box)
        self.ignored.append(False)
        self.hidden.append(0.0)

    def repaint(self, person: Cutout, box: FloatArray) -> None:
        """Put ``person`` back, in other clothes, where it was cut out with label ``box``."""
        left, top = np.round(box[:2] - person.box[:2]).astype(int)
        self._blend(_premultiplied(person.pixels), int(left), int(top), covers=False)

    def finish(self) -> Example:
        """The image; people of whom more than 0.65 is covered are to be ignored."""
        ignored = np.array(self.ignored, dtype=np.bool_) | (np.array(self.hidden) > 0.65)
        boxes = np.array(self.boxes, dtype=np.float64).reshape(-1, 4)
        inside = clip_boxes(boxes, self.image.shape[1], self.image.shape[0])
        share = areas(inside) / areas(boxes)
        visible = share > 0.02
        return Example(self.image, inside[visible], (ignored | (share < 0.3))[visible])

    def _blend(self, pixels: NDArray[np.float32], left: int, top: int, covers: bool = True) -> None:
        height, width = self.image.shape[:2]
        x1, y1 = max(left, 0), max(top, 0)
        x2, y2 = min(left + pixels.shape[1], width), min(top + pixels.shape[0], height)
        if x2 <= x1 or y2 <= y1:
            return
        patch = pixels[y1 - top : y2 - top, x1 - left : x2 - left]
        alpha = patch[..., 3:]
        self.image[y1:y2, x1:x2] = (self.image[y1:y2, x1:x2] * (1 - alpha) + patch[..., :3] + 0.5).astype(np.uint8)
        if covers and self.boxes:
            region = np.array([x1, y1, x2, y2], dtype=np.float64)
            boxes = np.array(self.boxes)
            share = intersections(boxes, region[None]) / areas(boxes) * float(alpha.mean()) * 1.5
            self.hidden = (np.array(self.hidden) + share).tolist()


def place_people(
    rng: np.random.Generator, canvas: Canvas, pools: Sequence[Sequence[Cutout]], count: int, sizes: SizeByRow
) -> None:
    """Paste ``count`` people drawn from ``pools`` (each pool as likely), the farthest first, some beside others."""
    height, width = canvas.image.shape[:2]
    slack = 0.15 * (sizes.rows[1] - sizes.rows[0])
    lowest = min(sizes.rows[1] + 2 * slack, height)
    feet = np.sort(rng.uniform(sizes.rows[0] - slack, lowest, count))
    for row in feet:
        pool = pools[int(rng.integers(len(pools)))]
        person = pool[int(rng.integers(len(pool)))]
        if rng.random() < 0.5:
            person = change_clothes(rng, person)
        if rng.random() < 0.5:
            person = mirror(person)
        tall = sizes.draw(rng, row)
        sides = person.box[2:] - person.box[:2]
        wide = tall * sides[0] / sides[1]
        x = rng.uniform(0, width)
        if canvas.boxes and rng.random() < 0.35:
            beside = canvas.boxes[rng.integers(len(canvas.boxes))]
            x, row = (beside[0] + beside[2]) / 2 + rng.normal(0, 1.2) * wide, beside[3] + rng.uniform(-1, 4)
        box = np.array([x - wide / 2, row - tall, x + wide / 2, row])
        canvas.paste(person, box, soften=float(rng.uniform(0, 0.6)) if rng.random() < 0.5 else 0.0)


def _premultiplied(pixels: ImageArray) -> NDArray[np.float32]:
    """Colour times coverage, and coverage in [0, 1]: what may be averaged without dark seams."""
    values = pixels.astype(np.float32)
    values[..., 3] /= 255
    values[..., :3] *= values[..., 3:]
    return values


def mirror(person: Cutout) -> Cutout:
    """``person`` with left and right exchanged, box and all."""
    width = person.pixels.shape[1]
    x1, y1, x2, y2 = person.box
    return Cutout(np.ascontiguousarray(person.pixels[:, ::-1]), np.array([width - x2, y1, width - x1, y2]))
