"""How a camera over a floor sees the people who stand on it, as numbers that can be fitted.

A camera is a row of `NUMBERS`: the logarithm of the focal length, the principal point in pixels, tilt below the level
and roll in radians, the logarithm of the height over the floor in metres; then its place over the floor: turn and the
two coordinates; then its clock: the offset in seconds and the drift in seconds a second. Places on the floor are
complex numbers in metres. The lens is ideal and its pixels are square.

A box spans the columns of foot and head, which differ where people lean in the picture. So the foot is not the middle
of its lower edge: half the lean lies between them.

Two cameras are put over one floor by the paths of people, with no knowledge of who is who. Each path of one camera is
laid on each of the other by the turn and shift that fit best (Procrustes in complex numbers), for each difference of
the clocks. Right pairs all give the same turn and shift, wrong ones any: the one that most pairs agree with is taken,
each path counting once. Where both see few people, two pairs together make a hypothesis, so that those who stand count,
too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.geometry import areas, intersections
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Track
from tsuiseki.tracking.types.tracks import rows_of_each

NUMBERS = ("log_focal", "x", "y", "tilt", "roll", "log_height", "turn", "east", "north", "offset", "drift")
# Columns of `NUMBERS` that one camera's own people tell.
LENS = slice(0, 6)
# Columns of its place over the floor.
PLACE = slice(6, 9)
# Column of its clock's offset.
OFFSET = 9
# Column of its clock's drift.
DRIFT = 10
# Seconds that are averaged: noise falls, and a walker stays on a line.
CELL = 0.4
# Longest gap within a track over which a place is interpolated, seconds.
GAP = 1.6
# Distance from the border within which a box may be cut off, pixels.
BORDER = 2.0
# Covered share from which a box may be too short.
COVERED = 0.25
# Averages of boxes, one a `CELL`, that a person must have.
FEWEST_CELLS = 3


@dataclass(frozen=True)
class PeopleView:
    """The people in one camera.

    Attributes:
        name: of the source.
        size: width and height of the picture, pixels.
        frame_rate: frames a second.
        times: ``(N,)`` seconds of the camera's clock, increasing within a track.
        boxes: ``(N, 4)`` pixels, whole people only, averaged over `CELL`.
        people: ``(N,)`` numbers of the tracks from 0, increasing.
    """

    name: str
    size: tuple[int, int]
    frame_rate: float
    times: FloatArray
    boxes: FloatArray
    people: IntArray

    @property
    def count(self) -> int:
        """Number of tracks."""
        return int(self.people.max(initial=-1)) + 1

    @property
    def heights(self) -> FloatArray:
        """``(N,)`` of the boxes, pixels."""
        return np.asarray(self.boxes[:, 3] - self.boxes[:, 1])


def view_of(
    name: str, tracks: Sequence[Track], size: tuple[int, int], frame_rate: float, times: FloatArray | None = None
) -> PeopleView:
    """The boxes that show whole people.

    Args:
        name: of the source.
        tracks: of its people.
        size: width and height of the picture, pixels.
        frame_rate: frames a second.
        times: of all frames, seconds, where they are uneven.
    """
    rows = [(t.frames[t.observed], t.boxes[t.observed], np.full(t.observed.sum(), k)) for k, t in enumerate(tracks)]
    frames = np.concatenate([np.empty(0, np.int64), *(row[0] for row in rows)])
    boxes = np.concatenate([np.empty((0, 4)), *(row[1] for row in rows)])
    people = np.concatenate([np.empty(0, np.int64), *(row[2] for row in rows)])
    uncut = (boxes[:, :2] > BORDER).all(axis=1) & (boxes[:, 2:] < np.array(size) - BORDER).all(axis=1)
    uncut &= ~_covered(frames, boxes)
    frames, boxes, people = frames[uncut], boxes[uncut], people[uncut]
    seconds = frames / frame_rate if times is None else times[frames]
    cells = people * 10**8 + np.floor(seconds / CELL).astype(np.int64)
    used_cells, cell, counts = np.unique(cells, return_inverse=True, return_counts=True)
    means = [np.bincount(cell, column, len(used_cells)) / counts for column in (seconds, *boxes.T)]
    people = used_cells // 10**8
    enough = np.bincount(people, minlength=len(tracks))[people] >= FEWEST_CELLS
    numbers = np.unique(people[enough], return_inverse=True)[1].astype(np.int64)
    return PeopleView(name, size, frame_rate, means[0][enough], np.stack(means[1:], axis=1)[enough], numbers)


def _covered(frames: IntArray, boxes: FloatArray) -> BoolArray:
    """``(N,)`` boxes of which somebody nearer may hide the feet."""
    hidden = np.zeros(len(frames), dtype=np.bool_)
    for rows in rows_of_each(frames):
        frame_boxes = boxes[rows]
        shared = intersections(frame_boxes[:, None], frame_boxes[None]) * (
            frame_boxes[None, :, 3] > frame_boxes[:, None, 3]
        )
        hidden[rows] = shared.max(axis=1, initial=0.0) / areas(frame_boxes) > COVERED
    return hidden


def sight(camera: FloatArray, pixels: FloatArray) -> FloatArray:
    """Where pixels ``(N, 2)`` meet the floor before the camera: to the right and, as imaginary part, ahead; metres.

    Args:
        camera: `NUMBERS`, ``(11,)`` or ``(N, 11)``.
        pixels: those above the horizon meet the floor very far away.
    """
    x, y = ((pixels - camera[..., 1:3]) / np.exp(camera[..., :1])).T
    cos, sin = np.cos(camera[..., 4]), np.sin(camera[..., 4])
    right, down = cos * x - sin * y, sin * x + cos * y
    level, dip = np.cos(camera[..., 3]), np.sin(camera[..., 3])
    far = np.exp(camera[..., 5]) / np.maximum(dip + level * down, 2e-3)
    return np.asarray(far * right + 1j * far * (level - dip * down))


def picture(camera: FloatArray, places: FloatArray, height: float) -> FloatArray:
    """``(N, 2)`` pixels of points ``height`` above `sight` places."""
    level, dip = np.cos(camera[..., 3]), np.sin(camera[..., 3])
    above = height - np.exp(camera[..., 5])
    depth = np.maximum(level * places.imag - dip * above, 0.05)
    right, down = places.real / depth, (-dip * places.imag - level * above) / depth
    cos, sin = np.cos(camera[..., 4]), np.sin(camera[..., 4])
    focal = np.exp(camera[..., 0])
    turned = np.stack([cos * right + sin * down, cos * down - sin * right], axis=-1)
    return np.asarray(camera[..., 1:3] + focal[..., None] * turned)


def feet(camera: FloatArray, boxes: FloatArray, height: float) -> FloatArray:
    """``(N,)`` places as of `sight` where people of a ``height`` stand who fill ``(N, 4)`` boxes."""
    middle = (boxes[:, 0] + boxes[:, 2]) / 2
    foot = np.stack([middle, boxes[:, 3]], axis=-1)
    for _ in range(2):
        lean = picture(camera, sight(camera, foot), height)[:, 0] - foot[:, 0]
        foot = np.stack([middle - lean / 2, boxes[:, 3]], axis=-1)
    return sight(camera, foot)


def on_floor(camera: FloatArray, boxes: FloatArray, height: float) -> FloatArray:
    """``(N,)`` places of people over the common floor, complex metres."""
    here = feet(camera, boxes, height)
    return np.asarray(camera[..., 7] + 1j * camera[..., 8] + np.exp(1j * camera[..., 6]) * here)


def height_errors(camera: FloatArray, view: PeopleView, height: float) -> FloatArray:
    """``(N,)`` logarithm of the boxes' heights over those of people of a ``height`` in metres."""
    top = picture(camera, feet(camera, view.boxes, height), height)[:, 1]
    return np.asarray(np.log(view.heights / np.maximum(view.boxes[:, 3] - top, 1e-3)))


def pinhole(camera: FloatArray, size: tuple[int, int]) -> PinholeCamera:
    """The camera of a row of `NUMBERS`."""
    focal, tilt, roll, turn = np.exp(camera[0]), camera[3], camera[4], camera[6]
    ahead = np.array([-np.sin(turn), np.cos(turn), 0.0])
    right, up = np.array([np.cos(turn), np.sin(turn), 0.0]), np.array([0.0, 0.0, 1.0])
    forward, down = np.cos(tilt) * ahead - np.sin(tilt) * up, -np.sin(tilt) * ahead - np.cos(tilt) * up
    rolled = np.array([[np.cos(roll), np.sin(roll), 0], [-np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    position = np.array([camera[7], camera[8], np.exp(camera[5])])
    return PinholeCamera(*size, np.full(2, focal), camera[1:3], rolled @ np.stack([right, down, forward]), position)


# Time between places that are compared, seconds.
STEP = 0.5
# Clock differences are tried first at every so many such steps.
COARSE = 2
# Common places that two paths must have.
FEWEST = 4
# Deviation of the places of a path from their middle from which a pair tells a turn, metres.
SPREAD = 0.6
# Two paths fit whose distance is below this, metres, and
MISFIT = 0.25
# a share of that deviation.
SHARE = 0.2
# Distance within which pairs agree, metres, and
AWAY = 1.0
# a share of how far the place is from the middle.
AWAY_SHARE = 0.1
# Turn within which pairs agree, radians.
TURN = 0.35
# Most hypotheses.
MOST = 150
# Most places of a pair that count.
LONGEST = 20
# Pairs of paths up to which two make a hypothesis.
FEW = 100
# Seconds by which a rival clock difference differs.
APART = 2.0


@dataclass(frozen=True)
class Alignment:
    """Where a second camera stands as a first one sees it.

    Attributes:
        offset: what the second clock lacks to the first, seconds.
        turn: of its places, a complex number of length 1.
        shift: of its places after the turn, metres.
        score: places of people that agree.
        rival: the same of the best alignment by another difference of the clocks, or to quite another place.
    """

    offset: float
    turn: complex
    shift: complex
    score: float
    rival: float


def places_at(view: PeopleView, places: FloatArray, times: FloatArray) -> FloatArray:
    """``(tracks, T)`` complex places at increasing ``times`` of the camera's clock, NaN where a person is missed."""
    placed = np.full((view.count, len(times)), complex(np.nan, np.nan))
    edges = np.searchsorted(view.people, np.arange(view.count + 1))
    for k, (a, b) in enumerate(pairwise(edges)):
        seconds = view.times[a:b]
        low, high = np.searchsorted(times, [seconds[0], seconds[-1]])
        following = np.clip(np.searchsorted(seconds, times[low:high]), 1, len(seconds) - 1)
        inside = seconds[following] - seconds[following - 1] < GAP
        row = np.interp(times[low:high], seconds, places[a:b])
        placed[k, low:high] = np.where(inside, row, complex(np.nan, np.nan))
    return placed


def align(first: FloatArray, second: FloatArray, reach: int) -> Alignment | None:
    """The best turn, shift and clock difference; None where no two paths fit.

    Args:
        first: ``(A, T)`` places of A paths every `STEP` seconds, see `places_at`.
        second: ``(B, T)`` of the other camera.
        reach: largest difference of the clocks, in steps.
    """
    tried: dict[int, tuple[float, complex, complex, float]] = {}

    def attempt(lag: int) -> float:
        if lag not in tried and abs(lag) <= reach:
            tried[lag] = _agreed(first, _lagged(second, lag))
        return tried[lag][0] if lag in tried else 0.0

    for lag in range(-reach, reach + 1, COARSE):
        attempt(lag)
    for lag in sorted(tried, key=lambda k: -tried[k][0])[:3]:
        for near in range(lag - COARSE + 1, lag + COARSE):
            attempt(near)
    best = max(tried, key=lambda k: tried[k][0])
    score, turn, shift, elsewhere = tried[best]
    if score <= 0:
        return None
    rival = max((result[0] for lag, result in tried.items() if abs(lag - best) * STEP > APART), default=0.0)
    return Alignment(best * STEP, turn, shift, score, max(rival, elsewhere))


def _lagged(places: FloatArray, lag: int) -> FloatArray:
    moved = np.full_like(places, complex(np.nan, np.nan))
    length = places.shape[1]
    moved[:, max(lag, 0) : length + min(lag, 0)] = places[:, max(-lag, 0) : length - max(lag, 0)]
    return moved


def _sums(first: FloatArray, second: FloatArray) -> FloatArray:
    """``(6, A, B)`` over the common places of two paths: count, both sums, sums of both squares, of the product."""
    both = [np.isfinite(places).astype(np.float64) for places in (first, second)]
    a, b = np.nan_to_num(first), np.nan_to_num(second)
    here, there = both[0], both[1].T
    squares = (np.abs(a) ** 2) @ there, here @ (np.abs(b) ** 2).T
    return np.stack([here @ there + 0j, a @ there, here @ b.T, *squares, a @ b.conj().T])


def _fitted(sums: FloatArray) -> tuple[FloatArray, ...]:
    """Of ``(6, P)`` sums the turn, both middles, the spread in metres and the root mean square of what is left."""
    count = np.maximum(sums[0].real, 1)
    a, b = sums[1] / count, sums[2] / count
    spread = [np.maximum(sums[k].real / count - np.abs(m) ** 2, 1e-9) for k, m in ((3, a), (4, b))]
    product = sums[5] / count - a * b.conj()
    turn = np.where(np.abs(product) > 0, product / np.maximum(np.abs(product), 1e-12), 1)
    left = np.sqrt(np.maximum(spread[0] + spread[1] - 2 * np.abs(product), 0))
    return turn, a, b, np.sqrt(np.minimum(*spread)), left


def _agreed(first: FloatArray, second: FloatArray) -> tuple[float, complex, complex, float]:
    """How many places agree, the turn and shift that they agree with, and how many agree with quite another."""
    sums = _sums(first, second)
    i, j = np.nonzero(sums[0].real >= FEWEST)
    if not len(i):
        return 0.0, 1, 0, 0.0
    sums = sums[:, i, j]
    turn, a, b, spread, left = _fitted(sums)
    few = len(i) <= FEW
    fitting = left < MISFIT + SHARE * spread
    hypotheses = np.flatnonzero(fitting & (spread > SPREAD))
    used = np.flatnonzero(fitting) if few else hypotheses
    guesses = [sums[:, hypotheses]]
    if few:
        pairs = [(p, q) for p, q in combinations(used.tolist(), 2) if i[p] != i[q] and j[p] != j[q]]
        ends = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        guesses.append(sums[:, ends[:, 0]] + sums[:, ends[:, 1]])
    turns, middles, others, spreads, lefts = _fitted(np.concatenate(guesses, axis=1))
    count = np.concatenate(guesses, axis=1)[0].real
    good = np.flatnonzero((lefts < MISFIT + SHARE * spreads) & (spreads > SPREAD))
    good = good[np.argsort(-(count * spreads / (lefts + 0.15))[good], kind="stable")[:MOST]]
    if not len(good):
        return 0.0, 1, 0, 0.0
    turns, shifts = turns[good], middles[good] - turns[good] * others[good]
    away = np.abs(a[used] - turns[:, None] * b[used] - shifts[:, None])
    reach = AWAY + AWAY_SHARE * np.abs(b[used] - others[good][:, None])
    weight = np.clip(1 - away / reach, 0, 1) * np.minimum(sums[0, used].real, LONGEST)
    turned = np.abs(np.angle(turn[used] / turns[:, None]))
    weight *= np.where(spread[used] > SPREAD, np.clip(1 - turned / TURN, 0, 1), 1.0)
    score = np.minimum(_once(weight, i[used]), _once(weight, j[used]))
    k = int(np.argmax(score))
    middle = others[good[k]]
    elsewhere = np.abs((turns - turns[k]) * middle + shifts - shifts[k]) > 3 * AWAY
    elsewhere |= np.abs(np.angle(turns / turns[k])) > 2 * TURN
    return float(score[k]), complex(turns[k]), complex(shifts[k]), float(score[elsewhere].max(initial=0.0))


def _once(weight: FloatArray, path: IntArray) -> FloatArray:
    """``(H,)`` sums of weights ``(H, P)``, of each path the largest alone."""
    order = np.argsort(path, kind="stable")
    starts = np.flatnonzero(np.diff(path[order], prepend=-1))
    return np.asarray(np.maximum.reduceat(weight[:, order], starts, axis=1).sum(axis=1))
