"""The trackers of people, online and flow, on people whose tracks are known, then what they share, then bad input."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from pydantic import ValidationError

from tests.tracking.people.families import LIFECYCLE
from tsuiseki.tracking.association.costs import ObservationCost, ProbabilityCost
from tsuiseki.tracking.association.flow_window import FlowCosts
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.people.contract import PeopleTracker, run_tracker
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.flow_input import FlowSettings
from tsuiseki.tracking.people.lifecycle import LifecycleSettings
from tsuiseki.tracking.people.settings import METHODS
from tsuiseki.tracking.people.sort import DeepSort, DeepSortSettings, Sort, SortSettings
from tsuiseki.tracking.people.tracker_choice import people_tracker
from tsuiseki.tracking.types import Detections, Track

FLOWS: dict[str, Callable[[], PeopleTracker]] = {
    "whole flow": lambda: FlowTracker(FlowSettings(decide_every=None)),
    "sliding flow": lambda: FlowTracker(FlowSettings(decide_every=0.3)),
    "flow with a delay": lambda: FlowTracker(delay=0.5),
}
CONFIRMING = {method: partial(people_tracker, method) for method in LIFECYCLE} | FLOWS
ANY = {method: partial(people_tracker, method) for method in METHODS} | FLOWS
# Trackers that report only whom several detections confirm.
EACH = pytest.mark.parametrize("make", CONFIRMING.values(), ids=CONFIRMING.keys())
# What the contract asks of a tracker of any method.
CONTRACT = pytest.mark.parametrize("make", ANY.values(), ids=ANY.keys())


def crowd(
    rng: np.random.Generator, people: int, length: int, miss: float = 0.0, clutter: float = 0.0, noise: float = 1.0
) -> tuple[list[Detections], np.ndarray]:
    """People on straight ways in lanes of their own, with looks; and the true boxes ``(length, people, 4)``."""
    looks = np.abs(rng.normal(size=(people, 16))) ** 3
    looks /= np.linalg.norm(looks, axis=1, keepdims=True)
    start = np.stack([rng.uniform(0, 600, people), 120.0 * np.arange(people)], axis=1)
    step = np.stack([rng.uniform(-4, 4, people), rng.uniform(-0.3, 0.3, people)], axis=1)
    corner = start + np.arange(length)[:, None, None] * step
    truth = np.concatenate([corner, corner + np.array([30, 80])], axis=2)
    video = []
    for boxes in truth:
        seen = rng.random(people) >= miss
        false = rng.uniform(0, 600, (rng.poisson(clutter), 2))
        found = np.vstack(
            [(boxes + rng.normal(0, noise, boxes.shape))[seen], np.hstack([false, false + np.array([30, 80])])]
        )
        described = np.vstack([looks[seen], np.abs(rng.normal(size=(len(false), 16)))])
        described = described + rng.normal(0, 0.02, described.shape)
        described /= np.linalg.norm(described, axis=1, keepdims=True)
        scores = np.append(rng.uniform(0.95, 1, seen.sum()), rng.uniform(0.5, 0.7, len(false)))
        order = rng.permutation(len(found))
        video.append(Detections(found[order], scores[order], described[order]))
    return video, truth


def owners(tracks: list[Track], truth: np.ndarray) -> list[set[int]]:
    """For each track the people that its boxes are on."""
    centre = (truth[..., :2] + truth[..., 2:]) / 2
    found = []
    for track in tracks:
        middle = (track.boxes[:, None, :2] + track.boxes[:, None, 2:]) / 2
        found.append(set(np.linalg.norm(centre[track.frames] - middle, axis=2).argmin(axis=1).tolist()))
    return found


@EACH
def test_people_seen_in_every_frame_get_one_track_each(make: Callable[[], PeopleTracker]) -> None:
    video, truth = crowd(np.random.default_rng(0), 5, 30)
    tracks = run_tracker(video, make())
    assert [track.id for track in tracks] == [1, 2, 3, 4, 5]
    assert all(track.frames.tolist() == list(range(30)) for track in tracks)
    assert sorted(next(iter(people)) for people in owners(tracks, truth)) == [0, 1, 2, 3, 4]
    assert all(len(people) == 1 for people in owners(tracks, truth))


@pytest.mark.slow
@EACH
def test_missed_and_false_detections_do_not_break_tracks(make: Callable[[], PeopleTracker]) -> None:
    video, truth = crowd(np.random.default_rng(1), 5, 60, miss=0.1, clutter=0.5)
    tracks = [track for track in run_tracker(video, make()) if len(track) > 20]
    assert sorted(map(tuple, owners(tracks, truth))) == [(0,), (1,), (2,), (3,), (4,)]


@EACH
def test_detections_without_features_do(make: Callable[[], PeopleTracker]) -> None:
    video, truth = crowd(np.random.default_rng(2), 4, 25)
    tracks = run_tracker((Detections(found.boxes, found.scores) for found in video), make())
    assert sorted(map(tuple, owners(tracks, truth))) == [(0,), (1,), (2,), (3,)]


@CONTRACT
def test_same_input_same_tracks_and_own_ids(make: Callable[[], PeopleTracker]) -> None:
    video, _ = crowd(np.random.default_rng(3), 6, 30, miss=0.2, clutter=1.0)
    one, two = make(), make()
    for found in video:
        one.update(found)
        two.update(found)
    assert one.tracks()
    for a, b in zip(one.tracks(), two.tracks(), strict=True):
        assert a.id == b.id
        np.testing.assert_array_equal(a.boxes, b.boxes)


@CONTRACT
def test_the_input_is_never_written_to(make: Callable[[], PeopleTracker]) -> None:
    video, _ = crowd(np.random.default_rng(4), 4, 15, clutter=1.0)
    for found in video:
        for array in (found.boxes, found.scores, found.features):
            assert array is not None
            array.setflags(write=False)
    assert run_tracker(video, make())


@pytest.mark.slow
@CONTRACT
def test_asking_for_tracks_early_changes_nothing(make: Callable[[], PeopleTracker]) -> None:
    video, _ = crowd(np.random.default_rng(5), 4, 31, miss=0.2, clutter=0.5)
    quiet, asked = make(), make()
    for found in video:
        quiet.update(found)
        asked.update(found)
        asked.tracks()
    assert quiet.tracks()
    for a, b in zip(quiet.tracks(), asked.tracks(), strict=True):
        np.testing.assert_array_equal(a.frames, b.frames)
        np.testing.assert_allclose(a.boxes, b.boxes)


@EACH
def test_no_frames_no_detections_one_frame(make: Callable[[], PeopleTracker]) -> None:
    assert make().tracks() == []
    assert run_tracker([Detections.empty()] * 20, make()) == []
    video, _ = crowd(np.random.default_rng(6), 3, 1)
    assert run_tracker(video, make()) == []


@CONTRACT
def test_empty_frames_count_as_frames(make: Callable[[], PeopleTracker]) -> None:
    video, _ = crowd(np.random.default_rng(7), 2, 12)
    tracks = run_tracker([Detections.empty()] * 5 + video, make())
    assert {track.frames[0] for track in tracks} == {5}


@EACH
def test_unknown_features_are_no_obstacle(make: Callable[[], PeopleTracker]) -> None:
    video, truth = crowd(np.random.default_rng(8), 3, 24)
    patchy = []
    for frame, found in enumerate(video):
        assert found.features is not None
        features = found.features.copy()
        features[frame % 3 :: 2] = np.nan
        patchy.append(found.with_features(features) if frame % 5 else Detections(found.boxes, found.scores))
    assert sorted(map(tuple, owners(run_tracker(patchy, make()), truth))) == [(0,), (1,), (2,)]


@pytest.mark.parametrize("make", [DeepSort, FlowTracker], ids=["deepsort", "flow"])
def test_features_of_changing_length_are_refused(make: Callable[[], PeopleTracker]) -> None:
    video, _ = crowd(np.random.default_rng(9), 2, 4)
    shorter = [found.with_features(np.ones((len(found), 3)) / np.sqrt(3)) for found in video]
    with pytest.raises(ValueError, match="features of"):
        run_tracker([*video, *shorter], make())


def _apart_then_swapped() -> list[Detections]:
    """Two people side by side, unseen for two frames in which they change places."""
    looks = np.eye(2)
    here, there = [0, 0, 30, 80.0], [35, 0, 65, 80.0]
    before = [Detections(np.array([here, there]), np.full(2, 0.99), looks)] * 8
    after = [Detections(np.array([here, there]), np.full(2, 0.99), looks[::-1])] * 8
    return [*before, Detections.empty(), Detections.empty(), *after]


@pytest.mark.parametrize("make", [Sort, DeepSort])
def test_what_no_detector_scored_counts_as_seen_with_score_0(make: Callable[[], PeopleTracker]) -> None:
    video, _ = crowd(np.random.default_rng(4), 3, 12)
    unscored = [replace(d, scores=np.full(len(d), np.nan)) if n == 8 else d for n, d in enumerate(video)]
    tracks = run_tracker(unscored, make())
    assert len(tracks) == 3
    for track, scored in zip(tracks, run_tracker(video, make()), strict=True):
        np.testing.assert_array_equal(track.boxes, scored.boxes)
        np.testing.assert_array_equal(track.scores, np.where(track.frames == 8, 0, scored.scores))


def test_sort_goes_by_place_and_deepsort_by_appearance() -> None:
    video = _apart_then_swapped()
    by_place, by_appearance = run_tracker(video, Sort()), run_tracker(video, DeepSort())
    assert [len(track) for track in by_place] == [len(track) for track in by_appearance] == [16, 16]
    assert abs(by_place[0].boxes[-1, 0] - by_place[0].boxes[0, 0]) < 5
    assert abs(by_appearance[0].boxes[-1, 0] - by_appearance[0].boxes[0, 0]) > 20


def test_deepsort_gates_are_separate() -> None:
    """Where looks are barred by their gate position decides, and with both barred nobody is followed."""
    video, _ = crowd(np.random.default_rng(32), 2, 12)
    turning = [found.with_features(np.tile([np.sin(k), np.cos(k)], (len(found), 1))) for k, found in enumerate(video)]
    assert len(run_tracker(turning, DeepSort(DeepSortSettings(feature_gate=0.01)))) == 2
    assert run_tracker(turning, DeepSort(DeepSortSettings(feature_gate=0.01, position_gate=0.0))) == []


def test_sort_lifecycle() -> None:
    box = np.array([[0, 0, 30, 80.0]])
    seen, blank = Detections(box, np.array([0.9])), Detections.empty()
    settings = SortSettings(min_hits=3, max_age=2)
    frames = [track.frames.tolist() for track in run_tracker([seen] * 3 + [blank] * 2 + [seen] * 3, Sort(settings))]
    assert frames == [[0, 1, 2, 5, 6, 7]]
    frames = [track.frames.tolist() for track in run_tracker([seen] * 3 + [blank] * 3 + [seen] * 3, Sort(settings))]
    assert frames == [[0, 1, 2], [6, 7, 8]]
    assert run_tracker([seen, seen, blank] * 4, Sort(settings)) == []
    weak = Detections(box, np.array([0.4]))
    assert run_tracker([weak] * 9, Sort(settings)) == []
    assert len(run_tracker([seen, *[weak] * 8], Sort(settings))[0]) == 9


@pytest.mark.parametrize("seed", range(4))
def test_sliding_flow_is_the_flow(seed: int) -> None:
    video, _ = crowd(np.random.default_rng(20 + seed), 6, 150, miss=0.2, clutter=0.5, noise=2.0)
    whole = run_tracker(video, FlowTracker(FlowSettings(decide_every=None)))
    assert whole
    sliding = FlowTracker(FlowSettings(decide_every=0.5 + seed))
    for a, b in zip(whole, run_tracker(video, sliding), strict=True):
        np.testing.assert_array_equal(a.frames, b.frames)
        np.testing.assert_allclose(a.boxes, b.boxes)
    assert sliding.facts()["exact"]


def test_flow_fills_gaps_and_says_so() -> None:
    video, _ = crowd(np.random.default_rng(30), 3, 40, noise=0.5)
    video[15:19] = [Detections.empty()] * 4
    tracks = run_tracker(video, FlowTracker())
    assert len(tracks) == 3
    for track in tracks:
        assert track.frames.tolist() == list(range(40))
        assert np.flatnonzero(~track.observed).tolist() == [15, 16, 17, 18]
    plain = FlowSettings(fill=0.0, smoothing=False)
    for track, person in zip(run_tracker(video, FlowTracker(plain)), range(3), strict=True):
        assert track.frames.tolist() == [*range(15), *range(19, 40)]
        assert track.observed.all()
        assert any((track.boxes[0] == box).all() for box in video[0].boxes), person


@pytest.mark.parametrize("score", [0.5, 0.86, 1.0, 40.0, np.nan])
def test_flow_needs_no_scale_of_scores(score: float) -> None:
    boxes = np.array([[0.0, 0, 30, 80], [200, 0, 230, 80]])
    moves = np.array([[2.0, 0, 2, 0], [-1, 0, -1, 0]])
    video = [Detections(boxes + frame * moves, np.full(2, score)) for frame in range(60)]
    assert [len(track) for track in run_tracker(video, FlowTracker())] == [60, 60]


def test_flow_leaves_doubled_boxes_out() -> None:
    boxes = np.array([[0.0, 0, 30, 80], [0.1, 0, 30.1, 80], [200, 0, 230, 80]])
    tracker = FlowTracker()
    tracks = run_tracker([Detections(boxes, np.array([0.9, 0.8, 0.9]))] * 30, tracker)
    np.testing.assert_allclose([track.boxes[0, 0] for track in tracks], [0, 200], atol=1e-9)
    assert tracker.duplicates == 30


def test_flow_follows_a_camera_by_its_boxes() -> None:
    """Six people stand, the camera swings by two of their widths every frame."""
    place = np.array([[300.0 * k, 50.0 * (k % 2)] for k in range(6)])
    video = []
    for frame in range(40):
        corner = place + np.array([50 * np.sin(1.5 * frame), 0])
        video.append(Detections(np.concatenate([corner, corner + np.array([30, 80])], axis=1), np.full(6, 0.9)))
    tracks = run_tracker(video, FlowTracker())
    assert [len(track) for track in tracks] == [40] * 6
    for track in tracks:
        np.testing.assert_allclose(track.boxes[:, 2] - track.boxes[:, 0], 30, atol=1e-6)


def test_flow_prices_by_what_it_is_given() -> None:
    """Learnt prices under which no detection is worth anything leave no track."""
    video, _ = crowd(np.random.default_rng(31), 3, 20)
    assert run_tracker(video, FlowTracker(observation=ObservationCost(alpha=9.0, beta=0.0))) == []


def test_flow_believes_scores_that_are_probabilities() -> None:
    """Tracks whose detections are mostly wrong by their own scores are clutter; others stay."""
    scores = np.array([0.95, 0.9, 0.6, 0.55])
    left = 200.0 * np.arange(4)
    video = [
        Detections(np.stack([left + t, 0 * left, left + t + 30, 0 * left + 80], axis=1), scores) for t in range(30)
    ]
    assert len(run_tracker(video, FlowTracker())) == 4
    believed = run_tracker(video, FlowTracker(observation=ProbabilityCost()))
    assert sorted(float(track.scores[0]) for track in believed) == [0.9, 0.95]


@pytest.mark.parametrize("wrong", [{"decide_every": 0}, {"fill": -1.0}])
def test_flow_settings_must_make_sense(wrong: dict[str, float]) -> None:
    with pytest.raises(ValidationError, match=next(iter(wrong))):
        FlowSettings(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", [{"entry": -1.0}, {"exit": np.inf}])
def test_flow_costs_must_make_sense(wrong: dict[str, float]) -> None:
    with pytest.raises(ValidationError, match=next(iter(wrong))):
        FlowCosts(**wrong)  # type: ignore[arg-type]


def test_online_settings_must_make_sense() -> None:
    with pytest.raises(ValueError, match="min_iou"):
        SortSettings(min_iou=0.0)
    with pytest.raises(ValueError, match="min_hits"):
        LifecycleSettings(min_hits=0)
    with pytest.raises(ValueError, match="feature_gate"):
        DeepSortSettings(feature_gate=3.0)


@pytest.mark.parametrize("frames", [2, 3, 4])
def test_a_video_shorter_than_the_shortest_track_has_people_too(frames):
    tracker = FlowTracker(FlowSettings(min_time=0.4))
    for k in range(frames):
        tracker.update(np.array([[10 + k, 10, 50 + k, 110, 0.9], [200 + k, 10, 240 + k, 110, 0.9]]))
    assert [len(track) for track in tracker.tracks()] == [frames, frames]


def test_the_flow_tells_what_it_rejects_and_how_fast_targets_are() -> None:
    video, _ = crowd(np.random.default_rng(3), 2, 40)
    stray = []
    for t, found in enumerate(video):
        false = [[20.0 * t, 900.0 - 20 * t, 20.0 * t + 30, 930.0 - 20 * t]] if t % 13 == 0 else np.empty((0, 4))
        boxes = np.vstack([found.boxes, false])
        stray.append(Detections(boxes, np.full(len(boxes), 0.9)))
    tracker = FlowTracker()
    run_tracker(stray, tracker)
    facts = tracker.facts()
    assert (facts["detections"], facts["detections_rejected"]) == (84, 4)
    assert facts["typical_speed"] > 0


def test_features_of_another_length_are_refused():
    tracker, box = DeepSort(), np.array([[10.0, 10, 40, 90]])
    tracker.update(Detections(box, np.ones(1), np.eye(1, 8)))
    with pytest.raises(RequestError, match="expected features of length 8 as before, got 4; use one network"):
        tracker.update(Detections(box, np.ones(1), np.eye(1, 4)))
