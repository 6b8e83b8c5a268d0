"""What does not change the tracks of people: the order of detections, the place of the picture's origin, its unit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.properties.drawn import boxes_of, seeds
from tsuiseki.tracking.people.bytetrack import ByteTrack
from tsuiseki.tracking.people.contract import PeopleTracker, run_tracker
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.ocsort import OcSort
from tsuiseki.tracking.people.sort import DeepSort, Sort
from tsuiseki.tracking.types import Detections, Track

Make = Callable[[], PeopleTracker]
ONLINE: list[Make] = [Sort, DeepSort, ByteTrack, OcSort]
FRAMES = 10


def video_of(seed: int, people: int = 4) -> list[Detections]:
    """People who walk, are missed now and then, and false positives beside them; with appearance."""
    rng = np.random.default_rng(seed)
    boxes, steps = boxes_of(rng, people), np.tile(rng.normal(0, 3, (people, 2)), 2)
    looks = rng.normal(0, 1, (people, 5))
    frames = []
    for k in range(FRAMES):
        there = rng.random(people) < 0.85
        detected = np.concatenate([(boxes + k * steps + rng.normal(0, 0.5, boxes.shape))[there], boxes_of(rng, 1)])
        features = np.concatenate([looks[there], rng.normal(0, 1, (1, 5))])
        features /= np.linalg.norm(features, axis=1, keepdims=True)
        frames.append(Detections(detected, rng.uniform(0.3, 1, len(detected)), features))
    return frames


def lines(tracks: Sequence[Track]) -> list[tuple[list[int], np.ndarray]]:
    """Frames and boxes of tracks, in an order that does not depend on their ids."""
    return sorted(((t.frames.tolist(), t.boxes.round(6)) for t in tracks), key=lambda line: (line[0], line[1].tolist()))


def assert_same(tracks: Sequence[Track], expected: Sequence[Track], scale: float = 1.0, shift: float = 0.0) -> None:
    """The same frames and boxes, once the latter are scaled and moved, whatever the ids."""
    moved = [replace(track, boxes=track.boxes * scale + shift) for track in expected]
    pairs = zip(lines(tracks), lines(moved), strict=True)
    for (frames, boxes), (expected_frames, expected_boxes) in pairs:
        assert frames == expected_frames
        np.testing.assert_allclose(boxes, expected_boxes, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("make", ONLINE)
@given(seed=seeds)
def test_the_order_of_detections_does_not_matter(make: Make, seed: int) -> None:
    """Detections of a frame in another order give the same tracks."""
    frames, rng = video_of(seed), np.random.default_rng(seed)
    shuffled = [frame.select(rng.permutation(len(frame))) for frame in frames]
    assert_same(run_tracker(shuffled, make()), run_tracker(frames, make()))


@pytest.mark.parametrize("make", ONLINE)
@given(seed=seeds, shift=st.floats(-300, 300))
def test_tracks_move_with_the_picture(make: Make, seed: int, shift: float) -> None:
    """Boxes of a picture cut elsewhere give the same tracks there."""
    frames = video_of(seed)
    moved = [replace(frame, boxes=frame.boxes + shift) for frame in frames]
    assert_same(run_tracker(moved, make()), run_tracker(frames, make()), shift=shift)


@pytest.mark.parametrize("make", ONLINE)
@given(seed=seeds, scale=st.floats(0.3, 5))
def test_tracks_grow_with_the_picture(make: Make, seed: int, scale: float) -> None:
    """Boxes of a larger picture give the same tracks, as large."""
    frames = video_of(seed)
    larger = [replace(frame, boxes=frame.boxes * scale) for frame in frames]
    assert_same(run_tracker(larger, make()), run_tracker(frames, make()), scale=scale)


@pytest.mark.slow
@pytest.mark.parametrize("make", ONLINE)
@given(seed=seeds, empty=st.integers(1, 4))
def test_tracks_begin_later_after_empty_frames(make: Make, seed: int, empty: int) -> None:
    """Frames without anybody before the first detection put the tracks as many frames later."""
    frames = video_of(seed)
    later = run_tracker([*[Detections.empty()] * empty, *frames], make())
    assert_same([replace(track, frames=track.frames - empty) for track in later], run_tracker(frames, make()))


@pytest.mark.parametrize("make", ONLINE)
@given(seed=seeds)
def test_a_detection_supports_one_track(make: Make, seed: int) -> None:
    """Ids are positive and different, and no two tracks have the same detection of a frame."""
    frames = video_of(seed)
    tracks = run_tracker(frames, make())
    assert sorted({track.id for track in tracks}) == list(range(1, len(tracks) + 1))
    used = [(frame, row) for t in tracks for frame, row in zip(t.frames.tolist(), t.detection.tolist(), strict=True)]
    assert len(set(used)) == len(used)
    assert all(0 <= row < len(frames[frame]) for frame, row in used)


@pytest.mark.parametrize("make", ONLINE)
@given(seed=seeds)
def test_what_was_answered_stays(make: Make, seed: int) -> None:
    """Who is reported in a frame as detected stands in the tracks there, with the same id and box."""
    tracker = make()
    answers = [tracker.update(frame) for frame in video_of(seed)]
    places = {
        (t.id, frame): box for t in tracker.tracks() for frame, box in zip(t.frames.tolist(), t.boxes, strict=True)
    }
    for targets in answers:
        for target in targets:
            assert target.status != "tracking" or np.array_equal(places[target.id, targets.frame], target.box)


@settings(max_examples=8)
@given(seed=seeds)
def test_the_flow_does_not_depend_on_the_order_of_detections(seed: int) -> None:
    """Detections of a frame in another order give the same cheapest tracks."""
    frames, rng = video_of(seed), np.random.default_rng(seed)
    shuffled = [frame.select(rng.permutation(len(frame))) for frame in frames]
    assert_same(run_tracker(shuffled, FlowTracker()), run_tracker(frames, FlowTracker()))


@settings(max_examples=8)
@given(seed=seeds, scale=st.sampled_from([0.5, 2.0, 4.0]))
def test_the_flow_grows_with_the_picture(seed: int, scale: float) -> None:
    """Boxes of a larger picture give the same cheapest tracks, as large."""
    frames = video_of(seed)
    larger = [replace(frame, boxes=frame.boxes * scale) for frame in frames]
    assert_same(run_tracker(larger, FlowTracker()), run_tracker(frames, FlowTracker()), scale=scale)
