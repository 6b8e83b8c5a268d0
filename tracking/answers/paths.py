"""Where everybody stands in each frame: all tracks in one table, with gaps bridged on straight lines."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.answers.polygons import inside
from tsuiseki.tracking.answers.scene import Scene
from tsuiseki.tracking.answers.settings import PERSON, Anchor, CountSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Track


@dataclass(frozen=True, eq=False)
class Paths:
    """The paths of all people, one after the other.

    A piece is the part of a path that lies within the region of interest, from when a person comes in to when they
    leave it.

    Attributes:
        ids: ``(N,)`` whose each row is.
        frames: ``(N,)`` 0-based; within a piece each is one more than the one before.
        points: ``(N, 2)`` in the unit of the scene.
        heights: ``(N,)`` of the person, in the unit of the scene.
        scores: ``(N,)``.
        observed: ``(N,)`` False where no detection supports the place.
        starts: ``(P,)`` first row of each piece.
        metres: ``(N, 2)`` on the floor; None where it is not known.
    """

    ids: IntArray
    frames: IntArray
    points: FloatArray
    heights: FloatArray
    scores: FloatArray
    observed: BoolArray
    starts: IntArray
    metres: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def ends(self) -> IntArray:
        """``(P,)`` last row of each piece."""
        return np.append(self.starts[1:], len(self)) - 1 if len(self.starts) else self.starts

    @property
    def first_rows(self) -> IntArray:
        """``(N,)`` the first row of the piece that each row is of."""
        return np.repeat(self.starts, np.diff(np.append(self.starts, len(self))))


def paths_of(tracks: Iterable[Track], scene: Scene, settings: CountSettings) -> Paths:
    """The paths of tracks through a scene, which is in metres for the anchor ``floor``.

    Raises:
        RequestError: the anchor does not fit the scene; see `anchored`.
    """
    own = [track for track in tracks if len(track)]
    lengths = np.array([len(track) for track in own], dtype=np.int64)
    ids = np.repeat(np.array([track.id for track in own], dtype=np.int64), lengths)
    frames = np.concatenate([np.empty(0, np.int64), *(track.frames for track in own)])
    boxes = np.concatenate([np.empty((0, 4)), *(track.boxes for track in own)])
    scores = np.concatenate([np.empty(0), *(track.scores for track in own)])
    observed = np.concatenate([np.empty(0, np.bool_), *(track.observed for track in own)])
    points, heights, metres = anchored(boxes, scene, settings.anchor)
    known = np.isfinite(points).all(axis=1)
    new = np.append(True, np.diff(ids) != 0) if len(ids) else np.empty(0, np.bool_)
    values = np.column_stack([points, heights, scores, *([] if metres is None else [metres])])
    rows, shares, filled = _bridged(frames, np.append(new[1:], True) if len(new) else new)
    after = np.minimum(rows + 1, len(ids) - 1)
    values = values[rows] + np.where(filled, shares, 0.0)[:, None] * (values[after] - values[rows])
    kept = known[rows] & (known[after] | ~filled) & _counts(values[:, :2], scene)
    new = new[rows] & ~filled
    broken = np.append(True, ~kept[:-1]) if len(kept) else kept
    parts = (new | broken)[kept]
    moved = frames[rows] + np.rint(shares * _steps(frames, rows, after)).astype(np.int64)
    return Paths(
        ids[rows][kept],
        moved[kept],
        values[kept, :2],
        values[kept, 2],
        values[kept, 3],
        (observed[rows] & ~filled)[kept],
        np.flatnonzero(parts),
        None if metres is None else values[kept, 4:6],
    )


def anchored(
    boxes: FloatArray, scene: Scene, anchor: Anchor | None = None
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """The places of boxes in a scene: ``(N, 2)`` and ``(N,)`` heights in its unit, ``(N, 2)`` metres or None.

    Args:
        boxes: ``(N, 4)`` pixels.
        scene: where they are; for the anchor ``floor`` it is in metres.
        anchor: see `CountSettings`.

    Raises:
        RequestError: another anchor than ``floor`` in a scene in metres.
    """
    on_floor = scene.unit == "metres"
    if on_floor and anchor not in (None, "floor"):
        raise RequestError(f"`anchor`: a scene in metres counts on the floor, got {anchor}; leave it out")
    middle = 0.5 * (boxes[:, 0] + boxes[:, 2])
    feet = np.column_stack([middle, boxes[:, 3]])
    metres = scene.metres(feet) if scene.has_metres else None
    if on_floor and metres is not None:
        return metres, np.full(len(boxes), PERSON), metres
    heights = boxes[:, 3] - boxes[:, 1]
    level = {"centre": 0.5 * (boxes[:, 1] + boxes[:, 3]), "head": boxes[:, 1]}.get(anchor or "feet", boxes[:, 3])
    return np.column_stack([middle, level]), heights, metres


def _counts(points: FloatArray, scene: Scene) -> BoolArray:
    """``(N,)`` which points lie where people count."""
    kept = np.ones(len(points), dtype=np.bool_) if scene.region is None else inside(points, scene.region)
    for corners in scene.ignored:
        kept &= ~inside(points, corners)
    return kept


def _bridged(frames: IntArray, last: BoolArray) -> tuple[IntArray, FloatArray, BoolArray]:
    """For each frame from the first to the last of each track, the row before, the share of the way, if filled in."""
    steps = np.ones(len(frames), dtype=np.int64)
    if len(frames):
        steps[:-1] = np.where(last[:-1], 1, np.diff(frames))
    rows = np.repeat(np.arange(len(frames)), steps)
    offsets = np.arange(len(rows)) - np.repeat(np.cumsum(steps) - steps, steps)
    return rows, offsets / steps[rows], offsets > 0


def _steps(frames: IntArray, rows: IntArray, after: IntArray) -> IntArray:
    return np.maximum(frames[after] - frames[rows], 0)
