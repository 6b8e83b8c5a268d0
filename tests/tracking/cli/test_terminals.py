"""Terminals that cannot show all letters: old Windows ones, and the locale C."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.cli.commands import all_commands

ENCODINGS = ("cp1252", "cp437", "ascii")
# Their help is Lightning's, and takes seconds.
OF_LIGHTNING = [("train", name) for name in ("detector", "appearance", "action", "association")]
C_LOCALE = {"LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


@pytest.fixture
def said() -> dict[str, io.BytesIO]:
    """What is written to the two streams of a terminal that refuses letters that it cannot show."""
    return {name: io.BytesIO() for name in ("stdout", "stderr")}


def run(
    said: dict[str, io.BytesIO], monkeypatch: pytest.MonkeyPatch, encoding: str, *words: str
) -> tuple[int, str, str]:
    """The exit status, and what both streams say."""
    streams = {}
    for name, buffer in said.items():
        buffer.seek(0)
        buffer.truncate()
        streams[name] = io.TextIOWrapper(buffer, encoding=encoding, errors="strict", write_through=True)
        monkeypatch.setattr(sys, name, streams[name])
    status = main(words)
    texts = [buffer.getvalue().decode(encoding) for buffer in said.values()]
    for stream in streams.values():
        stream.detach()
    return status, texts[0], texts[1]


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(
    "words", [(), ("track",), *(words for words in all_commands() if words not in OF_LIGHTNING)], ids=" ".join
)
def test_help_of_each_command_is_shown_on_any_terminal(
    words: tuple[str, ...], encoding: str, said: dict[str, io.BytesIO], monkeypatch: pytest.MonkeyPatch
) -> None:
    status, text, errors = run(said, monkeypatch, encoding, *words, "--help")
    assert (status, errors) == (0, "")
    usage = text.splitlines()[0]
    assert usage.startswith(" ".join(["usage: tsuiseki", *words]))
    # What is to be typed can be typed.
    assert usage.isascii()
    assert "?" not in usage


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_names_that_cannot_be_shown_leave_one_line(
    encoding: str, said: dict[str, io.BytesIO], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    words = ["track", "people", "f門\u2192.mp4", "--out", str(tmp_path / "out")]
    status, text, errors = run(said, monkeypatch, encoding, *words)
    assert (status, text, len(errors.splitlines())) == (2, "", 1)
    assert "found no f\\u9580\\u2192.mp4" in errors


@pytest.mark.slow
@pytest.mark.parametrize(
    "environment", [*({"PYTHONIOENCODING": encoding} for encoding in ENCODINGS), C_LOCALE], ids=[*ENCODINGS, "C"]
)
def test_names_of_all_scripts_are_counted_on_any_terminal(environment: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "tracks.txt").write_text("".join(f"{n},1,300,{40 + 10 * n},40,90,1,-1,-1,-1\n" for n in range(1, 31)))
    lines = "- {name: Türe門, from: [100, 240], to: [500, 240], directions: [hinein→, út]}"
    (tmp_path / "scene.yaml").write_text(f"size: [640, 480]\nlines:\n{lines}\n", encoding="utf-8")
    call = [sys.executable, "-c", "import sys; from tsuiseki.tracking.cli import main; sys.exit(main())"]
    words = ["count", "tracks.txt", "--scene", "scene.yaml", "--fps", "25", "--out", "out"]
    done = subprocess.run([*call, *words], cwd=tmp_path, env={**os.environ, **environment}, capture_output=True)
    assert done.returncode == 0
    assert b"Traceback" not in done.stderr
    assert b"re? hinein?: 1" in done.stdout
    assert (tmp_path / "out" / "lines.csv").read_text(encoding="utf-8").splitlines()[1] == "Türe門,hinein→,1,1,1"
