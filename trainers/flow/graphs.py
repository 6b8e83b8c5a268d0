"""A labelled sequence with its detections, its flow networks, the labelled flow x* in them, and windows of them.

**Networks.** The tracker runs over the given detections; at its last round its links, their features and their costs by
default are kept. So the network learns on exactly what it will be asked, second level included: the tracklets found and
the joins of their ends form a network of the same kind.

**Labelled flow.** A detection is a person's whom it overlaps by 0.5, one to one. Detections of a person that follow
each other are linked where the tracker considers that link; where it does not, the labelled track ends and starts
again. False positives are not used. Those on an ignored label are taken out, for it is unknown whether they are
right, and so are labelled runs that are shorter than the shortest track. People without detections have no arc; they
only count in MOTA.

**Windows.** A window holds the detections of some frames and the links between them. Beyond its first frame the video
goes on: whatever flow there is outside, a track can come in over a link, and then pays for that link and no start. So a
start at a detection with links from before the window costs no more than the cheapest of them, at least 0; ends
likewise. In the first frame after a border that is next to nothing, at the true beginning of the video it is the full
cost, as in the tracker. These costs are constants: no gradient goes through them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.video_pictures import Picture
from tsuiseki.tracking.association.chain_motion import beliefs_along
from tsuiseki.tracking.association.detection_tables import DetectionTable
from tsuiseki.tracking.association.evidence import (
    DETECTION_FEATURES,
    JOIN_FEATURES,
    LinkParts,
    LinkWeigher,
    detection_evidence,
    link_evidence,
)
from tsuiseki.tracking.association.flow_rounds import AVERAGED, mean_features
from tsuiseki.tracking.association.flow_window import FlowWindow
from tsuiseki.tracking.association.inference_times import InferenceTimes
from tsuiseki.tracking.association.network_flow import Ends
from tsuiseki.tracking.association.tracklets import MISS_OF_JOIN, MOST_FOR_JOIN, evidence_of_joins, join_parts
from tsuiseki.tracking.evaluation.coverage import IGNORED, UNMATCHED, owners_of
from tsuiseki.tracking.features.camera_motion import CameraStep
from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.people.flow_input import FlowInput, FlowSettings
from tsuiseki.tracking.types import BoolArray, Columns, Detections, FloatArray, IntArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.flow.flow_layer import FlowWindows
from tsuiseki.trainers.flow.flow_loss import labelled_flow


@dataclass(frozen=True)
class DetectedVideo:
    """Detections and labels of one sequence.

    Attributes:
        name: for people to read.
        detections: of each frame.
        truth: labels, frames counted from 0.
        frame_rate: frames a second.
        size: width and height of the image; None where not known.
        images: one a frame; none where not needed.
        anchors: of each frame the ``(N,)`` anchors of a detector that its detections come from; none where unknown.
        camera: its step into each frame, from the images; none takes the boxes.
        detections_file: file of detections beside the labels; None where there is none.
    """

    name: str
    detections: Sequence[Detections]
    truth: GroundTruth
    frame_rate: float
    size: tuple[int, int] | None
    images: tuple[Picture, ...] = ()
    anchors: tuple[IntArray, ...] = ()
    camera: tuple[CameraStep, ...] = ()
    detections_file: Path | None = None

    def path(self) -> CameraPath | None:
        """Where the frames lie, from the images; None where the boxes have to tell."""
        if not self.camera:
            return None
        path = CameraPath()
        for step in self.camera:
            path.follow(step)
        return path


@dataclass(frozen=True)
class Origin(Columns):
    """Where the detections of a network come from, for a detector to learn.

    Attributes:
        anchors: ``(N,)`` of the detector.
        logits: ``(N,)`` of its scores.
        slope: of the straight line that fits the logits of the probabilities, which the tracker takes scores for, to
            those of the scores.
        cost_slope: by how much a detection costs more a unit of the logit of its probability; below 0.
    """

    anchors: IntArray
    logits: FloatArray
    slope: float
    cost_slope: float


@dataclass(frozen=True)
class Nodes(Columns):
    """Detections, or the first ones of tracklets.

    Attributes:
        frames: ``(N,)`` of each.
        owners: ``(N,)`` whose each is, below 0 for a false positive.
        boxes: ``(N, 4)`` where the image shows them, pixels.
        tracks: ``(N,)`` track of each by default, -1 for none.
    """

    frames: IntArray
    owners: IntArray
    boxes: FloatArray
    tracks: IntArray


# No indices.
NONE = np.empty(0, dtype=np.int64)
# What a window has no others of.
NO_NODES = Nodes(NONE, NONE, np.empty((0, 4)), NONE)


@dataclass(frozen=True)
class Graph:
    """A network at the tracker's costs, its features, and the labelled flow.

    Attributes:
        name: of the sequence, and of the frames of a window.
        frame_rate: frames a second.
        nodes: N detections or tracklets.
        costs: ``(3 N + P,)`` by default: of use, starts, ends and links.
        fixed: ``(3 N,)`` those of use, starts and ends that are not learnt.
        detections: ``(N, G)`` features; without columns where those costs are fixed.
        tail: ``(P,)``.
        head: ``(P,)``.
        links: ``(P, F)`` features.
        labelled: ``(3 N + P,)`` x*.
        people: frames of the labelled boxes, those without a detection included.
        images: of the sequence, one a frame; none where not needed.
        origin: where the detections come from; None where not known.
        truth: labels of the sequence; None where not needed.
        others: detections that are in tracks and not in the network, for labels do not say whether they are right;
            appearance is averaged over them, too.
    """

    name: str
    frame_rate: float
    nodes: Nodes
    costs: FloatArray
    fixed: BoolArray
    detections: FloatArray
    tail: IntArray
    head: IntArray
    links: FloatArray
    labelled: FloatArray
    people: IntArray
    images: tuple[Picture, ...] = ()
    origin: Origin | None = None
    truth: GroundTruth | None = None
    others: Nodes = NO_NODES

    def __len__(self) -> int:
        return len(self.nodes)

    @property
    def flow_windows(self) -> FlowWindows:
        """The network as a window for `FlowLayer`."""
        nodes = self.nodes
        return FlowWindows(nodes.frames, nodes.owners, self.tail, self.head, np.array([len(self)]), self.labelled)


@dataclass(frozen=True)
class Graphs:
    """The two levels of a sequence.

    Attributes:
        detections: links of detections.
        tracklets: joins of the tracklets that the flow over the detections gives.
    """

    detections: Graph
    tracklets: Graph


# A tracklet is used whatever it costs.
ALWAYS = 1000.0


def labelled(graph: Graph, all_used: bool = False) -> Graph:
    """The graph with the labelled flow of its owners.

    Args:
        graph: its ``labelled`` is not used.
        all_used: false positives are used, too, each by itself.
    """
    nodes = graph.nodes
    return replace(graph, labelled=labelled_flow(nodes.frames, nodes.owners, graph.tail, graph.head, all_used))


def taken_out(graph: Graph, which: BoolArray) -> Graph:
    """The graph without some of its detections, of which those in tracks become its others; x* is to be made anew."""
    extra = graph.nodes.select(which & (graph.nodes.tracks >= 0))
    return replace(without(graph, which), others=graph.others.and_then(extra))


def without(graph: Graph, which: BoolArray) -> Graph:
    """The graph without some of its detections, as if they had never been; the labelled flow is to be made anew."""
    return kept_of(graph, ~which, ~which[graph.tail] & ~which[graph.head])


def kept_of(graph: Graph, nodes: BoolArray, links: BoolArray) -> Graph:
    """The graph with some of its detections ``(N,)`` and some of the links between them ``(P,)``."""
    place, three = np.cumsum(nodes) - 1, np.tile(nodes, 3)
    return replace(
        graph,
        nodes=graph.nodes.select(nodes),
        detections=graph.detections[nodes],
        **{name: getattr(graph, name)[np.append(three, links)] for name in ("costs", "labelled")},
        fixed=graph.fixed[three],
        tail=place[graph.tail[links]],
        head=place[graph.head[links]],
        links=graph.links[links],
        origin=None if graph.origin is None else graph.origin.select(nodes),
    )


def short_runs(graph: Graph, fewest: int) -> BoolArray:
    """``(N,)`` detections of labelled runs that are shorter than the shortest track: neither right nor wrong."""
    count = len(graph)
    label = np.arange(count)
    joined = graph.labelled[3 * count :] > 0
    for tail, head in sorted(zip(graph.tail[joined].tolist(), graph.head[joined].tolist(), strict=True)):
        label[head] = label[tail]
    return np.asarray((np.bincount(label, minlength=count)[label] < fewest) & (graph.nodes.owners >= 0))


# Scores nearer to 0 and 1 count as this.
CERTAIN = 1e-6
# Least slope of the logit: a video that trusts all scores alike still lets a little gradient through.
FLATTEST = 0.1


def sequence_graphs(video: DetectedVideo, settings: FlowSettings | None = None) -> Graphs:
    """The networks of both levels of a sequence, at the tracker's costs by default.

    Args:
        video: the sequence.
        settings: of the tracker.
    """
    settings = settings or FlowSettings().alike()
    preparing = FlowInput(settings.input, InferenceTimes(video.frame_rate), video.size, video.path())
    table, scores, _ = preparing.rows(list(video.detections) or [Detections.empty()])
    settings = replace(settings, costs=preparing.flow_costs(settings.costs))
    probability = preparing.probability(scores)
    observation = settings.input.detection(probability, video.frame_rate)
    logit = np.log(probability / (1 - probability))
    window = FlowWindow(settings.costs, video.frame_rate, video.size)
    window.add(table)
    if len(table):
        window.solve(observation, first_costs=preparing.first_costs(scores))
    owners = owners_of(table.frames, table.image, video.truth)
    labels = window.labels() if len(table) else np.empty(0, np.int64)
    parts = _link_parts(table, window, labels, settings)
    graph = _detection_graph(video, table, owners, labels, parts, observation, logit, settings)
    return Graphs(graph, _tracklet_graph(video, table, owners, labels, settings))


def _link_parts(table: DetectionTable, window: FlowWindow, labels: IntArray, settings: FlowSettings) -> LinkParts:
    """All links that the tracker considers, at the costs along its tracks without learnt changes."""
    links, cost = window.links, settings.costs.link
    pairs = np.searchsorted(table.numbers, links.tail), np.searchsorted(table.numbers, links.head)
    means = None if table.features is None else mean_features(table, labels, table.features, AVERAGED)
    weigher = LinkWeigher(table, cost, beliefs_along(labels, table.measured, cost.motion), means=means, labels=labels)
    return weigher.parts(pairs, np.inf, links.hidden)[1]


def _detection_graph(
    video: DetectedVideo,
    table: DetectionTable,
    owners: IntArray,
    tracks: IntArray,
    parts: LinkParts,
    observation: FloatArray,
    logit: FloatArray,
    settings: FlowSettings,
) -> Graph:
    costs = settings.costs
    features = detection_evidence(table, observation, logit)
    links = link_evidence(table, parts, costs.link.motion)
    graph = Graph(
        video.name,
        video.frame_rate,
        Nodes(table.frames, owners, table.image, tracks),
        np.concatenate([observation, np.full(len(table), costs.entry), np.full(len(table), costs.exit), parts.cost]),
        np.zeros(3 * len(table), dtype=np.bool_),
        features,
        parts.i,
        parts.j,
        links,
        np.zeros(3 * len(table) + len(parts.i)),
        video.truth.select(video.truth.evaluated).frames,
        tuple(video.images),
        _origin(video, table, logit, settings) if video.anchors else None,
        video.truth,
    )
    graph = labelled(taken_out(graph, owners == IGNORED))
    short = short_runs(graph, settings.fewest(video.frame_rate))
    return labelled(taken_out(graph, short))


def _origin(video: DetectedVideo, table: DetectionTable, logit: FloatArray, settings: FlowSettings) -> Origin:
    """The anchors and scores of the detections that the tracker took, which leaves out duplicates."""
    anchors, scores = np.empty(len(table), dtype=np.int64), np.empty(len(table))
    for frame in np.unique(table.frames):
        here, detections = np.flatnonzero(table.frames == frame), video.detections[frame]
        which = (table.image[here, None] == detections.boxes[None]).all(axis=2).argmax(axis=1)
        anchors[here], scores[here] = video.anchors[frame][which], detections.scores[which]
    logits = np.clip(scores, CERTAIN, 1 - CERTAIN)
    logits = np.log(logits / (1 - logits))
    spread = float(((logits - logits.mean()) ** 2).sum()) if len(logits) else 0.0
    slope = float(((logits - logits.mean()) * logit).sum()) / spread if spread > 0 else 0.0
    detection = settings.input.detection
    low, high = detection(np.array([0.4, 0.6]), video.frame_rate)
    logit_cost = float(high - low) / (2 * np.log(1.5))
    return Origin(anchors, logits, max(slope, FLATTEST), logit_cost)


def _tracklet_graph(
    video: DetectedVideo, table: DetectionTable, owners: IntArray, labels: IntArray, settings: FlowSettings
) -> Graph:
    """Tracklets in place of detections, joins of their ends in place of links; an owner has half of one."""
    ends = Ends.of(labels)
    count = len(ends.track)
    i, j, cost, rows = NONE, NONE, np.empty(0), np.empty((0, len(JOIN_FEATURES)))
    if count:
        link = replace(settings.costs.link, miss=MISS_OF_JOIN)
        parts = join_parts(table, labels, None, link)
        near = np.flatnonzero(parts.cost < 3 * MOST_FOR_JOIN)
        i, j = (np.searchsorted(ends.track, labels[end[near]]) for end in (parts.i, parts.j))
        cost = parts.cost[near] - MOST_FOR_JOIN
        rows = evidence_of_joins(table, labels, parts, link)[near]
    majority = np.array([_majority(owners[labels == track]) for track in ends.track.tolist()], dtype=np.int64)
    graph = Graph(
        f"{video.name}, tracklets",
        video.frame_rate,
        Nodes(table.frames[ends.first], majority, table.image[ends.first], np.arange(count)),
        np.concatenate([np.full(count, -ALWAYS), np.zeros(2 * count), cost]),
        np.ones(3 * count, dtype=np.bool_),
        np.empty((count, len(DETECTION_FEATURES))),
        i,
        j,
        rows,
        np.zeros(3 * count + len(i)),
        NONE,
    )
    # It is unknown what follows an ignored one.
    return labelled(without(graph, majority == IGNORED), all_used=True)


def _majority(owners: IntArray) -> int:
    """Who has half of the detections of a tracklet or more; `UNMATCHED` for nobody."""
    values, counts = np.unique(owners, return_counts=True)
    best = int(counts.argmax())
    return int(values[best]) if 2 * counts[best] >= len(owners) else UNMATCHED


def windows(graph: Graph, seconds: float) -> list[Graph]:
    """The graph cut into windows of so many seconds, of two frames at least, end to end."""
    length = max(2, round(seconds * graph.frame_rate))
    return [
        window(graph, first, first + length) for first in range(0, int(graph.nodes.frames.max(initial=0)) + 1, length)
    ]


def window(graph: Graph, first: int, end: int) -> Graph:
    """The frames from ``first`` to before ``end``, with starts and ends that the video beyond makes cheaper."""
    count = len(graph)
    inside = (graph.nodes.frames >= first) & (graph.nodes.frames < end)
    start, stop = graph.costs[count : 2 * count].copy(), graph.costs[2 * count : 3 * count].copy()
    link = np.maximum(graph.costs[3 * count :], 0.0)
    entering = ~inside[graph.tail] & inside[graph.head]
    leaving = inside[graph.tail] & ~inside[graph.head]
    dearest_start, dearest_stop = start.copy(), stop.copy()
    np.minimum.at(start, graph.head[entering], link[entering])
    np.minimum.at(stop, graph.tail[leaving], link[leaving])
    fixed = graph.fixed | np.concatenate([np.zeros(count, np.bool_), start < dearest_start, stop < dearest_stop])
    costs = np.concatenate([graph.costs[:count], start, stop, graph.costs[3 * count :]])
    people = graph.people[(graph.people >= first) & (graph.people < end)]
    cut = replace(graph, costs=costs, fixed=fixed, people=people, name=f"{graph.name}, frames {first + 1}-{end}")
    always = bool(count) and bool((graph.costs[:count] <= -ALWAYS).all())
    others = graph.others.select((graph.others.frames >= first) & (graph.others.frames < end))
    return labelled(replace(without(cut, ~inside), others=others), all_used=always)


@dataclass
class FlowCounts:
    """What a flow does right and wrong, added up over windows.

    Attributes:
        agreeing: links and detections on which it and the labelled flow agree, of those that either has.
        either: those that either has.
        missed: labelled boxes that no used detection shows.
        false: used false positives.
        switches: links between two people.
        people: labelled boxes.
    """

    agreeing: float = 0.0
    either: float = 0.0
    missed: float = 0.0
    false: float = 0.0
    switches: float = 0.0
    people: float = 0.0

    def add(self, graph: Graph, flow: FloatArray) -> None:
        """Take in the flow ``(3 N + P,)`` of a window."""
        count = len(graph)
        chosen = np.r_[0:count, 3 * count : len(flow)]
        self.agreeing += float(np.minimum(flow, graph.labelled)[chosen].sum())
        self.either += float(np.maximum(flow, graph.labelled)[chosen].sum())
        used, links = flow[:count] > 0, flow[3 * count :] > 0
        owners = graph.nodes.owners
        right = float((used & (owners >= 0)).sum())
        self.people += len(graph.people)
        self.missed += max(len(graph.people) - right, 0.0)
        self.false += float((used & (owners < 0)).sum())
        tail, head = owners[graph.tail[links]], owners[graph.head[links]]
        self.switches += float(((tail != head) & (tail >= 0) & (head >= 0)).sum())

    @classmethod
    def together(cls, parts: Sequence[FlowCounts]) -> FlowCounts:
        """The counts of some sequences added up."""
        return cls(*(sum(getattr(counts, x.name) for counts in parts) for x in fields(cls)))

    @property
    def agreement(self) -> float:
        """Share on which the flow and x* agree."""
        return self.agreeing / max(self.either, 1.0)

    @property
    def mota(self) -> float:
        """1 − (missed + false + switches) / people."""
        return 1 - (self.missed + self.false + self.switches) / max(self.people, 1.0)


def track_numbers(graph: Graph, flow: FloatArray) -> IntArray:
    """``(N,)`` which track each node is in by a flow ``(3 N + P,)``, numbered from 0; -1 for those that none uses."""
    count = len(graph)
    numbers = np.full(count, -1, dtype=np.int64)
    links = flow[3 * count :] > 0
    before = np.full(count, -1, dtype=np.int64)
    before[graph.head[links]] = graph.tail[links]
    tracks = 0
    for node in np.lexsort([graph.nodes.frames]):
        if flow[node] > 0 and before[node] >= 0:
            numbers[node] = numbers[before[node]]
        elif flow[node] > 0:
            numbers[node], tracks = tracks, tracks + 1
    return numbers
