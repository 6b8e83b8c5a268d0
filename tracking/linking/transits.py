"""Who leaves one view and enters another, by times and appearance.

Tracks end and begin at places, clustered in each view: exits and entries. Of those who leave by exit a a share π enters
next by b, after a time whose logarithm is normal; others who enter there come at a rate λ. A link of tracks i and j is
so much likelier than two strangers (negative logarithm of the cost):

    log π_ab N(log t; μ_ab, σ_ab) / t − log λ_b (1 − Σ π_a) + log N(s; same) / N(s; different)

where s is the cosine of their appearance. Shares, times and appearance of the same people are learnt from all
candidates by expectation and maximisation; the links are then the cheapest flow, which is exact. A link's margin is by
how much the best solution without it costs more.

The best links of strangers have margins, too. What chance gives is drawn from the tracks themselves: the clock of each
view is turned by a random time, looks change owners within a view, and all is learnt and linked again. Of the links
with at least some margin, the expected share of false ones is the number that a draw has, over the number that there
is (the target-decoy rule; Benjamini and Hochberg, 1995), times the share of pairs that have no partner (Storey, 2002).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from tsuiseki.tracking.association.network_flow import build_graph, solve
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Seconds by which clocks may differ.
EARLY = 0.5
# Seconds that a way takes at most.
LONGEST = 300.0
# Least seconds that are distinguished.
LEAST = 0.25
# Share of the picture within which ends of tracks are one place.
PLACE = 0.3
# Usual seconds of a way, before its times are learnt.
USUAL = 15.0
# Deviation of the logarithm of the seconds, before it is learnt.
SPREAD = 1.0
# Links that what is set before learning counts for.
WEIGHT = 2.0
# Share of those who leave that come by one entry, before it is learnt.
SHARE = 0.3
# Least deviation of the logarithm of the seconds.
NARROWEST = 0.15
# Rounds of expectation and maximisation.
ROUNDS = 30
# Deviations between the appearance of different people and of the same, before it is learnt.
ALIKE = 2.5
# Pairs that it counts for.
ALIKE_WEIGHT = 5.0
# Least margin of a join that is made: nine to one, as a natural logarithm.
MARGIN = 2.2
# Draws of what chance gives. Nobody is shared where the margins of one are together as large as those that there are:
# one in 21 pairs of views without shared people has larger ones than all draws.
DRAWS = 20
# Expected share of false joins, at most. Draws have more tracks without a partner: of generated joins 3 % were false.
FALSE_SHARE = 0.15


@dataclass(frozen=True)
class Passages:
    """N tracks, of all views.

    Attributes:
        view: ``(N,)`` number of the result that each is of.
        begin: ``(N,)`` seconds of the common clock.
        end: ``(N,)`` seconds of the common clock.
        entry: ``(N, 2)`` where it begins, as shares of the picture.
        exit: ``(N, 2)`` where it ends.
        features: ``(N, D)`` appearance of unit length, zeros where it is not known.
    """

    view: IntArray
    begin: FloatArray
    end: FloatArray
    entry: FloatArray
    exit: FloatArray
    features: FloatArray


@dataclass(frozen=True)
class Transits:
    """Which track goes on in which.

    Attributes:
        earlier: ``(L,)`` tracks.
        later: ``(L,)`` the same people.
        seconds: ``(L,)`` in between.
        margins: ``(L,)`` what the best solution without the link costs more, natural logarithm.
        likeness: ``(L,)`` cosine of the appearance, NaN where it is not known.
    """

    earlier: IntArray
    later: IntArray
    seconds: FloatArray
    margins: FloatArray
    likeness: FloatArray


@dataclass(frozen=True)
class Candidates:
    """Pairs of tracks that may be one person."""

    earlier: IntArray
    later: IntArray
    seconds: FloatArray
    likeness: FloatArray
    way: IntArray
    exits: IntArray
    entries: IntArray


def linked(passages: Passages) -> Transits:
    """The cheapest links; each track has one before and one after at most."""
    pairs = _candidates(passages)
    if not len(pairs.earlier):
        nothing, none = np.empty(0, np.int64), np.empty(0)
        return Transits(nothing, nothing, none, none, none)
    gains = learnt(pairs, passages)
    graph = build_graph(np.zeros(len(passages.view)), [(pairs.earlier, pairs.later, -gains)], 0.0, 0.0)
    best = solve(graph)
    chosen = np.flatnonzero(best.follower[pairs.earlier] == pairs.later)
    earlier, later, seconds = pairs.earlier[chosen], pairs.later[chosen], pairs.seconds[chosen]
    others = [(graph.tail != i) | (graph.head != j) for i, j in zip(earlier, later, strict=True)]
    margins = [solve(graph.with_transitions(mask)).cost - best.cost for mask in others]
    return Transits(earlier, later, seconds, np.array(margins), pairs.likeness[chosen])


def standing_out(passages: Passages, links: Transits, margin: float = MARGIN) -> BoolArray:
    """``(L,)`` which links have at least this ``margin``, and stand out from what chance gives; none may."""
    made = links.margins >= margin
    draws = list[FloatArray]()
    for n in range(DRAWS if made.any() else 0):
        draws.append(linked(_strangers(passages, np.random.default_rng(n))).margins)
        if draws[-1].sum() >= links.margins.sum():
            return np.zeros_like(made)
    while made.any():
        # Half a link more: that none was drawn does not say that there is none.
        drawn = (_as_large(np.concatenate(draws), links.margins) + 0.5) / DRAWS
        false = (1 - made.sum() / len(passages.view)) ** 2 * drawn / _as_large(links.margins, links.margins)
        # No smaller margin than one at which few enough are false.
        fewer = made & (links.margins >= links.margins[made & (false <= FALSE_SHARE)].min(initial=np.inf))
        if (fewer == made).all():
            break
        made = fewer
    return made


def _as_large(margins: FloatArray, least: FloatArray) -> IntArray:
    """``(L,)`` how many of the ``margins`` are at least as large as each of ``least`` ``(L,)``."""
    return len(margins) - np.searchsorted(np.sort(margins), least)


def _strangers(passages: Passages, rng: np.random.Generator) -> Passages:
    """The same tracks without a word of who goes on as whom: clocks of views are turned, looks change owners."""
    order = np.lexsort((passages.begin, passages.view))
    view, begin, features = passages.view[order], passages.begin[order], passages.features[order]
    first, lasts = begin.min(), passages.end[order] - begin
    length = max(float((begin + lasts).max() - first), LEAST)
    for number in np.unique(view):
        rows = np.flatnonzero(view == number)
        begin[rows] = first + (begin[rows] - first + rng.uniform(0, length)) % length
        features[rows] = features[rng.permutation(rows)]
    return Passages(view, begin, begin + lasts, passages.entry[order], passages.exit[order], features)


def _candidates(passages: Passages) -> Candidates:
    exits, entries = (_places(passages.view, places) for places in (passages.exit, passages.entry))
    seconds = passages.begin[None] - passages.end[:, None]
    apart = passages.view[None] != passages.view[:, None]
    i, j = np.nonzero(apart & (seconds > -EARLY) & (seconds < LONGEST))
    likeness = np.einsum("nd,nd->n", passages.features[i], passages.features[j])
    described = (passages.features != 0).any(axis=1)
    likeness[~(described[i] & described[j])] = np.nan
    way = np.unique(exits[i] * len(exits) + entries[j], return_inverse=True)[1].astype(np.int64)
    return Candidates(i, j, np.maximum(seconds[i, j], LEAST), likeness, way, exits, entries)


def _places(view: IntArray, places: FloatArray) -> IntArray:
    """``(N,)`` numbers of clusters of places, each within one view."""
    numbers, count = np.zeros(len(view), dtype=np.int64), 0
    for number in np.unique(view):
        rows = np.flatnonzero(view == number)
        if len(rows) > 1:
            tree = scipy.cluster.hierarchy.linkage(places[rows], "average")
            numbers[rows] = count + scipy.cluster.hierarchy.fcluster(tree, PLACE, "distance") - 1
        else:
            numbers[rows] = count
        count = int(numbers.max()) + 1
    return numbers


@dataclass(frozen=True)
class Ways:
    """What is learnt of the W ways from an exit to an entry, and of the appearance.

    Attributes:
        source: ``(W,)`` number of the exit.
        target: ``(W,)`` of the entry.
        share: ``(W,)`` of those who leave that take it.
        centre: ``(W,)`` mean of the logarithm of seconds.
        spread: ``(W,)`` its standard deviation.
        rate: ``(W,)`` strangers who enter there a second.
        same: mean and deviation of the cosine of one person.
        different: likewise, of two.
    """

    source: IntArray
    target: IntArray
    share: FloatArray
    centre: FloatArray
    spread: FloatArray
    rate: FloatArray
    same: tuple[float, float]
    different: tuple[float, float]

    def gains(self, pairs: Candidates) -> FloatArray:
        """``(P,)`` logarithm of how much likelier each link is than two strangers."""
        k, logs, described = pairs.way, np.log(pairs.seconds), np.isfinite(pairs.likeness)
        alone = 1 - np.bincount(self.source, self.share)[self.source]
        gains = np.log(self.share / alone / self.rate)[k] + _normal(logs, self.centre[k], self.spread[k]) - logs
        s = pairs.likeness[described]
        gains[described] += _normal(s, *self.same) - _normal(s, *self.different)
        return np.asarray(gains)


def learnt(pairs: Candidates, passages: Passages) -> FloatArray:
    """``(P,)`` what each link is worth, by ways and appearance learnt from all."""
    count = int(pairs.way.max()) + 1
    first = np.unique(pairs.way, return_index=True)[1]
    source, target = pairs.exits[pairs.earlier[first]], pairs.entries[pairs.later[first]]
    entered = np.bincount(pairs.entries)
    length = max(float(passages.end.max() - passages.begin.min()), 1.0)
    s = pairs.likeness[np.isfinite(pairs.likeness)]
    middle = float(np.median(s)) if len(s) else 0.0
    width = max(1.4826 * float(np.median(np.abs(s - middle))), 0.02) if len(s) else 1.0
    share, spread = _shared(np.full(count, SHARE), source), np.full(count, SPREAD)
    same = middle + ALIKE * width, width
    ways = Ways(source, target, share, _peaks(pairs, count), spread, entered[target] / length, same, (middle, width))
    for _ in range(ROUNDS):
        odds = np.exp(np.clip(ways.gains(pairs), -50, 50))
        # A track goes on in one at most, and comes from one.
        rivals = [np.bincount(ends, odds)[ends] for ends in (pairs.earlier, pairs.later)]
        ways = _again(ways, pairs, odds / (1 + rivals[0] + rivals[1] - odds), entered, length)
    return ways.gains(pairs)


def _again(ways: Ways, pairs: Candidates, weight: FloatArray, entered: IntArray, length: float) -> Ways:
    """What ``(P,)`` probabilities of the links say of ways and appearance."""
    k, logs, count = pairs.way, np.log(pairs.seconds), len(ways.share)
    mass = np.bincount(k, weight, count)
    share = _shared((mass + WEIGHT * SHARE) / (np.bincount(pairs.exits)[ways.source] + WEIGHT), ways.source)
    centre = np.where(mass > 0.1, np.bincount(k, weight * logs, count) / np.maximum(mass, 0.1), ways.centre)
    square = np.bincount(k, weight * np.square(logs - centre[k]), count)
    spread = np.maximum(np.sqrt((square + WEIGHT * SPREAD**2 / 4) / (mass + WEIGHT)), NARROWEST)
    strangers = np.maximum(entered - np.bincount(ways.target, mass, len(entered)), 1.0)
    described, (middle, width) = np.isfinite(pairs.likeness), ways.different
    pair_weight, s = weight[described], pairs.likeness[described]
    total = pair_weight.sum() + ALIKE_WEIGHT
    mean = (pair_weight @ s + ALIKE_WEIGHT * (middle + ALIKE * width)) / total
    deviation = np.sqrt((pair_weight @ np.square(s - mean) + ALIKE_WEIGHT * width**2) / total)
    same = max(float(mean), middle + width), float(deviation)
    rate = strangers[ways.target] / length
    return replace(ways, share=share, centre=centre, spread=spread, rate=rate, same=same)


def _shared(share: FloatArray, source: IntArray) -> FloatArray:
    """``(W,)`` shares of which those of an exit make 0.95 at most."""
    total = np.bincount(source, share)
    return np.asarray(share / np.maximum(total / 0.95, 1.0)[source])


def _normal(x: FloatArray, mean: FloatArray | float, spread: FloatArray | float) -> FloatArray:
    return np.asarray(-0.5 * np.square((x - mean) / spread) - np.log(spread) - 0.5 * np.log(2 * np.pi))


def _peaks(pairs: Candidates, ways: int) -> FloatArray:
    """``(W,)`` log times that more candidates of a way have than strangers would, weighed by appearance."""
    grid = np.linspace(np.log(LEAST), np.log(LONGEST), 120)
    weight = np.ones(len(pairs.way))
    described = np.isfinite(pairs.likeness)
    if described.any():
        s = pairs.likeness[described]
        weight[described] = np.exp(2 * (s - s.mean()) / max(s.std(), 1e-3))
    peaks = np.empty(ways)
    for way in range(ways):
        of_way = pairs.way == way
        near = np.exp(-0.5 * np.square((np.log(pairs.seconds[of_way]) - grid[:, None]) / 0.15)) @ weight[of_way]
        # Strangers are spread evenly over time: their number grows with it.
        strangers = np.exp(grid) * weight[of_way].sum() / LONGEST * 0.15 * np.sqrt(2 * np.pi)
        prior = -0.5 * np.square((grid - np.log(USUAL)) / 1.5)
        peaks[way] = grid[int(np.argmax((near - strangers) / np.sqrt(strangers + 1) + prior))]
    return peaks


def people_of(count: int, links: Transits, sure: BoolArray) -> IntArray:
    """``(N,)`` ids from 1 in the order of the tracks, the same for tracks that sure links join."""
    ones = np.ones(int(sure.sum()))
    graph = scipy.sparse.coo_array((ones, (links.earlier[sure], links.later[sure])), shape=(count, count))
    labels = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    return np.asarray(np.unique(labels, return_inverse=True)[1] + 1, dtype=np.int64)
