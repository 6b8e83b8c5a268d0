from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from tsuiseki.datamodules.scenes import clip as clips
from tsuiseki.datamodules.scenes.clip import ClipSettings, by_appearance, ground_truth, write_clip
from tsuiseki.datamodules.scenes.people import walkers as walkers_module
from tsuiseki.datamodules.scenes.people.walkers import Motion, crowd
from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.formats.mot_sequence import find_sequences, read_sequence
from tsuiseki.tracking.types import FloatArray

SETTINGS = StreetSettings(width=160, height=120, frames=6, frame_rate=10, people=4, occluders=3, person_height=(15, 60))


def test_clip_is_read_back_as_written(tmp_path: Path) -> None:
    folder = write_clip(tmp_path / "clip", StreetClip(SETTINGS, 3))
    sequence = read_sequence(folder)
    assert (sequence.length, sequence.width, sequence.height, sequence.frame_rate) == (6, 160, 120, 10)
    assert [s.name for s in find_sequences(tmp_path)] == ["clip"]
    frames = list(StreetClip(SETTINGS, 3).frames())
    expected = ground_truth([truth for _, truth in frames])
    truth = read_ground_truth(folder / "gt" / "gt.txt")
    np.testing.assert_array_equal(truth.frames, expected.frames)
    np.testing.assert_array_equal(truth.ids, by_appearance(expected.ids))
    # The file's own precision.
    np.testing.assert_allclose(truth.boxes, expected.boxes, atol=0.011)
    np.testing.assert_allclose(truth.visibility, expected.visibility, atol=1e-4)
    assert truth.evaluated.all()
    assert set(truth.ids) == set(range(1, truth.ids.max() + 1))
    image = cv2.imread(str(sequence.images[2]))
    assert image is not None
    # JPEG of quality 90 on a noisy picture.
    assert np.abs(image[:, :, ::-1].astype(int) - frames[2][0][0]).mean() < 6


def test_same_seed_same_clip() -> None:
    ((image,), truth), ((same,), others), ((another,), _) = (
        StreetClip(SETTINGS, seed).draw_frame(4) for seed in (7, 7, 8)
    )
    np.testing.assert_array_equal(image, same)
    np.testing.assert_array_equal(truth.boxes, others.boxes)
    assert (image != another).any()


def test_boxes_are_where_the_people_are() -> None:
    plan = StreetClip(StreetSettings(width=160, height=120, frames=3, people=5, person_height=(15, 60)), 1)
    _, truth = plan.draw_frame(1)
    assert len(truth.ids) >= 3
    for identity, box, visible in zip(truth.ids, truth.boxes, truth.visibility, strict=True):
        walker = plan.walkers[identity - 1]
        at = np.append(walker.positions[1 - walker.first], 0.5 * walker.person.build.height)
        x, y = plan.camera.project(at[None])[0][0]
        if visible > 0.99:
            assert box[0] - 2 < x < box[2] + 2
            assert box[1] < y < box[3]


def test_the_background_stands_still() -> None:
    plan = StreetClip(StreetSettings(width=160, height=120, frames=20, people=2, person_height=(15, 60)), 2)
    plan.drift, plan.lens = np.ones(20), replace(plan.lens, noise=0.0)
    images = [plan.draw_frame(frame)[0][0].astype(int) for frame in (0, 10)]
    changed = np.abs(images[0] - images[1]).max(axis=2) > 2
    assert 0 < changed.mean() < 0.5


def test_an_interrupted_run_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(clips, "write_ground_truth", broken)
    with pytest.raises(KeyboardInterrupt):
        write_clip(tmp_path / "clip", StreetClip(SETTINGS, 0))
    assert list(tmp_path.iterdir()) == []


def test_an_existing_clip_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "clip").mkdir()
    (tmp_path / "clip" / "mine.txt").write_text("precious")
    with pytest.raises(RequestError, match=r"already holds mine\.txt"):
        write_clip(tmp_path / "clip", StreetClip(SETTINGS, 0))
    assert (tmp_path / "clip" / "mine.txt").read_text() == "precious"
    with pytest.raises(RequestError, match="is a file"):
        write_clip(tmp_path / "clip" / "mine.txt", StreetClip(SETTINGS, 0))
    with pytest.raises(RequestError, match="cannot write"):
        write_clip(tmp_path / "clip" / "mine.txt" / "below", StreetClip(SETTINGS, 0))


def test_an_empty_folder_is_filled_and_names_the_sequence(tmp_path: Path) -> None:
    (tmp_path / "work").mkdir()
    folder = write_clip(tmp_path / "work", StreetClip(SETTINGS, 0))
    assert read_sequence(folder).name == "work"
    assert [p.name for p in tmp_path.iterdir()] == ["work"]


@pytest.mark.parametrize(
    "change",
    [
        {"frames": 0},
        {"frame_rate": 0.0},
        {"frame_rate": float("nan")},
        {"people": 0},
        {"width": 3},
        {"person_height": (60.0, 20.0)},
        {"motion": "swim"},
    ],
    ids=str,
)
def test_impossible_settings_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValidationError, match=next(iter(change))):
        StreetSettings(**change)  # type: ignore[arg-type]


def test_a_size_no_camera_shows_is_refused() -> None:
    with pytest.raises(RequestError, match="person_height"):
        StreetClip(StreetSettings(width=64, height=64, person_height=(5000, 6000)), 0)


def test_walkers_walk(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    monkeypatch.setattr(walkers_module, "PAUSES", 0.5)
    walkers = crowd(
        rng,
        ClipSettings(frames=300),
        6,
        lambda r: r.uniform(-5, 5, 2),
        lambda r: np.array([12.0 * r.choice([-1, 1]), r.uniform(-5, 5)]),
        np.array([[0.0, 0.0, 0.5]]),
    )
    there = np.array([sum(w.is_there(f) for w in walkers) for f in range(300)])
    assert there[0] == 6
    assert there.mean() > 4
    for walker in walkers:
        moved = np.linalg.norm(np.diff(walker.positions, axis=0), axis=1) * 25
        # 1.7 times the mean speed, and what stepping aside adds.
        assert moved.max(initial=0) < 4.5
        assert (np.diff(walker.phases) >= 0).all()
        walking = walker.speeds > 0.8
        forward = np.stack([np.cos(walker.headings), np.sin(walker.headings)], axis=1)
        velocity = np.gradient(walker.positions, axis=0) * 25 if len(walker.positions) > 1 else forward
        along = np.einsum("ij,ij->i", forward, velocity)[walking] / walker.speeds[walking]
        assert np.mean(along) > 0.9 or not walking.any()


def test_people_keep_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    monkeypatch.setattr(walkers_module, "PAUSES", 0.0)
    monkeypatch.setattr(walkers_module, "GROUPS", 0.0)
    # Everybody crosses one spot; undisturbed ways would pass through each other.
    walkers = crowd(
        rng,
        ClipSettings(frames=150, frame_rate=10.0),
        4,
        lambda r: r.normal(0, 0.3, 2),
        lambda r: 8 * np.array([np.cos(a := r.uniform(0, 7)), np.sin(a)]),
        np.empty((0, 3)),
    )
    gaps = []
    for frame in range(30, 150):
        now = np.array([w.positions[frame - w.first] for w in walkers if w.is_there(frame)])
        apart = np.linalg.norm(now[:, None] - now[None], axis=2)[np.triu_indices(len(now), 1)]
        gaps += apart.tolist()
    assert np.mean(np.array(gaps) < 0.25) < 0.02


def velocities(motion: Motion) -> FloatArray:
    """``(150, 10, 2)`` metres a second of ten people on a square of ten metres."""
    rng, clip = np.random.default_rng(0), ClipSettings(frames=150)
    inside = lambda r: r.uniform(-5, 5, 2)  # noqa: E731
    walkers = crowd(rng, clip, 10, inside, lambda r: r.uniform(20, 30, 2), np.empty((0, 3)), motion)
    assert [walker.first for walker in walkers] == [0] * 10
    return np.gradient(np.stack([walker.positions for walker in walkers], axis=1), axis=0) * clip.frame_rate


def test_dancers_move_at_once_and_players_run_fast_and_turn() -> None:
    dance, sport = velocities("dance"), velocities("sport")
    # How alike the speeds of any two people are over time.
    alike = [np.corrcoef(np.linalg.norm(v, axis=2).T)[np.triu_indices(10, 1)].mean() for v in (dance, sport)]
    assert alike[0] > 0.5
    assert abs(alike[1]) < 0.2
    speed = np.linalg.norm(sport, axis=2)
    assert np.quantile(speed, 0.9) > 4
    # Velocities half a second apart often point to opposite sides.
    assert np.mean((sport[12:] * sport[:-12]).sum(axis=2) < 0) > 0.15
