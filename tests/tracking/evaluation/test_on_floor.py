"""Scores of people on a floor, by closed forms."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tsuiseki.tracking.cameras.multicamera import PlacedTruth, read_placed_truth
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.on_floor import evaluate_on_floor

TIMES = np.repeat(np.arange(10.0), 2)
IDS = np.tile([1, 2], 10)
PLACES = np.tile([[0.0, 0.0], [5.0, 0.0]], (10, 1))
TRUTH = PlacedTruth(TIMES, IDS, PLACES)


def test_the_truth_itself_is_perfect():
    scores = evaluate_on_floor(TRUTH, TRUTH)
    assert (scores.idf1, scores.mota, scores.hota, scores.moda, scores.modp) == pytest.approx((1, 1, 1, 1, 1))
    assert (scores.switches, scores.gospa, scores.labelled) == (0, 0, 20)


@pytest.mark.parametrize(("away", "idf1", "moda", "modp"), [(0.2, 1, 1, 0.6), (0.7, 1, -1, 0), (1.2, 0, -1, 0)])
def test_distances_count_within_one_metre_and_within_half(away, idf1, moda, modp):
    moved = PlacedTruth(TIMES, IDS, PLACES + np.array([0.0, away]))
    scores = evaluate_on_floor(TRUTH, moved)
    assert (scores.idf1, scores.moda, scores.modp) == pytest.approx((idf1, moda, modp))
    # Two targets: each costs its squared distance, or a missed and a false one of 1/2 each.
    assert scores.gospa == pytest.approx(np.sqrt(2 * min(away**2, 1.0)))


def test_hota_of_a_distance():
    """A similarity of 1 - 0.4 / 2 = 0.8 passes 16 of the 19 thresholds."""
    scores = evaluate_on_floor(TRUTH, PlacedTruth(TIMES, IDS, PLACES + np.array([0.4, 0.0])))
    assert scores.hota == pytest.approx(16 / 19)


def test_a_switch_halves_the_identity():
    swapped = np.where(TIMES < 5, IDS, 3 - IDS)
    scores = evaluate_on_floor(TRUTH, PlacedTruth(TIMES, swapped, PLACES))
    assert (scores.idf1, scores.switches, scores.mota) == pytest.approx((0.5, 2, 0.9))


def test_misses_and_false_ones():
    keep = IDS == 1
    extra = PlacedTruth(TIMES[keep], IDS[keep], PLACES[keep])
    scores = evaluate_on_floor(TRUTH, extra)
    assert (scores.mota, scores.recall, scores.precision) == pytest.approx((0.5, 0.5, 1.0))


def test_results_between_the_labels_do_not_count():
    fine = PlacedTruth(np.repeat(np.arange(0, 10, 0.1), 2), np.tile([1, 2], 100), np.tile(PLACES[:2], (100, 1)))
    assert evaluate_on_floor(TRUTH, fine).mota == pytest.approx(1.0)


def test_results_of_another_time_are_refused():
    with pytest.raises(RequestError, match=r"expected results at the labels' times, 0 to 9 s, got 100 to 109 s"):
        evaluate_on_floor(TRUTH, PlacedTruth(TIMES + 100, IDS, PLACES))


def test_files(tmp_path):
    path = tmp_path / "truth.csv"
    rows = [f"{t},{i},{x},{y}" for t, i, (x, y) in zip(TIMES, IDS, PLACES, strict=True)]
    path.write_text("time,id,x,y\n" + "\n".join(rows) + "\n")
    empty = tmp_path / "none.csv"
    empty.write_text("time,id,x,y\n")
    words = ["evaluate", "floor", str(path), str(path), str(empty), "--json", str(tmp_path / "scores.json")]
    assert main(words) == 0
    scores = json.loads((tmp_path / "scores.json").read_text())
    assert scores["truth"]["idf1"] == pytest.approx(1.0)
    assert (scores["none"]["mota"], scores["none"]["recall"]) == (0.0, 0.0)
    path.write_text("time,id,x,y\n0,1,0,0\n0,1,2,2\n")
    with pytest.raises(RequestError, match="expected each id once at a time"):
        read_placed_truth(path)


def test_a_part_that_was_tracked_is_scored_on_its_labels(tmp_path, capsys):
    rows = [f"{t},{i},{x},{y}" for t, i, (x, y) in zip(TIMES, IDS, PLACES, strict=True)]
    (tmp_path / "truth.csv").write_text("\n".join(["time,id,x,y", *rows]))
    (tmp_path / "part").mkdir()
    (tmp_path / "part/world.csv").write_text("\n".join(["time,id,x,y", *rows[:8]]))
    (tmp_path / "part/run.json").write_text(json.dumps({"frames": {"time": [0, 1, 2, 3]}}))
    words = [str(tmp_path / name) for name in ("truth.csv", "part", "scores.json")]
    assert main(["evaluate", "floor", *words[:2], "--json", words[2]]) == 0
    assert json.loads((tmp_path / "scores.json").read_text())["part"]["mota"] == pytest.approx(1.0)
    assert "6 labelled moments are left out, for it was tracked from 0 to 3 s" in capsys.readouterr().err


def test_a_page_is_no_table_of_places(tmp_path):
    page = tmp_path / "x.html"
    page.write_text("<!doctype html>\n<p>a, b, c, d</p>\n")
    with pytest.raises(RequestError, match="expected the columns time,id,x,y in its first line, found no time"):
        read_placed_truth(page)
