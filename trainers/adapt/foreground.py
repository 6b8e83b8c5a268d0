"""Whether a camera stands still, where its picture differs from its empty view, and how far boxes are off silhouettes.

A label's box is drawn towards the silhouette of its frame: a track smooths its boxes and does not know how far the legs
are apart. One silhouette is rough, so a box goes only part of the way to it. Where none is clear, it goes as far as
others do.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import cv2
import numpy as np

from tsuiseki.tracking.geometry import clip_boxes, grown, intersections, iou_matrix
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray

# Grey levels by which a pixel must differ from the empty view.
_DIFFERENT = 18.0
# A pixel with less than this share of the largest difference near it lies beyond an edge, in what smoothing leaves
# there.
_HALO = 0.4
# Share of the empty view's light that a shadow leaves, at least: it does not darken to black.
_DARKEST = 0.45
# Share of the empty view's light that a shadow leaves, at most.
_BRIGHTEST = 1.02
# Largest difference of these shares between red, green and blue: a shadow darkens all alike.
_TINT = 0.10
# Share of the box's height from which a column of a silhouette counts.
_COLUMN = 0.06
# Share of the box's width from which a row of a silhouette counts.
_ROW = 0.12
# Least area of a silhouette, as a share of the box's.
_LEAST_FILLED = 0.15
# What the thresholds take off each side, as shares of width and height: rendered people on two empty views are measured
# to 0.02 with it.
_ROOM = np.array([0.08, 0.03])
# Silhouettes that tell by how much boxes usually lie off, at least.
_FEWEST = 20
# The middle of a box is all person: from these shares of its width and height on, to as much before the other end.
_MIDDLE = np.array([0.25, 0.08])
# Share of the middle's different pixels that are no shadow, from which clothes look unlike a shadow.
_UNLIKE = 0.7
# A detection is that of a track's box from this overlap on.
_SAME = 0.5
# A silhouette that lies farther off, in widths and heights of the box, is torn or joined with something else.
FARTHEST = 0.2


@dataclass(frozen=True)
class Difference:
    """A picture, as it differs from the empty view.

    Attributes:
        different: ``(H, W)`` pixels that differ.
        bright: those of them that are no shadow.
    """

    different: BoolArray
    bright: BoolArray

    def offsets(self, boxes: FloatArray) -> FloatArray:
        """``(N, 4)`` by how much boxes ``(N, 4)`` lie off silhouettes, see `edge_offsets`.

        NaN also where clothes look like a shadow.
        """
        clear = unlike_shadow(self.different, self.bright, boxes)
        return np.where(clear[:, None], edge_offsets(self.bright, boxes), np.nan)


def difference(image: ImageArray, empty: ImageArray) -> tuple[BoolArray, BoolArray]:
    """``(H, W)`` pixels that differ from the empty view; and those of them that are no shadow, up to their edges."""
    now, then = (cv2.GaussianBlur(x, (0, 0), 0.8).astype(np.float32) for x in (image, empty))
    change = now - then
    # The light of the whole picture may have changed.
    change -= np.median(change[::4, ::4], axis=(0, 1))
    size = np.abs(change).max(axis=2)
    different = size > _DIFFERENT
    sharp = size > _HALO * cv2.dilate(size, np.ones((5, 5), np.uint8))
    ratio = (now + 4) / (then + 4)
    level, tint = ratio.mean(axis=2), ratio.max(axis=2) - ratio.min(axis=2)
    shadow = (level > _DARKEST) & (level < _BRIGHTEST) & (tint < _TINT)
    return np.asarray(different), np.asarray(different & sharp & ~shadow)


def covered_share(mask: BoolArray, boxes: FloatArray) -> FloatArray:
    """``(N,)`` share of the pixels of boxes ``(N, 4)`` that are set in ``mask`` ``(H, W)``."""
    sums = cv2.integral(mask.astype(np.uint8))
    height, width = mask.shape
    x1, y1, x2, y2 = clip_boxes(boxes, width, height).round().astype(int).T
    inside = sums[y2, x2] - sums[y1, x2] - sums[y2, x1] + sums[y1, x1]
    return np.asarray(inside / np.maximum((x2 - x1) * (y2 - y1), 1), dtype=np.float64)


def unlike_shadow(different: BoolArray, bright: BoolArray, boxes: FloatArray) -> BoolArray:
    """``(N,)`` whether the clothes in boxes ``(N, 4)`` look unlike a shadow.

    Dark or grey clothes on dark or grey ground are taken for shadow, and such a silhouette lacks arms and legs. In the
    middle of a box, where all that differs from the empty view is the person, that shows.
    """
    inset = _MIDDLE * (boxes[:, 2:] - boxes[:, :2])
    middle = boxes + np.concatenate([inset, -inset], axis=1)
    return np.asarray(covered_share(bright, middle) >= _UNLIKE * covered_share(different, middle))


def edge_offsets(mask: BoolArray, boxes: FloatArray) -> FloatArray:
    """``(N, 4)`` by how much the sides of boxes lie off the silhouettes in them, in widths and heights of the box.

    NaN where another box is near, or no silhouette is clear.
    """
    offsets = np.full((len(boxes), 4), np.nan)
    near = (intersections(grown(boxes, 0.15)[:, None], boxes[None]) > 0).sum(axis=1) > 1
    for row in np.flatnonzero(~near):
        silhouette = _silhouette(mask, boxes[row])
        if silhouette is not None:
            offsets[row] = (silhouette - boxes[row]) / np.tile(boxes[row, 2:] - boxes[row, :2], 2)
    return offsets


def _silhouette(mask: BoolArray, box: FloatArray) -> FloatArray | None:
    """``(4,)`` box about the largest blob near ``box``, with the room that the thresholds take."""
    width, height = box[2:] - box[:2]
    region = box + np.array([-0.25 * width, -0.12 * height, 0.25 * width, 0.12 * height])
    x1, y1, x2, y2 = clip_boxes(region[None], mask.shape[1], mask.shape[0])[0].astype(int)
    part = cv2.morphologyEx(mask[y1:y2, x1:x2].astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 3), np.uint8))
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(part)
    if count < 2:
        return None
    largest = 1 + int(np.argmax(statistics[1:, cv2.CC_STAT_AREA]))
    if statistics[largest, cv2.CC_STAT_AREA] < _LEAST_FILLED * width * height:
        return None
    blob = labels == largest
    columns, rows = np.flatnonzero(blob.sum(axis=0) > _COLUMN * height), np.flatnonzero(blob.sum(axis=1) > _ROW * width)
    if not len(columns) or not len(rows):
        return None
    outline = np.array([x1 + columns[0], y1 + rows[0], x1 + columns[-1] + 1, y1 + rows[-1] + 1], dtype=np.float64)
    room = _ROOM * (outline[2:] - outline[:2])
    return np.asarray(outline + np.concatenate([-room, room]), dtype=np.float64)


def usual_offset(offsets: FloatArray) -> FloatArray:
    """``(4,)`` the median of `edge_offsets`; zero where too few silhouettes tell.

    A shadow lies on the same side of everybody, so what one silhouette tells badly, all tell together.
    """
    clear = offsets[~np.isnan(offsets[:, 0])]
    return np.asarray(np.median(clear, axis=0) if len(clear) >= _FEWEST else np.zeros(4), dtype=np.float64)


def moving_blobs(mask: BoolArray, boxes: FloatArray, least_height: float) -> FloatArray:
    """``(M, 4)`` boxes of what differs from the empty view and that no box of ``boxes`` ``(N, 4)`` covers.

    Args:
        mask: ``(H, W)``.
        boxes: of what is known.
        least_height: pixels; what is lower is no person.
    """
    uncovered = mask.astype(np.uint8)
    for x1, y1, x2, y2 in clip_boxes(grown(boxes, 0.1), mask.shape[1], mask.shape[0]).round().astype(int):
        uncovered[y1:y2, x1:x2] = 0
    opened = cv2.morphologyEx(uncovered, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    _, _, statistics, _ = cv2.connectedComponentsWithStats(opened)
    x, y, width, height, area = statistics[1:].astype(np.float64).T
    large = (height >= least_height) & (area >= 0.2 * width * height)
    blobs: FloatArray = np.stack([x, y, x + width, y + height], axis=1)[large]
    return blobs


def detected_boxes(boxes: FloatArray, observed: BoolArray, detections: FloatArray) -> FloatArray:
    """``(N, 4)`` the detections that tracks were made of, in one frame.

    Args:
        boxes: ``(N, 4)`` of the tracks.
        observed: ``(N,)`` whether a detection supports each; the others stay.
        detections: ``(M, 4)`` boxes of detections.
    """
    if not len(boxes) or not len(detections):
        return boxes
    overlaps = iou_matrix(boxes, detections)
    best = overlaps.argmax(axis=1)
    matched = observed & (overlaps.max(axis=1) >= _SAME)
    return np.where(matched[:, None], detections[best], boxes)


def drawn_to_silhouettes(
    boxes: FloatArray, observed: BoolArray, picture: Difference, usual: FloatArray, share: float
) -> FloatArray:
    """``(N, 4)`` boxes of one frame, moved ``share`` of the way to their own silhouettes.

    Args:
        boxes: ``(N, 4)``.
        observed: ``(N,)`` whether each was detected; only then a silhouette is measured.
        picture: of the frame.
        usual: ``(4,)`` by how much the others move, in widths and heights.
        share: in [0, 1].
    """
    if not len(boxes) or share == 0:
        return boxes
    offsets = np.where(observed[:, None], picture.offsets(boxes), np.nan)
    moves = np.where(np.isnan(offsets), usual, share * np.clip(offsets, -FARTHEST, FARTHEST))
    return np.asarray(boxes + moves * np.tile(boxes[:, 2:] - boxes[:, :2], 2))


CameraMotion: TypeAlias = Literal["still", "moves", "unknown"]
# Movement between pictures, as a share of the width, from which a camera does not stand still.
_MOVED = 0.01
# Least correlation of the edges of two pictures of one place. Measured: .8 in a street, .3 in a crowd that hides nearly
# all that stands still; below .1 for pictures of noise, whose best shift is besides anywhere.
_SAME_EDGES = 0.15
# Nine of ten places of an empty picture have gradients below this (Sobel, 255 grey levels).
_NOTHING = 15.0
# Width of the small copies whose edges are compared, pixels.
_EDGE_WIDTH = 240


def motion_of(pictures: Sequence[ImageArray]) -> tuple[CameraMotion, int | None]:
    """How the camera moves between ``pictures``, each ``(H, W, 3)`` uint8 RGB, in their order.

    The edges of every two are compared. A picture lies where the others do if it agrees with half of them: one that is
    hidden by people does not decide.

    Returns:
        ``still``; ``moves``, where most pictures lie elsewhere; or ``unknown``, where most show nothing. And the number
        of the first picture after a turn, where a camera that stands still looks elsewhere from one picture on.
    """
    edges = [_gradients(picture) for picture in pictures]
    clear = np.flatnonzero([np.percentile(strengths, 90) >= _NOTHING for strengths in edges])
    if 2 * len(clear) <= len(pictures) or len(clear) < 2:
        return "unknown", None
    maps = np.stack([_levelled(edges[n]) for n in clear])
    agreeing = np.zeros((len(maps), len(maps)), dtype=np.bool_)
    for first, second in itertools.combinations(range(len(maps)), 2):
        agreeing[first, second] = agreeing[second, first] = _at_one_place(maps[first], maps[second])
    same = 2 * agreeing.sum(axis=1) >= len(maps) - 1
    turned = _turn(same)
    if turned is not None:
        return "moves", int(clear[turned])
    return ("still" if 2 * same.sum() > len(same) else "moves"), None


def _turn(same: BoolArray) -> int | None:
    """The first picture after a turn: those before or after it, two at least, lie elsewhere, and no others do."""
    changes = np.flatnonzero(same[1:] != same[:-1])
    if len(changes) != 1 or min(same.sum(), (~same).sum()) < 2:
        return None
    return int(changes[0]) + 1


def _at_one_place(first: FloatArray, second: FloatArray) -> bool:
    """Whether two maps of edges agree best where they are."""
    agreement = np.fft.irfft2(np.fft.rfft2(first) * np.conj(np.fft.rfft2(second)), first.shape)
    at = np.array(np.unravel_index(int(agreement.argmax()), first.shape))
    shift = np.minimum(at, np.array(first.shape) - at)
    least = _SAME_EDGES * np.sqrt(np.sum(first * first) * np.sum(second * second))
    return bool(agreement.max() > least and np.hypot(*shift) <= _MOVED * _EDGE_WIDTH)


def edge_correlation(first: ImageArray, second: ImageArray) -> float:
    """Correlation of the edges of two pictures of one size, which light changes little; 1 for equal ones."""
    a, b = _levelled(_gradients(first)), _levelled(_gradients(second))
    return float(np.sum(a * b) / max(np.sqrt(np.sum(a * a) * np.sum(b * b)), 1e-9))


def _gradients(image: ImageArray) -> FloatArray:
    """Lengths of the gradients of a small copy."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    scale = _EDGE_WIDTH / grey.shape[1]
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA).astype(np.float64)
    return np.hypot(cv2.Sobel(small, cv2.CV_64F, 1, 0), cv2.Sobel(small, cv2.CV_64F, 0, 1))


def _levelled(gradients: FloatArray) -> FloatArray:
    """Blurred, with mean 0; strong edges must not outweigh all others."""
    length = np.sqrt(cv2.GaussianBlur(gradients, (0, 0), 1.5))
    return np.asarray(length - length.mean(), dtype=np.float64)
