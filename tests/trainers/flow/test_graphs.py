"""The labelled flow of a sequence and its windows: borders, false detections, people without detections, nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.association.evidence import JOIN_FEATURES
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.flow.flow_loss import cheapest
from tsuiseki.trainers.flow.graphs import DetectedVideo, FlowCounts, Graph, sequence_graphs, window, windows

FRAMES = 60


def video(people: int = 2, clutter: bool = True, unseen: bool = True, frames: int = FRAMES) -> DetectedVideo:
    """People side by side who walk to the right; clutter that stands; one more whom nobody detects."""
    ids, boxes, when, found = [], [], [], []
    for t in range(frames):
        here = [[50 + 3 * t, 60 + 150 * k, 90 + 3 * t, 160 + 150 * k] for k in range(people + unseen)]
        ids += list(range(1, len(here) + 1))
        boxes += here
        when += [t] * len(here)
        shown = here[:people] + ([[500, 300, 520, 340]] if clutter and 10 <= t < 20 else [])
        found.append(Detections(np.array(shown, dtype=float).reshape(-1, 4), np.full(len(shown), 0.9)))
    every = np.ones(len(ids), np.bool_)
    truth = GroundTruth(
        np.array(when, np.int64),
        np.array(ids, np.int64),
        np.array(boxes, float).reshape(-1, 4),
        every,
        ~every,
        np.ones(len(ids)),
    )
    return DetectedVideo("walk", found, truth, 30.0, (640, 480))


@pytest.fixture(scope="module")
def graph() -> Graph:
    return sequence_graphs(video()).detections


def parts(graph: Graph) -> tuple[np.ndarray, ...]:
    count = len(graph)
    return tuple(np.split(graph.labelled, [count, 2 * count, 3 * count]))


def test_labelled_flow(graph: Graph) -> None:
    used, starts, ends, links = parts(graph)
    assert used.sum() == 2 * FRAMES
    assert not used[graph.nodes.owners < 0].any()
    assert (graph.nodes.owners < 0).sum() == 10
    assert starts.sum() == ends.sum() == 2
    assert links.sum() == 2 * (FRAMES - 1)
    taken = links > 0
    assert (graph.nodes.owners[graph.tail[taken]] == graph.nodes.owners[graph.head[taken]]).all()
    assert (graph.nodes.frames[graph.head[taken]] - graph.nodes.frames[graph.tail[taken]] == 1).all()
    assert len(graph.people) == 3 * FRAMES


def test_the_labelled_flow_is_a_flow(graph: Graph) -> None:
    """Where it is made the cheapest of all, the solver finds it."""
    for piece in (graph, *windows(graph, 0.5)):
        found = cheapest(3 * (1 - 2 * piece.labelled), piece.tail, piece.head)
        np.testing.assert_array_equal(found, piece.labelled)


def test_borders_are_free_only_where_the_video_goes_on(graph: Graph) -> None:
    count = len(graph)
    middle, beginning = window(graph, 20, 40), window(graph, 0, 20)
    first, starts = middle.nodes.frames == 20, middle.costs[len(middle) : 2 * len(middle)]
    assert (starts[first] == 0).all()
    assert middle.fixed[len(middle) : 2 * len(middle)][first].all()
    assert (starts[middle.nodes.frames == 39] == graph.costs[count]).all()
    assert (middle.costs[2 * len(middle) : 3 * len(middle)][middle.nodes.frames == 39] == 0).all()
    assert (
        beginning.costs[len(beginning) : 2 * len(beginning)][beginning.nodes.frames == 0] == graph.costs[count]
    ).all()
    assert len(middle.people) == 3 * 20


def test_windows_hold_every_detection_once(graph: Graph) -> None:
    pieces = windows(graph, 0.4)
    assert sum(len(piece) for piece in pieces) == len(graph)
    assert sum(len(piece.people) for piece in pieces) == len(graph.people)
    assert pieces[1].name == "walk, frames 13-24"


def hidden(seconds: float, ignored: tuple[int, ...] = ()) -> DetectedVideo:
    """Two people whom nothing detects for longer than a link reaches; some are labelled as ignored."""
    whole = video(clutter=False, unseen=False, frames=120)
    last = 40 + round(30 * seconds)
    found = [Detections.empty() if 40 <= t < last else one for t, one in enumerate(whole.detections)]
    counts = ~np.isin(whole.truth.ids, ignored)
    truth = replace(whole.truth, evaluated=counts, ignored=~counts)
    return replace(whole, detections=found, truth=truth)


def test_tracklets() -> None:
    joins = sequence_graphs(hidden(1.5)).tracklets
    assert joins.links.shape == (len(joins.tail), len(JOIN_FEATURES))
    assert len(joins) == 4
    # Each person's first half and their second.
    assert joins.labelled[12:].sum() == 2
    assert sorted(joins.nodes.owners) == [1, 1, 2, 2]
    assert (joins.nodes.owners[joins.tail] != joins.nodes.owners[joins.head]).any()
    np.testing.assert_array_equal(cheapest(joins.costs, joins.tail, joins.head), joins.labelled)
    assert joins.fixed.all()


def test_tracklets_of_ignored_people_are_neither_right_nor_wrong() -> None:
    levels = sequence_graphs(hidden(1.5, ignored=(2,)))
    assert set(levels.detections.nodes.owners) == set(levels.tracklets.nodes.owners) == {1}
    assert len(levels.tracklets) == 2
    assert levels.tracklets.labelled[6:].tolist() == [1]


@pytest.mark.parametrize(
    "empty",
    [
        video(people=0, clutter=False, unseen=True),
        video(people=0, clutter=True, unseen=False),
        video(frames=1),
        video(people=0, clutter=False, unseen=False),
    ],
    ids=["no detections", "no people", "one frame", "nothing"],
)
def test_windows_of_next_to_nothing(empty: DetectedVideo) -> None:
    levels = sequence_graphs(empty)
    for graph in (levels.detections, levels.tracklets):
        assert next(graph.flow_windows.arcs()).count == len(graph)
        flow = cheapest(graph.costs, graph.tail, graph.head)
        assert flow.shape == graph.labelled.shape
        counts = FlowCounts()
        counts.add(graph, flow)
        assert counts.switches == 0
    assert levels.detections.labelled.sum() == 0


def test_people_whom_first_prices_leave_out_are_in_tracks_as_in_the_tracker() -> None:
    """A detector that misses every third person and places boxes ill, at 7 frames a second."""
    rng = np.random.default_rng(0)
    rate, frames, people = 7.0, 40, 12
    first, velocity = rng.uniform(0, [600, 400], (people, 2)), rng.normal(0, 1, (people, 2))
    velocity *= 1.2 * 60 / rate / np.linalg.norm(velocity, axis=1, keepdims=True)
    found, labels = [], []
    for t in range(frames):
        size = np.array([25.0, 60.0]) * np.exp(rng.normal(0, 0.1, (people, 2)))
        place = first + velocity * t
        centre = place + rng.normal(0, 3, (people, 2))
        boxes = np.concatenate([centre - size / 2, centre + size / 2], axis=1)[rng.random(people) > 0.3]
        found.append(Detections(boxes, np.ones(len(boxes))))
        half = np.array([12.5, 30.0])
        labels.append(np.concatenate([place - half, place + half], axis=1))
    count = frames * people
    every, ids = np.ones(count, np.bool_), np.tile(np.arange(1, people + 1), frames)
    when = np.repeat(np.arange(frames), people)
    truth = GroundTruth(when, ids, np.concatenate(labels), every, ~every, np.ones(count))
    graph = sequence_graphs(DetectedVideo("poor", found, truth, rate, (800, 600))).detections
    assert (graph.nodes.tracks >= 0).mean() > 0.7


def test_single_labelled_boxes_are_neither_right_nor_wrong() -> None:
    """The tracker drops shorter tracks, so x* has none."""
    whole = video(people=1, clutter=False, unseen=False)
    few = [found if t < 2 else Detections.empty() for t, found in enumerate(whole.detections)]
    assert len(sequence_graphs(DetectedVideo("few", few, whole.truth, 30.0, None)).detections) == 0


def test_counts(graph: Graph) -> None:
    counts = FlowCounts()
    counts.add(graph, graph.labelled)
    assert counts.agreement == 1
    assert counts.false == counts.switches == 0
    # A third of the people are not detected.
    assert counts.mota == pytest.approx(2 / 3)
    # A link from one person to the other, which the tracker would not consider here.
    tail, head = (int(np.flatnonzero(graph.nodes.owners == who)[k]) for who, k in ((1, 0), (2, 1)))
    tails, heads = np.append(graph.tail, tail), np.append(graph.head, head)
    wrong = replace(graph, tail=tails, head=heads, labelled=np.append(graph.labelled, 0.0))
    counts.add(wrong, np.append(graph.labelled, 1.0))
    assert counts.switches == 1
