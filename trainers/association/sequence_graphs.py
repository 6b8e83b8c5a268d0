"""The flow networks of labelled sequences, as the tracker builds them, with the labelled flow x* of both levels.

The tracker runs over the given detections; at its last round its links, their features and their costs
by default are kept. So the network learns on exactly what it will be asked, second level included: the tracklets found
and the joins of their ends form a network of the same kind.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

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
from tsuiseki.tracking.people.flow_input import FlowInput, FlowSettings
from tsuiseki.tracking.types import Detections, FloatArray, IntArray
from tsuiseki.trainers.association.graphs import (
    ALWAYS,
    DetectedVideo,
    Graph,
    Graphs,
    Origin,
    labelled,
    short_runs,
    taken_out,
    without,
)

# Scores nearer to 0 and 1 count as this; a video that trusts all scores alike still lets a little gradient through.
CERTAIN, FLATTEST = 1e-6, 0.1


def sequence_graphs(
    video: DetectedVideo,
    settings: FlowSettings | None = None,
) -> Graphs:
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
        table.frames,
        owners,
        table.image,
        tracks,
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
        table.features,
    )
    graph = labelled(taken_out(graph, owners == IGNORED))
    short = short_runs(graph, settings.fewest(video.frame_rate))
    return labelled(taken_out(graph, short))


def _origin(video: DetectedVideo, table: DetectionTable, logit: FloatArray, settings: FlowSettings) -> Origin:
    """The anchors and scores of the detections that the tracker took, which leaves out duplicates."""
    anchors, scores = np.empty(len(table), dtype=np.int64), np.empty(len(table))
    for frame in np.unique(table.frames):
        here, found = np.flatnonzero(table.frames == frame), video.detections[frame]
        which = (table.image[here, None] == found.boxes[None]).all(axis=2).argmax(axis=1)
        anchors[here], scores[here] = video.anchors[frame][which], found.scores[which]
    given = np.clip(scores, CERTAIN, 1 - CERTAIN)
    given = np.log(given / (1 - given))
    spread = float(((given - given.mean()) ** 2).sum()) if len(given) else 0.0
    slope = float(((given - given.mean()) * logit).sum()) / spread if spread > 0 else 0.0
    detection = settings.input.detection
    low, high = detection(np.array([0.4, 0.6]), video.frame_rate)
    logit_cost = float(high - low) / (2 * np.log(1.5))
    return Origin(anchors, given, max(slope, FLATTEST), logit_cost, video.truth)


def _tracklet_graph(
    video: DetectedVideo, table: DetectionTable, owners: IntArray, labels: IntArray, settings: FlowSettings
) -> Graph:
    """Tracklets in place of detections, joins of their ends in place of links; an owner has half of one."""
    ends = Ends.of(labels)
    count = len(ends.track)
    none = np.empty(0, dtype=np.int64)
    i, j, cost, rows = none, none, np.empty(0), np.empty((0, len(JOIN_FEATURES)))
    if count:
        link = replace(settings.costs.link, miss=MISS_OF_JOIN)
        parts = join_parts(table, labels, None, link)
        near = np.flatnonzero(parts.cost < 3 * MOST_FOR_JOIN)
        i, j = (np.searchsorted(ends.track, labels[end[near]]) for end in (parts.i, parts.j))
        cost = parts.cost[near] - MOST_FOR_JOIN
        rows = evidence_of_joins(table, labels, parts, link)[near]
    majority = _owners_of_tracks(owners, labels, int(labels.max(initial=-1)) + 1)[ends.track]
    starts = table.frames[ends.first] if count else none
    graph = Graph(
        f"{video.name}, tracklets",
        video.frame_rate,
        starts,
        majority,
        table.image[ends.first] if count else np.empty((0, 4)),
        np.arange(count),
        np.concatenate([np.full(count, -ALWAYS), np.zeros(2 * count), cost]),
        np.ones(3 * count, dtype=np.bool_),
        np.empty((count, len(DETECTION_FEATURES))),
        i,
        j,
        rows,
        np.zeros(3 * count + len(i)),
        none,
    )
    # It is unknown what follows an ignored one.
    return labelled(without(graph, majority == IGNORED), all_used=True)


def _owners_of_tracks(owners: IntArray, labels: IntArray, count: int) -> IntArray:
    """``(count,)`` who has half of each tracklet or more, `UNMATCHED` for those without detections, too."""
    mine = [owners[labels == track] for track in range(count)]
    return np.array([_majority(one) if len(one) else UNMATCHED for one in mine], dtype=np.int64)


def _majority(owners: IntArray) -> int:
    values, counts = np.unique(owners, return_counts=True)
    best = int(counts.argmax())
    return int(values[best]) if 2 * counts[best] >= len(owners) else UNMATCHED
