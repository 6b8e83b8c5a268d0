"""Identities over a whole video on one floor: grouping and linking, alternated.

1. The detections of each moment are grouped by themselves (`grouping`).
2. The groups are the nodes of the minimum-cost flow (`association.network_flow`), which links them into tracks.
3. Along the tracks, Kalman filters from either side predict each person's place at each moment.
4. The detections are grouped anew, now beside the tracks that are expected there; the flow links the new groups, by the
   velocities that the tracks gave. And again from 3.

Solving both at once is a set packing over all candidate groups: NP-hard, and its relaxation over the candidates of a
crowd takes longer than all rounds here. Alternated, each step is solved exactly or climbs, in a second or two a minute
of video; later rounds correct errors of the first grouping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from tsuiseki.tracking.association.network_flow import build_graph, solve, track_labels
from tsuiseki.tracking.filters.kalman import Gaussians
from tsuiseki.tracking.floor.grouping import ExpectedTracks, MomentPoints, PersonNodes, group, joined_nodes, weighed
from tsuiseki.tracking.floor.measured_floor import FloorPoints, SensorRates, SensorView, shares
from tsuiseki.tracking.floor.walking import (
    Expectations,
    Walking,
    filtered,
    from_both_sides,
    link_likelihood,
)
from tsuiseki.tracking.types import FloatArray, IntArray

LEAST_CHANCE, CERTAIN = 0.05, 50.0
CHUNK, MOMENTS = 20_000, 200
FASTEST, FARTHEST = 4.0, 4.0
"""Speed of a link, m/s, and its length beside the noise, metres."""
# Mean time for which a person is there, seconds.
LIVES = 20.0


@dataclass(frozen=True)
class FloorFlow:
    """How people are linked on the floor.

    Attributes:
        walking: motion of people.
        window: longest time between two linked groups, seconds.
        rounds: number of rounds of grouping and linking.
        density: expected people per square metre where no track is expected.
        births: new people per square metre and second.
        hidden: log probability of being hidden from all sensors for one moment, and for each further one.
        beyond: moments for which a track is expected beyond its ends.
        short: tracks of fewer moments are left out.
        appearance: cost of a cosine distance of 1 between two features, nats.
        neutral: cosine distance that costs nothing, in [0, 2].
    """

    walking: Walking = field(default_factory=Walking)
    window: float = 3.0
    rounds: int = 3
    density: float = 0.015
    births: float = 0.004
    hidden: tuple[float, float] = (-5.0, -1.0)
    beyond: int = 1
    short: int = 2
    appearance: float = 2.0
    neutral: float = 0.35


@dataclass(frozen=True)
class FloorTracks:
    """What came out.

    Attributes:
        nodes: the groups.
        label: ``(G,)`` track of each node, from 0, or -1.
        expected: every track at every moment from its first to its last node, its own node included.
    """

    nodes: PersonNodes
    label: IntArray
    expected: Expectations
    rates: SensorRates


def solve_on_floor(
    points: FloorPoints, views: Sequence[SensorView], times: FloatArray, rates: SensorRates, settings: FloorFlow
) -> FloorTracks:
    """Tracks of all people.

    Args:
        points: of all moments.
        views: S of them, what the sensors see.
        times: ``(T,)`` seconds of the moments, rising.
        rates: of the sensors, to begin with; then as the tracks say.
        settings: see `FloorFlow`.
    """
    expected: Expectations | None = None
    for _ in range(settings.rounds):
        nodes, track = _grouped(points, views, len(times), rates, settings, expected)
        table = _table(nodes.moment, track, len(times))
        ahead, behind, _ = _passes(nodes, table, times, settings, 0)
        label = _linked(points, nodes, ahead, behind, times, settings)
        table = _table(nodes.moment, label, len(times))
        *_, expected = _passes(nodes, table, times, settings, settings.beyond)
        rates = _learnt(points, views, nodes, label, expected, rates)
    assert expected is not None
    return FloorTracks(nodes, label, expected, rates)


def _grouped(
    points: FloorPoints,
    views: Sequence[SensorView],
    moments: int,
    rates: SensorRates,
    settings: FloorFlow,
    expected: Expectations | None,
) -> tuple[PersonNodes, IntArray]:
    """The groups of all moments, and ``(G,)`` the track that each goes on with, -1 for none."""
    chance = rates.detected(points.visible)
    missed = np.log(1.0 - chance)
    own_chance = np.maximum(chance[np.arange(len(points)), points.sensor], LEAST_CHANCE)
    gain = np.log(own_chance) - np.log(rates.false[points.sensor] * points.spread)
    edges = np.searchsorted(points.moment, np.arange(moments + 1))
    known, numbers, ends = None, np.empty(0, np.int64), np.zeros(moments + 1, np.int64)
    if expected is not None:
        mean, covariance = expected.states.mean[:, :2], expected.states.covariance[:, :2, :2]
        away = np.log(1.0 - rates.detected(shares(views, expected.moment, mean)))
        ends = np.searchsorted(expected.moment, np.arange(moments + 1))
    parts: list[PersonNodes] = []
    tracks: list[IntArray] = []
    total = 0
    for first in range(0, moments, MOMENTS):
        last = min(first + MOMENTS, moments)
        own, there = slice(edges[first], edges[last]), slice(ends[first], ends[last])
        if own.start == own.stop:
            continue
        here = MomentPoints(
            points.moment[own], points.sensor[own], points.places[own], points.covariances[own], gain[own], missed[own],
            points.names[own], _alike(points, edges[first : last + 1], settings),
        )  # fmt: skip
        if expected is not None:
            known = ExpectedTracks(expected.moment[there], mean[there], covariance[there], away[there])
            numbers = expected.track[there]
        nodes, label = weighed(here, group(here, settings.density, known))
        parts.append(replace(nodes, node=nodes.node + total))
        total += len(nodes.moment)
        # Groups of new people go on with no track.
        tracks.append(np.append(numbers, -1)[np.minimum(label, len(numbers))])
    return joined_nodes(parts), np.concatenate(tracks)


def _alike(points: FloorPoints, edges: IntArray, settings: FloorFlow) -> list[FloatArray] | None:
    """``(n, n)`` of each moment: what appearance says for one person, of pairs in view from a like side."""
    if points.features is None or points.facing is None:
        return None
    blocks = []
    for first, last in pairwise(edges.tolist()):
        features, facing = points.features[first:last], points.facing[first:last]
        known = (features != 0).any(axis=1)
        side = np.maximum(facing @ facing.T, 0.0) * (known[:, None] & known[None])
        if last > first:
            blocks.append(np.asarray(settings.appearance * side * (settings.neutral - 1.0 + features @ features.T)))
    return blocks


def _mean_features(points: FloorPoints, nodes: PersonNodes) -> FloatArray | None:
    """``(G, D)`` of unit length, zero where there is none."""
    if points.features is None:
        return None
    total = np.zeros((len(nodes.moment), points.features.shape[1]))
    np.add.at(total, nodes.node, points.features)
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-9))


def _table(moment: IntArray, label: IntArray, moments: int) -> IntArray:
    """``(K, T)`` node of each track at each moment, -1 for none."""
    table = np.full((int(label.max(initial=-1)) + 1, moments), -1)
    held = np.flatnonzero(label >= 0)
    table[label[held], moment[held]] = held
    return table[(table >= 0).any(axis=1)]


def _passes(
    nodes: PersonNodes, table: IntArray, times: FloatArray, settings: FloorFlow, beyond: int
) -> tuple[Gaussians, Gaussians, Expectations]:
    """States of the nodes from the past and from the future, and where tracks are expected."""
    walk, (tracks, count), groups = settings.walking, table.shape, len(nodes.moment)
    # Both ways at once: from behind, nodes and tracks have numbers of their own.
    turned = np.where(table >= 0, table + groups, -1)[:, ::-1]
    steps = np.stack([np.diff(one, prepend=one[:1]) for one in (times, times[::-1])])
    places, covariances = np.tile(nodes.places, (2, 1)), np.tile(nodes.covariances, (2, 1, 1))
    states, found = filtered(
        walk, steps.repeat(tracks, axis=0), np.concatenate([table, turned]), places, covariances, beyond
    )
    ahead, behind = (Gaussians(states.mean[k], states.covariance[k]) for k in (np.s_[:groups], np.s_[groups:]))
    past, back = (found.chosen(found.track // max(tracks, 1) == way) for way in (0, 1))
    back = replace(back, track=back.track - tracks, moment=count - 1 - back.moment)
    return ahead, behind, from_both_sides(past, back, walk, count)


def _linked(
    points: FloorPoints, nodes: PersonNodes, ahead: Gaussians, behind: Gaussians, times: FloatArray, settings: FloorFlow
) -> IntArray:
    """``(G,)`` tracks by the cheapest flow."""
    tail, head = _candidates(nodes, times, settings)
    seconds = times[nodes.moment[head]] - times[nodes.moment[tail]]
    cost = np.empty(len(tail))
    for k in range(0, len(tail), CHUNK):
        part = slice(k, k + CHUNK)
        past, future = (
            Gaussians(one.mean[at[part]], one.covariance[at[part]]) for one, at in ((ahead, tail), (behind, head))
        )
        cost[part] = -link_likelihood(settings.walking, past, future, seconds[part])
    gap = nodes.moment[head] - nodes.moment[tail] - 1
    start, further = settings.hidden
    missed = np.maximum(gap * (nodes.missed[tail] + nodes.missed[head]) / 2, start + further * (gap - 1))
    cost += np.where(gap > 0, -missed, 0.0) + seconds / LIVES
    features, names = _mean_features(points, nodes), nodes.highest(points.names)
    if features is not None:
        both = features[tail].any(axis=1) & features[head].any(axis=1)
        distance = 1.0 - np.einsum("pd,pd->p", features[tail], features[head])
        cost += np.where(both, settings.appearance * (distance - settings.neutral), 0.0)
    named = names >= 0
    same = named[tail] & named[head]
    cost = np.where(same & (names[tail] == names[head]), np.minimum(cost, 0.0) - CERTAIN, cost)
    cost = np.where(same & (names[tail] != names[head]), np.inf, cost)
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    entry, leave = -np.log(settings.births * step), -np.log(step / LIVES)
    graph = build_graph(-nodes.weight - CERTAIN * named, [(tail, head, cost)], entry, leave)
    return _by_name(track_labels(solve(graph)), nodes.moment, names)


def _by_name(label: IntArray, moment: IntArray, names: IntArray) -> IntArray:
    """The tracks cut where their certain name changes, and those of one name joined over any gap."""
    result = label.copy()
    fresh = int(label.max(initial=-1)) + 1
    held: dict[int, int] = {}
    for track in np.unique(label[(names >= 0) & (label >= 0)]):
        own = np.flatnonzero(label == track)
        own = own[np.argsort(moment[own])]
        known = np.flatnonzero(names[own] >= 0)
        who = names[own[known]]
        part = np.concatenate([[0], np.cumsum(np.diff(who) != 0)])
        # Nodes before the first name go with it, those between two go with the earlier.
        segment = part[np.clip(np.searchsorted(known, np.arange(len(own)), side="right") - 1, 0, None)]
        for number in np.unique(part):
            name = int(who[np.argmax(part == number)])
            if name not in held:
                held[name], fresh = fresh, fresh + 1
            result[own[segment == number]] = held[name]
    return _without_twins(result, moment, names)


def _without_twins(label: IntArray, moment: IntArray, names: IntArray) -> IntArray:
    """Of two nodes of one track at one moment, the unnamed one leaves it."""
    order = np.lexsort([names < 0, moment, label])
    again = (label[order][1:] == label[order][:-1]) & (moment[order][1:] == moment[order][:-1])
    result = label.copy()
    result[order[1:][again & (label[order][1:] >= 0)]] = -1
    return result


def _candidates(nodes: PersonNodes, times: FloatArray, settings: FloorFlow) -> tuple[IntArray, IntArray]:
    """Pairs of nodes that somebody may have walked between within the window."""
    edges = np.searchsorted(nodes.moment, np.arange(len(times) + 1))
    tails, heads = [], []
    spread = 3 * np.sqrt(np.maximum(nodes.covariances[:, 0, 0], nodes.covariances[:, 1, 1]))
    for moment in range(len(times)):
        last = int(np.searchsorted(times, times[moment] + settings.window, side="right"))
        own = np.arange(edges[moment], edges[moment + 1])
        later = np.arange(edges[moment + 1], edges[last])
        if not len(own) or not len(later):
            continue
        apart = np.linalg.norm(nodes.places[own][:, None] - nodes.places[later][None], axis=2)
        seconds = times[nodes.moment[later]] - times[moment]
        reach = np.minimum(spread[own][:, None] + spread[later][None], 1.5) + np.minimum(FASTEST * seconds, FARTHEST)
        i, j = np.nonzero(apart < reach)
        tails.append(own[i])
        heads.append(later[j])
    none = np.empty(0, dtype=np.int64)
    return np.concatenate([none, *tails]), np.concatenate([none, *heads])


def _learnt(
    points: FloorPoints, views: Sequence[SensorView], nodes: PersonNodes, label: IntArray, expected: Expectations,
    rates: SensorRates,
) -> SensorRates:  # fmt: skip
    """The rates as the tracks say: detections over what could be detected, and false positives."""
    track = label[nodes.node]
    used = track >= 0
    covered = np.array([max(int(view.measured.sum()), 1) for view in views])
    spurious = np.bincount(points.sensor[~used], minlength=len(views)) / covered
    width = int(label.max(initial=0)) + 1
    key, wanted = expected.moment * width + expected.track, points.moment[used] * width + track[used]
    order = np.argsort(key)
    at = order[np.searchsorted(key[order], wanted).clip(max=len(key) - 1)] if len(key) else wanted[:0]
    known = key[at] == wanted[: len(at)]
    hit = np.zeros((len(key), len(views)), dtype=np.bool_)
    hit[at[known], points.sensor[used][: len(at)][known]] = True
    return rates.learnt(shares(views, expected.moment, expected.states.mean[:, :2]), hit, spurious)
