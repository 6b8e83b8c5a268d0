"""The goldfish experiment in small: one clip to learn from, one to test on."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.papers import goldfish
from benchmarks.papers.__main__ import main
from benchmarks.papers.goldfish import followed_counts, sudden_turns
from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.goldfish_clip import GoldfishClip, GoldfishSettings, goldfish_states

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Where one experiment of two clips was run: its store and its results."""
    root = tmp_path_factory.mktemp("goldfish")
    settings = GoldfishSettings(frames=16, width=400, height=300, fish=2)
    sets = {
        name: [write_clip(root / f"{name}-01", GoldfishClip(settings, n))]
        for n, name in enumerate(("learning", "test"), start=1)
    }

    def kept():
        return {path: path.stat().st_mtime_ns for path in (root / "cache").rglob("run_trial-*.npz")}

    def run(out, *more):
        words = ["--out", str(root / out), "--cache", str(root / "cache"), "--seeds", "2", *more]
        return main(["pca-particle-filter", *words])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(goldfish, "clips", lambda _, name, __: sets[name])
        arms = [arms for arms, _ in goldfish.PARTS.values()]
        patch.setattr(goldfish, "PARTS", {"arms": (arms[0], (60, 120)), "beyond": (arms[1], (60,))})
        patch.setattr(goldfish, "LEARNING_PARTICLES", 800)
        patch.setattr(goldfish, "CLAIMS", (("C against A", ("C", 60), ("A", 120)), ("not run", ("C", 500), ("A", 60))))
        assert run("first") == 0
        before = kept()
        assert run("second") == 0
        assert kept() == before
        assert len(before) == 2
        patch.setattr(goldfish, "PARTS", {"arms": (arms[0], (60,)), "beyond": (arms[1], (60,))})
        assert run("other") == 0
        assert len(kept()) == 4
    return root


def test_an_experiment_is_whole_and_the_same_again(folders):
    first, second = (json.loads((folders / name / "results.json").read_text()) for name in ("first", "second"))
    assert first == second
    assert {"success.png", "particles.png", "motion.json", "tables.md", "tables.json"} <= {
        path.name for path in (folders / "first").iterdir()
    }
    assert json.loads((folders / "first/motion.json").read_text())["body"] == "goldfish"
    found = {(run["arm"], run["particles"]): run for run in first["runs"]}
    paper, added = (arms for arms, _ in goldfish.PARTS.values())
    assert set(found) == {(a, n) for a in paper for n in (60, 120)} | {(a, 60) for a in added}
    assert len(found) == len(first["runs"])
    gain = np.subtract(found["C", 60]["all"], found["A", 120]["all"])
    assert np.array(first["claims"]["C against A"])[:, 0].tolist() == gain.tolist()
    assert list(first["claims"]) == ["C against A"]
    other = json.loads((folders / "other/results.json").read_text())
    assert {run["particles"] for run in other["runs"]} == {60}


def test_fish_are_counted_over_the_clips_of_a_seed():
    def trial(*followed):
        return {"turning": np.array([False, True]), "followed": np.array(followed)}

    found = followed_counts([trial([1, 0], [0, 0]), trial([1, 1], [0, 1])])
    assert found.tolist() == [[3, 1], [1, 1]]


def test_the_sets_are_the_papers():
    assert (sum(goldfish.LEARNING_FISH), sum(goldfish.TEST_FISH)) == (20, 24)
    settings = GoldfishSettings()
    assert settings.frames / settings.frame_rate == 10.0


def test_at_least_nine_fish_of_the_test_set_turn_suddenly():
    turning = 0
    for number, fish in enumerate(goldfish.TEST_FISH):
        rng = np.random.default_rng(goldfish.FIRST_SEEDS["test"] + number).spawn(2)[0]
        states = goldfish_states(GoldfishSettings(fish=fish), rng)
        turning += sum(sudden_turns(states[:, k]).any() for k in range(fish))
    assert turning >= 9


def corner(angle, step=6.0, frames=10, over=1):
    """A way that turns by ``angle`` degrees, spread evenly ``over`` frames."""
    direction = np.deg2rad(angle) * np.clip((np.arange(2 * frames) - frames + 1) / over, 0, 1)
    return np.cumsum(step * np.stack([np.cos(direction), np.sin(direction)], axis=1), axis=0)


@pytest.mark.parametrize(
    ("way", "turns"),
    [
        (corner(90), 1),
        (corner(-150), 1),
        (corner(55), 0),
        (corner(62, over=4), 1),
        (corner(120, over=9), 0),
        (corner(90, step=0.5), 0),
        (np.concatenate([corner(90), corner(90)[-1] + corner(90)[:, ::-1]]), 2),
        (np.zeros((1, 2)), 0),
    ],
)
def test_sudden_turns_are_those_of_over_60_degrees_within_4_frames(way, turns):
    turned = sudden_turns(way)
    assert np.count_nonzero(np.diff(turned, prepend=False) & turned) == turns
    assert turned.shape == (len(way),)


def test_no_seed_is_refused_in_one_line(tmp_path, capsys):
    words = ["--seeds", "0", "--out", str(tmp_path / "out"), "--cache", str(tmp_path / "cache")]
    assert main(["pca-particle-filter", *words]) == 2
    assert "--seeds. Must be > 0" in capsys.readouterr().err
