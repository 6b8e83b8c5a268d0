"""Frames of several videos laid on one time line."""

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import Frame
from tsuiseki.tracking.video.synchronise import Moment, align, default_tolerance, moments_with_images, read_timestamps


def test_videos_in_step_give_one_moment_a_frame():
    times = [np.arange(5) / 10, np.arange(5) / 10 + 0.001]
    moments = align(times, default_tolerance(times))
    assert [m.frames for m in moments] == [(k, k) for k in range(5)]
    np.testing.assert_allclose([m.time for m in moments], np.arange(5) / 10 + 0.0005)


def test_dropped_frames_and_other_rates_leave_gaps_but_lose_nothing():
    times = [np.array([0.0, 0.1, 0.3, 0.4]), np.arange(0.0, 0.45, 0.2)]
    moments = align(times, 0.02)
    assert [m.frames for m in moments] == [(0, 0), (1, None), (None, 1), (2, None), (3, 2)]


def test_an_offset_shifts_the_pairs():
    times = [np.arange(4) / 10, np.arange(4) / 10 + 0.2]
    assert [m.frames for m in align(times, 0.02)] == [(0, None), (1, None), (2, 0), (3, 1), (None, 2), (None, 3)]


@pytest.mark.parametrize("seed", range(5))
def test_every_frame_is_in_exactly_one_moment_and_time_never_goes_back(seed):
    rng = np.random.default_rng(seed)
    times = [np.sort(rng.uniform(0, 3, n)) for n in rng.integers(1, 40, 3)]
    moments = align(times, 0.05)
    assert (np.diff([m.time for m in moments]) > -0.05).all()
    for video, stamps in enumerate(times):
        assert [m.frames[video] for m in moments if m.frames[video] is not None] == list(range(len(stamps)))


def test_images_come_with_their_moments():
    def video(value):
        return iter([Frame(k, k / 10, np.full((2, 2, 3), value + k, np.uint8)) for k in range(3)])

    moments = [Moment(0.0, (0, None)), Moment(0.1, (2, 1))]
    found = [
        [None if i is None else int(i[0, 0, 0]) for i in images]
        for _, images in moments_with_images(moments, [video(10), video(20)])
    ]
    assert found == [[10, None], [12, 21]]


def test_timestamps_are_read_with_or_without_a_header(tmp_path):
    path = tmp_path / "times.csv"
    path.write_text("time,frame\n0.0,1\n0.04,2\n0.09,3\n")
    np.testing.assert_allclose(read_timestamps(path), [0, 0.04, 0.09])


@pytest.mark.parametrize("text", ["", "0\n1\nx\n", "0\n1\n1\n", "0\nnan\n"])
def test_wrong_timestamps_are_refused(tmp_path, text):
    (tmp_path / "times.csv").write_text(text)
    with pytest.raises(RequestError, match="expected"):
        read_timestamps(tmp_path / "times.csv")
