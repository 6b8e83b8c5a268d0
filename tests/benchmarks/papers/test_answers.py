"""The experiment that counts on generated streets."""

import json

import numpy as np
import pytest

from benchmarks.papers.__main__ import main
from benchmarks.papers.answers import scene_in, true_answers, true_crossings, true_stays
from tsuiseki.tracking.types import Track


@pytest.mark.slow
def test_a_street_is_counted_and_told(tmp_path, capsys):
    words = ["--streets", "1", "--frames", "60", "--data", str(tmp_path / "none"), "--cache", str(tmp_path / "cache")]
    assert main(["answers", *words, "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert "1 streets, all boxes" in told
    assert "passed over" in told
    values = json.loads((tmp_path / "out/results.json").read_text())
    assert values["all boxes"][0]["runs"][0]["errors"] == [0, 0, 0, 0]
    (dithering,) = values["dithering"][0]["runs"]
    assert (dithering["errors"], dithering["true"]) == ([0, 0, 0, 0], [0, 0, 10, 0])


def test_the_truth_in_closed_form():
    ends = np.array([[0.0, 50.0], [100.0, 50.0]])
    across = [(50, 40), (50, 60), (50, 40)]
    assert true_crossings(np.array(across, float), np.full(3, 20.0), ends) == [(1, 1), (2, -1)]
    assert true_crossings(np.array(across, float), np.full(3, 200.0), ends) == []
    assert true_crossings(np.array([(150, 40), (150, 60)], float), np.full(2, 20.0), ends) == []
    scene = scene_in((100, 100))
    boxes = np.array([[58.0, 50, 62, 60]] * 5)
    found = true_answers([Track(1, np.arange(5), boxes, np.ones(5))], scene, 8, 5.0)
    assert found["occupancy"] == [1] * 5 + [0] * 3
    assert (found["dwell"], found["stay"]) == pytest.approx((1.0, 1.0))


def test_a_visit_within_the_band_is_no_stay_and_a_brief_leave_ends_none():
    """The band is two deep."""
    depths = np.array([-9, 1, -9, 1, 5, -1, 5, -9, -9, 3.0])
    assert true_stays(depths, np.full(10, 10.0)) == [(3, 6), (9, 9)]
    assert true_stays(np.array([1.0, -9, 1]), np.full(3, 10.0)) == [(0, 0), (2, 2)]
    assert true_stays(np.array([-9.0, 1, -9]), np.full(3, 10.0)) == []
