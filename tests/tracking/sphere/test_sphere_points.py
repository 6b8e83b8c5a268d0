"""A ball from its measured pixels: thrown before two cameras, seen by a detector that misses and errs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.sphere_clip import ball_cameras
from tsuiseki.tracking.cameras.camera_files import PlacedCamera, write_cameras
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.space import distance_to_position
from tsuiseki.tracking.formats.world_tables import read_ball_points, read_path3d, write_path3d
from tsuiseki.tracking.sphere.points import track_sphere_points
from tsuiseki.tracking.sphere.settings import SphereSettings
from tsuiseki.tracking.types.tracks import Path3D

RATE, FRAMES = 50.0, 50


@pytest.fixture(scope="module")
def throw(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One second of free flight; 10 % of the pixels are missing and 4 % anywhere; the second file is TrackNet's."""
    folder, rng = tmp_path_factory.mktemp("throw"), np.random.default_rng(0)
    times = np.arange(FRAMES) / RATE
    truth = np.array([0.0, -0.9, 0.9]) + times[:, None] * [0.3, 1.8, 4.2]
    truth[:, 2] -= 0.5 * 9.81 * times**2
    cameras = ball_cameras(2)
    for number, camera in enumerate(cameras):
        pixels = camera.project(truth)[0] + rng.normal(0, 1.0, (FRAMES, 2))
        wild = rng.random(FRAMES) < 0.04
        pixels[wild] = rng.uniform(0, 600, (wild.sum(), 2))
        seen = rng.random(FRAMES) >= 0.1
        seen[0] = True
        if number == 0:
            rows = [f"{k + 1},{x!r},{y!r}" for k, (x, y) in enumerate(pixels.tolist()) if seen[k]]
            text = "frame,x,y"
        else:
            rows = [
                f"{k},{int(seen[k])},{x - 0.5 if seen[k] else 0!r},{y - 0.5 if seen[k] else 0!r}"
                for k, (x, y) in enumerate(pixels.tolist())
            ]
            text = "Frame,Visibility,X,Y"
        (folder / f"{'ab'[number]}.csv").write_text("\n".join([text, *rows]) + "\n")
    write_cameras(folder / "cameras.yaml", [PlacedCamera(n, c, RATE) for n, c in zip("ab", cameras, strict=True)])
    write_path3d(folder / "truth.csv", Path3D(times, truth))
    return folder


@pytest.mark.slow
def test_a_thrown_ball_is_found_and_followed(throw: Path, tmp_path: Path) -> None:
    words = [
        "track",
        "sphere",
        "--points",
        f"{throw / 'a.csv'},{throw / 'b.csv'}",
        "--cameras",
        str(throw / "cameras.yaml"),
    ]
    words += ["--motion", "ballistic", "--deviation", "1", "--truth", str(throw / "truth.csv"), "--particles", "1000"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    away = distance_to_position(read_path3d(tmp_path / "out/track3d.csv"), read_path3d(throw / "truth.csv"))
    # A pixel is 6 mm here; the first moments have no velocity yet.
    assert np.median(away[10:]) < 0.01
    assert away[10:].max() < 0.1
    record = json.loads((tmp_path / "out/run.json").read_text())
    assert record["frames"]["status"].count("tracking") >= 40
    assert {"track3d.csv", "path.png", "report.html", "run.json"} == {p.name for p in (tmp_path / "out").iterdir()}
    settings = SphereSettings(motion="ballistic", particles=1000)
    found = track_sphere_points(
        [throw / "a.csv", throw / "b.csv"], throw / "cameras.yaml", settings=settings, deviation=1
    )
    written = read_path3d(tmp_path / "out/track3d.csv")
    np.testing.assert_allclose(written.points, [p.point for p in found], atol=1e-5)


def test_tracknet_frames_begin_at_nought_and_hidden_balls_are_none(tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours.csv", tmp_path / "theirs.csv"
    ours.write_text("frame,x,y\n1,10.5,20.5\n3,,\n4,12,21\n")
    theirs.write_text("Frame,Visibility,X,Y\n0,1,10,20\n1,0,0,0\n2,0,0,0\n3,1,11.5,20.5\n")
    np.testing.assert_array_equal(read_ball_points(ours), read_ball_points(theirs))
    assert np.isnan(read_ball_points(ours)[[1, 2]]).all()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("x,y\n1,2\n", "found no frame"),
        ("frame,x,y\n0,1,2\n", "expected a whole number from 1 to .* in column frame, got .0"),
        ("frame,x,y\n1,1,2\n1,1,2\n", "expected each frame once, got 1 again"),
        ("frame,x,y\n1,a,2\n", "expected a finite number in column x, got 'a'"),
        ("frame,x,y\n1,,\n", "expected at least one frame that shows the ball"),
    ],
)
def test_a_broken_file_gets_one_line(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "ball.csv"
    path.write_text(text)
    with pytest.raises(RequestError, match=reason):
        read_ball_points(path)


def test_wrong_requests_get_one_line(throw: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files, cameras = f"{throw / 'a.csv'},{throw / 'b.csv'}", ["--cameras", str(throw / "cameras.yaml")]
    for words, reason in (
        (["--points", str(throw / "a.csv")], "--points: expected at least two files and one camera for each, got 1"),
        (["--points", files, "--overlay"], "--points: expected no videos"),
        (["--points", files, "--preset", "paper"], "--preset: expected none with --points"),
        (["--points", files, "--likelihood", "background"], "--likelihood: expected none with --points"),
        (["--points", files, "--deviation", "0"], "--deviation: expected a number greater than 0"),
        ([], "--radius: expected the ball's radius"),
    ):
        assert main(["track", "sphere", *words, *cameras, "--out", str(tmp_path / "out")]) == 2
        assert reason in capsys.readouterr().err
