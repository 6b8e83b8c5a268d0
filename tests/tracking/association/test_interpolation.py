"""Filled gaps and smoothed boxes against straight lines and a dense linear system."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.association.smoothing import SmoothingSettings, fill_gaps, smooth
from tsuiseki.tracking.types import Track


def _walk(frames: np.ndarray, step: tuple[float, float] = (3.0, 1.0)) -> Track:
    """A person of 20 x 50 pixels on a straight way."""
    frames = np.asarray(frames)
    corner = frames[:, None] * np.array(step) + 10
    boxes = np.hstack([corner, corner + np.array([20, 50])])
    return Track(7, frames, boxes, np.linspace(0.5, 1, len(frames)))


def test_a_gap_is_filled_on_the_straight_line() -> None:
    whole = _walk(np.arange(20))
    kept = np.r_[0:8, 12:20]
    track = Track(7, whole.frames[kept], whole.boxes[kept], whole.scores[kept])
    filled = fill_gaps(track, 4)
    np.testing.assert_array_equal(filled.frames, np.arange(20))
    np.testing.assert_allclose(filled.boxes, whole.boxes)
    np.testing.assert_allclose(filled.scores, whole.scores)
    assert np.flatnonzero(~filled.observed).tolist() == [8, 9, 10, 11]
    assert filled.id == 7


def test_only_gaps_that_are_short_enough_are_filled() -> None:
    filled = fill_gaps(_walk(np.r_[0:10, 13:20, 45:55]), 10)
    assert filled.frames.tolist() == [*range(20), *range(45, 55)]
    assert len(fill_gaps(_walk(np.r_[0:10, 15:25]), 4)) == 20


def test_smoothing_is_the_penalised_least_squares_solution() -> None:
    rng = np.random.default_rng(0)
    frames, strength = np.array([3, 4, 5, 7, 8, 9, 12, 13]), 30.0
    boxes = _walk(frames).boxes + rng.normal(0, 2, (8, 4))
    observed = np.ones(8, dtype=bool)
    observed[3] = False
    track = smooth(Track(1, frames, boxes, np.ones(8), observed), SmoothingSettings(strength, strength))
    penalty = np.diff(np.eye(11), 2, axis=0)
    weight, target = np.zeros(11), np.zeros((11, 4))
    weight[frames[observed] - 3], target[frames[observed] - 3] = 1, boxes[observed]
    expected = np.linalg.solve(np.diag(weight) + strength * penalty.T @ penalty, target)
    np.testing.assert_allclose(track.boxes, expected[frames - 3], rtol=1e-9)


def test_straight_motion_stays_and_noise_shrinks() -> None:
    straight = _walk(np.r_[0:30, 40:70])
    np.testing.assert_allclose(smooth(straight, SmoothingSettings()).boxes, straight.boxes, atol=1e-6)
    noise = np.random.default_rng(0).normal(0, 3, straight.boxes.shape)
    noisy = Track(1, straight.frames, straight.boxes + noise, straight.scores)
    left = smooth(noisy, SmoothingSettings()).boxes - straight.boxes
    assert np.std(left) < np.std(noise) / 2


def test_no_strength_leaves_boxes_alone() -> None:
    track = _walk(np.arange(6))
    noisy = Track(1, track.frames, track.boxes + np.random.default_rng(0).normal(0, 2, (6, 4)), track.scores)
    np.testing.assert_allclose(smooth(noisy, SmoothingSettings(0, 0)).boxes, noisy.boxes, atol=1e-12)


@pytest.mark.parametrize("frames", [np.array([4]), np.array([4, 9])])
def test_too_short_tracks_stay_as_they_are(frames: np.ndarray) -> None:
    track = _walk(frames)
    assert smooth(track, SmoothingSettings()) is track
    assert (fill_gaps(track, 9).boxes[[0, -1]] == track.boxes[[0, -1]]).all()


def test_a_shrinking_size_never_turns_negative() -> None:
    frames = np.r_[0:5, 60:63]
    size = np.array([50, 40, 30, 20, 10, 10, 10, 10.0])
    boxes = np.stack([np.zeros(8), np.zeros(8), size, size], axis=1)
    smoothed = smooth(fill_gaps(Track(1, frames, boxes, np.ones(8)), 99), SmoothingSettings())
    assert (smoothed.boxes[:, 2:] > smoothed.boxes[:, :2]).all()


@pytest.mark.parametrize("wrong", [-1.0, np.inf, np.nan])
def test_smoothing_settings_must_make_sense(wrong: float) -> None:
    with pytest.raises(ValueError, match="position"):
        SmoothingSettings(position=wrong)
