"""`python -m benchmarks.papers stereo-sphere` on a film of three moments."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from benchmarks.papers import sphere
from benchmarks.papers.__main__ import main
from benchmarks.papers.sphere import distance_scores, turned
from tsuiseki.datamodules.scenes.sphere_clip import CarriedBallSettings, SphereClip, ball_cameras


@pytest.fixture
def fewer_particles(monkeypatch: pytest.MonkeyPatch) -> None:
    """One row of every group but section 3, fifty particles, and one ray a pixel for the pictures."""
    names = [name for name in sphere.WAYS if name[0] == "section 3"]
    names += [next(name for name in sphere.WAYS if name[0] == group) for group in sphere.VARIED]
    names += [name for name, way in sphere.WAYS.items() if way.radius_error == 0.1]
    few = {name: replace(sphere.WAYS[name], particles=50, cameras=2) for name in names}
    monkeypatch.setattr(sphere, "WAYS", few)
    monkeypatch.setattr(sphere, "CarriedBallSettings", partial(CarriedBallSettings, samples=1))


@pytest.mark.slow
@pytest.mark.usefixtures("fewer_particles")
def test_the_experiment_prints_writes_and_keeps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["stereo-sphere", "--seeds", "1", "--frames", "3", "--cache", str(tmp_path / "cache")]
    assert main([*words, "--out", str(tmp_path / "first")]) == 0
    printed = capsys.readouterr().out
    # The paper's numbers stand beside its method as printed, the additions below.
    order = ["contour, as printed (2.2.2)", "3.20", "to the fourth power", "`track sphere`"]
    places = [printed.index(name) for name in order]
    assert places == sorted(places)
    rows = json.loads((tmp_path / "first/results.json").read_text())
    groups = [row["group"] for row in rows]
    assert groups == ["section 3"] * 7 + ["particles", "cameras", "covered", "disturbed", "disturbed"]
    by_name = {row["name"]: row["runs"][0]["to_position"] for row in rows[:7]}
    assert all(scores["count"] == 3 for scores in by_name.values())
    # It starts where the ball is and moves by hand: a ball's width away would be 0.2 m.
    assert by_name["+ two stages of weighing"]["mean"] < 0.1
    files = {"results.json", "tables.md", "errors.png", "pictures.png", "tables.json"}
    assert {p.name for p in (tmp_path / "first").iterdir()} == files
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("*.npz")}
    # One for what is told wrongly to the tracker, for it is another table.
    assert len(kept) == 2
    assert main([*words, "--out", str(tmp_path / "second")]) == 0
    assert kept == {path: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("*.npz")}
    assert json.loads((tmp_path / "second/results.json").read_text()) == rows


def test_each_addition_changes_one_thing() -> None:
    ladder = [way for name, way in sphere.WAYS.items() if name[0] == "section 3"][3:]
    for before, after in pairwise(ladder):
        named = ("likelihood", "motion", "notices", "stages")
        assert sum(getattr(before, name) != getattr(after, name) for name in named) == 1


def test_a_turned_camera_moves_its_picture_by_the_pixels_asked_for() -> None:
    camera = ball_cameras(1)[0]
    ahead = (camera.position + 3 * camera.rotation[2])[None]
    wrong = turned(camera, 2.0, np.random.default_rng(0))
    assert np.linalg.norm(wrong.project(ahead)[0] - camera.project(ahead)[0]) == pytest.approx(2.0, abs=1e-6)
    np.testing.assert_allclose(wrong.rotation @ wrong.rotation.T, np.eye(3), atol=1e-12)


@pytest.mark.slow
def test_a_smeared_and_late_film_differs_only_where_it_should() -> None:
    plain = CarriedBallSettings(frames=1, noise=0.0, samples=1)
    first = next(SphereClip(plain, 0).frames())[0]
    late = next(SphereClip(replace(plain, lateness=(0.0, 0.2)), 0).frames())[0]
    np.testing.assert_array_equal(first[0], late[0])
    assert (first[1] != late[1]).any()
    smeared = next(SphereClip(replace(plain, exposure=0.2), 0).frames())[0]
    moved = np.abs(smeared[0].astype(int) - first[0]).max(axis=2)
    # The person and the shadow move, the room does not.
    assert 0.001 < np.mean(moved > 8) < 0.2


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--frames", "1"], "expected at least"),
        (["--seeds", "0"], '"0" for --seeds. Must be > 0'),
        (["--seed", "-1"], '"-1" for --seed. Must be >= 0'),
    ],
)
def test_wrong_requests_get_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], expected: str
) -> None:
    assert main(["stereo-sphere", "--out", str(tmp_path / "out"), *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line


def test_the_summary_of_distances():
    scores = distance_scores(np.array([1.0, 2.0, 6.0]))
    assert (scores.mean, scores.maximum, scores.median, scores.count) == (3.0, 6.0, 2.0, 3)
    with pytest.raises(ValueError, match="at least one"):
        distance_scores(np.empty(0))
