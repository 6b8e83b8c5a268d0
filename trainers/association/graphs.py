"""The flow networks of labelled sequences, as the tracker builds them, with the labelled flow x* and its windows.

The tracker runs over the given detections; at its last round the links it has priced, their features and their costs
by default are kept. So the network learns on exactly what it will be asked, second level included: the tracklets found
and the joins of their ends form a network of the same kind.

**Labelled flow.** A detection is a person's whom it overlaps by 0.5, one to one. Detections of a person that follow
each other are linked where the tracker considers that link; where it does not, the labelled track ends and starts
again. Detections on nobody are not used. Those on an ignored label are taken out, for nobody says whether they are
right, and so are labelled runs that are shorter than the shortest track. People without detections have no arc; they
only count in MOTA.

**Windows.** A window holds the detections of some frames and the links between them. Beyond its first frame the video
goes on: whatever flow there is outside, a track can come in over a link, and then pays for that link and no start. So a
start at a detection with links from before the window costs no more than the cheapest of them, at least 0; ends
likewise. In the first frame after a border that is next to nothing, at the true beginning of the video it is the full
price, as in the tracker. These costs are constants: no gradient goes through them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.association.flow.cost_network import CostChanges
from tsuiseki.tracking.association.flow.evidence import (
    DETECTION_FEATURES,
    JOIN_FEATURES,
    detection_evidence,
    link_evidence,
)
from tsuiseki.tracking.association.flow.flow_rounds import LinkParts, mean_features, priced
from tsuiseki.tracking.association.flow.flow_window import FlowWindow
from tsuiseki.tracking.association.flow.seen import Seen
from tsuiseki.tracking.association.tracklets.chain_motion import beliefs_along
from tsuiseki.tracking.association.tracklets.joining import Ends, evidence_of_joins, join_parts
from tsuiseki.tracking.trackers.people.flow import FlowSettings
from tsuiseki.tracking.trackers.people.flow_input import FlowInput
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.association.flow_loss import Arcs, DifferenceWeights
from tsuiseki.trainers.experiments.association.oracle import IGNORED, NOBODY, owners_of

# A tracklet is used whatever it costs.
ALWAYS = 1000.0
# Scores nearer to 0 and 1 count as this; a video that trusts all scores alike still lets a little gradient through.
CERTAIN, FLATTEST = 1e-6, 0.1


@dataclass(frozen=True)
class DetectedVideo:
    """Detections and labels of one sequence.

    Attributes:
        name: for people to read.
        detections: of each frame.
        truth: labels, frames counted from 0.
        frame_rate: frames a second.
        size: width and height of the image; None where not known.
        images: files, one a frame; none where nothing looks at them.
        anchors: of each frame the ``(N,)`` anchors of a detector that its detections come from; none where unknown.
    """

    name: str
    detections: Sequence[Detections]
    truth: GroundTruth
    frame_rate: float
    size: tuple[int, int] | None
    images: tuple[Path, ...] = ()
    anchors: tuple[IntArray, ...] = ()


@dataclass(frozen=True)
class Origin:
    """Where the detections of a network come from, for a detector to learn.

    Attributes:
        anchors: ``(N,)`` of the detector.
        logits: ``(N,)`` of its scores.
        slope: of the straight line that fits the logits of the probabilities, which the tracker takes scores for, to
            those of the scores.
        price: by how much a detection costs more a unit of the logit of its probability; below 0.
        truth: labels of the sequence.
    """

    anchors: IntArray
    logits: FloatArray
    slope: float
    price: float
    truth: GroundTruth

    def select(self, which: BoolArray) -> Origin:
        """That of some of the detections."""
        return replace(self, anchors=self.anchors[which], logits=self.logits[which])


@dataclass(frozen=True)
class Graph:
    """A network at the tracker's costs, its features, and the labelled flow.

    Attributes:
        name: of the sequence, and of the frames of a window.
        frame_rate: frames a second.
        frames: ``(N,)`` of the detections, or of the first ones of tracklets.
        owners: ``(N,)`` whose each is, below 0 for nobody's.
        boxes: ``(N, 4)`` where the image shows them, pixels.
        tracks: ``(N,)`` track of each by default, -1 for none.
        costs: ``(3 N + P,)`` by default: of use, starts, ends and links.
        fixed: ``(3 N,)`` those of use, starts and ends that are not learnt.
        detections: ``(N, G)`` features; without columns where those costs are fixed.
        tail: ``(P,)``.
        head: ``(P,)``.
        links: ``(P, F)`` features.
        labelled: ``(3 N + P,)`` x*.
        people: frames of the labelled boxes, those without a detection included.
        images: files of the sequence, one a frame; none where nothing looks at them.
        origin: where the detections come from; None where not known.
    """

    name: str
    frame_rate: float
    frames: IntArray
    owners: IntArray
    boxes: FloatArray
    tracks: IntArray
    costs: FloatArray
    fixed: BoolArray
    detections: FloatArray
    tail: IntArray
    head: IntArray
    links: FloatArray
    labelled: FloatArray
    people: IntArray
    images: tuple[Path, ...] = ()
    origin: Origin | None = None

    def __len__(self) -> int:
        return len(self.frames)

    def arcs(self, weights: DifferenceWeights) -> Arcs:
        """The arcs with what Δ counts for them."""
        weight = weights.of(self.owners, self.tail, self.head, self.labelled)
        return Arcs(self.tail, self.head, self.labelled, weight)


@dataclass(frozen=True)
class Graphs:
    """The two levels of a sequence.

    Attributes:
        detections: links of detections.
        tracklets: joins of the tracklets that the flow over the detections gives.
        lost: links of the labels that the tracker does not consider.
    """

    detections: Graph
    tracklets: Graph
    lost: int


def sequence_graphs(
    video: DetectedVideo, settings: FlowSettings | None = None, changes: CostChanges | None = None
) -> Graphs:
    """The networks of both levels of a sequence, at the tracker's costs by default.

    Args:
        video: the sequence.
        settings: of the tracker.
        changes: learnt costs with which the tracker finds the tracks along which links are priced; by default none.
    """
    settings = settings or FlowSettings()
    preparing = FlowInput(settings.input, settings.costs.link.motion, video.frame_rate, video.size)
    seen, scores = preparing.rows(list(video.detections) or [Detections.empty()])
    settings = replace(settings, costs=preparing.flow_costs(settings.costs))
    probability = preparing.calibration(scores)
    observation = settings.input.detection(probability, video.frame_rate)
    logit = np.log(probability / (1 - probability))
    window = FlowWindow(settings.costs, video.frame_rate, video.size, changes=changes)
    window.add(seen)
    if len(seen):
        change = window.learnt(logit, observation)
        window.solve(observation + change[:, 0], change[:, 1], change[:, 2])
    owners = owners_of(seen.frames, seen.image, video.truth)
    labels = window.labels() if len(seen) else np.empty(0, np.int64)
    parts = _link_parts(seen, window, labels, settings)
    graph = _detection_graph(video, seen, owners, labels, parts, observation, logit, settings)
    kept = owners != IGNORED
    lost = _links_to_make(seen.frames, owners) - int(graph.labelled[3 * len(graph) :].sum()) if kept.any() else 0
    return Graphs(graph, _tracklet_graph(video, seen, owners, labels, settings), max(lost, 0))


def _link_parts(seen: Seen, window: FlowWindow, labels: IntArray, settings: FlowSettings) -> LinkParts:
    """All links that the tracker considers, at the prices along its tracks without learnt changes."""
    found: list[LinkParts] = []

    def keep(_: Seen, parts: LinkParts) -> FloatArray:
        found.append(parts)
        return np.zeros(len(parts.i))

    tails, heads = (np.searchsorted(seen.numbers, part) for part in (window.links.tail, window.links.head))
    past, future = beliefs_along(labels, seen.measured, settings.costs.link.motion)
    averaged = settings.costs.rounds.averaged
    means = None if seen.features is None else mean_features(seen, labels, seen.features, averaged)
    cost, hidden = settings.costs.link, window.links.hidden
    priced(seen, tails, heads, past, future, cost, np.inf, None, means, hidden, keep, labels=labels)
    return found[0]


def _detection_graph(
    video: DetectedVideo,
    seen: Seen,
    owners: IntArray,
    tracks: IntArray,
    parts: LinkParts,
    observation: FloatArray,
    logit: FloatArray,
    settings: FlowSettings,
) -> Graph:
    costs = settings.costs
    features = detection_evidence(seen, observation, logit)
    links = link_evidence(seen, parts, costs.link.motion)
    graph = Graph(
        video.name,
        video.frame_rate,
        seen.frames,
        owners,
        seen.image,
        tracks,
        np.concatenate([observation, np.full(len(seen), costs.entry), np.full(len(seen), costs.exit), parts.cost]),
        np.zeros(3 * len(seen), dtype=np.bool_),
        features,
        parts.i,
        parts.j,
        links,
        np.zeros(3 * len(seen) + len(parts.i)),
        video.truth.select(video.truth.evaluated).frames,
        tuple(video.images),
        _origin(video, seen, logit, settings) if video.anchors else None,
    )
    graph = labelled(taken_out(graph, owners == IGNORED))
    short = _short_runs(graph, settings.fewest(video.frame_rate))
    return labelled(taken_out(graph, short))


def _origin(video: DetectedVideo, seen: Seen, logit: FloatArray, settings: FlowSettings) -> Origin:
    """The anchors and scores of the detections that the tracker took, which leaves out duplicates."""
    anchors, scores = np.empty(len(seen), dtype=np.int64), np.empty(len(seen))
    for frame in np.unique(seen.frames):
        here, found = np.flatnonzero(seen.frames == frame), video.detections[frame]
        which = (seen.image[here, None] == found.boxes[None]).all(axis=2).argmax(axis=1)
        anchors[here], scores[here] = video.anchors[frame][which], found.scores[which]
    given = np.clip(scores, CERTAIN, 1 - CERTAIN)
    given = np.log(given / (1 - given))
    spread = float(((given - given.mean()) ** 2).sum()) if len(given) else 0.0
    slope = float(((given - given.mean()) * logit).sum()) / spread if spread > 0 else 0.0
    detection = settings.input.detection
    low, high = detection(np.array([0.4, 0.6]), video.frame_rate)
    price = float(high - low) / (2 * np.log(1.5))
    return Origin(anchors, given, max(slope, FLATTEST), price, video.truth)


def _tracklet_graph(
    video: DetectedVideo, seen: Seen, owners: IntArray, labels: IntArray, settings: FlowSettings
) -> Graph:
    """Tracklets in place of detections, joins of their ends in place of links; an owner has half of one."""
    ends = Ends.of(labels)
    count, joining = len(ends.track), settings.join
    none = np.empty(0, dtype=np.int64)
    i, j, cost, rows = none, none, np.empty(0), np.empty((0, len(JOIN_FEATURES)))
    if count and joining is not None:
        link = replace(settings.costs.link, miss=joining.miss)
        before, after, parts = join_parts(seen, labels, ends, None, link, joining)
        near = np.flatnonzero(parts.cost < 3 * joining.limit)
        i, j = np.searchsorted(ends.track, before[near]), np.searchsorted(ends.track, after[near])
        cost = parts.cost[near] - joining.limit
        rows = evidence_of_joins(seen, labels, ends, parts, link)[near]
    majority = np.array([_majority(owners[labels == track]) for track in ends.track], dtype=np.int64)
    starts = seen.frames[ends.first] if count else none
    return labelled(
        Graph(
            f"{video.name}, tracklets",
            video.frame_rate,
            starts,
            majority,
            seen.image[ends.first] if count else np.empty((0, 4)),
            np.arange(count),
            np.concatenate([np.full(count, -ALWAYS), np.zeros(2 * count), cost]),
            np.ones(3 * count, dtype=np.bool_),
            np.empty((count, len(DETECTION_FEATURES))),
            i,
            j,
            rows,
            np.zeros(3 * count + len(i)),
            none,
        ),
        all_used=True,
    )


def _majority(owners: IntArray) -> int:
    values, counts = np.unique(owners, return_counts=True)
    best = int(counts.argmax())
    return int(values[best]) if 2 * counts[best] >= len(owners) else NOBODY


def labelled(graph: Graph, all_used: bool = False) -> Graph:
    """The graph with the labelled flow of its owners.

    Args:
        graph: its ``labelled`` is not looked at.
        all_used: those of nobody are used, too, each by itself.
    """
    count = len(graph)
    follower = next_of_owner(graph.frames, graph.owners)
    taken = follower[graph.tail] == graph.head if count else np.zeros(0, np.bool_)
    used = np.ones(count, np.bool_) if all_used else graph.owners >= 0
    starts, ends = used.copy(), used.copy()
    starts[graph.head[taken]] = False
    ends[graph.tail[taken]] = False
    flow = np.concatenate([used, starts, ends, taken]).astype(np.float64)
    return replace(graph, labelled=flow)


def next_of_owner(frames: IntArray, owners: IntArray) -> IntArray:
    """``(N,)`` the next detection of the same person in time, -1 where there is none."""
    order = np.lexsort([frames, owners])
    same = (owners[order[:-1]] == owners[order[1:]]) & (owners[order[:-1]] >= 0)
    follower = np.full(len(frames), -1, dtype=np.int64)
    follower[order[:-1][same]] = order[1:][same]
    return follower


def taken_out(graph: Graph, which: BoolArray) -> Graph:
    """The graph without some of its detections; the labelled flow is to be made anew."""
    kept = ~which
    place = np.cumsum(kept) - 1
    links = kept[graph.tail] & kept[graph.head]
    nodes = np.tile(kept, 3)
    return replace(
        graph,
        frames=graph.frames[kept],
        owners=graph.owners[kept],
        boxes=graph.boxes[kept],
        tracks=graph.tracks[kept],
        costs=graph.costs[np.append(nodes, links)],
        fixed=graph.fixed[nodes],
        detections=graph.detections[kept],
        tail=place[graph.tail[links]],
        head=place[graph.head[links]],
        links=graph.links[links],
        labelled=graph.labelled[np.append(nodes, links)],
        origin=None if graph.origin is None else graph.origin.select(kept),
    )


def windows(graph: Graph, seconds: float, step: float | None = None) -> list[Graph]:
    """The graph cut into windows of so many seconds that start every ``step`` seconds, by default end to end."""
    length = max(1, round(seconds * graph.frame_rate))
    apart = max(1, round((step or seconds) * graph.frame_rate))
    last = int(graph.frames.max(initial=0))
    return [window(graph, first, first + length) for first in range(0, last + 1, apart)]


def window(graph: Graph, first: int, end: int) -> Graph:
    """The frames from ``first`` to before ``end``, with starts and ends that the video beyond makes cheaper."""
    count = len(graph)
    inside = (graph.frames >= first) & (graph.frames < end)
    start, stop = graph.costs[count : 2 * count].copy(), graph.costs[2 * count : 3 * count].copy()
    link = np.maximum(graph.costs[3 * count :], 0.0)
    entering = ~inside[graph.tail] & inside[graph.head]
    leaving = inside[graph.tail] & ~inside[graph.head]
    before, after = start.copy(), stop.copy()
    np.minimum.at(start, graph.head[entering], link[entering])
    np.minimum.at(stop, graph.tail[leaving], link[leaving])
    fixed = graph.fixed | np.concatenate([np.zeros(count, np.bool_), start < before, stop < after])
    costs = np.concatenate([graph.costs[:count], start, stop, graph.costs[3 * count :]])
    people = graph.people[(graph.people >= first) & (graph.people < end)]
    cut = replace(graph, costs=costs, fixed=fixed, people=people, name=f"{graph.name}, frames {first + 1}-{end}")
    always = bool(count) and bool((graph.costs[:count] <= -ALWAYS).all())
    return labelled(taken_out(cut, ~inside), all_used=always)


def _short_runs(graph: Graph, fewest: int) -> BoolArray:
    """Detections of labelled runs that are shorter than the shortest track: neither right nor wrong."""
    count = len(graph)
    label = np.arange(count)
    taken = graph.labelled[3 * count :] > 0
    for tail, head in sorted(zip(graph.tail[taken].tolist(), graph.head[taken].tolist(), strict=True)):
        label[head] = label[tail]
    return np.asarray((np.bincount(label, minlength=count)[label] < fewest) & (graph.owners >= 0))


def _links_to_make(frames: IntArray, owners: IntArray) -> int:
    return int((next_of_owner(frames, owners) >= 0).sum())
