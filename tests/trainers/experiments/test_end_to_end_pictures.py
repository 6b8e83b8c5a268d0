"""Generated streets, and the networks that look at pictures, on very small ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.drone.settings import DRONE_FLOW
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.association.fitting import Fit
from tsuiseki.trainers.experiments import end_to_end_pictures
from tsuiseki.trainers.experiments.end_to_end_pictures import (
    APPEARANCE_WAYS,
    HEADS_WAYS,
    FramesOf,
    Taught,
    appearance_sums,
    graphs_of_video,
    heads_sums,
    read_filmed,
    read_frames,
    tracked_sums,
    write_drones,
    write_pictured,
)

FRAMES = 8


@pytest.fixture(scope="module")
def pictured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pictured")
    write_pictured(folder, 1, FRAMES, 0.5)
    return folder / "street-00"


def test_frames_are_counted_from_the_first(pictured: Path) -> None:
    video = read_frames(FramesOf(pictured, 3, 6))
    assert len(video.detections) == len(video.images) == 4
    assert set(video.truth.frames) == {0, 1, 2, 3}
    assert tracked_sums(video, list(video.detections)).shape == (83,)


def test_clips_from_a_drone_are_tracked_with_its_settings(tmp_path: Path) -> None:
    write_drones(tmp_path, 1, FRAMES, 0.0)
    video = read_filmed(FramesOf(tmp_path / "drone-00", 1, FRAMES))
    assert len(video.images) == len(video.camera) == FRAMES
    assert tracked_sums(video, list(video.detections), DRONE_FLOW)[:19].sum() > 0
    assert len(graphs_of_video(video, DRONE_FLOW).detections) > FRAMES


@pytest.mark.slow
def test_the_siamese_network_before_and_after(pictured: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(end_to_end_pictures, "APPEARANCE_FIT", Fit(steps=2, seconds=0.4))
    every = (FramesOf(pictured, 1, FRAMES),)
    source = Taught(shipped("appearance_people"), every, every)
    found = [appearance_sums(way, source)[0] for way in APPEARANCE_WAYS]
    assert all(sums.shape == (83,) and np.isfinite(sums).all() for sums in found)


@pytest.mark.slow
def test_the_heads_before_and_after(pictured: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(end_to_end_pictures, "HEADS_FIT", Fit(steps=2, seconds=0.6))
    monkeypatch.setattr(end_to_end_pictures, "HEADS_RATE", 3.0)
    every = (FramesOf(pictured, 1, FRAMES),)
    found = heads_sums(Taught(shipped("detector_street"), every, every))
    assert len(found) == len(HEADS_WAYS)
    before, after = found[0][0], found[-1][0]
    assert before.shape == (84,)
    assert 0 < before[83] <= 1
    assert before[83] != after[83]
