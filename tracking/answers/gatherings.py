"""Gatherings: three people or more who stay near to each other for some time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.answers.paths import Paths
from tsuiseki.tracking.types import IntArray

FEWEST = 3
LEAST_SECONDS = 3.0
"""Who passes each other gathers for less."""


@dataclass(frozen=True)
class SocialGroup:
    """People near to each other.

    Attributes:
        first: 0-based frame.
        last: likewise.
        ids: of all who were in it.
        most: people at a time.
        x: middle of the places, in the unit of the scene.
        y: likewise.
    """

    first: int
    last: int
    ids: frozenset[int]
    most: int
    x: float
    y: float


def gatherings_of(paths: Paths, reach: float, frame_rate: float) -> list[SocialGroup]:
    """The gatherings, searched once a second.

    Args:
        paths: of everybody.
        reach: between two people who are together, in heights.
        frame_rate: frames a second.
    """
    step = max(1, round(frame_rate))
    rows = np.flatnonzero(paths.frames % step == 0)
    if not len(rows) or reach == 0:
        return []
    groups = _groups(paths, rows, reach)
    open_ones, done = list[list[tuple[int, IntArray]]](), list[list[tuple[int, IntArray]]]()
    for frame, members in groups:
        done += [one for one in open_ones if one[-1][0] < frame - step]
        open_ones = [one for one in open_ones if one[-1][0] >= frame - step]
        ids = paths.ids[members]
        before = [o for o in open_ones if o[-1][0] < frame and len(np.intersect1d(paths.ids[o[-1][1]], ids)) > 1]
        if before:
            max(before, key=len).append((frame, members))
        else:
            open_ones.append([(frame, members)])
    found = [_gathering(paths, one) for one in done + open_ones]
    return sorted(
        (one for one in found if one.last - one.first >= LEAST_SECONDS * frame_rate), key=lambda one: one.first
    )


def _groups(paths: Paths, rows: IntArray, reach: float) -> list[tuple[int, IntArray]]:
    """Frame and rows of each group of people within reach of each other, in the order of frames."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    # People of different frames are never near: the frame is a third coordinate, far apart.
    limit = reach * paths.heights[rows]
    places = np.column_stack([paths.points[rows], paths.frames[rows] * 2.0 * limit.max()])
    pairs = cKDTree(places).query_pairs(float(limit.max()), output_type="ndarray")
    apart = np.hypot(*(places[pairs[:, 0], :2] - places[pairs[:, 1], :2]).T)
    pairs = pairs[apart <= np.minimum(limit[pairs[:, 0]], limit[pairs[:, 1]])]
    joined = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(rows), len(rows)))
    _, labels = connected_components(joined, directed=False)
    some = np.flatnonzero(np.bincount(labels)[labels] >= FEWEST)
    order = some[np.argsort(labels[some], kind="stable")]
    large = np.split(rows[order], np.flatnonzero(np.diff(labels[order])) + 1) if len(order) else []
    return sorted(((int(paths.frames[part[0]]), part) for part in large), key=lambda one: one[0])


def _gathering(paths: Paths, parts: list[tuple[int, IntArray]]) -> SocialGroup:
    rows = np.concatenate([part for _, part in parts])
    x, y = paths.points[rows].mean(axis=0).tolist()
    ids = frozenset(paths.ids[rows].tolist())
    return SocialGroup(parts[0][0], parts[-1][0], ids, max(len(part) for _, part in parts), x, y)
