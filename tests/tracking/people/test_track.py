"""`tsuiseki track people` from files to files."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.cli.commands import all_commands
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.people.settings import METHODS
from tsuiseki.tracking.types import Detections, ImageArray
from tsuiseki.tracking.video.source import open_source


def run_record(folder: Path) -> dict[str, Any]:
    values: dict[str, Any] = json.loads((folder / "run.json").read_text())
    return values


def check_result(folder: Path, first: int, last: int) -> None:
    """One person stands still in the 0-based frames ``first`` to ``last``."""
    (track,) = read_tracks(folder / "tracks.txt")
    assert track.frames.tolist() == list(range(first, last + 1))
    # Smoothing and filters leave a still box where it is; VP8 does not move the constant detector.
    assert np.abs(track.boxes - [8, 8, 24, 40]).max() < 0.01


NUMBERS = "counts.csv counts.png paths.csv paths.png people.csv places.csv places.png sides.csv sides.png"
REPORT = ["report.html", *(f"report/{name}" for name in NUMBERS.split())]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("source", ["video", "images"])
def test_a_person_is_tracked_from_any_source_by_any_method(
    inputs: Any, tmp_path: Path, method: str, source: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["track", "people", str(getattr(inputs, source)), "--detector", str(inputs.detector), "--view", "1"]
    words += ["--appearance", str(inputs.appearance)] if method in ("deepsort", "flow") else []
    words += ["--affinity", str(inputs.affinity)] if method == "flow" else []
    assert main([*words, "--method", method, "--out", str(tmp_path / "o")]) == 0
    check_result(tmp_path / "o", 0, 11)
    record = run_record(tmp_path / "o")
    assert record["partial"] is False
    assert record["files"] == [*(["flow.npz"] if method == "flow" else []), *REPORT, "tracks.txt"]
    assert record["frames"]["frame"] == list(range(1, 13))
    assert record["frames"]["detections"] == record["frames"]["people"] == [1] * 12
    assert record["settings"]["method"] == method
    assert {"decode", "detect", method} <= set(record["seconds"])
    said = f"1 person in 12 frames: {tmp_path / 'o/tracks.txt'}\nopen {tmp_path / 'o/report.html'}\n"
    assert capsys.readouterr().out == said


@pytest.mark.slow
def test_given_detections_need_no_network_and_no_images(inputs: Any, tmp_path: Path) -> None:
    sequence = tmp_path / "s"
    (sequence / "det").mkdir(parents=True)
    (sequence / "seqinfo.ini").write_text("[Sequence]\nname=s\nseqLength=12\n")
    words = ["--appearance", "none", "--affinity", "none", "--detections", str(inputs.detections)]
    assert main(["track", "people", str(sequence), *words, "--out", str(tmp_path / "text")]) == 0
    assert main(["track", "people", str(inputs.images), *words, "--out", str(tmp_path / "images")]) == 0
    check_result(tmp_path / "text", 0, 11)
    assert (tmp_path / "text" / "tracks.txt").read_text() == (tmp_path / "images" / "tracks.txt").read_text()


@pytest.fixture
def text_only(tmp_path: Path) -> Path:
    """A sequence of labels and detections of two classes that cross, without seqinfo.ini and images."""
    folder = tmp_path / "text-only"
    (folder / "gt").mkdir(parents=True)
    (folder / "gt" / "gt.txt").write_text("1,1,1,1,40,100,1,-1,-1,-1\n")
    spots = [(t, number, 5 * t if number == 1 else 5 * (40 - t)) for t in range(1, 41) for number in (1, 3)]
    lines = [f"{t},-1,{x},1,40,100,0.95,{number},-1,-1" for t, number, x in spots if t != 20]
    (folder / "det.txt").write_text("\n".join(lines) + "\n")
    return folder


def notes(text: str) -> list[str]:
    return [line.removeprefix("tsuiseki: note: ") for line in text.splitlines() if line.startswith("tsuiseki: note: ")]


@pytest.mark.slow
def test_classes_are_tracked_apart(text_only: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["track", "people", str(text_only), "--detections", str(text_only / "det.txt"), "--method", "sort"]
    assert main([*words, "--fps", "10", "--classes", "1,3", "--out", str(tmp_path / "apart")]) == 0
    assert notes(capsys.readouterr().err) == []
    rows = [line.split(",") for line in (tmp_path / "apart" / "tracks.txt").read_text().splitlines()]
    assert {(row[1], row[7]) for row in rows} == {("1", "1"), ("2", "3")}
    assert {int(row[0]) for row in rows} == {*range(1, 41)} - {20}
    assert main([*words, "--fps", "10", "--classes", "3", "--frames", "5-30", "--out", str(tmp_path / "one")]) == 0
    rows = [line.split(",") for line in (tmp_path / "one" / "tracks.txt").read_text().splitlines()]
    assert {(row[1], row[7]) for row in rows} == {("1", "3")}
    assert [int(row[0]) for row in rows] == [t for t in range(5, 31) if t != 20]


def test_the_flow_of_each_class_tells_what_it_found(
    text_only: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = text_only / "det.txt"
    false = [f"{t},-1,{700 + 97 * t * t % 300},{53 * t * t % 400},40,100,0.4,3,-1,-1" for t in range(1, 41)]
    file.write_text(file.read_text() + "\n".join([*false, *false[::-1]]) + "\n")
    words = ["track", "people", str(text_only), "--detections", str(file), "--fps", "10"]
    assert main([*words, "--classes", "1,3", "--out", str(tmp_path / "o")]) == 0
    flows = json.loads((tmp_path / "o" / "run.json").read_text())["facts"]["flow"]
    assert {number: facts["detections"] for number, facts in flows.items()} == {"1": 39, "3": 79}
    assert flows["1"]["detections_rejected"] == 0
    assert flows["3"]["detections_rejected"] >= 40
    assert "class 3: 40 of 79 detections belong to no track" in capsys.readouterr().out


def test_what_a_sequence_does_not_say_is_told(
    text_only: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = text_only / "det.txt"
    words = ["track", "people", str(text_only), "--detections", str(file), "--method", "sort"]
    assert main([*words, "--out", str(tmp_path / "o")]) == 0
    assert notes(capsys.readouterr().err) == [
        "text-only does not say its frame rate: 25 a second are taken; give --fps",
        f"{file}: detections of the classes 1,3 are tracked as one; give --classes to track each apart",
    ]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--classes", "2"], "--classes: expected classes of"),
        (["--classes", "1,1"], "--classes: expected each class once, got 1 twice"),
        (["--fps", "0"], "--fps: expected a number greater than 0, got '0'"),
        (["--classes", "one"], "--classes: "),
    ],
)
def test_wrong_classes_and_rates(
    words: list[str], line: str, text_only: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["track", "people", str(text_only), "--detections", str(text_only / "det.txt"), "--method", "sort"]
    assert main([*given, *words, "--out", str(tmp_path / "o")]) == 2
    assert line in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("source", ["video", "images"])
def test_a_stretch_keeps_its_frame_numbers(inputs: Any, tmp_path: Path, source: str) -> None:
    words = inputs.words(getattr(inputs, source))
    assert main([*words, "--frames", "4-9", "--out", str(tmp_path / "o")]) == 0
    check_result(tmp_path / "o", 3, 8)
    assert run_record(tmp_path / "o")["frames"]["frame"] == [4, 5, 6, 7, 8, 9]


def test_the_overlay_has_the_frames_of_the_stretch(inputs: Any, tmp_path: Path) -> None:
    assert main([*inputs.words(), "--frames", "3-10", "--overlay", "--out", str(tmp_path / "o")]) == 0
    assert len(list(open_source(tmp_path / "o" / "overlay.webm").frames())) == 8
    assert run_record(tmp_path / "o")["files"] == ["flow.npz", "overlay.webm", *REPORT, "tracks.txt"]


@pytest.mark.slow
def test_a_stream_is_recorded_for_its_overlay(inputs: Any, tmp_path: Path) -> None:
    assert main([*inputs.words(f"file://{inputs.video}"), "--overlay", "--out", str(tmp_path / "o")]) == 0
    check_result(tmp_path / "o", 0, 11)
    assert sorted(p.name for p in (tmp_path / "o").iterdir()) == [
        "flow.npz",
        "overlay.webm",
        "report",
        "report.html",
        "run.json",
        "tracks.txt",
    ]
    assert len(list(open_source(tmp_path / "o" / "overlay.webm").frames())) == 12


@pytest.mark.slow
def test_the_same_run_gives_the_same_tracks(inputs: Any, tmp_path: Path) -> None:
    for name in ("a", "b"):
        assert main([*inputs.words(), "--out", str(tmp_path / name)]) == 0
    assert (tmp_path / "a" / "tracks.txt").read_bytes() == (tmp_path / "b" / "tracks.txt").read_bytes()


def test_options_come_from_yaml(inputs: Any, tmp_path: Path) -> None:
    config = tmp_path / "c.yaml"
    config.write_text(
        f"source: {inputs.images}\nmethod: sort\ndetector: {inputs.detector}\nframes: 1-5\n"
        "view: '1'\nsort:\n  min_iou: 0.4\n"
    )
    assert main(["track", "people", "--config", str(config), "--out", str(tmp_path / "o")]) == 0
    check_result(tmp_path / "o", 0, 4)
    assert run_record(tmp_path / "o")["settings"]["sort"]["min_iou"] == 0.4


class Interrupting(Detector):
    """Presses Ctrl-C while it works on the ninth frame."""

    def detect(self, images: Any) -> list[Detections]:
        self.seen: int = getattr(self, "seen", 0) + len(images)
        if self.seen == 9:
            signal.raise_signal(signal.SIGINT)
        found: list[Detections] = super().detect(images)
        return found


def interrupt(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tsuiseki.tracking.features.exported.Detector", Interrupting)


def test_ctrl_c_keeps_the_finished_frames_and_marks_them(
    inputs: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    interrupt(monkeypatch)
    out = tmp_path / "o"
    assert main([*inputs.words(), "--batch-size", "1", "--overlay", "--out", str(out)]) == 130
    record = run_record(out)
    assert record["partial"] is True
    last = record["frames"]["frame"][-1]
    # Detection runs some frames ahead of linking.
    assert 5 <= last <= 9
    check_result(out, 0, last - 1)
    names = {path.name for path in out.iterdir()} - {"report", "report.html"}
    assert names == {"flow.npz", "run.json", "tracks.txt"}
    lines = capsys.readouterr().err.splitlines()
    # A line before it says that the rest is being written.
    assert [line for line in lines if line.startswith("tsuiseki:")][-1:] == [
        f"tsuiseki: interrupted; the partial result up to frame {last} is in {out}, marked in its run.json"
    ]


def test_ctrl_c_before_a_frame_is_finished_leaves_nothing(
    inputs: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop(*_: object) -> ImageArray:
        raise KeyboardInterrupt

    monkeypatch.setattr("tsuiseki.tracking.video.source.eight_bits", stop)
    assert main([*inputs.words(), "--out", str(tmp_path / "o")]) == 130
    assert list(tmp_path.iterdir()) == []
    assert capsys.readouterr().err == "tsuiseki: interrupted; nothing was written\n"


def python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_tracking_never_imports_torch(inputs: Any, tmp_path: Path) -> None:
    words = [*inputs.words(), "--overlay", "--out", str(tmp_path / "o")]
    heavy = {"torch", "lightning", "torchvision", "sklearn", "onnx"}
    done = python(
        f"import sys; from tsuiseki.tracking.cli import main; status = main({words!r});"
        f"sys.exit(' '.join({heavy} & set(sys.modules)) or status)"
    )
    assert (done.returncode, done.stderr) == (0, "tracking: 12/12 done\ndrawing: 12/12 done\n")


@pytest.mark.parametrize("words", [["track", "--help"], ["--help"], ["--version"]])
def test_help_of_a_group_imports_next_to_nothing(words: list[str]) -> None:
    done = python(
        f"import sys; from tsuiseki.tracking.cli import main; status = main({words!r});"
        "sys.exit(' '.join({'numpy', 'scipy', 'cv2', 'av', 'yaml', 'pydantic'} & set(sys.modules)) or status)"
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "tsuiseki" in done.stdout


def test_training_without_its_extra_says_what_to_install() -> None:
    for words in (
        ["train", "detector"],
        ["train", "affinity"],
        ["export", "appearance", "--out", "x", "--checkpoint", "y"],
    ):
        done = python(
            "import sys; sys.modules.update(dict.fromkeys(['torch', 'lightning', 'sklearn', 'onnx']));"
            f"from tsuiseki.tracking.cli import main; sys.exit(main({words!r}))"
        )
        assert done.returncode == 2
        assert done.stderr.count("\n") == 1
        assert "pip install 'tsuiseki[train]'" in done.stderr


@pytest.mark.parametrize("words", [w for w in all_commands() if w[0] not in ("train", "export")], ids=" ".join)
def test_every_command_has_help(words: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*words, "--help"]) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"usage: tsuiseki {' '.join(words)}")
    assert "--config" in text or words == ("models", "list")


TRACKED = "people, single, sphere, drone, blobs, points, deformable, animals, floor, fisheye"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["trak"], "unknown command `tsuiseki trak`; did you mean track?"),
        (["track", "peple"], "unknown command `tsuiseki track peple`; did you mean people?"),
        (["track", "zzz"], f"unknown command `tsuiseki track zzz`; expected one of {TRACKED}"),
    ],
)
def test_an_unknown_command_names_its_neighbour(
    words: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    assert capsys.readouterr().err == f"tsuiseki: {line}\n"
