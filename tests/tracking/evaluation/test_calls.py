"""Scores in one call: files, folders, labels and tracks are all taken, and what cannot be scored says so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.calls import evaluate_people, evaluate_points, evaluate_target, ground_truth_of
from tsuiseki.tracking.formats.mot import read_ground_truth, write_tracks
from tsuiseki.tracking.types import Estimate, Track


def walk(identity: int, frames: range, lane: float) -> Track:
    steps = np.array(frames, dtype=float)[:, None] * np.array([2, 0, 2, 0])
    return Track(identity, np.array(frames), steps + np.array([10, lane, 40, lane + 80]), np.ones(len(frames)))


RIGHT = [walk(1, range(20), 0), walk(2, range(20), 100)]


def test_the_right_tracks_score_one() -> None:
    scores = evaluate_people(RIGHT, RIGHT)
    assert (scores.hota, scores.mota, scores.idf1) == (1, 1, 1)


def test_half_a_result_scores_half_of_the_boxes() -> None:
    assert evaluate_people(RIGHT, RIGHT[:1]).recall == 0.5
    assert evaluate_people(RIGHT, [walk(1, range(10), 0), walk(2, range(10), 100)], frames="1-10").recall == 1


@pytest.mark.slow
def test_files_folders_and_labels_are_truth(street: Path, tmp_path: Path) -> None:
    truth = read_ground_truth(street / "gt" / "gt.txt")
    keep = [
        Track(int(i), truth.frames[rows], truth.boxes[rows], np.ones(rows.sum()))
        for i in np.unique(truth.ids[truth.evaluated])
        if (rows := (truth.ids == i) & truth.evaluated).any()
    ]
    write_tracks(tmp_path / "tracks.txt", keep)
    for given in (street, str(street), street / "gt" / "gt.txt", truth):
        for result in (keep, tmp_path / "tracks.txt", str(tmp_path)):
            assert evaluate_people(given, result).hota == pytest.approx(1, abs=1e-3)


def test_a_target_is_scored_by_its_estimates_or_boxes() -> None:
    boxes = RIGHT[0].boxes
    estimates = [Estimate(n, box, 1.0, "tracking") for n, box in enumerate(boxes)]
    assert evaluate_target(boxes, boxes).overlaps.mean() == 1
    assert evaluate_target(boxes, iter(estimates)).overlaps.mean() == 1
    assert evaluate_target(boxes, boxes + 1000).overlaps[1:].max() == 0


def test_points_are_the_centres_of_boxes() -> None:
    scores = evaluate_points(RIGHT, RIGHT, 20)
    assert (scores.ospa1, scores.missed, scores.switches) == (0, 0, 0)
    assert evaluate_points(RIGHT, RIGHT[:1], 20).missed == 1


@pytest.mark.parametrize(
    ("truth", "tracks", "message"),
    [
        ([], RIGHT, "expected the truth as a folder, a file or tracks"),
        (7, RIGHT, "expected the truth as a folder, a file or tracks"),
        ("nowhere", RIGHT, "found no nowhere"),
        (RIGHT, "nowhere", "found no nowhere"),
        (RIGHT, [RIGHT[0], RIGHT[0]], "an id twice"),
        (RIGHT, 5, "expected the result as tracks"),
    ],
)
def test_what_cannot_be_scored_says_so(truth: Any, tracks: Any, message: str) -> None:
    with pytest.raises(RequestError, match=message):
        evaluate_people(truth, tracks)


def test_boxes_of_another_shape_say_so() -> None:
    with pytest.raises(RequestError, match="expected `target` as boxes"):
        evaluate_target(RIGHT[0].boxes, np.zeros((20, 3)))


def of_kind(track: Track, number: int, name: str) -> Track:
    return replace(track, origin=np.full((len(track), 2), number), names={number: name})


def test_classes_are_scored_apart() -> None:
    truth = [of_kind(RIGHT[0], 0, "person"), of_kind(RIGHT[1], 2, "car")]
    result = [of_kind(RIGHT[0], 0, "pedestrian"), of_kind(walk(5, range(10), 100), 2, "car")]
    scores = evaluate_people(truth, result, classes=["Person", 2])
    assert {kind: one.recall for kind, one in scores.items()} == {"person": 1.0, 2: 0.5}
    with pytest.raises(RequestError, match="expected tracks of bus in the truth"):
        evaluate_people(truth, result, classes=["bus"])
    with pytest.raises(RequestError, match="labels of one class"):
        evaluate_people(ground_truth_of(RIGHT), result, classes=["car"])
