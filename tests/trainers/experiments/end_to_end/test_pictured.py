"""Generated streets, and the networks that look at pictures, on very small ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.drone.tracker import DRONE_FLOW
from tsuiseki.tracking.features.networks.exported import Appearance, Detector
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.association.fitting import Fit
from tsuiseki.trainers.association.videos import described
from tsuiseki.trainers.experiments.association.sequences import find_clips, read_clip
from tsuiseki.trainers.experiments.end_to_end import appearance, detected, heads
from tsuiseki.trainers.experiments.end_to_end.pictured import (
    Stretch,
    gap_links,
    graphs_of_video,
    read_filmed,
    read_stretch,
    sums_of,
    tracks_on,
)
from tsuiseki.trainers.experiments.end_to_end.streets import (
    STREETS,
    StreetCount,
    write_drones,
    write_pictured,
    write_streets,
)

FRAMES = 8


@pytest.fixture(scope="module")
def pictured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pictured")
    write_pictured(folder, StreetCount(clips=1, frames=FRAMES, seed=500), 0.5)
    return folder / "street-00"


def test_streets_are_clips_with_detections(tmp_path: Path) -> None:
    for name in ("streets", "again"):
        write_streets(tmp_path / name, StreetCount(clips=2, frames=4))
    one, other = find_clips(tmp_path, STREETS)
    assert one.length == 4
    assert one.rate != other.rate or one.size == other.size
    assert sum(len(found) for found in read_clip(one)) > 4
    assert not list((tmp_path / "streets").rglob("*.jpg"))
    for path in (tmp_path / "streets").rglob("*.txt"):
        assert path.read_bytes() == (tmp_path / "again" / path.relative_to(tmp_path / "streets")).read_bytes()


def test_a_stretch_counts_its_frames_from_its_first(pictured: Path) -> None:
    video = read_stretch(Stretch(pictured, 3, 6))
    assert len(video.detections) == len(video.images) == 4
    assert set(video.truth.frames) == {0, 1, 2, 3}
    tracks = tracks_on(video, video.detections)
    every, made = gap_links(video, tracks)
    assert 0 <= made <= every


def test_clips_from_a_drone_are_tracked_with_its_settings(tmp_path: Path) -> None:
    write_drones(tmp_path, StreetCount(clips=1, frames=FRAMES, seed=500), 0.0)
    video = read_filmed(Stretch(tmp_path / "drone-00", 1, FRAMES))
    assert len(video.images) == len(video.camera) == FRAMES
    assert tracks_on(video, video.detections, DRONE_FLOW)
    assert len(graphs_of_video(video, DRONE_FLOW).detections) > FRAMES


@pytest.mark.slow
def test_the_siamese_network_before_and_after(pictured: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(appearance, "STEPS", 2)
    monkeypatch.setattr(appearance, "SECONDS", 0.4)
    every = Stretch(pictured, 1, FRAMES)
    found = {
        way: appearance.appearance_sums((every,), (every,), shipped("appearance_people"), way, "people")[0]
        for way in ("as it ships", "through the flow", "projected, the flow")
    }
    assert all(sums.shape == (85,) and np.isfinite(sums).all() for sums in found.values())


@pytest.mark.slow
def test_the_heads_before_and_after(pictured: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heads, "RATE", 3.0)
    every = Stretch(pictured, 1, FRAMES)
    found = heads.heads_sums((every,), (every,), shipped("detector_street"), steps=2)
    assert len(found) == len(heads.WAYS)
    before, after = found[0][0], found[-1][0]
    assert before.shape == (84,)
    assert 0 < before[83] <= 1
    assert before[83] != after[83]


@pytest.mark.slow
def test_costs_after_a_detector(pictured: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The default's row is that of the tracker alone, and what was learnt changes costs by the shares taken."""
    monkeypatch.setattr(detected, "FIT", Fit(steps=10, learning_rate=0.1))
    every = Stretch(pictured, 1, FRAMES)
    models = shipped("detector_street"), shipped("appearance_people"), shipped("affinity_people")
    found = detected.detected_sums((every,), (every,), *models)
    assert list(found) == [
        detected.DEFAULT,
        detected.PAIRS,
        *detected.SHARES,
        detected.SCORES,
        detected.LINKS_AND_SCORES,
    ]
    look = Appearance(models[1], threads=1)
    video = described(read_stretch(every, Detector(models[0], detected.THRESHOLD, threads=1)), look)
    tracker = FlowTracker(frame_rate=video.frame_rate, size=video.size, camera=detected.standing_in(every))
    for one in video.detections:
        tracker.update(one)
    np.testing.assert_allclose(found[detected.DEFAULT][0], sums_of(video, tracker.tracks()))
    assert all(np.isfinite(sums).all() and sums.shape == (83,) for (sums,) in found.values())
