"""The drone tracker: windows against the whole, and a camera that moves against one that stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.drone.settings import DroneSettings
from tsuiseki.tracking.drone.tracker import DroneTracker, acting_track
from tsuiseki.tracking.features.camera_motion import CameraStep
from tsuiseki.tracking.features.camera_path import CameraTrajectory, move_boxes
from tsuiseki.tracking.types import Detections, FloatArray, Track

SIZE = np.array([10.0, 25.0])


def walk(seed: int, frames: int = 200, people: int = 5) -> list[Detections]:
    """People who walk straight on, a third of the detections missing, places, looks and actions noisy."""
    rng = np.random.default_rng(seed)
    place, step = rng.uniform(0, 700, (people, 2)), rng.normal(0, 0.8, (people, 2))
    look, does = rng.normal(0, 1, (people, 12)), rng.integers(0, 4, people)
    result = []
    for _ in range(frames):
        place = place + step
        seen = np.flatnonzero(rng.random(people) < 0.7)
        centre = place[seen] + rng.normal(0, 1.5, (len(seen), 2))
        features = look[seen] + rng.normal(0, 0.2, (len(seen), 12))
        features /= np.linalg.norm(features, axis=1, keepdims=True)
        actions = rng.uniform(0, 0.4, (len(seen), 4))
        actions[np.arange(len(seen)), does[seen]] += 0.6
        boxes = np.concatenate([centre - SIZE, centre + SIZE], axis=1)
        result.append(Detections(boxes, np.full(len(seen), 0.9), features, actions))
    return result


FLOW = DroneSettings().flow


def tracked(frames: list[Detections], settings: DroneSettings | None = None, *, actions: bool = True) -> DroneTracker:
    tracker = DroneTracker(settings)
    for found in frames:
        tracker.update(found if actions else replace(found, actions=None))
    return tracker


@pytest.mark.parametrize("actions", [True, False])
def test_people_and_what_they_do(actions: bool) -> None:
    people = tracked(walk(0), actions=actions).people()
    assert len(people) == 5
    for person in people:
        assert (person.multi is not None) == actions
        if person.single is not None and person.multi is not None:
            assert person.single.shape == person.multi.shape == (len(person.track), 4)
            # Everybody does one thing; means over windows are surer of it than single frames.
            assert person.multi.std(axis=0).mean() < 0.8 * person.single.std(axis=0).mean()


def test_between_detections_what_somebody_does_changes_evenly() -> None:
    frames = np.array([3, 4, 5, 8])
    track = Track(1, np.arange(3, 9), np.tile([0.0, 0, 9, 9], (6, 1)), np.ones(6), np.isin(np.arange(3, 9), frames))
    doing = np.array([[1.0, 0.0], [0.6, 0.4], [0.8, 0.2], [0.2, 0.8]])
    person = acting_track(track, doing, half=1)
    assert person.single is not None
    assert person.multi is not None
    np.testing.assert_allclose(person.single[:, 0], [1.0, 0.6, 0.8, 0.6, 0.4, 0.2])
    # Over windows of three frames the means of the detections in them; without any, the frame alone.
    np.testing.assert_allclose(person.multi[:, 0], [0.8, 0.8, 0.7, 0.8, 0.2, 0.2])


def test_asking_in_between_changes_nothing() -> None:
    frames = walk(3, 90)
    asked, quiet = (
        DroneTracker(DroneSettings(replace(FLOW, decide_every=1.0))),
        DroneTracker(DroneSettings(replace(FLOW, decide_every=1.0))),
    )
    for number, found in enumerate(frames):
        asked.update(found)
        quiet.update(found)
        if number % 25 == 0:
            asked.people()
    assert quiet.tracks()
    for a, b in zip(asked.tracks(), quiet.tracks(), strict=True):
        np.testing.assert_array_equal(a.boxes, b.boxes)


def similarity(rng: np.random.Generator, step: float) -> FloatArray:
    """A jerk of a camera: moved by up to so many pixels, turned and scaled a little."""
    angle, scale = rng.normal(0, 0.02), np.exp(rng.normal(0, 0.02))
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.column_stack([turn, rng.uniform(-step, step, 2)])


def test_a_moving_camera_is_taken_out() -> None:
    frames = walk(4, 80)
    rng = np.random.default_rng(0)
    still, moving = DroneTracker(), DroneTracker()
    path = np.eye(3)[:2]
    paths = []
    for number, found in enumerate(frames):
        step = similarity(rng, 60.0) if number else np.eye(3)[:2]
        path = (np.vstack([step, [0, 0, 1]]) @ np.vstack([path, [0, 0, 1]]))[:2]
        paths.append(path)
        boxes = move_boxes(found.boxes, np.repeat(path[None], len(found), axis=0))
        still.update(found)
        moving.update(replace(found, boxes=boxes), CameraStep(step) if number else None)
    expected, got = still.tracks(), moving.tracks()
    assert len(expected) == len(got) > 0
    for a, b in zip(expected, got, strict=True):
        seen = move_boxes(a.boxes, np.stack(paths)[a.frames])
        # Boxes of 20 pixels are smoothed where the first frame shows them, larger or smaller than here.
        np.testing.assert_allclose(b.boxes, seen, atol=1)
    # The same boxes without the motion are torn apart.
    torn = DroneTracker()
    for found, there in zip(frames, paths, strict=True):
        boxes = move_boxes(found.boxes, np.repeat(there[None], len(found), axis=0))
        torn.update(replace(found, boxes=boxes))
    assert sum(len(t) for t in torn.tracks()) < 0.8 * sum(len(t) for t in expected)


def test_without_pictures_the_boxes_tell_how_the_camera_moves() -> None:
    # Eight people at once, boxes off by a twentieth of a height, jerks of up to a fifth of one.
    frames, rng = walk(6, 80, people=12), np.random.default_rng(1)
    still, left_in, by_boxes = DroneTracker(), DroneTracker(), DroneTracker(pictures=False)
    for found, shift in zip(frames, rng.uniform(-20, 20, (len(frames), 2)), strict=True):
        moved = replace(found, boxes=found.boxes + np.tile(shift, 2))
        still.update(found)
        left_in.update(moved)
        by_boxes.update(moved)
    followed, torn, expected = (sum(map(len, t.tracks())) for t in (by_boxes, left_in, still))
    assert followed > 0.95 * expected
    assert torn < followed
    assert by_boxes.facts()["camera_from"] == "boxes"


def test_who_stands_and_scores_little_is_no_clutter_under_a_drone() -> None:
    frames = []
    for number in range(60):
        walkers = np.array([[10.0 + 3 * number, 100.0 * k, 30.0 + 3 * number, 100.0 * k + 50] for k in range(6)])
        sitting = np.array([[900.0, 300.0, 930.0, 330.0]])
        frames.append(Detections(np.concatenate([walkers, sitting]), np.append(np.full(6, 0.9), 0.6)))
    flow = replace(FLOW, standing=False)
    assert len(tracked(frames).tracks()) == 7
    assert len(tracked(frames, DroneSettings(flow=flow)).tracks()) == 6


def test_a_camera_that_stands_still_changes_no_bit() -> None:
    motion = CameraTrajectory()
    for _ in range(5):
        motion.append(np.eye(3)[:2])
    boxes = np.random.default_rng(0).random((10, 4)).cumsum(axis=1)
    np.testing.assert_array_equal(motion.to_first(boxes, np.arange(10) % 5), boxes)


def test_boxes_go_there_and_back() -> None:
    rng = np.random.default_rng(1)
    motion = CameraTrajectory()
    motion.append(None)
    for _ in range(7):
        motion.append(similarity(rng, 20))
    corner = rng.uniform(0, 500, (30, 2))
    boxes = np.concatenate([corner, corner + rng.uniform(5, 60, (30, 2))], axis=1)
    frames = rng.integers(0, 8, 30)
    np.testing.assert_allclose(motion.from_first(motion.to_first(boxes, frames), frames), boxes, atol=1e-8)


def test_actions_for_some_frames_only_are_refused() -> None:
    found, *_ = walk(0, 1)
    tracker = DroneTracker()
    tracker.update(found)
    tracker.update(Detections.empty())
    tracker.update(replace(found, actions=None))
    with pytest.raises(ValueError, match="for all frames or for none"):
        tracker.tracks()


def test_what_the_camera_did_not_tell_is_said() -> None:
    tracker = DroneTracker()
    for number, found in enumerate(walk(5, 20)):
        unknown = CameraStep(np.eye(3)[:2], np.inf if number == 7 else 0.0)
        tracker.update(found, unknown)
    tracker.tracks()
    assert tracker.facts()["camera_unknown"] == [[8, 8]]
    assert tracker.facts()["camera_from"] == "images"


def test_a_window_below_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="window"):
        DroneSettings(window=-1.0)
