"""Every kind of bad input gets one clear line and the right exit status, and leaves nothing behind."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.onnx import FORMAT_VERSION, ModelCard
from tsuiseki.tracking.video.source import open_source
from tsuiseki.tracking.video.webm import VideoWriter

ROW = "{frame},-1,9,9,16,32,0.9\n"


def rows(*frames: int) -> str:
    return "".join(ROW.format(frame=frame) for frame in frames)


def images(folder: Path, inputs: Any) -> Path:
    shutil.copytree(inputs.images, folder / "images")
    return folder / "images"


def mixed_sizes(folder: Path, inputs: Any) -> Path:
    path = images(folder, inputs)
    cv2.imwrite(str(path / "000005.png"), np.zeros((32, 32, 3), np.uint8))
    return path


def image_of_text(folder: Path, inputs: Any) -> Path:
    path = images(folder, inputs)
    (path / "000005.png").write_text("no image")
    return path


def not_only_images(folder: Path, inputs: Any) -> Path:
    path = images(folder, inputs)
    (path / "notes.txt").write_text("no image")
    return path


def text_video(folder: Path, _: Any) -> Path:
    (folder / "text.mp4").write_text("no video")
    return folder / "text.mp4"


def zero_frames(folder: Path, _: Any) -> Path:
    with VideoWriter(folder / "zero.webm", 10):
        pass
    (folder / "zero.webm").touch()
    return folder / "zero.webm"


def header_only(folder: Path, inputs: Any) -> Path:
    (folder / "head.webm").write_bytes(inputs.video.read_bytes()[:300])
    return folder / "head.webm"


def truncated(folder: Path, _: Any) -> Path:
    path = folder / "cut.webm"
    rng = np.random.default_rng(0)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"VP80"), 10, (64, 48))
    for _number in range(12):
        writer.write(rng.integers(0, 256, (48, 64, 3), dtype=np.uint8))
    writer.release()
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return path


def broken_later(folder: Path, inputs: Any) -> Path:
    path = images(folder, inputs)
    (path / "000005.png").write_bytes((path / "000005.png").read_bytes()[:60])
    return path


Make = Callable[[Path, Any], Path]
SOURCES: dict[str, tuple[Make, int, str]] = {
    "missing video": (lambda folder, _: folder / "missing.mp4", 2, "found no"),
    "text as video": (text_video, 2, "expected a video that FFmpeg can decode"),
    "zero frames": (zero_frames, 2, "expected a video that FFmpeg can decode"),
    "header only": (header_only, 2, "expected a video that FFmpeg can decode"),
    "mixed sizes": (mixed_sizes, 2, "000005.png: expected 64x48 pixels as in 000001.png, got 32x32"),
    "text as image": (image_of_text, 2, "000005.png: expected an image"),
    "not only images": (not_only_images, 2, "expected only images, found notes.txt"),
    "empty folder": (lambda folder, _: folder, 2, "found neither"),
}
DETECTIONS: dict[str, tuple[str, int, str]] = {
    "negative size": ("1,-1,9,9,-16,32,0.9\n", 2, "expected a box with a positive width and height"),
    "NaN": ("1,-1,nan,9,16,32,0.9\n", 2, "expected finite numbers"),
    "frame 0": (rows(0), 2, "whole frame number from 1"),
    "too few columns": ("1,-1,9,9\n", 2, "numbers separated by commas, got 4"),
    "no numbers": ("1,-1,a,9,16,32,0.9\n", 2, ":1: expected numbers separated by commas, got 'a'"),
}


@pytest.fixture
def complaint(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[[list[str], int], str]:
    """Runs a command that must fail, and gives its only line; nothing may be written."""

    def run(words: list[str], status: int) -> str:
        capsys.readouterr()
        before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
        assert main([*words, *(() if "--out" in words else ("--out", str(tmp_path / "result")))]) == status
        captured = capsys.readouterr()
        assert captured.out == ""
        assert captured.err.startswith("tsuiseki: ")
        assert captured.err.count("\n") == 1
        assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before
        return captured.err

    return run


Complaint = Callable[[list[str], int], str]


@pytest.mark.parametrize("case", list(SOURCES))
def test_bad_sources(case: str, inputs: Any, tmp_path: Path, complaint: Complaint) -> None:
    make, status, line = SOURCES[case]
    assert line in complaint(inputs.words(make(tmp_path, inputs)), status)


@pytest.mark.parametrize("source", ["video", "images"])
@pytest.mark.parametrize("case", list(DETECTIONS))
def test_bad_detections(case: str, source: str, inputs: Any, tmp_path: Path, complaint: Complaint) -> None:
    text, status, line = DETECTIONS[case]
    file = tmp_path / "det.txt"
    file.write_text(text)
    words = ["track", "people", str(getattr(inputs, source)), "--method", "sort", "--detections", str(file)]
    assert line in complaint(words, status)


@pytest.mark.parametrize("source", ["video", "images"])
def test_detections_after_the_end_are_left_out_and_told(
    source: str, inputs: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "det.txt"
    file.write_text(rows(*range(1, 13), 500, 501))
    words = ["track", "people", str(getattr(inputs, source)), "--method", "sort", "--detections", str(file)]
    assert main([*words, "--out", str(tmp_path / "o")]) == 0
    assert [line for line in capsys.readouterr().err.splitlines() if line.startswith("tsuiseki:")] == [
        f"tsuiseki: note: {file}: 2 detection(s) after the video's last frame, 12, are left out"
        if source == "images"
        else "tsuiseki: note: 2 detection(s) after the last frame of v.webm, 12, are left out"
    ]
    noted = json.loads((tmp_path / "o" / "run.json").read_text())["facts"]["notes"]
    assert ["2 detection(s) after" in note for note in noted] == [True]


def test_detections_of_another_video_are_refused(inputs: Any, tmp_path: Path, complaint: Complaint) -> None:
    file = tmp_path / "det.txt"
    file.write_text(rows(500, 501))
    words = ["track", "people", str(inputs.images), "--method", "sort", "--detections", str(file)]
    assert "are these the detections of another video?" in complaint(words, 2)


@pytest.mark.slow
@pytest.mark.parametrize("make", [truncated, broken_later])
def test_a_video_that_breaks_off_keeps_what_is_finished(
    make: Make, inputs: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "result"
    words = ["track", "people", str(make(tmp_path, inputs)), "--detector", str(inputs.detector), "--method", "sort"]
    assert main([*words, "--batch-size", "2", "--overlay", "--out", str(out)]) == 1
    record = json.loads((out / "run.json").read_text())
    last = record["frames"]["frame"][-1]
    assert record["partial"] is True
    assert read_tracks(out / "tracks.txt")[0].frames.tolist() == list(range(last))
    assert len(list(open_source(out / "overlay.webm").frames())) == last
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("tsuiseki:")]
    assert len(lines) == 1
    assert f"the partial result up to frame {last} is in {out}, marked in its run.json" in lines[0]


def newer_version(path: Path) -> None:
    card = ModelCard("detector", "small", ("person",), 24, 32, settings={"variances": [0.1, 0.2]})
    save_detector(path, dataclasses.replace(card, format_version=FORMAT_VERSION + 1).to_json())


def save_detector(path: Path, card: str | None) -> None:
    """A sound graph with another card."""
    import onnx
    from onnx import TensorProto, helper

    from tsuiseki.tracking.onnx import METADATA_KEY

    value = helper.make_tensor_value_info("images", TensorProto.FLOAT, ["n", 3, 24, 32])
    result = helper.make_tensor_value_info("logits", TensorProto.FLOAT, ["n", 3, 24, 32])
    graph = helper.make_graph([helper.make_node("Identity", ["images"], ["logits"])], "g", [value], [result])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    if card is not None:
        helper.set_model_props(model, {METADATA_KEY: card})
    onnx.save(model, path)


MODELS: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (lambda _: None, "expected an ONNX file"),
    "not ONNX": (lambda path: path.write_text("no model"), "is not a readable ONNX model"),
    "without metadata": (lambda path: save_detector(path, None), "are of no known layout; known are"),
    "broken metadata": (lambda path: save_detector(path, "{}"), "expected metadata of format version up to"),
    "newer version": (newer_version, f"format version up to {FORMAT_VERSION}, got format version {FORMAT_VERSION + 1}"),
    "other outputs": (
        lambda path: save_detector(path, ModelCard("detector", "small").to_json()),
        "expected outputs logits, offsets and anchors, or boxes and scores, got logits",
    ),
}


@pytest.mark.parametrize("case", list(MODELS))
def test_bad_models(case: str, inputs: Any, tmp_path: Path, complaint: Complaint) -> None:
    make, line = MODELS[case]
    make(tmp_path / "m.onnx")
    assert line in complaint([*inputs.words(), "--detector", str(tmp_path / "m.onnx")], 2)


@pytest.mark.parametrize(
    ("option", "other"),
    [("detector", "appearance"), ("appearance", "affinity"), ("affinity", "detector")],
)
def test_models_of_another_kind(option: str, other: str, inputs: Any, complaint: Complaint) -> None:
    line = complaint([*inputs.words(), f"--{option}", str(getattr(inputs, other))], 2)
    assert f"expected a model of kind {option!r}, got {other!r}" in line


@pytest.mark.parametrize(
    ("option", "ours"),
    [
        ("--conf", "here it is --score-threshold"),
        ("--iou", "of boxes with an IoU above 0.5 the best score stays"),
        ("--imgsz", "here it is --view"),
        ("--tracker", "here it is --method"),
    ],
)
def test_options_of_other_programs_hint_at_ours(option: str, ours: str, inputs: Any, complaint: Complaint) -> None:
    assert f"unknown option {option}; {ours}" in complaint([*inputs.words(), option, "0.5"], 2)


@pytest.mark.parametrize(
    ("yaml", "line"),
    [
        ("ovrlay: true", "unknown option --ovrlay; did you mean --overlay?"),
        ("flow:\n  fil: 3", "unknown option --flow.fil; did you mean --flow.fill?"),
        ("batch_size: lots", "--batch-size: expected a valid integer"),
        ("method: magic", "--method: expected 'flow', 'deepsort', "),
        ("flow:\n  fill: high", "--flow.fill: expected a valid number, unable to parse string as a number, got 'high'"),
        ("flow: {fill: -1}", "--flow.fill: expected a number greater than or equal to 0"),
        ("fps: [1", "expected YAML of options"),
    ],
)
def test_bad_configurations(yaml: str, line: str, inputs: Any, tmp_path: Path, complaint: Complaint) -> None:
    (tmp_path / "c.yaml").write_text(yaml)
    assert line in complaint([*inputs.words(), "--config", str(tmp_path / "c.yaml")], 2)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--score-threshold", "2"], "--score-threshold: expected a number less than or equal to 1, got '2'"),
        (["--batch-size", "0"], "--batch-size: expected a number greater than 0, got '0'"),
        (["--threads", "-1"], "--threads: expected a number greater than or equal to 0, got '-1'"),
        (["--frames", "0-4"], "expected --frames FIRST-LAST"),
        (["--frames", "5-99"], "expected frames within 1-12, got --frames 5-99"),
        (["--detections", "d.txt"], "expected --detections or --detector, got both"),
        (["--method", "sort"], "expected --appearance with a method that compares it, flow or deepsort"),
    ],
)
def test_bad_options(words: list[str], line: str, inputs: Any, complaint: Complaint) -> None:
    assert line in complaint([*inputs.words(), *words], 2)


def test_an_output_folder_that_is_a_file(inputs: Any, tmp_path: Path, complaint: Complaint) -> None:
    (tmp_path / "file").write_text("keep me")
    for extra in ([], ["--overwrite"]):
        assert "is a file" in complaint([*inputs.words(), "--out", str(tmp_path / "file"), *extra], 2)


@pytest.mark.slow
def test_an_output_folder_full_of_results(inputs: Any, tmp_path: Path, complaint: Complaint) -> None:
    out = tmp_path / "o"
    assert main([*inputs.words(), "--out", str(out)]) == 0
    line = complaint([*inputs.words(), "--out", str(out)], 2)
    assert "already holds flow.npz, report, report.html and 2 more; choose another folder or add --overwrite" in line
