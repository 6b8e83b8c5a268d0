"""People on the floor: looks, then places, at any frame rate; and the flow over the same detections."""

from __future__ import annotations

import gc
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.fisheye.settings import FisheyeSettings
from tsuiseki.tracking.fisheye.tracker import PRUNED, FisheyeTracker, flow_on_floor
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.tracks import FloorDetections


def floor_detections(places, features=None, scores=None):
    places = np.asarray(places, dtype=np.float64).reshape(-1, 2)
    corner = 100 + 20 * places
    boxes = np.concatenate([corner, corner + np.array([20, 40])], axis=1)
    scores = np.full(len(places), 0.9) if scores is None else np.asarray(scores)
    rotated = np.column_stack([corner + np.array([10, 20]), np.full((len(places), 2), [20, 40]), np.zeros(len(places))])
    return FloorDetections(Detections(boxes, scores, features), rotated, places)


def crossing(rate, seconds=8, seed=0):
    """Two who walk past each other at 1.2 m/s, 1 m apart, found with an error of 5 cm."""
    rng = np.random.default_rng(seed)
    for frame in range(int(seconds * rate)):
        t = frame / rate
        yield floor_detections(np.array([[1.2 * t, 0.0], [9.6 - 1.2 * t, 1.0]]) + rng.normal(0, 0.05, (2, 2)))


def ids_by_person(tracks, frames):
    """``(T, 2)`` id of each of the two, distinguished by y."""
    ids = np.zeros((frames, 2), dtype=int)
    for each in tracks:
        person = (each.places[:, 1] > 0.5).astype(int)
        ids[each.track.frames, person] = each.track.id
    return ids


@pytest.mark.parametrize("rate", [1, 5, 15])
def test_two_who_cross_keep_their_ids_at_any_frame_rate(rate):
    tracker = FisheyeTracker(rate)
    found = list(crossing(rate))
    for each in found:
        tracker.update(each)
    ids = ids_by_person(tracker.tracks(), len(found))
    assert (ids == ids[0]).all()
    assert len(set(ids[0])) == 2


@pytest.mark.parametrize("rate", [1, 15])
def test_the_flow_keeps_them_too(rate):
    found = list(crossing(rate))
    ids = ids_by_person(flow_on_floor(found, rate), len(found))
    assert (ids == ids[0]).all()
    assert len(set(ids[0])) == 2


def test_tracks_name_the_rows_and_classes_of_their_detections():
    told = {"sources": np.array([5, 3]), "classes": np.array([2, 8]), "names": {2: "cat", 8: "dog"}}
    found = [replace(each, detections=replace(each.detections, **told)) for each in crossing(5)]
    tracker = FisheyeTracker(5)
    for each in found:
        tracker.update(each)
    for tracks in (tracker.tracks(), flow_on_floor(found, 5)):
        boxes = [one.track for one in tracks]
        assert sorted((one.class_name, *set(one.detection.tolist())) for one in boxes) == [("cat", 5), ("dog", 3)]


def test_looks_decide_before_places():
    red, blue = np.eye(2)
    tracker = FisheyeTracker(1.0, FisheyeSettings(confirm=0))
    tracker.update(floor_detections([[0, 0], [0.8, 0]], np.stack([red, blue])))
    # They have changed places: by place alone each would take the other's id.
    tracker.update(floor_detections([[0, 0], [0.8, 0]], np.stack([blue, red])))
    tracks = tracker.tracks()
    assert [t.places[:, 0].tolist() for t in tracks] == [[0.0, 0.8], [0.8, 0.0]]


def test_like_clothes_far_away_are_somebody_else():
    look = np.array([[1.0, 0.0]])
    near = FisheyeTracker(1.0, FisheyeSettings(confirm=0))
    everywhere = FisheyeTracker(1.0, FisheyeSettings(confirm=0, by_place=False))
    for tracker in (near, everywhere):
        tracker.update(floor_detections([[0, 0]], look))
        tracker.update(floor_detections([[6, 0]], look))
    assert len(near.tracks()) == 2
    assert len(everywhere.tracks()) == 1


def test_a_gap_is_bridged_as_long_as_it_may_last():
    def ids_after(silence):
        tracker = FisheyeTracker(1.0, FisheyeSettings(confirm=0, max_age=2.0))
        tracker.update(floor_detections([[0, 0]]))
        for _ in range(silence):
            tracker.update(floor_detections([]))
        tracker.update(floor_detections([[0, 0]]))
        return len(tracker.tracks())

    assert [ids_after(n) for n in (0, 1, 2, 3)] == [1, 1, 1, 2]


def test_a_short_flicker_is_nobody_at_fifteen_frames():
    tracker = FisheyeTracker(15.0)
    for frame in range(10):
        tracker.update(floor_detections([[0, 0]] if frame == 4 else []))
    assert tracker.tracks() == []


def held_after(frames, people, every=None):
    """Bytes that a tracker holds after ``frames`` of people who are hidden in every twentieth, and of a flicker."""
    features = np.eye(64)
    tracker = FisheyeTracker(15.0)
    tracemalloc.start()
    for frame in range(frames):
        here = people if frame % 20 else 0
        places = [[3.0 * k, 0.3 * np.sin(frame / 9)] for k in range(here)]
        # It stands elsewhere in every frame, and so is never confirmed.
        tracker.update(floor_detections([*places, [50.0, 4.0 * (frame % 7)]], features[[*range(here), 63]]))
        if every is not None and frame % every == 0:
            tracker.forget()
    gc.collect()
    held = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    return held


@pytest.mark.slow
def test_memory_grows_with_the_result_alone():
    # Frames after which what was never confirmed has just been dropped.
    few, many = PRUNED + 1, 2 * PRUNED + 1
    # Fourteen numbers of three boxes are 336 bytes, and four arrays and the lists they are in have some 800 bytes a
    # frame of their own; the features of four detections alone would be 2048.
    assert (held_after(many, 3) - held_after(few, 3)) / PRUNED < 1500
    assert held_after(many, 0) - held_after(few, 0) < 2000
    assert held_after(many, 3, every=50) - held_after(few, 3, every=50) < 2000


def test_ids_go_on_after_what_was_is_forgotten():
    whole, parts = FisheyeTracker(15.0), FisheyeTracker(15.0)
    seen = []
    for frame, each in enumerate(crossing(15)):
        whole.update(each)
        parts.update(each)
        if frame % 25 == 24:
            seen += parts.tracks()
            parts.forget()
    seen += parts.tracks()
    for track in whole.tracks():
        mine = [t for t in seen if t.track.id == track.track.id]
        assert np.concatenate([t.track.frames for t in mine]).tolist() == track.track.frames.tolist()
        assert np.array_equal(np.concatenate([t.places for t in mine]), track.places)


def test_weak_detections_go_on_but_do_not_start():
    tracker = FisheyeTracker(1.0, FisheyeSettings(confirm=0, start_score=0.5))
    for score in (0.3, 0.6, 0.3):
        tracker.update(floor_detections([[0, 0]], scores=[score]))
    assert tracker.tracks()[0].track.frames.tolist() == [1, 2]


def test_frames_without_people_and_looks_do_no_harm():
    tracker = FisheyeTracker(1.0, FisheyeSettings(confirm=0))
    tracker.update(floor_detections([]))
    tracker.update(floor_detections([[0, 0]], np.array([[1.0, 0.0]])))
    tracker.update(floor_detections([]))
    tracker.update(floor_detections([[0.2, 0]], np.array([[1.0, 0.0]])))
    assert [t.track.frames.tolist() for t in tracker.tracks()] == [[1, 3]]
    assert flow_on_floor([floor_detections([])], 1.0) == []


def test_two_on_one_spot_stay_two():
    found = [floor_detections([[0, 0], [0, 0]])] * 4
    tracks = flow_on_floor(found, 1.0)
    assert sorted(len(t.track) for t in tracks) == [4, 4]


def test_settings_that_match_by_nothing_are_refused():
    with pytest.raises(ValueError, match="by appearance or by place"):
        FisheyeSettings(by_appearance=False, by_place=False)


@pytest.mark.parametrize(("gate", "taken"), [(2.0, True), (0.5, False)])
def test_a_match_by_place_may_ask_for_looks_too(gate, taken):
    person, thing = np.eye(4)[:1], np.eye(4)[1:2]
    tracker = FisheyeTracker(1.0, FisheyeSettings(place_feature_gate=gate))
    for t in range(3):
        tracker.update(floor_detections([[0.5 * t, 0.0]], person))
    # The person is missed, and something stands near that is too faint to start a track.
    for _ in range(3):
        tracker.update(floor_detections([[1.8, 0.3]], thing, scores=[0.4]))
    [track] = tracker.tracks()
    assert (len(track.track) > 3) == taken
    with pytest.raises(ValueError, match="place_feature_gate"):
        FisheyeSettings(place_feature_gate=3.0)
