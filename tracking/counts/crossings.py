"""Who crossed a line, when, and in which direction: never twice for going to and fro on it.

A person has a signed distance from the line. Beyond a band about it their side is settled; within the band they keep
the side that they were on last. A change of the settled side is a crossing, at the moment at which the distance changed
its sign last. Where a path begins and ends, its side counts even within the band. Of a line, the path must have met it
between its ends: once more in this direction than back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.counts.paths import Paths
from tsuiseki.tracking.counts.scene import Scene, SceneLine
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Crossings:
    """Crossings of one line or border, in the order of rows.

    Attributes:
        rows: ``(C,)`` of `Paths`: the first behind the line.
        sides: ``(C,)`` 1 to the right of the line or into the zone, -1 back.
        settled_before: ``(C,)`` last row at which the earlier side was settled.
        settled_after: ``(C,)`` first row at which the new side was settled.
    """

    rows: IntArray
    sides: IntArray
    settled_before: IntArray
    settled_after: IntArray


def line_crossings(paths: Paths, scene: Scene, line: SceneLine, band: float) -> Crossings:
    """Who crossed a line; ``band`` is in heights of the person, to each side."""
    distances, along = line_distances(paths.points, scene, line)
    crossed = changes(distances, band * paths.heights, paths.starts)
    met = np.zeros(len(paths), dtype=np.int64)
    steps = np.flatnonzero(_turned(distances, paths.starts))
    between = steps[meets(distances[steps - 1], distances[steps], along[steps - 1], along[steps])]
    met[between] = np.where(distances[between] > 0, 1, -1)
    total, last = np.cumsum(met), _last(met != 0)
    start, end = crossed.settled_before, crossed.settled_after
    through = np.sign(total[end] - total[start]) == crossed.sides
    return Crossings(last[end][through], crossed.sides[through], start[through], end[through])


def line_distances(points: FloatArray, scene: Scene, line: SceneLine) -> tuple[FloatArray, FloatArray]:
    """``(N,)`` distance of ``(N, 2)`` points from a line, above 0 on its right, and the place along it in [0, 1]."""
    start, way = line.ends[0], line.ends[1] - line.ends[0]
    length = float(np.hypot(*way))
    x, y = points[:, 0] - start[0], points[:, 1] - start[1]
    return scene.right_is * (way[0] * y - way[1] * x) / length, (way[0] * x + way[1] * y) / length**2


def meets(start: FloatArray, end: FloatArray, along: FloatArray, further: FloatArray) -> BoolArray:
    """``(B,)`` which ways meet a line between its ends.

    Args:
        start: ``(B,)`` signed distance from the line where each way begins.
        end: where it ends.
        along: ``(B,)`` place along the line, see `line_distances`, where each way begins.
        further: where it ends.
    """
    turned = (start > 0) != (end > 0)
    place = along + start / np.where(turned, start - end, 1.0) * (further - along)
    return np.asarray(turned & (place >= 0) & (place <= 1))


def changes(distances: FloatArray, band: FloatArray, starts: IntArray) -> Crossings:
    """Where the settled side of paths changes.

    Args:
        distances: ``(N,)`` signed, of each row.
        band: ``(N,)`` distance at each row beyond which the side is settled.
        starts: ``(P,)`` first row of each piece.
    """
    width = band.copy()
    width[starts] = width[starts[1:] - 1] = width[-1:] = 0.0
    settled = np.flatnonzero(np.abs(distances) > width)
    sides = np.where(distances[settled] > 0, 1, -1)
    piece = np.searchsorted(starts, settled, "right")
    changed = np.flatnonzero((sides[1:] != sides[:-1]) & (piece[1:] == piece[:-1])) + 1
    arrivals = settled[changed]
    turns = _last(_turned(distances, starts))
    return Crossings(turns[arrivals], sides[changed], settled[changed - 1], arrivals)


def _turned(distances: FloatArray, starts: IntArray) -> BoolArray:
    """``(N,)`` rows at which the distance has another sign than at the row before, in the same piece."""
    right = distances > 0
    turned = np.zeros(len(right), dtype=np.bool_)
    turned[1:] = right[1:] != right[:-1]
    turned[starts] = False
    return turned


def _last(marked: BoolArray) -> IntArray:
    """``(N,)`` for each row the last marked one up to it; -1 before the first."""
    return np.maximum.accumulate(np.where(marked, np.arange(len(marked)), -1))
