"""People on one floor over a whole video, as tracks with one id in all cameras: grouping and linking, alternated.

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
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from tsuiseki.tracking.association.network_flow import build_graph, solve, track_labels
from tsuiseki.tracking.filters.kalman import Gaussians, update
from tsuiseki.tracking.floor.foot_points import expected_boxes
from tsuiseki.tracking.floor.grouping import ExpectedTracks, MomentPoints, PersonNodes, group, joined_nodes, weighed
from tsuiseki.tracking.floor.measured_floor import FloorPoints, MeasuredFloor, SensorRates, shares
from tsuiseki.tracking.floor.walking import (
    BIRTHS,
    LIVES,
    PLACE,
    Expectations,
    filtered,
    from_both_sides,
    link_likelihood,
    start,
)
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Track
from tsuiseki.tracking.types.measurements import PersonOnFloor

# Of grouping and linking.
ROUNDS = 3
# Moments that a track has at least.
SHORTEST = 2
# Seconds that a track lasts at least on which no two sensors agree, or half of the time that there is; shorter ones are
# mostly of nobody.
LONE = 1.5
# Least probability of detection where somebody was detected: a visible share may be wrong.
LEAST_CHANCE = 0.05
# What a certain name brings, nats: more than any other cost of a link.
CERTAIN = 50.0
# Links whose likelihood is computed at a time, so that memory stays small.
CHUNK = 20_000
# Moments that are grouped at a time, so that memory stays small.
MOMENTS = 200
# Longest time between two linked groups, seconds.
WINDOW = 3.0
# Speed of a link at most, m/s.
FASTEST = 4.0
# Length of a link beside the noise at most, metres.
FARTHEST = 4.0
# Expected people per square metre where no track is expected.
DENSITY = 0.015
# Log probability of being hidden from all sensors for one moment.
HIDDEN = -5.0
# Log probability of being hidden for each further moment.
HIDDEN_FURTHER = -1.0
# Moments for which a track is expected beyond its ends.
BEYOND = 1
# Cost of a cosine distance of 1 between two features, nats.
APPEARANCE = 2.0
# Cosine distance that costs nothing, in [0, 2].
NEUTRAL = 0.35
# Order of a state in `SensedTrack`: x, vx, y, vy.
AXES = np.array([0, 2, 1, 3])
# Existence of a person at a moment at which no sensor detects them.
UNSEEN = 0.5
# Visible share from which a person without a detection has a box in a camera's image.
IN_VIEW = 0.3


def flow_on_one_floor(measured: MeasuredFloor) -> list[PersonOnFloor]:
    """Everybody on the floor, by the flow over the whole video.

    Tracks of at least `SHORTEST` nodes that are not `_lone`, or of a certain name, on the plan; ids in the order of
    their beginning.
    """
    return solved_people(measured).people


@dataclass(frozen=True)
class SolvedPeople:
    """Everybody on the floor, and what each of N measurements is of.

    Attributes:
        people: by their beginning.
        owner: ``(N,)`` id, 0 for none.
        rates: how well the sensors detect, as the tracks say.
    """

    people: list[PersonOnFloor]
    owner: IntArray
    rates: SensorRates


def solved_people(
    measured: MeasuredFloor, rates: SensorRates | None = None, first_id: int = 1, goes_on: bool = False
) -> SolvedPeople:
    """The people on a floor by one flow over all cameras, with how well the sensors detect; see `flow_on_one_floor`.

    Args:
        measured: measurements; certain names in them stay ids.
        rates: how well the sensors detect, to begin with.
        first_id: of those who have no certain name.
        goes_on: whether moments come after these, in which a track that is short may go on.
    """
    rates = measured.rates if rates is None else rates
    owner = np.zeros(len(measured.points), dtype=np.int64)
    if not len(measured.points):
        return SolvedPeople([], owner, rates)
    nodes, label, expected, rates = _solved(measured, rates)
    sensed = np.zeros((len(nodes.moment), len(measured.views)), dtype=np.bool_)
    sensed[nodes.node, measured.points.sensor] = True
    names = nodes.highest(measured.points.names)
    times, parts = measured.times, []
    least = min(LONE, (times[-1] - times[0]) / 2)
    latest = times[-1] - least if goes_on else np.inf
    for track in np.unique(label[label >= 0]):
        members = np.flatnonzero(label == track)
        name = int(names[members].max())
        short = len(members) < SHORTEST or _lone(times[nodes.moment[members]], sensed[members], least, latest)
        if name >= 0 or not short:
            parts.append((int(nodes.moment[members].min()), name, members, expected.chosen(expected.track == track)))
    parts.sort(key=lambda part: part[0])
    certain_ids = {name for _, name, *_ in parts if name >= 0}
    last = first_id + len(parts) + len(certain_ids)
    free = iter(number for number in range(first_id, last) if number not in certain_ids)
    people, id_of_node = list[PersonOnFloor](), np.zeros(len(nodes.moment), dtype=np.int64)
    for _, name, members, around in parts:
        at, moments, states = nodes.moment[members], *_states(nodes, members, around)
        detected = np.zeros((len(moments), sensed.shape[1]), dtype=np.bool_)
        detected[np.searchsorted(moments, at)] = sensed[members]
        inside = measured.inside(states.mean[:, :2])
        mean, covariance, detected = states.mean[inside], states.covariance[inside], detected[inside]
        number = name if name >= 0 else next(free)
        id_of_node[members] = number
        person = PersonOnFloor(
            number, moments[inside], measured.times[moments[inside]], mean[:, :2],
            mean[:, 2:], covariance[:, AXES][:, :, AXES], np.where(detected.any(axis=1), 1.0, UNSEEN),
            np.empty((len(mean), 0)), detected,
        )  # fmt: skip
        people += [person] if len(person) else []
    return SolvedPeople(people, id_of_node[nodes.node], rates)


def _lone(times: FloatArray, sensed: BoolArray, least: float, latest: float) -> bool:
    """Whether a track is too short for what one of several sensors says alone, so that it is held back.

    Two sensors must agree as often as a track must be detected.

    Args:
        times: ``(M,)`` seconds of its detections.
        sensed: ``(M, S)`` by which sensors.
        least: seconds that it lasts otherwise.
        latest: seconds; a track that began later may go on.
    """
    agreed = (sensed.sum(axis=1) > 1).sum()
    return bool(sensed.shape[1] > 1 and agreed < SHORTEST and np.ptp(times) < least and times.min() <= latest)


def _states(nodes: PersonNodes, members: IntArray, around: Expectations) -> tuple[IntArray, Gaussians]:
    """The moments of a track and its state at each, from its nodes, the ``members``, and where it is expected."""
    at = nodes.moment[members]
    around = around.chosen((around.moment >= at.min()) & (around.moment <= at.max()))
    if not len(around.moment):
        return at, start(nodes.places[members], nodes.covariances[members])
    states, row = around.states, np.searchsorted(around.moment, at)
    met = update(
        Gaussians(states.mean[row], states.covariance[row]), nodes.places[members], PLACE, nodes.covariances[members]
    )
    states.mean[row], states.covariance[row] = met.mean, met.covariance
    return around.moment, states


def _solved(measured: MeasuredFloor, rates: SensorRates) -> tuple[PersonNodes, IntArray, Expectations, SensorRates]:
    """The groups, ``(G,)`` the track of each, from 0, or -1, every track from its first to its last node, and rates."""
    times, views = measured.times, measured.views
    expected, visible = None, np.empty((0, len(views)))
    for _ in range(ROUNDS):
        nodes, track = _grouped(measured, rates, expected, visible)
        ahead, behind, _ = _passes(nodes, track, times, 0)
        label = _linked(measured.points, nodes, ahead, behind, times)
        *_, expected = _passes(nodes, label, times, BEYOND)
        visible = shares(views, expected.moment, expected.states.mean[:, :2])
        rates = _learnt(measured, nodes, label, expected, rates, visible)
    assert expected is not None
    return nodes, label, expected, rates


def _grouped(
    measured: MeasuredFloor, rates: SensorRates, expected: Expectations | None, visible: FloatArray
) -> tuple[PersonNodes, IntArray]:
    """The groups of all moments, and ``(G,)`` the track that each goes on with, -1 for none.

    ``(E, S)`` shares of the expected people are ``visible`` to the sensors.
    """
    points, moments = measured.points, len(measured.moments)
    chance = rates.detected(points.visible)
    missed = np.log(1.0 - chance)
    own_chance = np.maximum(chance[np.arange(len(points)), points.sensor], LEAST_CHANCE)
    gain = np.log(own_chance) - np.log(rates.false[points.sensor] * points.spread)
    edges = np.searchsorted(points.moment, np.arange(moments + 1))
    expected_tracks, numbers, ends = None, np.empty(0, np.int64), np.zeros(moments + 1, np.int64)
    if expected is not None:
        mean, covariance = expected.states.mean[:, :2], expected.states.covariance[:, :2, :2]
        away = np.log(1.0 - rates.detected(visible))
        ends = np.searchsorted(expected.moment, np.arange(moments + 1))
    parts: list[PersonNodes] = []
    tracks: list[IntArray] = []
    total = 0
    for first in range(0, moments, MOMENTS):
        last = min(first + MOMENTS, moments)
        here, there = slice(edges[first], edges[last]), slice(ends[first], ends[last])
        if here.start == here.stop:
            continue
        chunk = MomentPoints(
            points.moment[here], points.sensor[here], points.places[here], points.covariances[here], gain[here],
            missed[here], points.names[here], _affinities(points, edges[first : last + 1]),
        )  # fmt: skip
        if expected is not None:
            expected_tracks = ExpectedTracks(expected.moment[there], mean[there], covariance[there], away[there])
            numbers = expected.track[there]
        nodes, label = weighed(chunk, group(chunk, DENSITY, expected_tracks))
        parts.append(replace(nodes, node=nodes.node + total))
        total += len(nodes.moment)
        # Groups of new people go on with no track.
        tracks.append(np.append(numbers, -1)[np.minimum(label, len(numbers))])
    return joined_nodes(parts), np.concatenate(tracks)


def _affinities(points: FloorPoints, edges: IntArray) -> list[FloatArray] | None:
    """``(n, n)`` of each moment: what appearance says for one person, of pairs in view from a like side."""
    if points.features is None or points.facing is None:
        return None
    blocks = []
    for first, last in pairwise(edges.tolist()):
        features, facing = points.features[first:last], points.facing[first:last]
        described = (features != 0).any(axis=1)
        side = np.maximum(facing @ facing.T, 0.0) * (described[:, None] & described[None])
        if last > first:
            blocks.append(np.asarray(APPEARANCE * side * (NEUTRAL - 1.0 + features @ features.T)))
    return blocks


def _passes(
    nodes: PersonNodes, label: IntArray, times: FloatArray, beyond: int
) -> tuple[Gaussians, Gaussians, Expectations]:
    """States of the nodes from the past and from the future, and where tracks are expected.

    Args:
        nodes: the groups.
        label: ``(G,)`` track of each, -1 for none.
        times: ``(T,)`` seconds of the moments.
        beyond: moments for which a track is expected beyond its ends.
    """
    # Node of each track at each moment, -1 for none.
    table = np.full((int(label.max(initial=-1)) + 1, len(times)), -1)
    held = np.flatnonzero(label >= 0)
    table[label[held], nodes.moment[held]] = held
    table = table[(table >= 0).any(axis=1)]
    (tracks, count), groups = table.shape, len(nodes.moment)
    # Both ways at once: from behind, nodes and tracks have numbers of their own.
    turned = np.where(table >= 0, table + groups, -1)[:, ::-1]
    steps = np.stack([np.diff(stamps, prepend=stamps[:1]) for stamps in (times, times[::-1])])
    places, covariances = np.tile(nodes.places, (2, 1)), np.tile(nodes.covariances, (2, 1, 1))
    both_ways = np.concatenate([table, turned])
    states, expected = filtered(steps.repeat(tracks, axis=0), both_ways, places, covariances, beyond)
    ahead, behind = (Gaussians(states.mean[k], states.covariance[k]) for k in (np.s_[:groups], np.s_[groups:]))
    past, back = (expected.chosen(expected.track // max(tracks, 1) == way) for way in (0, 1))
    back = replace(back, track=back.track - tracks, moment=count - 1 - back.moment)
    return ahead, behind, from_both_sides(past, back, count)


def _linked(
    points: FloorPoints, nodes: PersonNodes, ahead: Gaussians, behind: Gaussians, times: FloatArray
) -> IntArray:
    """``(G,)`` tracks by the cheapest flow."""
    tail, head = _candidates(nodes, times)
    seconds = times[nodes.moment[head]] - times[nodes.moment[tail]]
    cost = np.empty(len(tail))
    for k in range(0, len(tail), CHUNK):
        part = slice(k, k + CHUNK)
        past, future = (
            Gaussians(states.mean[at[part]], states.covariance[at[part]])
            for states, at in ((ahead, tail), (behind, head))
        )
        cost[part] = -link_likelihood(past, future, seconds[part])
    gap = nodes.moment[head] - nodes.moment[tail] - 1
    missed = np.maximum(gap * (nodes.missed[tail] + nodes.missed[head]) / 2, HIDDEN + HIDDEN_FURTHER * (gap - 1))
    cost += np.where(gap > 0, -missed, 0.0) + seconds / LIVES
    if points.features is not None:
        features = np.zeros((len(nodes.moment), points.features.shape[1]))
        np.add.at(features, nodes.node, points.features)
        features = features / np.maximum(np.linalg.norm(features, axis=1, keepdims=True), 1e-9)
        both = features[tail].any(axis=1) & features[head].any(axis=1)
        distance = 1.0 - np.einsum("pd,pd->p", features[tail], features[head])
        cost += np.where(both, APPEARANCE * (distance - NEUTRAL), 0.0)
    names = nodes.highest(points.names)
    named = names >= 0
    same = named[tail] & named[head]
    cost = np.where(same & (names[tail] == names[head]), np.minimum(cost, 0.0) - CERTAIN, cost)
    cost = np.where(same & (names[tail] != names[head]), np.inf, cost)
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    entry, leave = -np.log(BIRTHS * step), -np.log(step / LIVES)
    graph = build_graph(-nodes.weight - CERTAIN * named, [(tail, head, cost)], entry, leave)
    return _by_name(track_labels(solve(graph)), nodes.moment, names)


def _by_name(label: IntArray, moment: IntArray, names: IntArray) -> IntArray:
    """The tracks cut where their certain name changes, and those of one name joined over any gap."""
    result = label.copy()
    fresh = int(label.max(initial=-1)) + 1
    held: dict[int, int] = {}
    for track in np.unique(label[(names >= 0) & (label >= 0)]):
        members = np.flatnonzero(label == track)
        members = members[np.argsort(moment[members])]
        named = np.flatnonzero(names[members] >= 0)
        who = names[members[named]]
        part = np.concatenate([[0], np.cumsum(np.diff(who) != 0)])
        # Nodes before the first name go with it, those between two go with the earlier.
        segment = part[np.clip(np.searchsorted(named, np.arange(len(members)), side="right") - 1, 0, None)]
        for number in np.unique(part):
            name = int(who[np.argmax(part == number)])
            if name not in held:
                held[name], fresh = fresh, fresh + 1
            result[members[segment == number]] = held[name]
    return _without_twins(result, moment, names)


def _without_twins(label: IntArray, moment: IntArray, names: IntArray) -> IntArray:
    """Of two nodes of one track at one moment, the unnamed one leaves it."""
    order = np.lexsort([names < 0, moment, label])
    again = (label[order][1:] == label[order][:-1]) & (moment[order][1:] == moment[order][:-1])
    result = label.copy()
    result[order[1:][again & (label[order][1:] >= 0)]] = -1
    # Numbers without a gap, as `_passes` counts its tracks.
    held = result >= 0
    result[held] = np.unique(result[held], return_inverse=True)[1]
    return result


def _candidates(nodes: PersonNodes, times: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs of nodes that somebody may have walked between within the window."""
    edges = np.searchsorted(nodes.moment, np.arange(len(times) + 1))
    tails, heads = [], []
    spread = 3 * np.sqrt(np.maximum(nodes.covariances[:, 0, 0], nodes.covariances[:, 1, 1]))
    for moment in range(len(times)):
        last = int(np.searchsorted(times, times[moment] + WINDOW, side="right"))
        present = np.arange(edges[moment], edges[moment + 1])
        later = np.arange(edges[moment + 1], edges[last])
        if not len(present) or not len(later):
            continue
        apart = np.linalg.norm(nodes.places[present][:, None] - nodes.places[later][None], axis=2)
        seconds = times[nodes.moment[later]] - times[moment]
        reach = np.minimum(spread[present][:, None] + spread[later][None], 1.5) + np.minimum(
            FASTEST * seconds, FARTHEST
        )
        i, j = np.nonzero(apart < reach)
        tails.append(present[i])
        heads.append(later[j])
    none = np.empty(0, dtype=np.int64)
    return np.concatenate([none, *tails]), np.concatenate([none, *heads])


def _learnt(
    measured: MeasuredFloor,
    nodes: PersonNodes,
    label: IntArray,
    expected: Expectations,
    rates: SensorRates,
    visible: FloatArray,
) -> SensorRates:
    """The rates as the tracks say: detections over what could be detected, and false positives; see `_grouped`."""
    points, views = measured.points, measured.views
    track = label[nodes.node]
    used = track >= 0
    covered = np.array([max(int(view.measured.sum()), 1) for view in views])
    spurious = np.bincount(points.sensor[~used], minlength=len(views)) / covered
    width = int(label.max(initial=0)) + 1
    key, point_keys = expected.moment * width + expected.track, points.moment[used] * width + track[used]
    order = np.argsort(key)
    at = order[np.searchsorted(key[order], point_keys).clip(max=len(key) - 1)] if len(key) else point_keys[:0]
    matching = key[at] == point_keys[: len(at)]
    hit = np.zeros((len(key), len(views)), dtype=np.bool_)
    hit[at[matching], points.sensor[used][: len(at)][matching]] = True
    return rates.learnt(visible, hit, spurious)


def tracks_in(measured: MeasuredFloor, people: Sequence[PersonOnFloor], camera: int) -> list[Track]:
    """The same people in the image of one camera: their detections, and where they are expected in full view.

    Args:
        measured: of the run.
        people: with ids of the floor.
        camera: its number.
    """
    frames = np.array([-1 if m.frames[camera] is None else m.frames[camera] for m in measured.moments], dtype=np.int64)
    points, feed, view = measured.points, measured.feeds[camera], measured.views[camera]
    of_camera = np.flatnonzero(points.sensor == camera)
    tracks = []
    for person in people:
        boxes = expected_boxes(feed.placed.camera, person.positions)
        visible = view.share(person.scans, person.positions) > IN_VIEW
        observed = person.detected[:, camera]
        for row in np.flatnonzero(observed):
            detected = feed.people[frames[person.scans[row]]].detections.boxes
            near = of_camera[points.moment[of_camera] == person.scans[row]]
            nearest = near[np.linalg.norm(points.places[near] - person.positions[row], axis=1).argmin()]
            boxes[row] = detected[points.row[nearest]]
        keep = (observed | visible) & (frames[person.scans] >= 0) & np.isfinite(boxes).all(axis=1)
        if keep.any():
            tracks.append(
                Track(
                    person.id,
                    frames[person.scans[keep]],
                    boxes[keep],
                    observed[keep].astype(np.float64),
                    observed[keep],
                )
            )
    return tracks
