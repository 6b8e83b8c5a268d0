"""`tsuiseki review` from its start to Ctrl-C."""

from __future__ import annotations

import _thread
import threading
from pathlib import Path

import pytest

from tsuiseki.tracking.cli import main


def test_the_command_shows_a_page_and_ends_by_an_interrupt(
    reviewable: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = []

    def show(address: str, _: str) -> None:
        shown.append(address)
        threading.Timer(0.5, _thread.interrupt_main).start()

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("tsuiseki.tracking.report.drawing.show_page", show)
    assert main(["review", str(reviewable)]) == 0
    assert shown[0].startswith("http://127.0.0.1:2")
    assert capsys.readouterr().out == f"0 answers; the tracks are in {reviewable}\n"
