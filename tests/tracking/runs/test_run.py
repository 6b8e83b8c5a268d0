"""The frame of commands: what is finished is kept, whatever ends a run, and a run can be given back as it was."""

from __future__ import annotations

import errno
import fcntl
import inspect
import json
import os
import re
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.cli.commands import all_commands, command_of
from tsuiseki.tracking.drone.tracker import DroneTracker
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.output import output_file
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.runs import ending
from tsuiseki.tracking.runs.run import where_to_look
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.video import image_folder
from tsuiseki.tracking.video.source import open_source
from tsuiseki.tracking.video.webm import VideoWriter

FRAMES = 10


def square_on_noise(folder: Path) -> Path:
    """Write the images of a red square that moves over noise."""
    folder.mkdir()
    rng = np.random.default_rng(0)
    for number in range(FRAMES):
        image = rng.integers(90, 130, (96, 128, 3)).astype(np.uint8)
        image[30:50, 20 + 3 * number : 40 + 3 * number] = (0, 0, 230)
        cv2.imwrite(str(folder / f"{number:03d}.png"), image)
    return folder


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return square_on_noise(tmp_path_factory.mktemp("run") / "clip")


def commands(clip: Path, streams: Path) -> dict[str, tuple[list[str], str]]:
    """The words of each command, and the file that it is about."""
    box = ["--box", "20,30,20,20", "--method", "kcf"]
    detections = clip.parent / "det.txt"
    detections.write_text("".join(f"{n},-1,{18 + 3 * n},31,20,20,0.9\n" for n in range(1, FRAMES + 1)))
    given = ["--detections", str(detections), "--appearance", "none", "--affinity", "none"]
    actions = ",".join(str(streams / f"{name}.onnx") for name in ("rgb_local", "flow_local"))
    return {
        "people": (["track", "people", str(clip), *given, "--moving-camera"], "tracks.txt"),
        "single": (["track", "single", str(clip), *box], "boxes.txt"),
        "blobs": (["track", "blobs", str(clip), "--colour", "red", "--particles", "50"], "tracks.txt"),
        "deformable": (
            ["track", "deformable", str(clip), "--colour", "orange", "--deformable.particles", "50"],
            "states.csv",
        ),
        "drone": (["track", "drone", str(clip), *given[:-2], "--actions", actions, "--batch-size", "1"], "tracks.json"),
    }


NAMES = ("people", "single", "blobs", "deformable", "drone")


def lines_of(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return [line for line in capsys.readouterr().err.splitlines() if line.startswith("tsuiseki:")]


def record_of(folder: Path) -> dict[str, Any]:
    values: dict[str, Any] = json.loads((folder / "run.json").read_text())
    return values


def at_call(number: int, what: Callable[[], object], function: Callable[..., Any]) -> Callable[..., Any]:
    """``function``, with ``what`` happening as it is called for the ``number``-th time."""
    calls = []

    def called(*values: Any, **named: Any) -> Any:
        calls.append(None)
        if len(calls) == number:
            what()
        return function(*values, **named)

    return called


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupt_keeps_the_finished_frames(
    name: str,
    number: signal.Signals,
    clip: Path,
    drone_models: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words, file = commands(clip, drone_models)[name]
    before = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    stop = at_call(7, lambda: signal.raise_signal(number), image_folder.read_image)
    monkeypatch.setattr(image_folder, "read_image", stop)
    assert main([*words, "--overlay", "--out", str(tmp_path / "o")]) == 128 + number
    record = record_of(tmp_path / "o")
    assert record["partial"] is True
    last = record["frames"]["frame"][-1]
    assert 5 <= last <= 8
    assert (tmp_path / "o" / file).is_file()
    assert not (tmp_path / "o" / "overlay.webm").exists()
    assert lines_of(capsys)[-1] == (
        f"tsuiseki: interrupted; the partial result up to frame {last} is in {tmp_path / 'o'}, marked in its run.json"
    )
    assert [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == before
    assert [p.name for p in tmp_path.iterdir()] == ["o"]
    assert not [p for p in (tmp_path / "o").iterdir() if p.name.startswith(".")]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("trouble", ["interrupt", "full disk"])
def test_what_is_finished_survives_the_drawing(
    name: str,
    trouble: str,
    clip: Path,
    drone_models: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def happen() -> None:
        if trouble == "interrupt":
            signal.raise_signal(signal.SIGINT)
        else:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    words, file = commands(clip, drone_models)[name]
    monkeypatch.setattr(VideoWriter, "write", at_call(4, happen, VideoWriter.write))
    assert main([*words, "--overlay", "--out", str(tmp_path / "o")]) == (130 if trouble == "interrupt" else 1)
    record = record_of(tmp_path / "o")
    assert record["partial"] is True
    assert record["frames"]["frame"] == list(range(1, FRAMES + 1))
    assert (tmp_path / "o" / file).is_file()
    assert not (tmp_path / "o" / "overlay.webm").exists()
    (line,) = lines_of(capsys)
    reason = "interrupted while overlay.webm was drawn" if trouble == "interrupt" else "No space left on device"
    assert reason in line
    assert f"is in {tmp_path / 'o'}, marked in its run.json" in line


@pytest.mark.parametrize(("apart", "kept"), [(0.0, []), (60.0, ["o"])])
def test_a_second_interrupt_ends_at_once_and_one_that_comes_twice_is_one(
    apart: float,
    kept: list[str],
    clip: Path,
    drone_models: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def twice() -> None:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(ending, "TWICE", apart)
    monkeypatch.setattr(image_folder, "read_image", at_call(7, twice, image_folder.read_image))
    assert main([*commands(clip, drone_models)["blobs"][0], "--out", str(tmp_path / "o")]) == 130
    assert [path.name for path in tmp_path.iterdir()] == kept
    said = "the partial result up to frame" if kept else "nothing was written"
    assert lines_of(capsys)[-1].startswith(f"tsuiseki: interrupted; {said}")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "linker"),
    [
        (["people"], (FlowTracker, "tracks")),
        (["drone", "--method", "flow", "--keep-camera-motion"], (DroneTracker, "people")),
    ],
)
def test_detections_are_kept_where_linking_them_is_interrupted(
    what: list[str], linker: tuple[type, str], inputs: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def link(_: object) -> list[Track]:
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGTERM)
        return []

    monkeypatch.setattr(ending, "TWICE", 0.0)
    words = ["track", *what, str(inputs.images), "--appearance", "none"]
    with monkeypatch.context() as patch:
        patch.setattr(*linker, link)
        detected = [*words, "--detector", str(inputs.detector), "--view", "1", "--out", str(tmp_path / "one")]
        assert main(detected) == 128 + signal.SIGTERM
    assert sorted(path.name for path in (tmp_path / "one").iterdir()) == ["detections.txt", "run.json"]
    record = record_of(tmp_path / "one")
    assert (record["partial"], record["files"]) == (True, ["detections.txt"])
    linked = [*words, "--detections", str(tmp_path / "one/detections.txt")]
    assert main([*linked, "--out", str(tmp_path / "two")]) == 0
    assert len(read_tracks(tmp_path / "two/tracks.txt")) > 0
    monkeypatch.setattr(*linker, link)
    assert main([*linked, "--out", str(tmp_path / "three")]) == 128 + signal.SIGTERM
    assert not (tmp_path / "three").exists()


def test_what_a_dead_run_left_behind_is_cleared_and_a_living_one_is_let_be(
    clip: Path, drone_models: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = commands(clip, drone_models)["blobs"][0]
    out = tmp_path / "o"
    left = out / ".o.abc.unfinished"
    left.mkdir(parents=True)
    (left / "tracks.txt").write_text("half")
    lock = os.open(out, os.O_RDONLY)
    fcntl.flock(lock, fcntl.LOCK_EX)
    assert main([*words, "--out", str(out)]) == 2
    assert lines_of(capsys) == [f"tsuiseki: another run is writing {out} at this moment; choose another name"]
    assert left.is_dir()
    os.close(lock)
    assert main([*words, "--out", str(out)]) == 0
    assert sorted(p.name for p in out.iterdir()) == ["points.csv", "report", "report.html", "run.json", "tracks.txt"]


def test_a_file_beside_which_a_dead_run_left_something(tmp_path: Path) -> None:
    left = tmp_path / ".scores.json.abc.unfinished"
    left.mkdir()
    with output_file(tmp_path / "scores.json", overwrite=False) as work:
        work.write_text("{}")
    assert [p.name for p in tmp_path.iterdir()] == ["scores.json"]


def test_options_win_over_files_wherever_they_stand(clip: Path, tmp_path: Path) -> None:
    config = tmp_path / "c.yaml"
    config.write_text(f"source: nowhere\nout: {tmp_path / 'wrong'}\nseed: 7\nparticles: 40\ncolour: red\n")
    words = ["track", "blobs", str(clip), "--out", str(tmp_path / "right"), "--seed", "3", "--config", str(config)]
    assert main(words) == 0
    assert not (tmp_path / "wrong").exists()
    settings = record_of(tmp_path / "right")["settings"]
    assert (settings["source"], settings["seed"], settings["particles"]) == (str(clip), 3, 40)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_printed_config_and_a_record_can_be_given_back(
    name: str, clip: Path, drone_models: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words, file = commands(clip, drone_models)[name]
    first, second, third = (tmp_path / n for n in ("first", "second", "third"))
    assert main([*words, "--out", str(first)]) == 0
    capsys.readouterr()
    assert main([*words, "--out", str(second), "--print-config"]) == 0
    (tmp_path / "c.yaml").write_text(capsys.readouterr().out)
    assert main([*words[:2], "--config", str(tmp_path / "c.yaml")]) == 0
    assert main([*words[:2], "--config", str(first / "run.json"), "--out", str(third)]) == 0
    assert (first / file).read_bytes() == (second / file).read_bytes() == (third / file).read_bytes()
    assert record_of(third)["settings"] == record_of(first)["settings"] | {"out": str(third)}


def test_a_record_of_another_command_and_one_that_would_overwrite(
    clip: Path, drone_models: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = commands(clip, drone_models)["blobs"][0]
    out = tmp_path / "o"
    assert main([*words, "--out", str(out), "--overwrite"]) == 0
    assert main(["track", "people", "--config", str(out / "run.json")]) == 2
    assert main(["track", "blobs", "--config", str(out / "run.json")]) == 2
    wrong, again = lines_of(capsys)
    assert "expected the record of `tsuiseki track people`" in wrong
    assert "add --overwrite" in again


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["webm", "mp4"])
def test_the_same_seed_gives_the_same_bytes(kind: str, clip: Path, drone_models: Path, tmp_path: Path) -> None:
    words = [*commands(clip, drone_models)["blobs"][0], "--overlay", "--overlay-format", kind]
    for name in ("a", "b"):
        assert main([*words, "--out", str(tmp_path / name)]) == 0
    first, second = (tmp_path / name / f"overlay.{kind}" for name in ("a", "b"))
    assert first.read_bytes() == second.read_bytes()
    assert len(list(open_source(first).frames())) == FRAMES


def picture(folder: Path) -> Path:
    cv2.imwrite(str(folder / "c.jpg"), np.zeros((20, 20, 3), np.uint8))
    return folder / "c.jpg"


def bomb(folder: Path) -> Path:
    rows = ["a: &a [x, x, x, x, x, x, x, x, x, x]"]
    rows += [f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]" for a, b in zip("abcdefgh", "bcdefghi", strict=True)]
    (folder / "c.yaml").write_text("\n".join(rows))
    return folder / "c.yaml"


@pytest.mark.parametrize(
    ("make", "line"),
    [(picture, "got something binary"), (bomb, "got more than 1000000 values, with those of aliases, line 6")],
)
def test_files_that_are_no_options(
    make: Callable[[Path], Path], line: str, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["track", "people", str(clip), "--out", "o", "--config", str(make(tmp_path))]) == 2
    (said,) = lines_of(capsys)
    assert said.startswith("tsuiseki: --config: ")
    assert "YAML of options" in said
    assert said.endswith(line)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            "blobs CLIP --colour red --seed -1 --out OUT",
            "--seed: expected a number greater than or equal to 0, got '-1'",
        ),
        ("people CLIP --out -", "--out: expected a value after it"),
        ("single CLIP --method mil --box 0,0,128,96 --out OUT", "--box: expected a box with room around it"),
        ("blobs CLIP --colour red --size 20000,20000 --out OUT", "--size: expected at most the 128x96 pixels"),
    ],
)
def test_requests_that_cannot_be_met(
    words: str, line: str, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [{"CLIP": str(clip), "OUT": str(tmp_path / "o")}.get(word, word) for word in words.split()]
    assert main(["track", *given]) == 2
    (said,) = lines_of(capsys)
    assert said.startswith(f"tsuiseki: {line}")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["OTB", "UAV123"])
@pytest.mark.parametrize("name", NAMES)
def test_folders_of_one_target_are_taken_by_every_command(
    layout: str, name: str, clip: Path, drone_models: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "sequence"
    (folder / "img").mkdir(parents=True)
    for image in clip.iterdir():
        (folder / ("img" if layout == "OTB" else "") / image.name).symlink_to(image)
    if layout != "OTB":
        (folder / "img").rmdir()
    (folder / "groundtruth_rect.txt").write_text("21,31,20,20\n" * FRAMES)
    words, file = commands(clip, drone_models)[name]
    assert main([*words[:2], str(folder), *words[3:], "--out", str(tmp_path / "o")]) == 0
    assert (tmp_path / "o" / file).is_file()
    assert record_of(tmp_path / "o")["frames"]["frame"] == list(range(1, FRAMES + 1))


@pytest.mark.parametrize("name", [n for n in NAMES if n != "single"])
def test_pictures_of_one_pixel_have_an_overlay(name: str, clip: Path, drone_models: Path, tmp_path: Path) -> None:
    folder = tmp_path / "tiny"
    folder.mkdir()
    for number in range(3):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((1, 1, 3), 60 * number, np.uint8))
    words = commands(clip, drone_models)[name][0]
    (clip.parent / "det.txt").write_text("".join(f"{n},-1,1,1,1,2,0.9\n" for n in (1, 2, 3)))
    given = [*words[:2], str(folder), *words[3:]]
    assert main([*given, "--frames", "1-3", "--overlay", "--out", str(tmp_path / "o")]) == 0
    assert len(list(open_source(tmp_path / "o" / "overlay.webm").frames())) == 3


def test_a_colour_that_nothing_has_is_told(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["track", "deformable", str(clip), "--colour", "green", "--deformable.particles", "50"]
    assert main([*words, "--out", str(tmp_path / "o")]) == 0
    assert "nothing of the colour green fits a body, give another --colour" in capsys.readouterr().out


def test_people_have_a_report(clip: Path, drone_models: Path, tmp_path: Path) -> None:
    words = ["track", "people", str(clip), *commands(clip, drone_models)["people"][0][3:5], "--method", "sort"]
    assert main([*words, "--overlay", "--out", str(tmp_path / "o")]) == 0
    page = (tmp_path / "o" / "report.html").read_text()
    assert "<h1>People in clip</h1>" in page
    assert "<title>person 1?, 0.0 to 0.4 s" in page
    assert 'src="data:video/webm;base64,' in page


def test_the_target_of_uav123_is_labelled_apart(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    images, labels = tmp_path / "data_seq" / "UAV123" / "bike1", tmp_path / "anno" / "UAV123"
    images.mkdir(parents=True)
    labels.mkdir(parents=True)
    for number, image in enumerate(sorted(clip.iterdir()), 1):
        (images / f"{number:06d}.png").symlink_to(image)
    (labels / "bike1.txt").write_text("".join(f"{21 + 3 * n},31,20,20\n" for n in range(FRAMES)))
    assert main(["track", "single", str(images), "--method", "kcf", "--out", str(tmp_path / "bike1")]) == 0
    capsys.readouterr()
    assert main(["evaluate", "single", str(images), str(tmp_path / "bike1")]) == 0
    assert "bike1" in capsys.readouterr().out


def pages_and_sources() -> Iterator[tuple[str, str]]:
    """Each command whose help names a page, and the source of its module."""
    for words in all_commands():
        function = command_of(words)[1].default_command
        text = " ".join((inspect.getdoc(function) or "").split()) if function else ""
        if function and re.search(r"report\.html|index\.html", text):
            yield " ".join(words), Path(inspect.getsourcefile(inspect.unwrap(function)) or "").read_text()


@pytest.mark.slow
def test_every_command_that_writes_a_page_says_in_its_last_line_where_to_look(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One rule: the frame of runs says it, and no command says it itself."""
    commands_with_page = dict(pages_and_sources())
    assert {"count", "demo", "adapt", "track people", "track floor", "track animals"} <= {*commands_with_page}
    for name, source in commands_with_page.items():
        assert "output.run()" in source or "where_to_look(" in source, name
        assert not re.search(r"(print|done)\(.*(report\.html|REPORT_FILE|index\.html|\bresults: )", source), name
    for name in ("people", "blobs"):
        words, _ = commands(clip, clip)[name]
        out = tmp_path / name
        assert main([*words, "--out", str(out)]) == 0
        assert capsys.readouterr().out.splitlines()[-1] == f"open {out / 'report.html'}"
    assert where_to_look(tmp_path) == "", "a folder without a page"
