"""`tsuiseki adapt`: a mistake is one line; what is finished is written; a stopped run goes on."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from tests.tracking.features.tiny_onnx import save_constant
from tests.trainers.adapt import street
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import Interrupted, RequestError
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.adapt.rounds import DEFAULT, Adaptation, Round, RoundScores
from tsuiseki.trainers.adapt.track_labels import TrackLabels, Verdict

pytest.importorskip("torch")
NO_LABELS = GroundTruth.of_boxes(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 4)))


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return street.write_video(tmp_path_factory.mktemp("camera") / "street")


def refused(capsys: pytest.CaptureFixture[str], out: Path, *words: str) -> str:
    """The one line that refuses the request; nothing is left behind."""
    assert main(["adapt", *words, "--out", str(out)]) == 2
    errors = capsys.readouterr().err.strip().splitlines()
    assert len(errors) == 1
    assert not out.exists() or not any(out.iterdir())
    return errors[0]


def made_up_rounds(adaptation: Adaptation, *agreements: float) -> Iterator[Round]:
    """Rounds of these agreements with everything that is written of them."""
    for number, agreement in enumerate(agreements):
        folder = adaptation.folder(number)
        (folder / "detector.onnx").write_bytes(str(number).encode())
        scores = RoundScores(agreement, 5, 4.0, 5.0, 1.0, 0.1)
        tracks = (street.track_of(0), street.decoy_track())
        found = [Detections(street.people(0), np.array([0.9, 0.4]))] * 110
        verdicts = (Verdict(1, "taken", 110, 0, 0.9, 1.0), Verdict(9, "never moves", 110, 0, 0.9, 0.0))
        labels = TrackLabels(NO_LABELS, verdicts, tracks, np.zeros(4))
        yield Round(number, folder / "detector.onnx", scores, 1, (labels,), (found,))


def default(adaptation: Adaptation, agreement: float) -> Round:
    """What the default detector sees."""
    (looked,) = made_up_rounds(adaptation, agreement)
    return replace(looked, number=DEFAULT, detector=adaptation.default)


def test_short_videos(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    short = street.write_video(tmp_path / "short", frames=40)
    assert "expected at least 100 frames to learn a camera from, got 40" in refused(capsys, tmp_path / "o", str(short))


def test_two_cameras(video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = street.write_video(tmp_path / "other", seed=1)
    line = refused(capsys, tmp_path / "o", str(video), str(other))
    assert "expected videos of one camera" in line
    assert "show different places" in line


def test_files_that_are_no_detector(video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused(capsys, tmp_path / "o", str(video), "--detector", str(shipped("appearance_people")))
    assert "expected a detector" in line
    assert "expected" in refused(capsys, tmp_path / "o", str(video), "--detector", str(tmp_path / "gone.onnx"))


@pytest.mark.slow
def test_a_teacher_that_cannot_look(video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = np.zeros((7, 126), np.float32)
    rows[:4] = [[40], [30], [10], [30]]
    teacher = save_constant(tmp_path / "teacher.onnx", {"output0": rows})
    # Refused before the video is looked for.
    words = (str(tmp_path / "gone"), "--teacher", str(teacher))
    assert "say which one is people with --detector-options.person" in refused(capsys, tmp_path / "o", *words)
    words += ("--detector-options.person", "1")
    assert main(["adapt", *words, "--out", str(tmp_path / "o")]) == 2
    said = capsys.readouterr()
    assert "teacher.onnx is read as layout yolov8, people are class 1; pictures letterbox, RGB, [0, 1]" in said.out
    assert "gone" in said.err
    line = refused(capsys, tmp_path / "o", str(video), "--detector-options.person", "1")
    assert "with a --teacher of another project, got no teacher" in line


@pytest.mark.slow
def test_nobody(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    import cv2

    from tsuiseki.trainers.adapt import rounds as module
    from tsuiseki.trainers.adapt.rounds import TrackedPeople

    monkeypatch.setattr(module, "find", lambda v, *_: TrackedPeople([Detections.empty()] * v.length, [], 1))
    empty = street.write_video(tmp_path / "empty", frames=100)
    for path in (empty / "img1").iterdir():
        cv2.imwrite(str(path), street.view()[..., ::-1])
    assert main(["adapt", str(empty), "--out", str(tmp_path / "o")]) == 2
    assert "expected people to learn from in" in capsys.readouterr().err
    assert not (tmp_path / "o" / ".adapt").exists()


def test_the_best_round_is_written(
    video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from tsuiseki.trainers.adapt import rounds as module

    monkeypatch.setattr(module, "rounds", lambda adaptation: made_up_rounds(adaptation, 0.7, 0.8, 0.75))
    monkeypatch.setattr(module, "default_round", lambda adaptation: default(adaptation, 0.75))
    out = tmp_path / "models"
    assert main(["adapt", str(video), "--fps", "10", "--out", str(out)]) == 0
    assert json.loads((out / "run.json").read_text())["settings"]["fps"] == 10
    assert (out / "detector.onnx").read_bytes() == b"1"
    facts = json.loads((out / "run.json").read_text())["facts"]
    assert facts["best"] == 1
    assert [r["agreement"] for r in facts["rounds"]] == [0.7, 0.8, 0.75]
    assert not (out / ".adapt").exists()
    page = (out / "report.html").read_text()
    assert "round 1 is kept" in page
    assert "never moves" in page
    assert page.count("<img") > 8
    said = capsys.readouterr().out
    assert "round 1 is the best, agreement 0.700 -> 0.800" in said
    assert "round 1 beats detector_people.onnx" in said
    assert "round 2 does not beat detector_people.onnx" in said
    assert f"track people VIDEO --detector {out}/detector.onnx --out DIR" in said


def test_a_moving_camera_is_said_and_an_interrupt_keeps_what_is_finished(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from tsuiseki.trainers.adapt import rounds as module

    def interrupted(_: object) -> Iterator[object]:
        raise Interrupted
        yield

    monkeypatch.setattr(module, "rounds", interrupted)
    moving = street.write_video(tmp_path / "moving", pan=1)
    words = ["adapt", str(moving), "--out", str(tmp_path / "o")]
    assert main(words) == 130
    said = capsys.readouterr()
    assert "the camera moves: the tracks alone teach" in said.out
    assert "the same command goes on from there" in said.err
    assert main(words) == 130
    assert "going on with what an earlier run has finished" in capsys.readouterr().out


def test_where_the_default_is_better_it_is_left(
    video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from tsuiseki.trainers.adapt import rounds as module

    monkeypatch.setattr(module, "rounds", lambda adaptation: made_up_rounds(adaptation, 0.7, 0.8))
    monkeypatch.setattr(module, "default_round", lambda adaptation: default(adaptation, 0.79))
    out = tmp_path / "o"
    assert main(["adapt", str(video), "--out", str(out)]) == 0
    assert (out / "detector.onnx").read_bytes() == shipped("detector_people").read_bytes()
    line = "round 1 does not beat detector_people.onnx, which track people takes: agreement 0.800 and 0.790"
    assert line in capsys.readouterr().out
    assert line in (out / "report.html").read_text()
    assert main(["adapt", str(video), "--fps", "0", "--out", str(tmp_path / "p")]) == 2
    assert "--fps: expected a number greater than 0" in capsys.readouterr().err


@pytest.mark.slow
def test_the_teacher_is_opened_once(video: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tsuiseki.tracking.features import exported
    from tsuiseki.tracking.features.foreign_detector import ForeignDetector
    from tsuiseki.trainers.adapt import rounds as module

    opened, given, look = [], [], module._detect_and_track
    monkeypatch.setattr(exported, "ForeignDetector", lambda *a: opened.append(a) or ForeignDetector(*a))

    def one_round(adaptation: Adaptation) -> Iterator[object]:
        given.append(adaptation)
        assert adaptation.teacher is not None
        for work in ("one", "other"):
            looking = replace(adaptation, work=adaptation.work / work, teacher=None)
            look(looking, 0, adaptation.teacher)
        yield from made_up_rounds(adaptation, 0.7)

    rows = np.zeros((7, 126), np.float32)
    rows[:4] = [[40], [30], [10], [30]]
    teacher = save_constant(tmp_path / "teacher.onnx", {"output0": rows})
    monkeypatch.setattr(module, "rounds", one_round)
    words = ["adapt", str(video), "--teacher", str(teacher), "--detector-options.person", "1"]
    assert main([*words, "--out", str(tmp_path / "o")]) == 0
    assert len(opened) == 1
    assert isinstance(given[0].teacher, ForeignDetector)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "kept"),
    [((), "detector_people"), (("--detector", "figures"), "detector_figures")],
    ids=["default", "given"],
)
def test_where_nothing_better_is_learnt_the_default_or_what_was_given_is_left(
    words: tuple[str, ...],
    kept: str,
    video: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from tsuiseki.trainers.adapt import rounds as module

    monkeypatch.setattr(module, "rounds", lambda adaptation: made_up_rounds(adaptation, 0.8, 0.7))
    assert main(["adapt", str(video), *words, "--out", str(tmp_path / "o")]) == 0
    assert (tmp_path / "o" / "detector.onnx").read_bytes() == shipped(kept).read_bytes()
    assert f"{kept}.onnx, which learnt nothing" in capsys.readouterr().out
    assert f"what is left is {kept}.onnx" in (tmp_path / "o" / "report.html").read_text()
    facts = json.loads((tmp_path / "o" / "run.json").read_text())["facts"]
    assert (facts["start"], facts["detector"]) == ("detector_figures.onnx", f"{kept}.onnx")


def test_a_detector_of_another_project_can_teach_and_not_learn(
    video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = save_constant(tmp_path / "other.onnx", {"output0": np.zeros((7, 126), np.float32)})
    line = refused(capsys, tmp_path / "o", str(video), "--detector", str(other))
    assert "expected a detector of this toolkit, which can learn, got another file; give it as --teacher" in line


def test_a_bare_word_names_a_shipped_detector(
    video: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    starts = list[Path]()

    def no_rounds(adaptation: Adaptation) -> NoReturn:
        starts.append(adaptation.start)
        raise RequestError("enough")

    monkeypatch.setattr("tsuiseki.trainers.adapt.rounds.rounds", no_rounds)
    assert refused(capsys, tmp_path / "o", str(video), "--detector", "street") == "tsuiseki: enough"
    assert refused(capsys, tmp_path / "o", str(video)) == "tsuiseki: enough"
    assert starts == [shipped("detector_street"), shipped("detector_figures")]
    line = refused(capsys, tmp_path / "p", str(video), "--detector", "streets")
    assert "one of the shipped ceiling, drone, drone_larger, figures, people, street, got streets" in line
