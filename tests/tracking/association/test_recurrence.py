"""What is found again on a line, how fast it moves, and how far the tracks of a video are smoothed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.association.link_cost import LinkCost
from tsuiseki.tracking.association.smoothing import USUAL, fit_smoothing
from tsuiseki.tracking.association.video_evidence import (
    DetectionCost,
    VideoEvidence,
    interval_frames,
    repeated_detections,
)
from tsuiseki.tracking.types import FloatArray, Track


def moving(speed: float, frames: int, rate: float, side: float = 80.0) -> FloatArray:
    """Boxes of one target that moves at ``speed`` sides a second."""
    x = np.arange(frames) * speed * side / rate
    return np.stack([x, np.zeros(frames), x + side, np.full(frames, side / 2)], axis=1)


@pytest.mark.parametrize(("rate", "speed"), [(10.0, 0.0), (10.0, 5.0), (30.0, 0.5), (30.0, 5.0), (5.0, 3.0)])
def test_a_target_is_found_again_at_any_speed_and_its_speed_is_told(rate: float, speed: float) -> None:
    triples = repeated_detections(np.arange(30), moving(speed, 30, rate), rate)
    found, told = triples.repeated, triples.speed
    gap = interval_frames(rate)
    assert found[gap : 30 - gap].all()
    assert not found[:gap].any()
    assert not found[30 - gap :].any()
    np.testing.assert_allclose(told[gap : 30 - gap], speed, atol=1e-9)


def test_a_box_off_the_line_is_not_found_again() -> None:
    boxes = moving(1.0, 3, 10.0)
    boxes[1, [1, 3]] += 40
    triples = repeated_detections(np.arange(3), boxes, 10.0)
    assert not triples.repeated.any()
    assert np.isnan(triples.speed).all()


def test_nothing_is_found_in_nothing() -> None:
    triples = repeated_detections(np.empty(0, np.int64), np.empty((0, 4)), 25.0)
    assert len(triples.repeated) == len(triples.speed) == len(triples.earlier) == 0


def test_the_typical_speed_starts_at_what_is_expected_and_follows_the_video() -> None:
    evidence = VideoEvidence(DetectionCost(), 10.0)
    assert evidence.speed() == 0.75
    evidence.add(np.arange(100), moving(3.0, 100, 10.0), np.ones(100), 99)
    assert evidence.speed() == pytest.approx(3.0)


def test_links_reach_further_where_targets_are_fast_and_no_less_where_they_are_slow() -> None:
    cost = LinkCost()
    fast, slow = cost.at_speed(3.0), cost.at_speed(0.5)
    np.testing.assert_allclose(fast.motion.velocity, np.array(cost.motion.velocity) * 4)
    np.testing.assert_allclose(fast.motion.acceleration, np.array(cost.motion.acceleration) * 2)
    np.testing.assert_allclose(fast.speed, np.array(cost.speed) * 4)
    assert slow.speed == cost.speed
    assert slow.motion.acceleration == cost.motion.acceleration


def noisy(noise: float, bend: float) -> list[Track]:
    """Tracks of targets that swing every 2 seconds, by ``bend`` sides, detected with errors of ``noise`` sides."""
    rng = np.random.default_rng(4)
    times, tracks = np.arange(120), []
    for number in range(8):
        x = 1000 * number + bend * 80 * np.sin(times * np.pi / 10)
        boxes = np.stack([x, np.zeros(120), x + 30, np.full(120, 80.0)], axis=1) + rng.normal(0, noise * 80, (120, 4))
        tracks.append(Track(number + 1, times, boxes, np.ones(120)))
    return tracks


def test_noisy_boxes_are_smoothed_more_than_targets_that_turn() -> None:
    still = fit_smoothing(noisy(0.05, 0.0), 10.0)
    turning = fit_smoothing(noisy(0.01, 0.5), 10.0)
    assert still.position > 100 * turning.position


def test_short_tracks_are_smoothed_as_by_default_whatever_the_rate() -> None:
    track = Track(1, np.arange(5), moving(1.0, 5, 30.0), np.ones(5))
    assert fit_smoothing([track], 30.0) == USUAL
    assert fit_smoothing([], 60.0).position == pytest.approx(480.0)


@pytest.mark.parametrize("tracks", [noisy(0.05, 0.0), noisy(0.01, 0.5), []])
def test_finer_steps_of_time_smooth_as_much(tracks: list[Track]) -> None:
    """A sum of squared second differences over steps of a quarter is 4³ times smaller on the same curve."""
    whole, fine = (
        fit_smoothing([replace(track, frames=ticks * track.frames) for track in tracks], 10.0, ticks)
        for ticks in (1, 4)
    )
    assert fine.position == pytest.approx(64 * whole.position)
    assert fine.size == pytest.approx(64 * whole.size)


@pytest.mark.parametrize(
    ("frames", "expected"),
    [([], 1), ([7], 1), ([0, 1], 1), ([0, 3, 6], 3), ([2, 6, 12], 2), ([0, 90, 180], 1), ([4, 4, 8, 8], 4)],
)
def test_the_stride_is_the_common_divisor_of_times_between_detections(frames: list[int], expected: int) -> None:
    every, parts = (VideoEvidence(DetectionCost(), 30.0) for _ in range(2))
    boxes, scores = np.tile([0.0, 0.0, 10.0, 20.0], (len(frames), 1)), np.ones(len(frames))
    every.add(np.array(frames, dtype=np.int64), boxes, scores, max(frames, default=0))
    for frame in frames:
        parts.add(np.array([frame]), boxes[:1], scores[:1], frame)
    assert every.stride() == parts.stride() == expected


@pytest.mark.parametrize(("rate", "stride", "expected"), [(30, 1, 3), (30, 2, 4), (30, 3, 3), (10, 3, 3), (10, 1, 1)])
def test_the_interval_falls_on_frames_with_detections(rate: float, stride: int, expected: int) -> None:
    assert interval_frames(rate, stride) == expected
