"""Classes tracked apart: as if each were in a video of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from tsuiseki.tracking.features.camera_motion import CameraStep
from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.people.by_class import ByClass
from tsuiseki.tracking.people.bytetrack import ByteTrack
from tsuiseki.tracking.people.contract import PeopleTracker
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.types import Detections

SHUFFLED = np.random.default_rng(0)


def crossing(length: int = 30) -> list[Detections]:
    """A class 1 that walks right and a class 4 that walks left through it, and a class 7 nobody asks for."""
    video = []
    for t in range(length):
        rows = [(1, 5.0 * t), (4, 5.0 * (length - t)), (7, 600.0)]
        order = SHUFFLED.permutation(3)
        rows = [rows[k] for k in order]
        boxes = np.array([[x, 0, x + 40, 100] for _, x in rows])
        video.append(Detections(boxes, np.full(3, 0.95), classes=np.array([number for number, _ in rows])))
    return video


@pytest.mark.parametrize("make", [Sort, FlowTracker])
def test_each_class_is_tracked_as_if_alone(make: type[Sort] | type[FlowTracker]) -> None:
    video = crossing()
    together = ByClass(make, [1, 4])
    for found in video:
        together.update(found)
    tracks = together.tracks()
    assert sorted(track.class_id for track in tracks) == [1, 4]
    for track in tracks:
        alone = make()
        for found in video:
            alone.update(found.select(found.classes == track.class_id))
        (same,) = alone.tracks()
        np.testing.assert_array_equal(same.frames, track.frames)
        np.testing.assert_allclose(same.boxes, track.boxes)
        given = [video[frame].classes[row] for frame, row in zip(track.frames, track.detection, strict=True)]
        assert set(given) == {track.class_id}


# An online tracker reports no frame without a detection: 32 of 40 have one of the class.
@pytest.mark.parametrize(
    ("make", "least"), [(FlowTracker, 36), (partial(ByteTrack, min_hits=1), 32), (partial(Sort, min_hits=1), 32)]
)
def test_a_class_that_flickers_makes_no_second_track(make: Callable[[], PeopleTracker], least: int) -> None:
    tracker = ByClass(make, [1, 2])
    for t in range(40):
        boxes = np.array([[2.0 * t, 0, 2.0 * t + 90, 50], [2.0 * t + 20, 80, 2.0 * t + 50, 170]])
        tracker.update(Detections(boxes, np.full(2, 0.9), classes=np.array([2 if t % 5 else 1, 1])))
    assert [(track.class_id, len(track) >= least) for track in tracker.tracks()] == [(1, True), (2, True)]


def test_answers_bear_the_ids_of_the_tracks() -> None:
    video = crossing()
    tracker = ByClass(Sort, [4, 1])
    said = [tracker.update(found) for found in video]
    last = said[-1]
    assert last is not None
    assert sorted(last.ids.tolist()) == [1, 2]
    for track in tracker.tracks():
        row = int(np.flatnonzero(last.ids == track.id)[0])
        np.testing.assert_allclose(last.boxes[row], track.boxes[-1])
        assert (last.classes[row], last.detection[row]) == (track.class_id, track.detection[-1])


@pytest.mark.slow
def test_all_classes_follow_one_moving_camera_and_answer_late() -> None:
    video = crossing(60)
    shift = np.array([[1.0, 0.0, 3.0], [0.0, 1.0, 0.0]])

    def answers(wanted: list[int]) -> tuple[ByClass, list[int]]:
        path, told = CameraPath(), []
        tracker = ByClass(lambda: FlowTracker(frame_rate=30.0, camera=path, delay=0.3), wanted)
        for frame, found in enumerate(video):
            path.follow(CameraStep(shift))
            moved = replace(found, boxes=found.boxes + np.array([3.0 * frame, 0, 3.0 * frame, 0]))
            people = tracker.update(moved)
            told.append(0 if people is None else len(people.ids))
            if frame == 40:  # asking what is known so far changes nothing
                tracker.tracks()
        return tracker, told

    both, told = answers([1, 4])
    apart = [answers([number])[0].tracks()[0] for number in (1, 4)]
    assert max(told) == 2
    for track in both.tracks():
        same = apart[0 if track.class_id == 1 else 1]
        np.testing.assert_array_equal(same.frames, track.frames)
        np.testing.assert_allclose(same.boxes, track.boxes)
