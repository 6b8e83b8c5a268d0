"""Runs of frames say what a list of them would."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.features.camera_path import FrameRuns


@pytest.mark.parametrize("seed", range(5))
def test_runs_hold_what_a_list_holds(seed: int) -> None:
    frames = np.flatnonzero(np.random.default_rng(seed).random(60) < 0.6).tolist()
    runs = FrameRuns(frames)
    assert list(runs) == frames
    assert len(runs) == len(frames)
    assert [frame for frame in range(-1, 61) if frame in runs] == frames
    assert sum(last - first + 1 for first, last in runs.from_one()) == len(frames)


def test_a_copy_goes_on_by_itself_and_a_long_run_is_one() -> None:
    runs = FrameRuns(range(100_000))
    other = runs.copy()
    other.append(100_000)
    assert runs.from_one() == [[1, 100_000]]
    assert other.from_one() == [[1, 100_001]]


def test_nothing_is_in_nothing_and_frames_come_in_order() -> None:
    runs = FrameRuns()
    assert not runs
    assert 0 not in runs
    runs.append(0)
    with pytest.raises(ValueError, match="after 0"):
        runs.append(0)
