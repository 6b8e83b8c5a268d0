from __future__ import annotations

import shutil
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.detectors import fixed_sets, long_training, misses
from benchmarks.long_training import LongTraining, draw_curve, read_record
from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.onnx import OnnxModel
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.detector import Detector
from tsuiseki.trainers.detector_network import _described
from tsuiseki.trainers.exporting.exported_weights import layout_of

LATER = timedelta(hours=1)


def training(folder: Path, results: Sequence[dict[str, float]]) -> LongTraining:
    """A training whose files hold numbers of lines of ``results``; the first is where it starts."""
    best = folder / "best"
    best.write_text("0")

    def fit(files: Sequence[Path], work: Path, number: int) -> list[Path]:
        assert files == [best]
        assert not list(work.iterdir())
        (work / "file").write_text(str(number))
        return [work / "file"]

    def score(files: Sequence[Path]) -> dict[str, float]:
        return results[int(files[0].read_text())]

    return LongTraining([best], folder / "record.jsonl", "score", ["recall", "false"], ["false"], fit, score)


def steps(long: LongTraining, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run ``count`` steps: the clock strikes the end after them."""
    now = datetime.now(UTC)

    class Clock(datetime):
        @classmethod
        def now(cls, _: object = None) -> datetime:  # type: ignore[override]
            begun = len(read_record(long.record)) - 1
            return now + (LATER if begun >= count else timedelta(0))

    monkeypatch.setattr("benchmarks.long_training.datetime", Clock)
    long.run(long.record.parent / "work", now + LATER / 2)


def test_a_step_is_kept_where_the_number_rises_and_nothing_falls(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    long = training(
        tmp_path,
        [
            {"score": 0.50, "recall": 0.50, "false": 0.1},
            {"score": 0.60, "recall": 0.48, "false": 0.1},  # a watched number falls
            {"score": 0.49, "recall": 0.60, "false": 0.1},  # the headline falls
            {"score": 0.60, "recall": 0.495, "false": 0.2},  # more false boxes
            {"score": 0.55, "recall": 0.495, "false": 0.1},  # better
        ],
    )
    steps(long, 4, monkeypatch)
    assert [step.kept for step in read_record(long.record)] == [True, False, False, False, True]
    assert long.best[0].read_text() == "4"
    why = [step.why for step in read_record(long.record)]
    assert why == ["", "recall 0.500 to 0.480", "score 0.5000 to 0.4900", "false 0.100 to 0.200", ""]


def test_a_fresh_machine_goes_on_from_the_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = [{"score": score, "recall": 1.0, "false": 0.0} for score in (0.1, 0.2, 0.3)]
    long = training(tmp_path, numbers)
    steps(long, 1, monkeypatch)
    kept = long.best[0].read_text()
    again = training(tmp_path, numbers)
    again.best[0].write_text(kept)
    steps(again, 2, monkeypatch)
    assert [step.number for step in read_record(again.record)] == [0, 1, 2]
    assert again.best[0].read_text() == "2"
    draw_curve(again.record, ["score", "recall"], tmp_path / "curve.png")
    assert (tmp_path / "curve.png").stat().st_size > 1000


def test_each_step_of_the_detector_has_pictures_of_its_own() -> None:
    folders = [{source["folder"] for source in long_training.sources(number)} for number in (1, 2, 5)]
    assert len(folders[0]) == 5
    assert folders[0] < folders[1]
    assert not folders[0] & folders[2]
    seeds = [source["seed"] for source in long_training.sources(5)]
    assert len(set(seeds)) == len(seeds) == 15
    assert Path(long_training.calibration()).name == "everyday-sparse"


def test_a_step_begins_with_scores_as_they_were_learnt() -> None:
    file = shipped("detector_people")
    scale, shift = layout_of(file).card.settings["branch_calibration"]
    picture = torch.rand(1, 3, 96, 128)
    learnt, calibrated = (
        module.network.eval()(picture)[0].diff().detach().numpy()
        for module in (long_training.uncalibrated(file), Detector(start=file, architecture="branched"))
    )
    people = Detector(start=file).network(picture)[0].shape[1]
    assert learnt[:, :people] == pytest.approx(calibrated[:, :people], abs=1e-3)
    assert scale * learnt[:, people:] + shift == pytest.approx(calibrated[:, people:], abs=1e-3)


def test_the_branch_is_made_more_careful_and_says_so(tmp_path: Path) -> None:
    file = tmp_path / "detector.onnx"
    shutil.copyfile(shipped("detector_people"), file)
    scale, shift = layout_of(file).card.settings["branch_calibration"]
    images = torch.rand(1, 3, 480, 640).numpy()
    people = len(Detector(start=file, height=480, width=640).network.anchors)
    before = np.diff(OnnxModel(file, "detector").run(images)[0])
    long_training.finish_branch(file, -0.5, layout_of(file).card)
    after = np.diff(OnnxModel(file, "detector").run(images)[0])
    assert after[:, :people] == pytest.approx(before[:, :people], abs=1e-4)
    assert after[:, people:] == pytest.approx(before[:, people:] - 0.5, abs=2e-2)
    settings = layout_of(file).card.settings
    assert settings["branch_calibration"] == [scale, shift - 0.5]
    # So that a teacher's scores are what they were learnt as.
    assert settings["people_calibration"] == list(_described(file)[2]) != [1.0, 0.0]
    with pytest.raises(RunError, match="expected 3 heads of a branch, found 0"):
        long_training.finish_branch(shipped("detector_street"), -0.5, layout_of(file).card)


def test_a_start_with_a_branch_computes_what_its_file_does() -> None:
    file = shipped("detector_people")
    images = torch.rand(1, 3, 480, 640)
    expected = OnnxModel(file, "detector").run(images.numpy())
    module = Detector(start=file, architecture="branched", height=480, width=640)
    with torch.no_grad():
        computed = module.network.eval()(images)
    for outputs, of_file in zip(computed, expected, strict=False):
        np.testing.assert_allclose(outputs.numpy(), of_file, atol=0.02)


@pytest.mark.parametrize(("visible", "missed"), [(1.0, True), (0.1, False)])
def test_boxes_are_false_on_nobody_and_people_missed_where_they_are_visible(visible: float, missed: bool) -> None:
    people, boxes = np.array([[0.0, 0, 10, 20], [50, 0, 60, 20]]), np.array([[0.0, 0, 10, 19], [100, 0, 110, 20]])
    who, false = misses.wrong(people, np.array([0.1, visible]), boxes)
    assert who.tolist() == [False, missed]
    assert false.tolist() == [False, True]
    picture = misses.marked(np.zeros((40, 120, 3), np.uint8), people, np.array([0.1, visible]), boxes)
    shown = [tuple(picture[0, x]) for x in (5, 105, 55)]
    assert shown == [misses.GREEN, misses.RED, misses.YELLOW if missed else (0, 0, 0)]


def test_the_score_is_the_mean_of_its_parts() -> None:
    scores = dict.fromkeys(fixed_sets.PARTS, 0.4) | {fixed_sets.FALSE: 0.25}
    assert fixed_sets.headline(scores) == pytest.approx(np.mean([0.4] * (len(scores) - 1) + [0.75]))
    assert fixed_sets.headline(scores | {fixed_sets.FALSE: 7.0}) < fixed_sets.headline(scores)
