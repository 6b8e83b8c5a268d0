"""The flow with a bounded delay: what is answered is final, asks nothing of the future, and costs no more with time."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from tests.tracking.people.test_people_trackers import crowd, owners
from tsuiseki.tracking.association.costs import ObservationCost
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.camera_motion import CameraStep
from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.people.contract import run_tracker
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.flow_input import FlowSettings
from tsuiseki.tracking.types import Detections, Targets, Track

RATE = 20.0


def followed(video: list[Detections], tracker: FlowTracker) -> list[Targets]:
    """The answers that came."""
    return [answer for found in video if (answer := tracker.update(found)) is not None]


def rows_at(tracks: list[Track], frame: int) -> list[tuple[int, list[float], bool]]:
    """Id, box and whether it was detected of everybody in a frame."""
    there = [(track, int(row)) for track in tracks for row in np.flatnonzero(track.frames == frame)]
    return [(track.id, track.boxes[row].tolist(), bool(track.observed[row])) for track, row in there]


def rows_of(answer: Targets) -> list[tuple[int, list[float], bool]]:
    return [(one.id, one.box.tolist(), one.status == "tracking") for one in answer]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("delay", [0.0, 0.1, 0.5, 1.0])
def test_what_is_answered_is_what_the_tracks_say_in_the_end(seed: int, delay: float) -> None:
    video, _ = crowd(np.random.default_rng(seed), 5, 50, miss=0.3, clutter=1.5, noise=3.0)
    tracker = FlowTracker(frame_rate=RATE, delay=delay)
    answers = followed(video, tracker)
    assert [answer.frame for answer in answers] == list(range(50 - round(delay * RATE)))
    tracks = tracker.tracks()
    assert tracks
    for answer in answers:
        assert len(set(answer.ids.tolist())) == len(answer)
        assert rows_of(answer) == rows_at(tracks, answer.frame)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_frames_beyond_the_delay_do_not_matter(seed: int) -> None:
    one, _ = crowd(np.random.default_rng(seed), 5, 60, miss=0.2, clutter=1.0, noise=2.0)
    other, _ = crowd(np.random.default_rng(100 + seed), 3, 30, clutter=3.0)
    known = followed(one, FlowTracker(frame_rate=RATE, delay=0.5))
    changed = followed([*one[:40], *other], FlowTracker(frame_rate=RATE, delay=0.5))
    assert any(len(answer) for answer in known)
    for a, b in zip(known[:30], changed[:30], strict=True):
        assert rows_of(a) == rows_of(b)


@pytest.mark.parametrize("seed", range(3))
def test_a_delay_longer_than_the_video_is_the_whole_flow(seed: int) -> None:
    video, _ = crowd(np.random.default_rng(seed), 6, 60, miss=0.3, clutter=1.0, noise=2.0)
    whole = run_tracker(video, FlowTracker(FlowSettings(decide_every=None), frame_rate=RATE))
    late = run_tracker(video, FlowTracker(frame_rate=RATE, delay=100.0))
    assert whole
    for a, b in zip(whole, late, strict=True):
        assert a.id == b.id
        np.testing.assert_array_equal(a.frames, b.frames)
        np.testing.assert_array_equal(a.boxes, b.boxes)
        np.testing.assert_array_equal(a.observed, b.observed)


@pytest.mark.slow
def test_an_id_outlives_a_gap_longer_than_the_delay() -> None:
    video, truth = crowd(np.random.default_rng(7), 3, 80, noise=0.5)
    video[30:50] = [Detections.empty()] * 20
    tracker = FlowTracker(frame_rate=RATE, delay=0.5)
    answers = followed(video, tracker)
    tracks = tracker.tracks()
    assert [len(people) for people in owners(tracks, truth)] == [1, 1, 1]
    # The gap is filled from the frame on in which its end is known.
    filled = {answer.frame for answer in answers if len(answer) == 3} & set(range(30, 50))
    assert filled
    assert filled == set(range(min(filled), 50))
    assert 50 - 0.5 * RATE <= min(filled) <= 50 - 0.5 * RATE / 2


@pytest.mark.slow
def test_the_state_does_not_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    """With what was answered forgotten, and as many scores seen as the calibration remembers."""
    video, _ = crowd(np.random.default_rng(8), 2, 200, miss=0.1, clutter=0.3)
    monkeypatch.setattr("tsuiseki.tracking.association.video_evidence.MEMORY", 200)
    tracker = FlowTracker(frame_rate=RATE, delay=1.0)
    sizes = {}
    for frame in range(1200):
        # Back and forth, so that nobody leaves.
        tracker.update(video[frame % 200 if frame // 200 % 2 == 0 else 199 - frame % 200])
        tracker.forget()
        if frame % 200 == 199:
            sizes[frame + 1] = len(pickle.dumps(tracker))
    assert sizes[1200] < 1.1 * sizes[200] + 2000
    assert len(tracker.tracks()) > 0


@pytest.mark.slow
def test_the_camera_of_the_images_is_forgotten_too() -> None:
    whole, path = CameraPath(), CameraPath()
    trackers = [FlowTracker(frame_rate=10.0, delay=1.0, camera=camera) for camera in (whole, path)]
    whole.forget = lambda before: None  # type: ignore[method-assign]  # noqa: ARG005
    answers: list[list[Targets | None]] = [[], []]
    for frame in range(120):
        step = CameraStep(np.array([[1.0, 0, 5.0 * (frame % 3)], [0, 1, 0]]), 0.5)
        box = np.array([100.0, 100, 130, 170]) + 5.0 * np.array([1, 0, 1, 0]) * sum(k % 3 for k in range(frame + 1))
        for camera, tracker, found in zip((whole, path), trackers, answers, strict=True):
            camera.follow(step)
            found.append(tracker.update([[*box, 0.9]]))
            tracker.forget()
        assert len(path.transforms) + len(path.deviations) < 30
    assert len(path) == len(whole) == 120
    for one, other in zip(*answers, strict=True):
        assert (one is None) == (other is None)
        if one is not None and other is not None:
            np.testing.assert_array_equal(one.boxes, other.boxes)


@pytest.mark.slow
def test_tracks_begin_with_the_first_frame_that_was_not_forgotten() -> None:
    video, _ = crowd(np.random.default_rng(9), 3, 60)
    tracker = FlowTracker(frame_rate=RATE, delay=0.5)
    whole = run_tracker(video, FlowTracker(frame_rate=RATE, delay=0.5))
    for frame, found in enumerate(video):
        tracker.update(found)
        if frame == 39:
            tracker.forget()
    for a, b in zip(tracker.tracks(), whole, strict=True):
        assert (a.id, a.frames.tolist()) == (b.id, list(range(30, 60)))
        np.testing.assert_array_equal(a.boxes, b.boxes[30:])


@pytest.mark.slow
def test_learnt_prices_judge_before_the_answer() -> None:
    video, _ = crowd(np.random.default_rng(10), 3, 40)
    sure, unsure = ObservationCost(alpha=-9.0, beta=0.0), ObservationCost(alpha=0.5, beta=0.0)
    assert len(run_tracker(video, FlowTracker(frame_rate=RATE, delay=0.5, observation=sure))) == 3
    tracker = FlowTracker(frame_rate=RATE, delay=0.5, observation=unsure)
    assert all(len(answer) == 0 for answer in followed(video, tracker))
    assert tracker.tracks() == []


@pytest.mark.slow
def test_features_may_come_and_go() -> None:
    video, truth = crowd(np.random.default_rng(11), 3, 60)
    patchy = [found if frame % 20 > 10 else replace(found, features=None) for frame, found in enumerate(video)]
    tracks = run_tracker(patchy, FlowTracker(frame_rate=RATE, delay=0.5))
    assert sorted(map(tuple, owners(tracks, truth))) == [(0,), (1,), (2,)]


@pytest.mark.parametrize("delay", [-0.1, np.inf, np.nan])
def test_a_delay_must_make_sense(delay: float) -> None:
    with pytest.raises(ValueError, match="delay"):
        FlowTracker(delay=delay)


def test_only_with_a_delay_can_be_forgotten() -> None:
    with pytest.raises(RequestError, match="delay"):
        FlowTracker().forget()
