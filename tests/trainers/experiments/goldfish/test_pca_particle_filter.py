"""The goldfish experiment in small: one clip to learn from, one to test on."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.fish.goldfish import GoldfishSettings, write_goldfish
from tsuiseki.datamodules.scenes.fish.sets import GoldfishSets
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.annealed import Annealed
from tsuiseki.tracking.filters.body_motion import Noise, RandomWalk
from tsuiseki.trainers.experiments.goldfish import pca_particle_filter
from tsuiseki.trainers.experiments.goldfish.arms import ARMS, BEYOND, interval, paired_interval
from tsuiseki.trainers.experiments.goldfish.pca_particle_filter import Experiment, Piece, Run, run_pieces
from tsuiseki.trainers.experiments.goldfish.summary import gather, summarise

SMALL = Experiment(seeds=2, particles=(60, 120), beyond=(60,))


@pytest.fixture(scope="module")
def sets(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clips")
    settings = GoldfishSettings(frames=16, fish=2)
    return GoldfishSets(
        (write_goldfish(folder / "learning-01", settings, 1),), (write_goldfish(folder / "test-01", settings, 2),)
    )


@pytest.fixture(scope="module")
def pieces(sets, tmp_path_factory):
    work = tmp_path_factory.mktemp("work")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pca_particle_filter, "write_goldfish_sets", lambda *_: sets)
        patch.setattr(pca_particle_filter, "LEARNING_PARTICLES", 800)
        first = list(run_pieces(work, SMALL, minutes=10))
        written = {path: path.stat().st_mtime_ns for path in (work / "pieces").iterdir()}
        again = list(run_pieces(work, SMALL, minutes=0))
        more = list(run_pieces(work, Experiment(seeds=3, particles=(60, 120), beyond=(60,)), minutes=0))
        with pytest.raises(RequestError, match="another experiment"):
            list(run_pieces(work, Experiment(seeds=2, particles=(60,), beyond=(60,)), minutes=0))
    assert first == again
    assert more == [*first, None]
    assert written == {path: path.stat().st_mtime_ns for path in (work / "pieces").iterdir()}
    assert json.loads((work / "motion.json").read_text())["body"] == "goldfish"
    return first


def test_every_arm_and_number_is_run_once(pieces):
    assert [(piece.clip, piece.seed) for piece in pieces] == [("test-01", 0), ("test-01", 1)]
    for piece in pieces:
        found = [(run.part, run.arm, run.particles) for run in piece.runs]
        expected = {("arms", arm, n) for arm in ARMS for n in (60, 120)} | {("beyond", arm, 60) for arm in BEYOND}
        assert len(found) == len(expected)
        assert set(found) == expected
        assert all(0 <= frames <= piece.frames for run in piece.runs for frames in run.survived)
        layered = next(run for run in piece.runs if run.arm == "annealed")
        assert layered.used == 60
    assert pieces[0].runs[0].survived != pieces[1].runs[0].survived or pieces[0] != pieces[1]


def fake(seed, survived_a, survived_c):
    runs = (
        Run("arms", "A", 3000, survived_a, 1.0, 40, 3000.0),
        Run("arms", "C", 500, survived_c, 0.5, 40, 500.0),
    )
    return Piece("test-01", seed, 10, (0, 2), 0.002, runs)


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
    other = Piece("test-02", 0, 10, (0, 2), 0.002, one.runs)
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
    base = ["reproduce", "pca-particle-filter", "--out", str(tmp_path / "out"), "--work", str(tmp_path / "work")]
    assert main([*base, *words]) == 2
    assert "expected" in capsys.readouterr().err
