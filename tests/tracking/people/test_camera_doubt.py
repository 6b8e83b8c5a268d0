"""A moving camera that its boxes tell too little of: said, and in doubt."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.association.camera_from_boxes import doubt_of, steps_from_boxes
from tsuiseki.tracking.features.camera_path import line_on_camera
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.types import Detections, ImageArray


def panned(frames: int, few_from: int, speed: float) -> list[Detections]:
    """Six people who stand still before a camera that pans; of some frame on the detector finds two of them."""
    video = []
    for t in range(frames):
        x = 100.0 * np.arange(6 if t < few_from else 2) + 40.0 - speed * t
        video.append(Detections(np.column_stack([x, 0 * x, x + 30, 0 * x + 80]), np.full(len(x), 0.9)))
    return video


def followed(video: list[Detections]) -> FlowTracker:
    tracker = FlowTracker(frame_rate=30.0)
    for found in video:
        tracker.update(found)
    tracker.tracks()
    return tracker


def test_steps_that_few_boxes_tell_are_in_doubt() -> None:
    camera = followed(panned(60, 30, 8.0)).camera
    assert list(camera.unknown) == list(camera.lost) == list(range(30, 60))
    variance = camera.variance(np.arange(60))
    least = doubt_of(2.0, 30.0) ** 2
    assert variance[29] == variance[1]
    assert (np.diff(variance[29:]) >= 0.99 * least).all()
    # The way of the two boxes is followed all the same.
    np.testing.assert_allclose(camera.to_first(np.array([[0.0, 0, 30, 80]]), np.array([59]))[0, 0], 8.0 * 59, atol=2)
    assert line_on_camera(camera.lost.from_one(), camera.source) == (
        "how the camera moved into frames 31-60 is not known from the few boxes there; links over them reach further"
    )


def test_a_step_over_a_longer_time_is_told_as_well() -> None:
    """Six people who walk apart: three times as long between two looks, all moves are three times as large."""
    place, walk = 100.0 * np.arange(6), np.linspace(-2, 2, 6) ** 3 / 2
    x = np.concatenate([place, place + 4 + walk, place + 16 + 4 * walk])
    boxes = np.column_stack([x, 0 * x, x + 30, 0 * x + 80])
    steps = steps_from_boxes(np.repeat(np.arange(3), 6), boxes, 3, np.array([15.0, 15.0, 5.0]))
    np.testing.assert_allclose(steps.shift[2], 3 * steps.shift[1], rtol=0.02)
    np.testing.assert_allclose(steps.support[2], steps.support[1], rtol=0.02)


def test_a_camera_that_stands_still_is_not_said_to_be_lost() -> None:
    camera = followed(panned(40, 20, 0.0)).camera
    assert list(camera.unknown) == list(range(20, 40))
    assert len(camera.lost) == 0


def still_and_turning(frames: int, turning_from: int) -> list[ImageArray]:
    """A place before a camera that stands still and then turns by 8 pixels a frame."""
    rng = np.random.default_rng(0)
    wide = cv2.GaussianBlur(rng.uniform(0, 255, (240, 1200)), (0, 0), 4)
    wide = np.clip(128 + 6 * (wide - wide.mean()), 0, 255).astype(np.uint8)
    starts = (8 * max(t - turning_from, 0) for t in range(frames))
    return [np.repeat(wide[:, start : start + 320, None], 3, axis=2) for start in starts]


@pytest.mark.parametrize("delay", [None, 0.5])
def test_people_who_walk_together_are_no_camera_that_turns_where_pictures_say_so(delay: float | None) -> None:
    walking, pictures = panned(60, 60, 8.0), still_and_turning(60, 45)
    standing = StandingCamera()
    tracker = FlowTracker(frame_rate=30.0, camera=standing, delay=delay)
    for found, picture in zip(walking, pictures, strict=True):
        standing.add(picture)
        tracker.update(found)
    tracker.tracks()
    box, frames = np.array([[0.0, 0, 30, 80]] * 2), np.array([40, 59])
    alone, seen = followed(walking).camera.to_first(box, frames)[:, 0], tracker.camera.to_first(box, frames)[:, 0]
    np.testing.assert_allclose(alone, [320, 8 * 59], atol=2, err_msg="boxes alone take it for a turn")
    assert seen[0] == 0
    np.testing.assert_allclose(seen[1], 8 * 14, atol=10, err_msg="once the camera turns the boxes tell how")
    assert tracker.facts()["camera_stood_still"] == 45
