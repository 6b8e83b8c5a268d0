"""Where to hide people: boxes of tracks, widened by their own doubt and held where nothing was detected.

A box at time t is that of the track, on a line between the detections before and after a gap. Before the first and
after the last it moves on as the track did, for `HOLD` seconds. Each side is widened by

    m(t) = s (BASE + SCORE (1 - score(t))) + RESIDUAL r(t) + SPREAD h g(t),

where s is the width or height and h the height of the person, r how far the box lies from the mean of its neighbours
(what smoothing would change), and g the seconds to the nearest detection, at most `HOLD`. The weights are chosen
on generated streets and on PETS09-S2L1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from tsuiseki.tracking.geometry import centres, clip_boxes, iou_matrix
from tsuiseki.tracking.types import BoolArray, Columns, Detections, FloatArray, ImageArray, IntArray, Track

Style = Literal["pixelated", "filled"]
# Seconds for which a place is held before and after a track.
HOLD = 1.0
# Share of its size by which a box of score 1 is widened.
BASE = 0.2
# Share by which one of score 0 is widened more.
SCORE = 0.15
# Weight of what smoothing would change.
RESIDUAL = 1.0
# Heights a second, across and down: a second of walking is most of a height.
SPREAD = np.array([0.5, 0.2, 0.5, 0.2])
# Seconds on each side that a box is compared with.
NEIGHBOURS = 0.25
# Share of a person's height that is hidden of heads.
HEAD = 0.25
# Overlap (intersection over union) from which a detection supports a box.
SUPPORT = 0.3
# Overlap from which a detection is of a person who stays as they are.
SAME = 0.5
# `Places.held` of a place that may be empty.
WEAK = 3
# Blocks along the longer side of a person, fewer than tell anybody.
BLOCKS = 8
# The same of a head.
HEAD_BLOCKS = 3
# Colour that fills a place, from 0 to 255.
GREY = 96


@dataclass(frozen=True)
class Places(Columns):
    """Boxes to hide.

    Attributes:
        frames: ``(N,)`` 0-based, in order.
        boxes: ``(N, 4)`` pixels: widened, within the image.
        ids: ``(N,)`` of the track, 0 without a track.
        bare: ``(N, 4)`` the boxes of whole people, before they are widened.
        held: ``(N,)`` -1 before a track, 1 after it, 2 in a gap, 0 where it has a detection; `WEAK` where it has none
            and the place may be empty.
    """

    frames: IntArray
    boxes: FloatArray
    ids: IntArray
    bare: FloatArray
    held: IntArray

    def at(self, frame: int) -> slice:
        """The rows of a frame."""
        return slice(*np.searchsorted(self.frames, [frame, frame + 1]).tolist())

    @classmethod
    def joined(cls, parts: Sequence[Places]) -> Places:
        """All of several, by frame."""
        none = np.empty(0, dtype=np.int64)
        tables = [*parts, cls(none, np.empty((0, 4)), none, np.empty((0, 4)), none)]
        joined = cls(*(np.concatenate([getattr(table, name) for table in tables]) for name in cls.__dataclass_fields__))
        return joined.select(np.argsort(joined.frames, kind="stable"))


def places_of(track: Track, rate: float, size: tuple[int, int], last: int, heads: bool) -> Places:
    """Where to hide the person of a track.

    Args:
        track: with at least a box.
        rate: frames a second.
        size: width and height of the image, pixels.
        last: 0-based number of the last frame of the video.
        heads: hide the head alone.
    """
    hold, real = round(HOLD * rate), np.flatnonzero(track.observed)
    real = real if len(real) else np.arange(len(track))
    begin, end = int(track.frames[0]), int(track.frames[-1])
    frames = np.arange(max(0, begin - hold), min(last, end + hold) + 1)
    inside = np.clip(frames, begin, end)
    boxes = np.column_stack([np.interp(inside, track.frames, column) for column in track.boxes.T])
    residuals = np.abs(track.boxes - _smooth(track, round(NEIGHBOURS * rate)))
    residual = np.column_stack([np.interp(inside, track.frames, column) for column in residuals.T])
    scores = np.interp(inside, track.frames, np.nan_to_num(np.clip(track.scores, 0, 1)))
    for rows, edge in ((frames < begin, slice(None, hold + 1)), (frames > end, slice(-hold - 1, None))):
        if rows.any():
            steps = (frames - inside)[rows]
            boxes[rows] += np.tile(steps[:, None] * _velocity(track.frames[edge], track.boxes[edge]), 2)
    detections = track.frames[real]
    following = np.searchsorted(detections, frames)
    away = np.minimum(
        np.abs(frames - detections[np.minimum(following, len(detections) - 1)]),
        np.abs(frames - detections[np.maximum(following - 1, 0)]),
    )
    bare, held = boxes, np.where(away > 0, 2, 0)
    held[frames < begin], held[frames > end] = -1, 1
    boxes = clip_boxes(widened(bare, scores, away / rate, heads, residual), *size)
    ids = np.full(len(frames), track.id)
    middle = centres(bare)
    held[(held != 0) & ((middle < 0) | (middle > size)).any(axis=1)] = WEAK
    in_view: BoolArray = np.all(boxes[:, 2:] > boxes[:, :2], axis=1)
    return Places(frames, boxes, ids, bare, held).select(in_view)


def widened(
    boxes: FloatArray, scores: FloatArray, away: FloatArray, heads: bool, residual: FloatArray | float = 0.0
) -> FloatArray:
    """``(N, 4)`` boxes made wider by m(t), see the module.

    Args:
        boxes: ``(N, 4)`` of whole people, pixels.
        scores: ``(N,)`` from 0 to 1.
        away: ``(N,)`` seconds to the nearest detection.
        heads: the heads alone.
        residual: ``(N, 4)`` how far each box lies from the mean of its neighbours, pixels.
    """
    wide, high = boxes[:, 2] - boxes[:, 0], boxes[:, 3] - boxes[:, 1]
    margin = np.column_stack([wide, high] * 2) * (BASE + SCORE * (1 - scores))[:, None] + RESIDUAL * residual
    margin += np.outer(high * np.minimum(away, HOLD), SPREAD)
    hidden = boxes.copy()
    if heads:
        hidden[:, 3] = boxes[:, 1] + HEAD * high
    return hidden + margin * [-1, -1, 1, 1]


def _smooth(track: Track, reach: int) -> FloatArray:
    """``(T, 4)`` the mean of the boxes up to ``reach`` frames away, on both sides equally many rows."""
    rows = np.arange(len(track))
    near = np.minimum(np.minimum(rows, rows[::-1]), reach)
    sums = np.concatenate([np.zeros((1, 4)), np.cumsum(track.boxes, axis=0)])
    mean: FloatArray = (sums[rows + near + 1] - sums[rows - near]) / (2 * near + 1)[:, None]
    return mean


def _velocity(frames: IntArray, boxes: FloatArray) -> FloatArray:
    """``(2,)`` pixels a frame of the middle of the boxes, by least squares; 0 for fewer than three."""
    if len(frames) < 3:
        return np.zeros(2)
    middle, time = centres(boxes), frames - frames.mean()
    slope: FloatArray = time @ middle / (time @ time)
    return slope


def unsupported(places: Places, detections: Sequence[Detections], first: int) -> BoolArray:
    """``(N,)`` places that are held where no detection of that frame, of either pass, supports them.

    Args:
        places: by frame.
        detections: of the second pass, an entry a frame.
        first: number of the frame of the first entry.
    """
    doubtful = np.isin(places.held, [-1, 1, 2])
    for frame in np.unique(places.frames[doubtful]).tolist():
        rows = places.at(frame)
        detected = places.bare[rows][places.held[rows] == 0]
        overlaps = iou_matrix(places.bare[rows], np.concatenate([detections[frame - first].boxes, detected]))
        doubtful[rows] &= overlaps.max(axis=1, initial=0.0) < SUPPORT
    return doubtful


def without_visible(detections: Detections, visible: Sequence[Track], frame: int) -> Detections:
    """The detections of a frame but those of people who stay as they are."""
    boxes = [track.boxes[track.frames == frame] for track in visible]
    if not len(detections) or not boxes:
        return detections
    apart = iou_matrix(detections.boxes, np.concatenate(boxes)).max(axis=1, initial=0.0) < SAME
    return Detections(detections.boxes[apart], detections.scores[apart])


def paint(image: ImageArray, boxes: FloatArray, style: Style, heads: bool) -> ImageArray:
    """``image`` ``(H, W, 3)`` with the insides of ``(N, 4)`` boxes hidden, borders rounded outwards; a new array."""
    hidden = image.copy()
    corners = np.column_stack([np.floor(boxes[:, :2]), np.ceil(boxes[:, 2:])]).astype(int)
    for x1, y1, x2, y2 in corners.tolist():
        if style == "filled":
            hidden[y1:y2, x1:x2] = GREY
            continue
        inside = image[y1:y2, x1:x2]
        height, width = inside.shape[:2]
        block = max(8.0, max(height, width) / (HEAD_BLOCKS if heads else BLOCKS))
        few = max(1, round(width / block)), max(1, round(height / block))
        coarse = cv2.resize(inside, few, interpolation=cv2.INTER_AREA)
        hidden[y1:y2, x1:x2] = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_NEAREST)
    return hidden
