"""Two cameras over one floor from the paths of people, with no knowledge of who is who.

Each path of one camera is laid on each of the other by the turn and shift that fit best (Procrustes in complex
numbers), for each difference of the clocks. Right pairs all give the same turn and shift, wrong ones any: the one that
most pairs agree with is taken, each path counting once. Where both see few people, two pairs together make a
hypothesis, so that those who stand count, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from tsuiseki.tracking.cameras.people_views import GAP, PeopleView
from tsuiseki.tracking.types import FloatArray, IntArray

# Seconds between places that are compared, and between clock differences that are tried first.
STEP, COARSE = 0.5, 2
# Common places of two paths; their deviation from the middle in metres; what fits: metres and share of that.
FEWEST, SPREAD, MISFIT, SHARE = 4, 0.6, 0.25, 0.2
# Metres, share of the distance and radians within which pairs agree.
AWAY, AWAY_SHARE, TURN = 1.0, 0.1, 0.35
# Hypotheses, and places of a pair that count.
MOST, LONGEST = 150, 20
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
    found = np.full((view.count, len(times)), complex(np.nan, np.nan))
    edges = np.searchsorted(view.people, np.arange(view.count + 1))
    for k, (a, b) in enumerate(pairwise(edges)):
        own = view.times[a:b]
        low, high = np.searchsorted(times, [own[0], own[-1]])
        after = np.clip(np.searchsorted(own, times[low:high]), 1, len(own) - 1)
        inside = own[after] - own[after - 1] < GAP
        row = np.interp(times[low:high], own, places[a:b])
        found[k, low:high] = np.where(inside, row, complex(np.nan, np.nan))
    return found


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
    rival = max((one[0] for lag, one in tried.items() if abs(lag - best) * STEP > APART), default=0.0)
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
    one, other = both[0], both[1].T
    squares = (np.abs(a) ** 2) @ other, one @ (np.abs(b) ** 2).T
    return np.stack([one @ other + 0j, a @ other, one @ b.T, *squares, a @ b.conj().T])


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
    alike = left < MISFIT + SHARE * spread
    hypotheses = np.flatnonzero(alike & (spread > SPREAD))
    used = np.flatnonzero(alike) if few else hypotheses
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
