"""Binarised normed gradients: a quick guess at which boxes hold an object of any kind.

Cheng et al., "BING: binarized normed gradients for objectness estimation at 300fps", CVPR 2014; thesis 3.2.5. A window,
resized to 8 x 8, is described by its normed gradients ``min(|gx| + |gy|, 255)`` and scored by one linear model for all
sizes; a second stage turns the score into one that can be compared between sizes. Both sides are binarised as in the
paper: gradients keep their four highest bits, the model is a sum of a few ``beta * a`` with ``a`` of plus or minus one.
The paper multiplies by counting bits; here OpenCV filters with the binarised model, which gives the same numbers.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.formats.rows import read_learnt
from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.openers.text import refusing
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.weights import shipped

# Side of a resized window, cells.
SIDE = 8
# The four highest bits of a gradient, which are kept.
KEPT_BITS = 0xF0
FORMAT = "tsuiseki-objectness-1"
# Greatest number of boxes of one size.
PER_SIZE = 64


@dataclass(frozen=True)
class ObjectnessModel:
    """A learnt model.

    Attributes:
        weights: ``(8, 8)`` binarised linear model.
        sizes: ``(S, 2)`` width and height of the windows, pixels.
        gains: ``(S,)`` second stage: ``gain * score + offset``.
        offsets: ``(S,)``.
        trained_on: in words.
    """

    weights: FloatArray
    sizes: FloatArray
    gains: FloatArray
    offsets: FloatArray
    trained_on: str

    def near(self, width: float, height: float, factor: float = 2.0) -> ObjectnessModel:
        """The model for sizes whose sides differ from ``width`` and ``height`` by at most ``factor``, at least one."""
        ratio = np.abs(np.log(self.sizes / [width, height])).max(axis=1)
        chosen = ratio <= max(np.log(factor), float(ratio.min()) + 1e-9)
        return replace(self, sizes=self.sizes[chosen], gains=self.gains[chosen], offsets=self.offsets[chosen])

    def write(self, path: Path) -> None:
        """Write as JSON."""
        content = {
            "format": FORMAT,
            "trained_on": self.trained_on,
            "weights": np.round(self.weights, 8).tolist(),
            "sizes": self.sizes.tolist(),
            "gains": np.round(self.gains, 8).tolist(),
            "offsets": np.round(self.offsets, 8).tolist(),
        }
        path.write_text(json.dumps(content) + "\n", encoding="utf-8")


def read_objectness(path: Path) -> ObjectnessModel:
    """The model in a file of `ObjectnessModel.write`.

    Raises:
        RequestError: there is none, or it is no such file.
    """
    content = read_learnt(path, "train objectness", FORMAT)
    with refusing(f"{path}: expected a file of tsuiseki train objectness, got other arrays"):
        arrays = [np.array(content[key], dtype=np.float64) for key in ("weights", "sizes", "gains", "offsets")]
        count = len(arrays[1])
        shapes = [array.shape for array in arrays]
        if shapes != [(SIDE, SIDE), (count, 2), (count,), (count,)] or not count:
            raise ValueError(shapes)
    return ObjectnessModel(arrays[0], arrays[1], arrays[2], arrays[3], str(content.get("trained_on", "")))


@lru_cache(maxsize=1)
def shipped_objectness() -> ObjectnessModel:
    """The model that ships with the toolkit, learnt on generated scenes."""
    return read_objectness(shipped("objectness_scenes"))


def binarise(weights: FloatArray, terms: int = 3) -> FloatArray:
    """The best sum of ``terms`` multiples of sign patterns, found one by one; BING algorithm 1."""
    remainder = np.asarray(weights, dtype=np.float64).copy()
    total = np.zeros_like(remainder)
    for _ in range(terms):
        pattern = np.where(remainder >= 0, 1.0, -1.0)
        part = float((remainder * pattern).mean()) * pattern
        total += part
        remainder -= part
    return total


# Central difference along x.
_CENTRAL = np.array([[-1, 0, 1]], dtype=np.float32)


def normed_gradients(image: ImageArray) -> NDArray[np.uint8]:
    """``(H, W)`` uint8 ``min(|gx| + |gy|, 255)`` of the strongest colour channel, with the four highest bits kept."""
    gx = cv2.convertScaleAbs(cv2.filter2D(image, cv2.CV_16S, _CENTRAL, borderType=cv2.BORDER_REPLICATE))
    gy = cv2.convertScaleAbs(cv2.filter2D(image, cv2.CV_16S, _CENTRAL.T, borderType=cv2.BORDER_REPLICATE))
    strength: NDArray[np.uint8] = np.asarray(cv2.add(gx, gy), dtype=np.uint8)
    if strength.ndim == 3:
        strength = strength.max(axis=2)
    return strength & np.uint8(KEPT_BITS)


def propose(
    image: ImageArray, model: ObjectnessModel, count: int, region: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """The boxes most like an object.

    Args:
        image: ``(H, W, 3)`` uint8.
        model: learnt.
        count: greatest number of boxes.
        region: ``(4,)`` pixels; only this part of the image is searched, which makes a frame cheap.

    Returns:
        Boxes ``(K, 4)`` pixels and scores ``(K,)``, best first.
    """
    x1, y1, x2, y2 = 0, 0, image.shape[1], image.shape[0]
    if region is not None:
        low, high = np.floor(region[:2]).astype(int).tolist(), np.ceil(region[2:]).astype(int).tolist()
        x1, y1, x2, y2 = max(low[0], 0), max(low[1], 0), min(high[0], x2), min(high[1], y2)
    part, factor = _reduced(image[y1:y2, x1:x2], float(model.sizes.min()))
    boxes, scores = [np.empty((0, 4))], [np.empty(0)]
    for (w, h), gain, offset in zip(model.sizes / factor, model.gains, model.offsets, strict=True):
        windows, values = _score_size(part, model.weights, float(w), float(h))
        boxes.append(windows * np.tile(factor, 2) + np.array([x1, y1, x1, y1]))
        scores.append(gain * values + offset)
    all_boxes, all_scores = np.concatenate(boxes), np.concatenate(scores)
    order = np.argsort(-all_scores, kind="stable")[:count]
    return all_boxes[order], all_scores[order]


def _reduced(part: ImageArray, least: float) -> tuple[ImageArray, FloatArray]:
    """The image with its sides divided, so that a window side of ``least`` keeps two pixels a cell, and by how much.

    Every size is then resized from fewer pixels.
    """
    factor = int(least // (2 * SIDE))
    if factor < 2 or min(part.shape[:2]) < 2 * factor:
        return part, np.ones(2)
    columns, rows = part.shape[1] // factor, part.shape[0] // factor
    small: ImageArray = np.asarray(cv2.resize(part, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return small, np.array([part.shape[1] / columns, part.shape[0] / rows])


def _score_size(part: ImageArray, weights: FloatArray, width: float, height: float) -> tuple[FloatArray, FloatArray]:
    """The best windows of one size, no two of them next to each other."""
    columns, rows = round(part.shape[1] * SIDE / width), round(part.shape[0] * SIDE / height)
    if columns < SIDE or rows < SIDE:
        return np.empty((0, 4)), np.empty(0)
    small: ImageArray = np.asarray(cv2.resize(part, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    scores = cv2.matchTemplate(normed_gradients(small).astype(np.float32), weights.astype(np.float32), cv2.TM_CCORR)
    # A window gives way to a better one whose corner is within two of its 8 x 8 cells, as in the paper.
    greatest = cv2.dilate(scores, np.ones((5, 5), dtype=np.uint8))
    peaks = np.flatnonzero(scores >= greatest)
    peaks = peaks[np.argsort(-scores.ravel()[peaks], kind="stable")[:PER_SIZE]]
    row, column = np.divmod(peaks, scores.shape[1])
    step_x, step_y = part.shape[1] / columns, part.shape[0] / rows
    x, y = column * step_x, row * step_y
    return np.column_stack([x, y, x + SIDE * step_x, y + SIDE * step_y]), scores.ravel()[peaks].astype(np.float64)


def recall(
    truths: list[FloatArray], proposals: list[FloatArray], counts: list[int], overlap: float = 0.5
) -> FloatArray:
    """Share of true boxes that one of the first ``n`` proposals of their image covers, for each ``n`` of ``counts``.

    Args:
        truths: ``(N_i, 4)`` an image.
        proposals: ``(K_i, 4)`` an image, best first.
        counts: numbers of windows.
        overlap: intersection over union from which a box is covered.
    """
    ranks = []
    for boxes, proposed in zip(truths, proposals, strict=True):
        if not len(proposed):
            ranks.append(np.full(len(boxes), np.iinfo(np.int64).max))
            continue
        hit = iou_pairs(boxes[:, None], proposed[None]) >= overlap
        ranks.append(np.where(hit.any(axis=1), hit.argmax(axis=1), np.iinfo(np.int64).max))
    rank = np.concatenate(ranks) if ranks else np.empty(0)
    if not len(rank):
        raise ValueError("expected at least one true box, got none")
    return np.array([(rank < n).mean() for n in counts])
