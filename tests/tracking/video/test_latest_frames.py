"""Live cameras side by side: what is paired, what is left out, and how it ends."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.types import Frame
from tsuiseki.tracking.video.synchronise import LatestFrames, paired


def frame(index: int) -> Frame:
    return Frame(index, 0.0, np.full((2, 2, 3), index, dtype=np.uint8))


def test_frames_within_the_tolerance_of_the_oldest_are_a_pair() -> None:
    newest = {0: (1.00, frame(4)), 1: (1.03, frame(7)), 2: (1.09, frame(2))}
    assert set(paired(newest, 0.05)) == {0, 1}
    assert set(paired(newest, 0.01)) == {0}
    assert set(paired(newest, 0.2)) == {0, 1, 2}


def test_two_cameras_in_step_come_together() -> None:
    def camera(barrier: threading.Barrier) -> Iterator[Frame]:
        for index in range(5):
            barrier.wait(10)
            yield frame(index)
            time.sleep(0.05)

    together = threading.Barrier(2)
    # So long a tolerance that a busy machine does not part them.
    latest = LatestFrames([lambda: camera(together)] * 2, tolerance=5.0)
    found = list(latest.moments())
    times = [moment.time for moment, _ in found]
    assert times == sorted(times)
    for moment, images in found:
        assert moment.frames[0] == moment.frames[1]
        assert [image[0, 0, 0] for image in images if image is not None] == list(moment.frames)


def test_a_camera_that_stalls_is_left_out() -> None:
    go_on = threading.Event()

    def lively() -> Iterator[Frame]:
        for index in range(6):
            yield frame(index)
            time.sleep(0.05)
        go_on.set()

    def stalled() -> Iterator[Frame]:
        yield frame(0)
        assert go_on.wait(10)

    found = [moment.frames for moment, _ in LatestFrames([lively, stalled], tolerance=0.01).moments()]
    assert found[-1][1] is None
    assert found[-1][0] == 5


def test_a_slow_filter_gets_the_newest_frame() -> None:
    def fast() -> Iterator[Frame]:
        for index in range(100):
            yield frame(index)
            time.sleep(0.002)

    numbers = []
    for moment, _ in LatestFrames([fast], tolerance=0.01).moments():
        numbers.append(moment.frames[0])
        time.sleep(0.05)
    assert numbers[-1] == 99
    assert len(numbers) < 50


def test_a_camera_that_breaks_ends_it_and_the_others_are_closed() -> None:
    closed = threading.Event()

    def endless() -> Iterator[Frame]:
        try:
            for index in range(100_000):
                yield frame(index)
                time.sleep(0.005)
        finally:
            closed.set()

    def broken() -> Iterator[Frame]:
        yield frame(0)
        raise RunError("webcam 1 stopped")

    with pytest.raises(RunError, match="webcam 1 stopped"):
        list(LatestFrames([endless, broken], tolerance=0.01).moments())
    assert closed.wait(5)
