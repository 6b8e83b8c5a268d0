"""ByteTrack on cases whose matches are known: who takes part in which matching, births, deaths, bad settings."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.people.bytetrack import ByteTrack, ByteTrackSettings
from tsuiseki.tracking.people.contract import run_tracker
from tsuiseki.tracking.people.lifecycle import matched
from tsuiseki.tracking.types import Detections

HERE = [100.0, 100.0, 140.0, 200.0]
SETTINGS = ByteTrackSettings()
HIGH, LOW = 0.9, 0.3


def frame(*rows: tuple[list[float], float]) -> Detections:
    """Detections of boxes and scores."""
    return Detections(np.array([box for box, _ in rows]).reshape(-1, 4), np.array([score for _, score in rows]))


def moved(box: list[float], x: float, y: float = 0.0) -> list[float]:
    return [box[0] + x, box[1] + y, box[2] + x, box[3] + y]


@pytest.mark.parametrize("seed", range(5))
def test_a_matching_has_the_greatest_total_overlap_of_all(seed: int) -> None:
    """Every one-to-one matching of four tracks and five boxes, pairs below the gate counting nothing."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(0, 60, (9, 2))
    boxes = np.concatenate([corners, corners + rng.uniform(30, 50, (9, 2))], axis=1)
    overlaps = iou_matrix(boxes[:4], boxes[4:])
    counting = np.where(overlaps >= 0.2, overlaps, 0)
    best = max(sum(counting[row, column] for row, column in enumerate(p)) for p in itertools.permutations(range(5), 4))
    rows, columns = matched(boxes[:4], boxes[4:], np.arange(4), np.arange(5), 0.2)
    assert overlaps[rows, columns].sum() == pytest.approx(best)
    assert (overlaps[rows, columns] >= 0.2).all()
    assert len(set(columns.tolist())) == len(columns)


def test_a_matching_is_within_its_rows() -> None:
    boxes = np.array([HERE, moved(HERE, 200)])
    rows, columns = matched(boxes, boxes, np.array([0]), np.array([0, 1]), 0.2)
    assert rows.tolist() == columns.tolist() == [0]
    rows, columns = matched(boxes, boxes, np.array([0, 1]), np.array([1]), 0.2)
    assert rows.tolist() == columns.tolist() == [1]


def test_low_scores_carry_a_track_and_start_none() -> None:
    video = [frame((HERE, score), (moved(HERE, 300), LOW)) for score in (HIGH, HIGH, LOW, LOW, LOW, HIGH)]
    (track,) = run_tracker(video, ByteTrack())
    assert track.frames.tolist() == [0, 1, 2, 3, 4, 5]
    assert track.scores.tolist() == [HIGH, HIGH, LOW, LOW, LOW, HIGH]


def test_below_the_lowest_score_is_clutter() -> None:
    video = [frame((HERE, score)) for score in (HIGH, HIGH, 0.05, HIGH)]
    (track,) = run_tracker(video, ByteTrack())
    assert track.frames.tolist() == [0, 1, 3]


def test_a_sure_detection_goes_before_an_unsure_one_that_overlaps_more() -> None:
    near, exact = moved(HERE, 12), HERE
    (track,) = run_tracker([frame((HERE, HIGH))] * 4 + [frame((near, HIGH), (exact, LOW))], ByteTrack())
    assert track.scores[-1] == HIGH
    (track,) = run_tracker([frame((HERE, HIGH))] * 4 + [frame((near, LOW), (exact, LOW))], ByteTrack())
    assert track.boxes[-1, 0] == pytest.approx(HERE[0], abs=1e-6)


def test_an_unsure_detection_must_overlap_more() -> None:
    """At 20 of 40 pixels aside the overlap is a third: enough at a high score, not at a low one."""
    aside = moved(HERE, 20)
    assert len(run_tracker([frame((HERE, HIGH))] * 4 + [frame((aside, HIGH))], ByteTrack())[0]) == 5
    assert len(run_tracker([frame((HERE, HIGH))] * 4 + [frame((aside, LOW))], ByteTrack())[0]) == 4


def test_only_a_sure_detection_brings_a_lost_track_back() -> None:
    gone = [Detections.empty()] * 3
    (track,) = run_tracker([frame((HERE, HIGH))] * 4 + gone + [frame((HERE, LOW))] * 2, ByteTrack())
    assert len(track) == 4
    (track,) = run_tracker([frame((HERE, HIGH))] * 4 + gone + [frame((HERE, HIGH))] * 2, ByteTrack())
    assert track.frames.tolist() == [0, 1, 2, 3, 7, 8]


def test_a_track_starts_above_the_threshold_and_a_tenth_and_is_believed_the_second_time() -> None:
    assert run_tracker([frame((HERE, 0.65))] * 5, ByteTrack()) == []
    assert run_tracker([frame((HERE, HIGH))], ByteTrack()) == []
    (track,) = run_tracker([frame((HERE, HIGH)), frame((HERE, 0.65))], ByteTrack())
    assert len(track) == 2


def test_a_lost_track_is_kept_for_its_age() -> None:
    settings = ByteTrackSettings(min_hits=2, max_age=5, start_score=0.7)
    for gap, tracks in ((5, 1), (6, 2)):
        video = [*[frame((HERE, HIGH))] * 3, *[Detections.empty()] * gap, *[frame((HERE, HIGH))] * 3]
        assert len(run_tracker(video, ByteTrack(settings))) == tracks


def test_what_nobody_scored_counts_as_sure() -> None:
    video = [frame((HERE, score)) for score in (HIGH, HIGH, np.nan)]
    (track,) = run_tracker(video, ByteTrack())
    assert track.scores.tolist() == [HIGH, HIGH, 0]


@pytest.mark.parametrize("wrong", [{"min_iou": 0.0}, {"min_iou_low": 1.1}, {"low_score": 0.7}])
def test_settings_must_make_sense(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        ByteTrackSettings(**wrong)  # type: ignore[arg-type]
