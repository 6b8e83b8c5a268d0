"""Fits on some sequences and tracks on others: the units that are kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

from tsuiseki.tracking.association.learnt_costs import Affinity, CostChanges
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.association.fitting import Fit, NetworkChanges, fit_network
from tsuiseki.trainers.association.flow_loss import Problem, cheapest
from tsuiseki.trainers.association.graphs import DetectedVideo, Graphs
from tsuiseki.trainers.association.sequence_graphs import sequence_graphs
from tsuiseki.trainers.association.windows import affordable
from tsuiseki.trainers.experiments.association.labelled import read_labels
from tsuiseki.trainers.experiments.association.sequences import Clip, read_clip, table_of
from tsuiseki.trainers.experiments.end_to_end.simple_changes import Shrunk


def video_of(clip: Clip) -> DetectedVideo:
    """The detections and labels of a sequence."""
    return DetectedVideo(clip.name, read_clip(clip), read_labels(clip), clip.rate, _size(clip))


@lru_cache(maxsize=40)
def graphs_of_clip(clip: Clip) -> Graphs:
    """The networks of a sequence, at the tracker's own costs."""
    return _graphs(clip, None)


def _graphs(clip: Clip, changes: CostChanges | None) -> Graphs:
    graphs = sequence_graphs(video_of(clip), changes=changes)
    return replace(graphs, detections=affordable(graphs.detections))


def learnable(clips: Sequence[Clip], changes: CostChanges | None = None) -> list[Graphs]:
    """The networks of those sequences that have detections, along the tracks at changed costs if there are any.

    Args:
        clips: the sequences.
        changes: the changed costs.
    """
    every = [graphs_of_clip(clip) if changes is None else _graphs(clip, changes) for clip in clips]
    return [graphs for graphs in every if len(graphs.detections) and len(graphs.detections.tail)]


def learnt_changes(train: Sequence[Clip], fit: Fit) -> NetworkChanges:
    """What is learnt through the flow."""
    return NetworkChanges(fit_network(learnable(train), fit))


def default_table(clip: Clip) -> FloatArray:
    """Tracks at the tracker's own costs, see `table_of`."""
    return tracked(clip, None)


def learnt_tables(train: tuple[Clip, ...], tests: tuple[Clip, ...], fit: Fit) -> list[FloatArray]:
    """Tracks of ``tests`` by a network that was fitted through the flow on ``train``."""
    changes = learnt_changes(train, fit)
    return [tracked(clip, changes) for clip in tests]


def shared_tables(
    train: tuple[Clip, ...], tests: tuple[Clip, ...], fit: Fit, shares: tuple[tuple[float, float], ...]
) -> list[list[FloatArray]]:
    """As `learnt_tables`, for each share of the changes of links and joins, and of detections."""
    changes = NetworkChanges(fit_network(learnable(train), replace(fit, trust=1.0)))
    return [[tracked(clip, Shrunk(changes, *share)) for clip in tests] for share in shares]


def shipped_table(clip: Clip) -> FloatArray:
    """Tracks with the costs of pairs that ship, by boxes alone."""
    pairs = Affinity(shipped("affinity_people"), 1)
    return _table(clip, FlowTracker(None, pairs, pairs.observation, clip.rate, _size(clip)))


def tracked(clip: Clip, changes: CostChanges | None) -> FloatArray:
    """Tracks by boxes alone."""
    return _table(clip, FlowTracker(frame_rate=clip.rate, size=_size(clip), changes=changes))


def lost_links(clip: Clip) -> list[int]:
    """What becomes of the links of the labels at the tracker's own costs, before tracklets are joined.

    Returns:
        All; those that the tracker does not consider; those that its flow takes; of those considered and not taken,
        those with an end that the flow does not use; and links that it takes and that are not of one person.
    """
    graphs = graphs_of_clip(clip)
    graph, count = graphs.detections, len(graphs.detections)
    flow = cheapest(Problem(graph.costs, graph.tail, graph.head)) > 0
    used, taken = flow[:count], flow[3 * count :]
    right = graph.labelled[3 * count :] > 0
    one_person = (graph.owners[graph.tail] == graph.owners[graph.head]) & (graph.owners[graph.tail] >= 0)
    unused = right & ~taken & ~(used[graph.tail] & used[graph.head])
    counted = (right & taken, unused, taken & ~one_person)
    return [int(right.sum()) + graphs.lost, graphs.lost, *(int(part.sum()) for part in counted)]


def _table(clip: Clip, tracker: FlowTracker) -> FloatArray:
    for found in read_clip(clip):
        tracker.update(found)
    return table_of(tracker.tracks())


def _size(clip: Clip) -> tuple[int, int] | None:
    return clip.size if min(clip.size) > 0 else None
