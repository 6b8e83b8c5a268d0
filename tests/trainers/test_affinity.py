"""Fitting the flow's costs: who is who, calibrated probabilities, the exported file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.tracking.association.costs import PairFeatures
from tsuiseki.tracking.association.learnt_costs import FEATURE_SETS, Affinity
from tsuiseki.tracking.association.pairwise_flow import GateSettings
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.evaluation.coverage import UNMATCHED
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.runs.options import OutputFile
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers import affinity
from tsuiseki.trainers.affinity import (
    AffinitySettings,
    AffinityVideo,
    LabelledDetections,
    PairSamples,
    every_nth,
    fit_affinity,
    fit_observation,
    fit_transition,
    label_detections,
    pair_samples,
)
from tsuiseki.trainers.exporting.written_costs import export_affinity, trees_parity
from tsuiseki.trainers.flow.videos import match_boxes

QUICK = 40


def two_walkers(frames: int = 60) -> GroundTruth:
    """Two people who walk towards and past each other."""
    t = np.arange(frames)
    left = np.stack([20 + 3 * t, np.full(frames, 40), 40 + 3 * t, np.full(frames, 90)], axis=1)
    right = np.stack([220 - 3 * t, np.full(frames, 45), 240 - 3 * t, np.full(frames, 95)], axis=1)
    boxes = np.concatenate([left, right]).astype(np.float64)
    yes = np.ones(2 * frames, dtype=np.bool_)
    truth = GroundTruth(np.tile(t, 2), np.repeat([5, 9], frames), boxes, yes, ~yes, np.ones(2 * frames))
    return truth.select(np.argsort(truth.frames, kind="stable"))


@pytest.fixture
def sequence(tmp_path: Path) -> Path:
    """A labelled sequence without images."""
    folder = tmp_path / "walkers"
    write_ground_truth(folder / "gt" / "gt.txt", two_walkers())
    write_sequence_info(folder, "walkers", 10, 60, 320, 240)
    return folder


def test_matching_by_hand() -> None:
    labelled = np.array([[0, 0, 10, 20], [100, 0, 110, 20.0]])
    found = np.array(
        [
            [0, 1, 10, 21],  # the first person
            [0, 8, 10, 28],  # nobody: the first is taken, though it overlaps him by 0.43
            [100, 10, 110, 30],  # the second, badly placed: 1/3
            [50, 0, 60, 20.0],  # nobody
        ]
    )
    person, right = match_boxes(found, labelled)
    assert person.tolist() == [0, -1, 1, -1]
    assert right.tolist() == [True, False, False, False]


def test_labels_of_a_frame() -> None:
    truth = two_walkers(1)
    ignored = GroundTruth(
        truth.frames, truth.ids, truth.boxes, np.array([True, False]), np.array([False, True]), truth.visibility
    )
    found = Detections(np.concatenate([truth.boxes, [[0, 0, 9, 9]]]), np.array([0.9, 0.8, 0.7]))
    labelled = label_detections([found], ignored, 0)
    assert labelled.ids.tolist() == [5, UNMATCHED], "a detection that an ignored label explains is left out"
    assert labelled.scores.tolist() == [0.9, 0.7]


def test_pairs_of_two_false_detections_are_left_out() -> None:
    boxes = np.array([[0, 0, 10, 20], [0, 0, 10, 20], [0, 0, 10, 20], [0, 0, 10, 20.0]])
    found = LabelledDetections(
        np.array([0, 0, 1, 1]), boxes, np.ones(4), None, np.array([3, UNMATCHED, 3, UNMATCHED]), np.ones(4, np.bool_)
    )
    samples = pair_samples(found, "thesis", GateSettings(window=1), groups=1)
    assert sorted(samples.same.tolist()) == [False, False, True]


def test_every_nth_frame_is_a_slower_video() -> None:
    frames = np.arange(7)
    boxes = np.tile([0, 0, 10, 20.0], (7, 1))
    found = LabelledDetections(frames, boxes, frames / 7, None, frames, frames > 0)
    slower = every_nth(found, 3)
    assert slower.frames.tolist() == [0, 1, 2]
    assert slower.ids.tolist() == [0, 3, 6]


def synthetic_pairs(count: int, rng: np.random.Generator) -> tuple[PairSamples, np.ndarray]:
    """Pairs whose probability of being one person is known: sigmoid(6 iou - 3 - 4 (appearance - 0.5))."""
    rows = rng.uniform(0, 1, (count, 2)).astype(np.float32).astype(np.float64)
    probability = 1 / (1 + np.exp(-(6 * rows[:, 0] - 3 - 4 * (rows[:, 1] - 0.5))))
    same = rng.random(count) < probability
    return PairSamples(rows, same, np.arange(count) * 5 // count), probability


def test_probabilities_are_calibrated(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    samples, _ = synthetic_pairs(20_000, rng)
    trees, report = fit_transition(samples, FEATURE_SETS["thesis"], QUICK, 0)
    path = tmp_path / "a.onnx"
    export_affinity(trees, (report.scale, report.shift), card_of_thesis(), path, samples.rows)
    fresh, truth = synthetic_pairs(5_000, rng)
    none = np.zeros(len(truth))
    pairs = PairFeatures(none.astype(np.int64) + 1, fresh.rows[:, 0], fresh.rows[:, 1], none, none, none, none)
    got = Affinity(path).probability(pairs)
    # 20,000 pairs on 40 trees of 12 leaves: a few percent of statistical error.
    assert np.abs(got - truth).mean() < 0.03
    for low in np.arange(0, 1, 0.2):
        inside = (got >= low) & (got < low + 0.2)
        assert abs(got[inside].mean() - truth[inside].mean()) < 0.03


def card_of_thesis():  # type: ignore[no-untyped-def]
    from tsuiseki.tracking.onnx import ModelCard

    settings = {"features": "thesis", "window": 3, "alpha": 1.0, "beta": -2.0, "b": 0.0}
    return ModelCard("affinity", "test", FEATURE_SETS["thesis"], layout="NF", settings=settings)


def test_probability_falls_with_distance(tmp_path: Path) -> None:
    samples, _ = synthetic_pairs(3_000, np.random.default_rng(1))
    trees, report = fit_transition(samples, FEATURE_SETS["thesis"], QUICK, 0)
    path = tmp_path / "a.onnx"
    export_affinity(trees, (report.scale, report.shift), card_of_thesis(), path, samples.rows)
    rows = np.stack([np.full(50, 0.5), np.linspace(0, 1, 50)], axis=1).astype(np.float32)
    assert (np.diff(Affinity(path).model.run(rows)[0]) <= 1e-6).all()


def test_a_wrong_calibration_is_noticed(tmp_path: Path) -> None:
    samples, _ = synthetic_pairs(2_000, np.random.default_rng(2))
    trees, _ = fit_transition(samples, FEATURE_SETS["thesis"], QUICK, 0)
    path = tmp_path / "a.onnx"
    export_affinity(trees, (1.0, 0.0), card_of_thesis(), path, samples.rows)
    with pytest.raises(RunError, match="parity check failed"):
        trees_parity(trees, (0.5, 0.0), path, samples.rows)


def test_observation_recovers_the_logistic() -> None:
    rng = np.random.default_rng(0)
    scores = rng.uniform(0, 1, 50_000)
    right = rng.random(50_000) < 1 / (1 + np.exp(3 - 7 * scores))
    nothing = np.zeros(len(scores), np.int64)
    found = LabelledDetections(nothing, np.tile([0, 0, 1, 1.0], (len(scores), 1)), scores, None, nothing, right)
    cost = fit_observation([found])
    # Standard errors at 50,000 samples are about 0.03 and 0.05.
    assert cost.alpha == pytest.approx(3, abs=0.12)
    assert cost.beta == pytest.approx(-7, abs=0.2)
    assert cost.b == -0.5


@pytest.mark.slow
def test_fits_from_labels_alone(sequence: Path, tmp_path: Path) -> None:
    video, settings = AffinityVideo(folders=[sequence], detections="simulated"), AffinitySettings(trees=QUICK)
    out = fit_affinity(video, OutputFile(out=tmp_path / "a.onnx"), settings)
    again = tmp_path / "b.onnx"
    words = ["--folders", str(sequence), "--detections", "simulated", "--out", str(again)]
    assert main(["train", "affinity", *words, "--trees", str(QUICK)]) == 0
    assert out.read_bytes() == again.read_bytes(), "the same seed gives the same file"
    affinity = Affinity(out)
    assert affinity.card.class_names == FEATURE_SETS["extended"]
    one, none = np.ones(1), np.zeros(1)
    gap = np.ones(1, np.int64)
    step = PairFeatures(gap, 0.74 * one, np.nan * one, 0.06 * one, none, none, none)
    leap = PairFeatures(gap, none, np.nan * one, 0.45 * one, none, none, none)
    assert affinity(step)[0] < affinity(leap)[0]
    assert affinity.observation.beta < 0


def test_frames_count_from_one(sequence: Path, tmp_path: Path) -> None:
    video = AffinityVideo(folders=[sequence], frames=(61, 90), detections="simulated")
    with pytest.raises(RequestError, match=r"no frame lies within \(61, 90\); it has 60"):
        fit_affinity(video, OutputFile(out=tmp_path / "a.onnx"))


def test_bad_requests(sequence: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    taken = tmp_path / "taken.onnx"
    taken.write_bytes(b"")
    with pytest.raises(RequestError, match="exists"):
        fit_affinity(AffinityVideo(folders=[sequence]), OutputFile(out=taken))
    with pytest.raises(RequestError, match="expected an ONNX file or one of the shipped ceiling,"):
        fit_affinity(AffinityVideo(folders=[sequence], detector=Path("nobody")), OutputFile(out=tmp_path / "a.onnx"))
    with pytest.raises(RequestError, match=r"expected det/det\.txt beside the labels of walkers"):
        fit_affinity(AffinityVideo(folders=[sequence]), OutputFile(out=tmp_path / "a.onnx"))
    perfect = DetectorFaults(jitter=0, missed=1e-9, hidden=1e-9, false_alarms=0, doubled=0)
    monkeypatch.setattr(affinity, "FAULTS", perfect)
    video = AffinityVideo(folders=[sequence], detections="simulated")
    with pytest.raises(RequestError, match="expected right and wrong detections"):
        fit_affinity(video, OutputFile(out=tmp_path / "a.onnx"), AffinitySettings(trees=QUICK))
    assert list(tmp_path.glob("a*")) == [], "nothing half-written"


def test_simulated_faults() -> None:
    truth = two_walkers()
    rng = np.random.default_rng(0)
    perfect = DetectorFaults(jitter=0, missed=1e-9, hidden=1e-9, false_alarms=0, doubled=0)
    exact = simulate_detections(rng, truth, 60, 320, 240, perfect)
    np.testing.assert_allclose(np.concatenate([d.boxes for d in exact]), truth.boxes)
    blind = simulate_detections(rng, truth, 60, 320, 240, DetectorFaults(missed=0.5, hidden=0.9, false_alarms=0))
    assert 30 < sum(len(d) for d in blind) < 90
    busy = simulate_detections(rng, truth, 60, 320, 240, DetectorFaults(missed=1e-9, hidden=1e-9, false_alarms=2))
    assert 60 < sum(len(d) for d in busy) - 120 < 180, "about two false boxes a frame"
