"""Trackers by name: what scores that are probabilities change."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from tsuiseki.tracking.association.costs import ProbabilityCost
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.people import tracker_choice as methods
from tsuiseki.tracking.people.settings import METHODS, ONLINE, MethodSettings
from tsuiseki.tracking.people.tracker_choice import people_tracker, score_scale, straddles
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.video.source import open_source
from tsuiseki.tracking.weights import shipped


def test_a_method_has_its_tracker_and_its_settings() -> None:
    assert {*METHODS} == {"flow", *ONLINE} == {field.name for field in fields(MethodSettings)}


@pytest.mark.parametrize(("score", "expected"), [(0.65, [60]), (0.6, [])])
def test_who_is_more_likely_there_than_not_is_kept(score: float, expected: list[int]) -> None:
    """One who walks past, found in each of 60 frames with a score that is a probability."""
    tracker = people_tracker("flow", scores=ProbabilityCost())
    for frame in range(60):
        tracker.update(Detections(np.array([[10.0 + frame, 20, 30 + frame, 70]]), np.array([score])))
    assert [len(track) for track in tracker.tracks()] == expected


def two_and_one_between(drop: bool) -> int:
    """Tracks of two who walk side by side, and of what is found half on either in every frame."""
    tracker = people_tracker("flow", scores=ProbabilityCost(), drop_straddling=drop)
    for frame in range(60):
        left = frame + np.array([10.0, 30.0, 20.0])
        boxes = np.stack([left, np.full(3, 20.0), left + 21, np.full(3, 80.0)], axis=1)
        tracker.update(Detections(boxes, np.array([0.95, 0.95, 0.8])))
    tracks = tracker.tracks()
    assert [track.id for track in tracks] == list(range(1, len(tracks) + 1))
    return len(tracks)


def test_nobody_stands_half_in_each_of_two_people() -> None:
    assert two_and_one_between(drop=True) == 2
    assert two_and_one_between(drop=False) == 3


def test_tracks_of_this_toolkits_detectors_may_straddle_and_given_ones_may_not() -> None:
    assert straddles(Detector(shipped("detector_street"), threads=1))
    assert not straddles([Detections(np.empty((0, 4)), np.empty(0))])


def test_a_method_without_a_start_score_takes_given_scores_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    video, given = open_source([np.zeros((24, 32, 3), np.uint8)]), [Detections.empty()]
    monkeypatch.setattr(methods, "METHODS", (*METHODS, "nearest"))
    monkeypatch.setattr(MethodSettings, "nearest", object(), raising=False)
    assert score_scale(given, "nearest", MethodSettings(), video) is None
    assert score_scale(given, "sort", MethodSettings(), video) is not None
