"""Progress is shown and nothing is lost on the way."""

from __future__ import annotations

import io

import pytest

from tsuiseki.tracking.runs import progress as module
from tsuiseki.tracking.runs.progress import progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_plain_lines_elsewhere(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(module, "SECONDS_BETWEEN_LINES", 0.0)
    assert list(progress(iter("abc"), "working", 3)) == ["a", "b", "c"]
    assert capsys.readouterr().err == "working: 1/3\nworking: 2/3\nworking: 3/3\nworking: 3/3 done\n"
    assert list(progress(iter("ab"), "working")) == ["a", "b"]
    assert capsys.readouterr().err.endswith("working: 2 done\n")


@pytest.mark.parametrize("total", [3, None])
def test_a_bar_on_a_terminal(monkeypatch: pytest.MonkeyPatch, total: int | None) -> None:
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    assert list(progress(iter("abc"), "working", total)) == ["a", "b", "c"]
    assert "working" in terminal.getvalue()
