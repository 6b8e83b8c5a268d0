"""Coloured objects and measured points in one call."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.blob_clip import BlobClip, BlobSceneSettings
from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.points.run import follow_blobs, follow_points, track_blobs, track_points
from tsuiseki.tracking.points.settings import BlobSettings, PointSettings
from tsuiseki.tracking.types import Detections


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    settings = BlobSceneSettings(frames=8, width=240, height=180, objects=2, clutter=0, enter=0.0)
    return write_clip(tmp_path_factory.mktemp("blobs") / "clip", BlobClip(settings, 1))


def points(length: int = 25) -> list[np.ndarray]:
    """Two points that walk apart."""
    return [np.array([[50.0 + 3 * t, 60.0], [250.0 - 2 * t, 150.0 + t]]) for t in range(length)]


@pytest.mark.slow
def test_the_command_writes_what_the_function_gives(clip: Path, tmp_path: Path) -> None:
    tracks = track_blobs(clip, "red", frames="2-8", settings=BlobSettings(particles=200))
    words = ["track", "blobs", str(clip), "--colour", "red", "--frames", "2-8", "--particles", "200"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    written = read_tracks(tmp_path / "out" / "tracks.txt")
    assert len(tracks) == len(written) == 2
    for ours, theirs in zip(tracks, written, strict=True):
        np.testing.assert_array_equal(ours.frames, theirs.frames)
        np.testing.assert_allclose(ours.boxes, theirs.boxes, atol=0.02)


@pytest.mark.parametrize("preset", ["calibrated", "single"])
def test_each_frame_is_answered(clip: Path, preset: Any) -> None:
    seen = list(follow_blobs(clip, "red", settings=BlobSettings(preset=preset, particles=200)))
    assert [(frame.index, some.frame) for frame, some in seen] == [(t, t) for t in range(8)]
    assert len(seen[-1][1]) == {"calibrated": 2, "single": 1}[preset]


def test_a_colour_is_taken_from_a_box(clip: Path) -> None:
    named = track_blobs(clip, "red")
    taken = track_blobs(clip, named[0].boxes[0])
    assert len(taken) >= 1


def test_points_are_tracked_whole_and_frame_by_frame() -> None:
    tracks = track_points(points(), (320, 240))
    assert len(tracks) == 2
    assert min(len(track) for track in tracks) > 20
    last = list(follow_points(points(), (320, 240)))[-1]
    assert (last.frame, sorted(last.ids.tolist())) == (24, [1, 2])
    ends = {track.id: track.boxes[-1] for track in tracks}
    for target in last:
        np.testing.assert_array_equal(target.box, ends[target.id])
    middles = sorted(((box[:2] + box[2:]) / 2).tolist() for box in ends.values())
    # Boxes lie about the points; a filter follows within a pixel or two.
    np.testing.assert_allclose(middles, sorted(points()[-1].tolist()), atol=3)


def test_points_come_in_the_forms_of_detections_too() -> None:
    half = np.array(PointSettings().box) / 2
    boxes = [np.hstack([p - half, p + half]) for p in points()]
    as_points = track_points(points(), (320, 240))
    assert len(as_points) == 2
    for form in (boxes, [Detections(b, np.ones(2)) for b in boxes], [b.tolist() for b in boxes]):
        for a, b in zip(as_points, track_points(form, (320, 240)), strict=True):
            np.testing.assert_allclose(a.boxes, b.boxes)
    assert len(track_points([[], np.empty((0, 2))], (320, 240))) == 0


@pytest.mark.parametrize("colour", ["reddish", (1, 2, 3), (9, 9, 5, 5)])
def test_what_is_no_colour_says_so(clip: Path, colour: Any) -> None:
    with pytest.raises(RequestError, match="expected a"):
        track_blobs(clip, colour)


def test_points_that_are_not_finite_say_so() -> None:
    with pytest.raises(RequestError, match="finite points"):
        track_points([[[np.nan, 2.0]]], (320, 240))
