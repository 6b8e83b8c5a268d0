"""The goldfish experiment in small: one clip to learn from, one to test on."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.fish.goldfish import GoldfishSettings, write_goldfish
from tsuiseki.datamodules.scenes.fish.sets import GoldfishSets
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.filters.motion.bodies import Noise, RandomWalk
from tsuiseki.tracking.filters.particles.particle_filter import Annealed
from tsuiseki.trainers.experiments.goldfish import pca_particle_filter
from tsuiseki.trainers.experiments.goldfish import trials as trials_module
from tsuiseki.trainers.experiments.goldfish.arms import ARMS, BEYOND
from tsuiseki.trainers.experiments.goldfish.summary import gather, summarise
from tsuiseki.trainers.experiments.goldfish.trials import Run, Trial
from tsuiseki.trainers.experiments.intervals import interval, paired_interval
from tsuiseki.trainers.experiments.values import restored


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Where one experiment of two clips was run: its store and its results."""
    root = tmp_path_factory.mktemp("goldfish")
    settings = GoldfishSettings(frames=16, width=400, height=300, fish=2)
    sets = GoldfishSets(
        (write_goldfish(root / "learning-01", settings, 1),), (write_goldfish(root / "test-01", settings, 2),)
    )

    def kept():
        return {path: path.stat().st_mtime_ns for path in (root / "cache" / "run_trial").iterdir()}

    def run(out, *more):
        words = ["--out", str(root / out), "--cache", str(root / "cache"), "--seeds", "2", *more]
        return main(["reproduce", "pca-particle-filter", *words])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pca_particle_filter, "goldfish_sets", lambda *_: sets)
        patch.setattr(pca_particle_filter, "PARTICLES", (60, 120))
        patch.setattr(pca_particle_filter, "BEYOND_PARTICLES", (60,))
        patch.setattr(trials_module, "LEARNING_PARTICLES", 800)
        assert run("first") == 0
        before = kept()
        assert run("second") == 0
        assert kept() == before
        assert len(before) == 2
        assert run("third", "--seeds", "3", "--minutes", "1e-9") == 0
        assert kept() == before
        assert not (root / "third").exists()
        patch.setattr(pca_particle_filter, "PARTICLES", (60,))
        assert run("other") == 0
        assert len(kept()) == 4
    return root


def test_an_experiment_is_whole_and_the_same_again(folders):
    first, second = (json.loads((folders / name / "results.json").read_text()) for name in ("first", "second"))
    assert first == second
    assert {"success.png", "turns.png", "beyond.png", "particles.png", "motion.json", "tables.md", "run.json"} <= {
        path.name for path in (folders / "first").iterdir()
    }
    assert json.loads((folders / "first/motion.json").read_text())["body"] == "goldfish"
    other = json.loads((folders / "other/results.json").read_text())
    assert {row["particles"] for row in other["table"]} == {60}


@pytest.fixture
def trials(folders):
    found = [
        restored(Trial, entry["value"])
        for path in (folders / "cache" / "run_trial").iterdir()
        if (entry := json.loads(path.read_text()))["arguments"][2] == [60, 120]
    ]
    return sorted(found, key=lambda trial: trial.seed)


def test_every_arm_and_number_is_run_once(trials):
    assert [(trial.clip, trial.seed) for trial in trials] == [("test-01", 0), ("test-01", 1)]
    for trial in trials:
        found = [(run.part, run.arm, run.particles) for run in trial.runs]
        expected = {("arms", arm, n) for arm in ARMS for n in (60, 120)} | {("beyond", arm, 60) for arm in BEYOND}
        assert len(found) == len(expected)
        assert set(found) == expected
        assert all(0 <= frames <= trial.frames for run in trial.runs for frames in run.survived)
        layered = next(run for run in trial.runs if run.arm == "annealed")
        assert layered.used == 60
    assert trials[0].runs[0].survived != trials[1].runs[0].survived or trials[0] != trials[1]


def fake(seed, survived_a, survived_c):
    runs = (
        Run("arms", "A", 3000, survived_a, 1.0, 40, 3000.0),
        Run("arms", "C", 500, survived_c, 0.5, 40, 500.0),
    )
    return Trial("test-01", seed, 10, (0, 2), 0.002, runs)


def test_counts_differences_and_rates():
    made = [fake(0, (10, 3), (10, 10)), fake(1, (10, 10), (10, 10)), fake(2, (2, 3), (10, 4))]
    found = gather(made)
    np.testing.assert_array_equal(found["arms", "A", 3000].counts(turning_only=False), [1, 2, 0])
    np.testing.assert_array_equal(found["arms", "A", 3000].counts(turning_only=True), [0, 1, 0])
    values = summarise(made)
    (claim,) = values["claims"]
    assert claim["all"] == pytest.approx(paired_interval(np.array([2, 2, 1]), np.array([1, 2, 0])))
    assert claim["all"][0] == pytest.approx(2 / 3)
    row = next(row for row in values["table"] if row["arm"] == "C")
    assert row["frames_per_second"] == pytest.approx(1 / (0.002 + 0.5 / 40))
    assert (values["fish"], values["turning"], values["seeds"]) == (2, 1, 3)


def test_only_seeds_that_every_clip_has_count():
    one = fake(0, (10, 3), (10, 10))
    other = Trial("test-02", 0, 10, (0, 2), 0.002, one.runs)
    found = gather([one, other, fake(1, (10, 10), (10, 10))])
    assert found["arms", "C", 500].success.shape == (1, 4)


def test_intervals_are_students():
    mean, low, high = interval(np.array([1.0, 2.0, 4.0]))
    half = 4.302653 * np.std([1, 2, 4], ddof=1) / np.sqrt(3)
    assert (mean, low, high) == pytest.approx((7 / 3, 7 / 3 - half, 7 / 3 + half))
    assert np.isnan(interval(np.array([1.0]))[1])


def test_annealing_draws_nearer_to_what_is_likely():
    motion = RandomWalk(Noise.independent(np.zeros(2), np.ones(2)))

    def near_two(particles, observation):
        return -50.0 * ((particles[:, 0] - observation) ** 2)

    particles = np.zeros((2000, 2))
    moved, correction = Annealed(motion, near_two)(particles, 2.0, np.random.default_rng(0))
    assert abs(moved[:, 0].mean() - 2.0) < 0.4
    assert abs(moved[:, 1].mean()) < 0.3
    assert not correction.any()
    with pytest.raises(ValueError, match="power"):
        Annealed(motion, near_two, power=0.0)


@pytest.mark.parametrize("words", [["--seeds", "0"], ["--minutes", "0"], ["--clips", "-1"]])
def test_wrong_requests_get_one_line(tmp_path, capsys, words):
    base = ["reproduce", "pca-particle-filter", "--out", str(tmp_path / "out"), "--cache", str(tmp_path / "cache")]
    assert main([*base, *words]) == 2
    assert "expected" in capsys.readouterr().err
