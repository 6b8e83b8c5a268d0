"""An empty name, as of a variable that is not set, is not the current folder: not in any command, not in Python."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tsuiseki
from tsuiseki.datamodules.labelled_images import labelled_images
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.cli.commands import all_commands, command_of
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.video.source import open_source

# Commands that have options alone.
OPTIONS_ALONE = ("simulate", "export", "demo")
# They read their words themselves.
LIGHTNING = [("train", name) for name in ("detector", "appearance", "action", "association", "tracker")]
IMAGES = [np.zeros((48, 64, 3), np.uint8)] * 3
RESULT = Result([Track(1, np.arange(5), np.tile([1.0, 1, 9, 9], (5, 1)), np.ones(5))], "v", 10.0, (64, 48))


def has_a_place(words: tuple[str, ...]) -> bool:
    """Whether something stands behind a command, without an option's name."""
    command = command_of(words)[1]
    return any(argument.index is not None for argument in command.assemble_argument_collection())


PLACED = [words for words in all_commands() if words[0] not in OPTIONS_ALONE and words not in LIGHTNING]


@pytest.mark.parametrize("empty", ["", "  "], ids=["nothing", "blanks"])
@pytest.mark.parametrize("words", [words for words in PLACED if has_a_place(words)], ids=" ".join)
def test_every_command_refuses_an_empty_name_in_its_place(
    words: tuple[str, ...],
    empty: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    out = [] if words[0] in ("evaluate", "review", "forget", "gallery") else ["--out", "out"]
    assert main([*words, empty, *out]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "empty" in line
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(
    "words",
    [
        ["track", "people", "x", "--out", ""],
        ["track", "people", "x", "--out", "o", "--detections", ""],
        ["track", "people", "x", "--out", "o", "--detector="],
        ["track", "people", "x", "--out", "o", "--config", ""],
        ["track", "sphere", "a", "b", "--cameras", "", "--out", "o"],
        ["count", "x", "--scene", "", "--out", "o"],
        ["evaluate", "people", "x", ""],
        ["evaluate", "people", "x", "y", "--json", ""],
        ["hide", "x", "y", "--out", ""],
        ["simulate", "street", "--out", ""],
        ["demo", "--out", ""],
        ["export", "detector", "--checkpoint", "", "--out", "o"],
        ["batch", "track", "people", "", "--out", "o"],
        ["batch", "track", "people", "x", "--out", ""],
    ],
    ids=" ".join,
)
def test_options_refuse_empty_names(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "empty" in line
    assert not [*tmp_path.iterdir()]


def test_a_file_of_options_refuses_an_empty_source(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "c.yaml").write_text("source: ''\nout: o\n")
    assert main(["track", "people", "--config", str(tmp_path / "c.yaml")]) == 2
    assert "SOURCE: expected a value, got an empty one" in capsys.readouterr().err


CALLS: dict[str, Callable[[], Any]] = {
    "open_source": lambda: open_source(""),
    "track_people": lambda: tsuiseki.track_people(""),
    "track_people, blanks": lambda: tsuiseki.track_people(" "),
    "track_animals": lambda: tsuiseki.track_animals(""),
    "track_drone": lambda: tsuiseki.track_drone(""),
    "track_single": lambda: tsuiseki.track_single("", (1, 1, 5, 5)),
    "follow_people": lambda: next(iter(tsuiseki.follow_people("", method="sort"))),
    "track_fisheye": lambda: tsuiseki.track_fisheye(IMAGES, cameras=""),
    "track_floor": lambda: tsuiseki.track_floor([IMAGES, IMAGES], cameras=""),
    "track_sphere_points": lambda: tsuiseki.track_sphere_points(["", ""], cameras=""),
    "Result.load": lambda: Result.load(""),
    "Result.save": lambda: RESULT.save(""),
    "convert": lambda: tsuiseki.convert(RESULT, "mot", ""),
    "convert, video": lambda: tsuiseki.convert(RESULT, "mot", "o.txt", video=""),
    "count": lambda: tsuiseki.count(RESULT, ""),
    "hide": lambda: tsuiseki.hide("", RESULT, out="o"),
    "hide, out": lambda: tsuiseki.hide("x", RESULT, out=""),
    "evaluate_people": lambda: tsuiseki.evaluate_people("", ""),
    "evaluate_people, tracks": lambda: tsuiseki.evaluate_people(RESULT, ""),
    "batch": lambda: tsuiseki.batch("track people", "", out="o"),
    "batch, out": lambda: tsuiseki.batch("track people", "x", out=""),
    "read_tracks": lambda: tsuiseki.read_tracks(""),
    "write_tracks": lambda: tsuiseki.write_tracks("", RESULT),
    "read_scene": lambda: tsuiseki.read_scene(""),
    "Detector": lambda: tsuiseki.Detector(""),
    "labelled_images": lambda: labelled_images(""),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_python_refuses_empty_names(call: Callable[[], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RequestError, match=r"empty|got nothing|got no name"):
        call()
    assert not [*tmp_path.iterdir()]
