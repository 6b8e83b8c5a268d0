"""What limits learnt costs: contests of links, what the features tell, and errors mended."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.evaluation.resampling import scores_of
from tsuiseki.tracking.types import Detections
from tsuiseki.trainers.association.graphs import DetectedVideo, Graph
from tsuiseki.trainers.association.sequence_graphs import sequence_graphs
from tsuiseki.trainers.experiments.association.sequences import DataSet, find_clips
from tsuiseki.trainers.experiments.end_to_end import mending, telling
from tsuiseki.trainers.experiments.end_to_end.gradient import crossing
from tsuiseki.trainers.experiments.end_to_end.limits import together, told_table
from tsuiseki.trainers.experiments.end_to_end.runs import default_table
from tsuiseki.trainers.experiments.end_to_end.streets import STREETS, StreetCount, write_streets
from tsuiseki.trainers.experiments.experiment import Bench
from tsuiseki.trainers.experiments.store import Store

SET = DataSet("set", "Set", "set")


@pytest.fixture(scope="module")
def graph() -> Graph:
    return sequence_graphs(crossing(3)).detections


def of_labels(graph: Graph) -> np.ndarray:
    return 1 - 2 * graph.labelled[3 * len(graph) :]


def test_costs_of_the_labels_tell_every_contest(graph: Graph) -> None:
    every = np.ones(len(graph.tail), dtype=np.bool_)
    contested, told = telling.contests(graph, of_labels(graph), every).T
    assert contested.sum() > 20
    np.testing.assert_array_equal(told, contested)
    assert telling.contests(graph, -of_labels(graph), every)[:, 1].sum() == 0


def test_contests_are_counted_as_by_hand(graph: Graph) -> None:
    """By a loop over all right links; links that nothing is known of neither compete nor count."""
    costs = graph.costs[3 * len(graph) :]
    known = np.random.default_rng(0).random(len(costs)) < 0.7
    right, owners = graph.labelled[3 * len(graph) :] > 0, graph.owners
    contested = told = 0
    for k in np.flatnonzero(right & known):
        i, j = graph.tail[k], graph.head[k]
        rivals = [
            costs[m]
            for m in np.flatnonzero(known & ((graph.tail == i) | (graph.head == j)))
            if owners[graph.tail[m]] < 0 or owners[graph.tail[m]] != owners[graph.head[m]]
        ]
        contested += bool(rivals)
        told += bool(rivals) and costs[k] < min(rivals)
    assert telling.contests(graph, costs, known).sum(axis=0).tolist() == [contested, told]
    assert contested > told > 0


def test_the_area_is_the_share_of_pairs_in_order() -> None:
    right, costs = np.array([True, True, False, False]), np.array([-3.0, 0.0, -1.0, 2.0])
    assert telling.area(right, costs) == pytest.approx(3 / 4)
    assert np.isnan(telling.area(right[:2], costs[:2]))


def _detected(graph_of: DetectedVideo) -> DetectedVideo:
    """The video with a false box in every frame, far from everybody."""
    more = [
        Detections(np.concatenate([one.boxes, [[20.0, 300, 60, 400]]]), np.append(one.scores, 0.4))
        for one in graph_of.detections
    ]
    return replace(graph_of, detections=more)


def test_the_other_half_tells_what_features_say() -> None:
    """A false box that stands where nobody comes is told from people; a half that is empty says nothing."""
    graph = sequence_graphs(_detected(crossing(1, 400))).detections
    links, detections = telling.by_its_other_half(graph)
    seen = ~np.isnan(detections)
    assert seen.all()
    assert telling.area(graph.owners >= 0, detections) > 0.95
    inside = (graph.frames[graph.tail] // 125) == (graph.frames[graph.head] // 125)
    assert (np.isnan(links) == ~inside).all()
    short = sequence_graphs(crossing(1)).detections
    assert all(np.isnan(part).all() for part in telling.by_its_other_half(short))


@pytest.fixture(scope="module")
def streets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("streets")
    write_streets(home / "streets", StreetCount(clips=1, frames=20))
    return home


def test_the_tables(streets: Path, tmp_path: Path) -> None:
    clips, bench = find_clips(streets, STREETS), Bench(Store(tmp_path))
    rows = mending.mended(bench, clips, 2.0)
    assert [row.name for row in rows] == [mending.UNFILLED, *mending.MENDED, mending.RIGHT]
    switches = [float(scores_of(row.sums.sum(axis=0))["id_switches"]) for row in rows]
    assert switches[1] <= switches[0]
    # The default's boxes that a detection supports, and no other.
    table = default_table(clips[0])
    np.testing.assert_allclose(
        mending.unfilled_sums(clips[0], table), mending.unfilled_sums(clips[0], table[table[:, 7] > 0])
    )
    one = telling.Told(np.full((4, 3, 2), 2.0), np.array([0.5, 0.6, 0.7, 0.8]), 30)
    none = telling.Told(np.zeros((4, 3, 2)), np.full(4, np.nan), 9)
    counts, areas = together([one, none])
    np.testing.assert_allclose(areas, one.detections)
    assert counts.sum() == 48
    table_of_both = told_table(SET, [one, none])
    assert table_of_both.rows[0] == ["links, one frame", "2", "1.000", "1.000", "1.000", "1.000"]
    assert table_of_both.rows[-1][2:] == ["0.500", "0.600", "0.700", "0.800"]
