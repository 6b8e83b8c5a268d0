"""Where everybody stands in each frame: all tracks in one table, with gaps bridged on straight lines."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsuiseki.tracking.counts.polygons import inside
from tsuiseki.tracking.counts.scene import Scene
from tsuiseki.tracking.counts.settings import PERSON, Anchor, CountSettings
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


def paths_of(tracks: Iterable[Track | Sequence[Track]], scene: Scene, settings: CountSettings) -> Paths:
    """The paths of tracks, or of chains of tracks, through a scene, which is in metres for the anchor ``floor``.

    Raises:
        RequestError: the anchor does not fit the scene; see `anchored`.
    """
    chains = [[entry] if isinstance(entry, Track) else [*entry] for entry in tracks]
    parts = [track for chain in chains for track in chain if len(track)]
    lengths = np.array([len(track) for track in parts], dtype=np.int64)
    ids = np.repeat(np.array([track.id for track in parts], dtype=np.int64), lengths)
    frames = np.concatenate([np.empty(0, np.int64), *(track.frames for track in parts)])
    boxes = np.concatenate([np.empty((0, 4)), *(track.boxes for track in parts)])
    scores = np.concatenate([np.empty(0), *(track.scores for track in parts)])
    observed = np.concatenate([np.empty(0, np.bool_), *(track.observed for track in parts)])
    points, heights, metres = anchored(boxes, scene, settings.anchor)
    new = np.zeros(len(ids), dtype=np.bool_)
    new[np.cumsum([0, *(sum(map(len, chain)) for chain in chains)])[:-1].clip(max=max(len(ids) - 1, 0))] = len(ids) > 0
    rows, gaps, shares = _bridged(frames, new)

    def bridged(values: Any) -> Any:
        """Values in every frame, those of gaps on straight lines."""
        if not len(gaps):
            return values
        filled, previous = values[rows], rows[gaps]
        share = shares if values.ndim == 1 else shares[:, None]
        filled[gaps] = values[previous] + share * (values[previous + 1] - values[previous])
        return filled

    points, observed, new = bridged(points), observed[rows], new[rows]
    observed[gaps] = new[gaps] = False
    valid = np.isfinite(points).all(axis=1) & counted(points, scene)
    new[1:] |= ~valid[:-1]
    keep = slice(None) if valid.all() else valid
    return Paths(
        ids[rows][keep],
        np.rint(bridged(frames.astype(np.float64))).astype(np.int64)[keep],
        points[keep],
        bridged(heights)[keep],
        bridged(scores)[keep],
        observed[keep],
        np.flatnonzero(new[keep]),
        None if metres is None else bridged(metres)[keep],
    )


def support_of(paths: Paths, rows: IntArray, doubtful: IntArray) -> list[str]:
    """What speaks for places of rows ``(K,)``: ``observed``, ``filled``, or ``doubtful`` of the ids ``(D,)`` that are.

    A detection supports an observed place and none a filled one; a doubtful track rather shows nobody.
    """
    kinds = np.where(paths.observed[rows], "observed", "filled")
    return [str(kind) for kind in np.where(np.isin(paths.ids[rows], doubtful), "doubtful", kinds)]


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


def counted(points: FloatArray, scene: Scene) -> BoolArray:
    """``(N,)`` which points lie where people count."""
    valid = np.ones(len(points), dtype=np.bool_) if scene.region is None else inside(points, scene.region)
    for corners in scene.ignored:
        valid &= ~inside(points, corners)
    return valid


def _bridged(frames: IntArray, new: BoolArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Every frame from the first to the last of each track.

    Returns:
        ``(M,)`` for each frame the last row up to it; ``(G,)`` which of them are in gaps, and the share ``(G,)`` of the
        way to the next row.
    """
    steps = np.ones(len(frames), dtype=np.int64)
    steps[:-1] = np.where(new[1:], 1, np.diff(frames))
    rows = np.repeat(np.arange(len(frames)), steps)
    offsets = np.arange(len(rows)) - np.repeat(np.cumsum(steps) - steps, steps)
    gaps = np.flatnonzero(offsets)
    return rows, gaps, offsets[gaps] / steps[rows[gaps]]
