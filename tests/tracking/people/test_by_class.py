"""Classes tracked apart: as if each were in a video of its own."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.features.camera_motion import CameraStep
from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.methods import ByClass
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.types import Detections

SHUFFLED = np.random.default_rng(0)


def crossing(length: int = 30) -> tuple[list[Detections], list[np.ndarray]]:
    """A class 1 that walks right and a class 4 that walks left through it, and a class 7 nobody asks for."""
    video, classes = [], []
    for t in range(length):
        rows = [(1, 5.0 * t), (4, 5.0 * (length - t)), (7, 600.0)]
        order = SHUFFLED.permutation(3)
        rows = [rows[k] for k in order]
        boxes = np.array([[x, 0, x + 40, 100] for _, x in rows])
        video.append(Detections(boxes, np.full(3, 0.95)))
        classes.append(np.array([number for number, _ in rows]))
    return video, classes


@pytest.mark.parametrize("make", [Sort, FlowTracker])
def test_each_class_is_tracked_as_if_alone(make: type[Sort] | type[FlowTracker]) -> None:
    video, classes = crossing()
    together = ByClass(make, classes, [1, 4])
    for found in video:
        together.update(found)
    tracks = together.tracks()
    assert sorted(together.class_of(track.id) for track in tracks) == [1, 4]
    for track in tracks:
        alone = make()
        for found, number in zip(video, classes, strict=True):
            alone.update(found.select(number == together.class_of(track.id)))
        (same,) = alone.tracks()
        np.testing.assert_array_equal(same.frames, track.frames)
        np.testing.assert_allclose(same.boxes, track.boxes)


def test_answers_bear_the_ids_of_the_tracks() -> None:
    video, classes = crossing()
    tracker = ByClass(Sort, classes, [4, 1])
    said = [tracker.update(found) for found in video]
    last = said[-1]
    assert last is not None
    assert sorted(last.ids.tolist()) == [1, 2]
    for track in tracker.tracks():
        row = int(np.flatnonzero(last.ids == track.id)[0])
        np.testing.assert_allclose(last.boxes[row], track.boxes[-1])


def test_frames_after_the_last_classes_have_no_detection() -> None:
    tracker = ByClass(Sort, [np.array([1])], [1])
    tracker.update([[0, 0, 40, 100, 0.9]])
    tracker.update([])
    with pytest.raises(ValueError, match="expected 0 detections in frame 2, got 1"):
        tracker.update([[0, 0, 40, 100, 0.9]])


def test_all_classes_follow_one_moving_camera_and_answer_late() -> None:
    video, classes = crossing(60)
    shift = np.array([[1.0, 0.0, 3.0], [0.0, 1.0, 0.0]])

    def answers(wanted: list[int]) -> tuple[ByClass, list[int]]:
        path, told = CameraPath(), []
        tracker = ByClass(lambda: FlowTracker(frame_rate=30.0, camera=path, delay=0.3), classes, wanted)
        for frame, found in enumerate(video):
            path.follow(CameraStep(shift))
            moved = Detections(found.boxes + np.array([3.0 * frame, 0, 3.0 * frame, 0]), found.scores)
            people = tracker.update(moved)
            told.append(0 if people is None else len(people.ids))
            if frame == 40:  # asking what is known so far changes nothing
                tracker.tracks()
        return tracker, told

    both, told = answers([1, 4])
    apart = [answers([number])[0].tracks()[0] for number in (1, 4)]
    assert max(told) == 2
    for track in both.tracks():
        same = apart[0 if both.class_of(track.id) == 1 else 1]
        np.testing.assert_array_equal(same.frames, track.frames)
        np.testing.assert_allclose(same.boxes, track.boxes)
