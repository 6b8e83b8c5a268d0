"""Tables of who crossed which line: each crossing, counts with their intervals, flows over time, and turns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from tsuiseki.tracking.counts.crossings import line_crossings
from tsuiseki.tracking.counts.doubt import Doubt, interval_of
from tsuiseki.tracking.counts.paths import Paths, support_of
from tsuiseki.tracking.counts.scene import Scene
from tsuiseki.tracking.counts.settings import CountSettings
from tsuiseki.tracking.types import FloatArray, IntArray

Columns = dict[str, list[Any]]
SIDES = ("left", "right", "top", "bottom")
# How near to a side of the picture paths begin and end there, as a share of its width or height.
SIDE = 0.1


def line_tables(
    paths: Paths, scene: Scene, settings: CountSettings, doubt: Doubt, doubtful: IntArray
) -> tuple[Columns, Columns]:
    """The tables ``lines`` and ``crossings`` of `Answers`; ``doubtful`` are ids of tracks that rather show nobody."""
    lines = empty("line", "direction", "count", "low", "high")
    crossings = empty("time", "frame", "id", "line", "direction", "x", "y", "probability", "support")
    for line in scene.lines:
        crossed = line_crossings(paths, scene, line, settings.band)
        real, missed = doubt.real(crossed), doubt.missed(line, crossed)
        for side, direction in zip((1, -1), line.directions, strict=True):
            one_way = crossed.sides == side
            number = int(one_way.sum())
            low, high = interval_of(number, float((1 - real[one_way]).sum()), missed[side])
            add(lines, line.name, direction, number, low, high)
        frames, points = paths.frames[crossed.rows], np.round(paths.points[crossed.rows], 3)
        add_rows(
            crossings,
            np.round(frames / doubt.rate, 3),
            frames + 1,
            paths.ids[crossed.rows],
            np.full(len(frames), line.name),
            np.where(crossed.sides > 0, *line.directions),
            points[:, 0],
            points[:, 1],
            np.round(real, 3),
            np.array(support_of(paths, crossed.rows, doubtful), dtype="U8"),
        )
    order = sorted(range(len(crossings["time"])), key=lambda k: (crossings["frame"][k], crossings["id"][k]))
    return lines, {name: [values[k] for k in order] for name, values in crossings.items()}


def flows(scene: Scene, crossings: Columns, interval: float, seconds: float) -> Columns:
    """The table ``flows``: each line and direction in each interval of so many seconds, up to the end of the video."""
    table = empty("start", "end", "line", "direction", "count")
    parts = [int(time // interval) for time in crossings["time"]]
    counted = Counter(zip(parts, crossings["line"], crossings["direction"], strict=True))
    for part in range(max(1, int(np.ceil(seconds / interval - 1e-9)))):
        for line in scene.lines:
            for direction in line.directions:
                ends = part * interval, min((part + 1) * interval, seconds)
                add(table, *(round(end, 3) for end in ends), line.name, direction, counted[part, line.name, direction])
    return table


def turns(crossings: Columns, people: Mapping[int, int]) -> Columns:
    """The table ``turns``: the first and the last line of who crossed two lines or more.

    ``people`` are the same number for all ids of one person.
    """
    ways = dict[int, list[str]]()
    for who, line in zip(crossings["id"], crossings["line"], strict=True):
        ways.setdefault(people[who], []).append(line)
    return _ways((way[0], way[-1]) for way in ways.values() if len(set(way)) > 1)


def sides(paths: Paths, pixels: FloatArray, size: FloatArray) -> Columns:
    """The table ``sides``: from which side of the picture to which everybody went.

    ``pixels`` ``(N, 2)`` are the places in a picture of width and height ``size`` ``(2,)``, pixels.
    """
    ids, first = np.unique(paths.ids, return_index=True)
    last = len(paths) - 1 - np.unique(paths.ids[::-1], return_index=True)[1]
    ends = []
    for rows in (first, last) if len(ids) else ():
        near = pixels[rows] / size
        gaps = np.column_stack([near[:, 0], 1 - near[:, 0], near[:, 1], 1 - near[:, 1]])
        ends.append(np.where(gaps.min(axis=1) < SIDE, np.array(SIDES)[gaps.argmin(axis=1)], "within").tolist())
    return _ways(zip(*ends, strict=True))


def _ways(pairs: Iterable[tuple[str, str]]) -> Columns:
    table = empty("origin", "destination", "count")
    for (origin, destination), number in sorted(Counter(pairs).items()):
        add(table, origin, destination, number)
    return table


def empty(*names: str) -> Columns:
    """A table without rows."""
    return {name: [] for name in names}


def add(table: Columns, *values: Any) -> None:
    """Add a row."""
    for column, value in zip(table.values(), values, strict=True):
        column.append(value)


def add_rows(table: Columns, *columns: Any) -> None:
    """Add rows, given as arrays."""
    for column, values in zip(table.values(), columns, strict=True):
        column.extend(values.tolist())
