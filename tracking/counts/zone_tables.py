"""Who was in a zone from when to when, how many were there at a time, who waited; people and gatherings.

Gatherings: three people or more who stay near to each other for some time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.counts.borders import border_crossings
from tsuiseki.tracking.counts.crossings import Crossings
from tsuiseki.tracking.counts.doubt import ABSENT, Doubt, interval_of
from tsuiseki.tracking.counts.line_tables import Columns, add, add_rows, empty
from tsuiseki.tracking.counts.paths import Paths
from tsuiseki.tracking.counts.polygons import area, inside
from tsuiseki.tracking.counts.scene import Scene, SceneZone
from tsuiseki.tracking.counts.settings import CountSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# People of the smallest gathering.
FEWEST = 3
# Seconds of the shortest gathering; who only passes each other does so for fewer.
LEAST_SECONDS = 3.0


@dataclass(frozen=True, eq=False)
class Stays:
    """Stays in one zone, in the order of rows.

    Attributes:
        first: ``(S,)`` row of `Paths` at which each begins.
        last: ``(S,)`` last row.
        entered: ``(S,)`` False where the person was there when their path began.
        left: ``(S,)`` False where they were there when it ended.
    """

    first: IntArray
    last: IntArray
    entered: BoolArray
    left: BoolArray


def stays_of(paths: Paths, within: BoolArray, crossed: Crossings) -> Stays:
    """The stays in a zone that rows ``within`` ``(N,)`` lie in; who goes to and fro on its border stays."""
    pieces = np.searchsorted(paths.starts, crossed.rows, "right") - 1
    # Before the first crossing of a piece its person was on the other side; without a crossing, where most rows are.
    inside_rows = np.add.reduceat(within.astype(np.int64), paths.starts) if len(paths.starts) else np.empty(0, np.int64)
    at_start = inside_rows > 0.5 * (paths.ends - paths.starts + 1)
    at_end = at_start.copy()
    present, first = np.unique(pieces, return_index=True)
    last = np.searchsorted(pieces, present, "right") - 1
    at_start[present], at_end[present] = crossed.sides[first] < 0, crossed.sides[last] > 0
    begin, end = crossed.rows[crossed.sides > 0], crossed.rows[crossed.sides < 0] - 1
    begins = np.concatenate([begin, paths.starts[at_start]])
    ends = np.concatenate([end, paths.ends[at_end]])
    entered = np.repeat([True, False], [len(begin), int(at_start.sum())])
    left = np.repeat([True, False], [len(end), int(at_end.sum())])
    begin_order, end_order = np.argsort(begins, kind="stable"), np.argsort(ends, kind="stable")
    return Stays(begins[begin_order], ends[end_order], entered[begin_order], left[end_order])


def speeds(paths: Paths, points: FloatArray, frame_rate: float) -> FloatArray:
    """``(N,)`` speed of each row, in units of ``points`` ``(N, 2)`` a second, over about a second."""
    half = max(1, round(0.5 * frame_rate))
    rows = np.arange(len(paths))
    low = np.maximum(rows - half, paths.first_rows)
    lengths = np.diff(np.append(paths.starts, len(paths)))
    high = np.minimum(rows + half, np.repeat(paths.ends, lengths))
    way = np.hypot(*(points[high] - points[low]).T)
    return np.asarray(way / np.maximum(high - low, 1) * frame_rate)


def people_in(paths: Paths, which: BoolArray, length: int) -> IntArray:
    """``(length,)`` number of rows at a mask in each frame."""
    return np.bincount(paths.frames[which], minlength=length)[:length]


# More people than can be false.
MANY = 1_000_000
ZONES = ("zone", "entries", "entries_low", "entries_high", "exits", "exits_low", "exits_high")
STAYS = ("people", "people_low", "people_high", "most", "stay", "stay_low", "stay_high", "longest", "density")


def zone_tables(
    paths: Paths, scene: Scene, settings: CountSettings, doubt: Doubt, span: tuple[int, int]
) -> tuple[dict[str, Columns], dict[str, IntArray]]:
    """The tables ``zones``, ``stays`` and ``occupancy`` of `Answers`, and people by zone and frame.

    ``span`` are the first processed frame and the number of frames up to the last.
    """
    first, length = span
    zones, times = empty(*ZONES, *STAYS), empty("time", "zone", "people", "low", "high", "most", "waiting")
    stays = empty("zone", "id", "start", "end", "seconds", "waited", "entered", "left")
    occupancy = dict[str, IntArray]()
    slow = settings.waiting * paths.heights
    waits = speeds(paths, paths.points, doubt.rate) < slow if scene.zones else paths.observed
    for zone in scene.zones:
        within = inside(paths.points, zone.corners)
        crossed = border_crossings(paths, zone, settings.band)
        real, missed = doubt.real(crossed), doubt.missed_at_border(zone, crossed)
        spans = stays_of(paths, within, crossed)
        here, waiting = people_in(paths, within, length), people_in(paths, within & waits, length)
        occupancy[zone.name] = here
        cells = list[float | int | None]()
        for side in (1, -1):
            one_way = crossed.sides == side
            number = int(one_way.sum())
            cells += [number, *interval_of(number, float((1 - real[one_way]).sum()), missed[side])]
        seconds = (spans.last - spans.first + 1) / doubt.rate
        mean = round(float(here[first:].mean()), 3) if length > first else 0.0
        space = _square_metres(scene, zone)
        people, stay = doubt.of_stays(spans.first, spans.last, length - first)
        cells += [mean, *_ends(people, mean, 3), int(here.max(initial=0))]
        stayed = round(float(seconds.mean()), 2) if len(seconds) else 0.0
        cells += [stayed, *_ends(stay, stayed, 2)]
        cells += [round(float(seconds.max(initial=0)), 2), None if space is None else round(mean / space, 4)]
        add(zones, zone.name, *cells)
        waited = np.append(0, np.cumsum(within & waits))
        start, end = paths.frames[spans.first], paths.frames[spans.last] + 1
        add_rows(
            stays,
            np.full(len(start), zone.name),
            paths.ids[spans.first],
            *(np.round(value / doubt.rate, 3) for value in (start, end, end - start)),
            np.round((waited[spans.last + 1] - waited[spans.first]) / doubt.rate, 3),
            spans.entered,
            spans.left,
        )
        without = np.bincount(paths.frames[within], doubt.without[within], minlength=length)[:length]
        false = ABSENT * people_in(paths, within & ~paths.observed, length)
        _add_times(times, zone.name, here, waiting, doubt.rate, first, np.array([false, without]))
    return {"zones": zones, "stays": stays, "occupancy": times}, occupancy


def _ends(interval: FloatArray, value: float, digits: int) -> list[float]:
    """The ends of an interval that holds a value, rounded."""
    return [round(min(float(interval[0]), value), digits), round(max(float(interval[1]), value), digits)]


def _square_metres(scene: Scene, zone: SceneZone) -> float | None:
    """Area of a zone; None where metres are not known."""
    if not scene.has_metres:
        return None
    try:
        (floor,) = [place for place in scene.on_floor().zones if place.name == zone.name]
    except RequestError:  # the zone reaches above the horizon
        return None
    return abs(area(floor.corners))


def counts_table(paths: Paths, span: tuple[int, int], rate: float) -> Columns:
    """The table ``counts``: how many are in view in each second; ``span`` is as for `zone_tables`."""
    table = empty("time", "zone", "people", "low", "high", "most", "waiting")
    here = people_in(paths, paths.ids > 0, span[1])
    _add_times(table, "", here, here, rate, span[0], np.zeros((2, span[1])))
    return {name: table[name] for name in ("time", "people", "most")}


def _add_times(
    table: Columns, zone: str, here: IntArray, waiting: IntArray, rate: float, first: int, doubts: FloatArray
) -> None:
    """Rows of a second each, from the ``first`` frame on; ``doubts`` ``(2, F)`` are false, and missed."""
    here, waiting, doubts = here[first:], waiting[first:], doubts[:, first:]
    if not len(here):
        return
    edges = np.unique(np.floor(np.arange(0, len(here) / rate) * rate).astype(np.int64))
    sizes = np.diff(np.append(edges, len(here)))
    people = np.add.reduceat(here, edges) / sizes
    # To a twentieth many seconds are alike; the ends are as far from any number that has room for them.
    pairs = np.rint(20 * (np.add.reduceat(doubts, edges, axis=1) / sizes).T) / 20
    kinds, which = np.unique(pairs, axis=0, return_inverse=True)
    apart = np.array([interval_of(MANY, *kind) for kind in kinds.tolist()]) - MANY
    add_rows(
        table,
        np.round((first + edges) / rate, 3),
        np.full(len(edges), zone),
        np.round(people, 3),
        np.maximum(np.floor(people) + apart[which.ravel(), 0], 0).astype(np.int64),
        np.ceil(people).astype(np.int64) + apart[which.ravel(), 1],
        np.maximum.reduceat(here, edges),
        np.round(np.add.reduceat(waiting, edges) / sizes, 3),
    )


def people(paths: Paths, rate: float) -> Columns:
    """The table ``people``: when each was there and how far they went."""
    names = ("id", "first", "last", "seconds", "path", *(("metres", "speed") if paths.metres is not None else ()))
    table = empty(*names)
    if not len(paths):
        return table
    ids, whose = np.unique(paths.ids, return_inverse=True)
    first, last = np.full(len(ids), np.iinfo(np.int64).max), np.zeros(len(ids), dtype=np.int64)
    np.minimum.at(first, whose, paths.frames)
    np.maximum.at(last, whose, paths.frames)
    rows = np.bincount(whose)
    columns = [ids, *(np.round(value / rate, 3) for value in (first, last + 1, rows))]
    for number, points in enumerate(places for places in (paths.points, paths.metres) if places is not None):
        # A box jitters from frame to frame; over half a second it moves.
        way = speeds(paths, points, rate) / rate
        length = np.bincount(whose, np.nan_to_num(way))
        columns += [np.round(length, 3 if number else 2), *([np.round(length / rows * rate, 3)] if number else [])]
    add_rows(table, *columns)
    return table


def gathering_table(paths: Paths, reach: float, rate: float) -> Columns:
    """The table ``gatherings``, which are searched once a second."""
    table = empty("start", "end", "people", "most", "x", "y", "ids")
    step = max(1, round(rate))
    open_groups, done = list[list[tuple[int, IntArray]]](), list[list[tuple[int, IntArray]]]()
    for frame, members in _groups(paths, np.flatnonzero(paths.frames % step == 0), reach):
        done += [group for group in open_groups if group[-1][0] < frame - step]
        open_groups = [group for group in open_groups if group[-1][0] >= frame - step]
        ids = paths.ids[members]
        earlier = [o for o in open_groups if o[-1][0] < frame and len(np.intersect1d(paths.ids[o[-1][1]], ids)) > 1]
        if earlier:
            max(earlier, key=len).append((frame, members))
        else:
            open_groups.append([(frame, members)])
    for parts in sorted(done + open_groups, key=lambda group: group[0][0]):
        first, last = parts[0][0], parts[-1][0]
        if last - first >= LEAST_SECONDS * rate:
            rows = np.concatenate([part for _, part in parts])
            ids, (x, y) = np.unique(paths.ids[rows]), paths.points[rows].mean(axis=0).tolist()
            largest, names = max(len(part) for _, part in parts), " ".join(map(str, ids))
            start, end = round(first / rate, 3), round(last / rate, 3)
            add(table, start, end, len(ids), largest, round(x, 2), round(y, 2), names)
    return table


def _groups(paths: Paths, rows: IntArray, reach: float) -> list[tuple[int, IntArray]]:
    """Frame and rows of each group of people within ``reach`` heights of each other, in the order of frames."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    if not len(rows):
        return []
    # People of different frames are never near: the frame is a third coordinate, far apart.
    limit = reach * paths.heights[rows]
    places = np.column_stack([paths.points[rows], paths.frames[rows] * 2.0 * limit.max()])
    pairs = cKDTree(places).query_pairs(float(limit.max()), output_type="ndarray")
    apart = np.hypot(*(places[pairs[:, 0], :2] - places[pairs[:, 1], :2]).T)
    pairs = pairs[apart <= np.minimum(limit[pairs[:, 0]], limit[pairs[:, 1]])]
    joined = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(rows), len(rows)))
    _, labels = connected_components(joined, directed=False)
    grouped = np.flatnonzero(np.bincount(labels)[labels] >= FEWEST)
    order = grouped[np.argsort(labels[grouped], kind="stable")]
    large = np.split(rows[order], np.flatnonzero(np.diff(labels[order])) + 1) if len(order) else []
    return sorted(((int(paths.frames[part[0]]), part) for part in large), key=lambda group: group[0])
