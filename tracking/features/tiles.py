"""Frames of any size: overlapping tiles for a detector, and their boxes put together again.

A detector sees people from about 25 pixels of its input on. A frame that is larger than the input is shrunk, and small
people in it with it; a tile of the frame is shrunk less. The whole frame is a tile, too, for people larger than a
tile.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import SizedDetect
from tsuiseki.tracking.features.foreign_detector import SAME
from tsuiseki.tracking.geometry import areas, intersections, iou_matrix, set_apart, suppress
from tsuiseki.tracking.preprocessing import enlarged
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, ImageArray, IntArray

# Share of a tile that the next one sees again: someone half as wide as a tile is whole in one of them.
OVERLAP = 0.2
# A tile that the input shows with more pixels than this for one of the frame tells no more than the frame does, but
# shows people as large as the detector knows them. Up to here `tiles` goes, and `auto` for a tenth more people; beyond,
# it is the enlarging that tells, so it is done smoothly.
LARGEST_SCALE = 1.7
# Most tiles across that are ever asked for.
MOST_COLUMNS = 8
# Most pictures of one call of a detector.
BATCH = 4
# The view of as many tiles as show more than fewer.
EVERY_TILE = (0, None)
# A box this near to a seam, in shares of its tile, is taken for cut off there.
_NEAR_SEAM = 0.01
# A cut-off box goes where another box covers this much of it.
_COVERED = 0.6
# A tile may be left out where others find its people with boxes of at least this intersection over union,
_ALIKE = 0.7
# with this share of the score, in the whole frame and in tiles,
_SCORED = (0.8, 0.5)
# but for this share of the sum of all scores.
_LOST = 0.05


@dataclass(frozen=True)
class TileView:
    """The parts of a frame for the detector.

    Attributes:
        columns: tiles across; 1 for the whole frame alone.
        tiles: ``(T, 4)`` x1, y1, x2, y2 in pixels of the frame, the whole frame first.
    """

    columns: int
    tiles: IntArray

    def __len__(self) -> int:
        return len(self.tiles)


def view_of(size: tuple[int, int], columns: int, shape: float, rows: int | None = None) -> TileView:
    """Tiles over a frame, overlapping by `OVERLAP`, and the whole frame.

    Args:
        size: height and width of the frame, pixels.
        columns: tiles across.
        shape: width of the detector's input by its height; tiles are of this shape.
        rows: tiles down, where the tiles may have another shape; by default as many as cover the frame.
    """
    height, width = size
    frame = np.array([[0, 0, width, height]], dtype=np.int64)
    if columns == 1 and rows in (None, 1):
        return TileView(1, frame)
    wide = width / (1 + (columns - 1) * (1 - OVERLAP))
    high = min(wide / shape, height) if rows is None else height / (1 + (rows - 1) * (1 - OVERLAP))
    if rows is None:
        rows = 1 + math.ceil(max(height - high, 0) / (high * (1 - OVERLAP)) - 1e-9)
    left = np.linspace(0, width - wide, columns)
    top = np.linspace(0, height - high, rows)
    y, x = (grid.ravel() for grid in np.meshgrid(top, left, indexing="ij"))
    tiles = np.stack([x, y, x + wide, y + high], axis=1).round().astype(np.int64)
    return TileView(columns, np.concatenate([frame, tiles]))


def parse_view(text: str) -> tuple[int, int | None] | None:
    """Tiles across and down of ``auto`` (None), ``tiles`` (`EVERY_TILE`), ``3`` or ``3x2``.

    Raises:
        RequestError: it is none of them.
    """
    if text == "auto":
        return None
    if text == "tiles":
        return EVERY_TILE
    match = re.fullmatch(r"(\d+)(?:x(\d+))?", text)
    counts = [int(x) for x in match.groups() if x is not None] if match else []
    if not counts or not all(1 <= n <= MOST_COLUMNS for n in counts):
        raise RequestError(
            f"`view`: expected auto, tiles, tiles across such as 2, or across and down such as 3x2, got {text!r}"
        )
    return counts[0], counts[1] if len(counts) == 2 else None


class TiledDetector:
    """A detector of the tiles of a view.

    Args:
        detector: finds people in pictures.
        view: for frames of one size.
        workers: calls of ``detector`` at a time; the result is the same with any number.
        first: the detections in the first of the images, where that was inferred before.

    Attributes:
        sizes: ``(T, 2)`` height and width at which ``detector`` gets the tiles: that of its input where this shows them
            larger than at `LARGEST_SCALE`, as its own way to enlarge is coarser; else, and for the whole frame, as
            they are.
    """

    def __init__(
        self,
        detector: SizedDetect,
        view: TileView,
        workers: int = 1,
        first: Detections | None = None,
    ) -> None:
        self.detector, self.view, self.workers, self.first = detector, view, workers, first
        self.sizes = (view.tiles[:, 2:] - view.tiles[:, :2])[:, ::-1]
        if detector.input_size is not None:
            scales = (np.array(detector.input_size) / self.sizes[1:]).min(axis=1, keepdims=True)
            self.sizes[1:] = np.where(scales > LARGEST_SCALE, (self.sizes[1:] * scales).round(), self.sizes[1:])
        self.across = getattr(detector, "across", True)

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        """People in ``images``, each ``(H, W, 3)`` uint8 RGB of the view's size, without doubles at the seams."""
        first, images = ([], images) if self.first is None else ([self.first], images[1:])
        return [*first, *(merge(in_tiles, self.view.tiles, self.across) for in_tiles in self.in_tiles(images))]

    def in_tiles(self, images: Sequence[ImageArray]) -> list[list[Detections]]:
        """People in each tile of each of ``images``, in pixels of the tile."""
        count = len(self.view)
        tiles = [(image, n) for image in images for n in range(count)]
        batches = [tiles[start : start + BATCH] for start in range(0, len(tiles), BATCH)]
        if self.workers == 1 or len(batches) == 1:
            parts = [self._detect(batch) for batch in batches]
        else:
            with ThreadPoolExecutor(self.workers, "tsuiseki") as pool:
                parts = list(pool.map(self._detect, batches))
        detections = list(itertools.chain.from_iterable(parts))
        return [detections[n : n + count] for n in range(0, len(detections), count)]

    def _detect(self, tiles: Sequence[tuple[ImageArray, int]]) -> list[Detections]:
        """People in each of the numbered tiles of images, in pixels of the tile."""
        pictures, scales = [], []
        for image, n in tiles:
            x1, y1, x2, y2 = self.view.tiles[n].tolist()
            height, width = self.sizes[n].tolist()
            pictures.append(enlarged(image[y1:y2, x1:x2], height, width))
            scales.append(np.tile([width / (x2 - x1), height / (y2 - y1)], 2))
        detections = self.detector.detect(pictures)
        return [replace(inside, boxes=inside.boxes / scale) for inside, scale in zip(detections, scales, strict=True)]


def merge(detections: Sequence[Detections], tiles: IntArray, across: bool = True) -> Detections:
    """The detections of a frame's tiles as those of the frame.

    A box that a seam cuts off goes where another tile saw more of the same person; the rest is suppressed as usual.

    Args:
        detections: in each tile, in its pixels.
        tiles: ``(T, 4)``, the whole frame first.
        across: whether boxes of different classes suppress each other.
    """
    if len(tiles) == 1:
        return detections[0]
    shifts = np.repeat(tiles[:, [0, 1, 0, 1]], [len(d) for d in detections], axis=0)
    boxes: FloatArray = np.concatenate([d.boxes for d in detections]) + shifts.astype(np.float64)
    scores = np.concatenate([d.scores for d in detections])
    owner = np.repeat(np.arange(len(tiles)), [len(d) for d in detections])
    classes = np.concatenate([d.origin[:, 1] for d in detections])
    cut = _cut_off(boxes, tiles[owner], tiles[0])
    compared = boxes if across else set_apart(boxes, classes)
    chosen = np.flatnonzero(~_covered_by_other_tile(compared, scores, cut, owner))
    chosen = chosen[suppress(compared[chosen], scores[chosen], SAME)]
    chosen_classes = None if all(d.classes is None for d in detections) else classes[chosen]
    return Detections(boxes[chosen], scores[chosen], classes=chosen_classes, names=detections[0].names)


def shown_in(detections: Sequence[Detections], merged: Detections, tiles: IntArray) -> BoolArray:
    """``(N, T)`` whether each tile shows each person: with much the same box, and no much lower a score.

    Args:
        detections: in each tile, in its pixels.
        merged: the N people of the frame, as `merge` gives them.
        tiles: ``(T, 4)``, the whole frame first.
    """
    visible = np.zeros((len(merged), len(tiles)), dtype=np.bool_)
    for tile, inside in enumerate(detections):
        similar = iou_matrix(merged.boxes, inside.boxes + np.tile(tiles[tile, :2], 2)) >= _ALIKE
        scored = inside.scores[None] >= _SCORED[tile > 0] * merged.scores[:, None]
        visible[:, tile] = (similar & scored).any(axis=1)
    return visible


def busy_tiles(visible: BoolArray, scores: FloatArray) -> IntArray:
    """Numbers of the fewest tiles, by the greedy rule, that show all but `_LOST` of the people; all where none are.

    Args:
        visible: ``(N, T)``, see `shown_in`; the first tile, the whole frame, is always kept.
        scores: ``(N,)`` what each counts.
    """
    tiles = np.arange(visible.shape[1])
    while len(scores) and len(tiles) > 1:
        alone = visible[:, tiles[1:]] & (visible[:, tiles].sum(axis=1) == 1)[:, None]
        missed = scores @ ~visible[:, tiles].any(axis=1) + scores @ alone
        if missed.min() > _LOST * scores.sum():
            break
        tiles = np.delete(tiles, 1 + int(missed.argmin()))
    return tiles


def _cut_off(boxes: FloatArray, tiles: IntArray, frame: IntArray) -> BoolArray:
    """``(N,)`` whether a box ends at a border of its tile that is no border of the frame."""
    margin = _NEAR_SEAM * (tiles[:, 2:] - tiles[:, :2])
    at_start = (boxes[:, :2] - tiles[:, :2] < margin) & (tiles[:, :2] > frame[:2])
    at_end = (tiles[:, 2:] - boxes[:, 2:] < margin) & (tiles[:, 2:] < frame[2:])
    return np.asarray((at_start | at_end).any(axis=1))


def _covered_by_other_tile(boxes: FloatArray, scores: FloatArray, cut: BoolArray, owner: IntArray) -> BoolArray:
    """``(N,)`` cut-off boxes that a box of another tile covers: a whole one, or a larger one that is cut off, too.

    The covering box scores at least half as much.
    """
    size = areas(boxes)
    covered = intersections(boxes[:, None], boxes[None]) >= _COVERED * size[:, None]
    more = ~cut[None] | (size[None] > size[:, None])
    scored = scores[None] >= 0.5 * scores[:, None]
    return np.asarray(cut & (covered & more & scored & (owner[:, None] != owner[None])).any(axis=1))
