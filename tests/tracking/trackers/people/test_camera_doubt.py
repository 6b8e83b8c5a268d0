"""A moving camera that its boxes tell too little of: said, and in doubt."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.association.camera_from_boxes import CameraFromBoxes
from tsuiseki.tracking.features.motion.camera_trajectory import said_of_camera
from tsuiseki.tracking.trackers.people.flow import FlowTracker
from tsuiseki.tracking.types import Detections


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
    least = CameraFromBoxes().doubt(2.0, 30.0) ** 2
    assert variance[29] == variance[1]
    assert (np.diff(variance[29:]) >= 0.99 * least).all()
    # The way of the two boxes is followed all the same.
    np.testing.assert_allclose(camera.to_first(np.array([[0.0, 0, 30, 80]]), np.array([59]))[0, 0], 8.0 * 59, atol=2)
    assert said_of_camera(camera.lost.from_one(), camera.source) == (
        "how the camera moved into frames 31-60 is not known from the few boxes there; links over them reach further"
    )


def test_a_camera_that_stands_still_is_not_said_to_be_lost() -> None:
    camera = followed(panned(40, 20, 0.0)).camera
    assert list(camera.unknown) == list(range(20, 40))
    assert len(camera.lost) == 0
