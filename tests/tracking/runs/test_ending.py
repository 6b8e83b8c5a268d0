"""What a command without steps leaves and says when it is interrupted."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from tsuiseki.tracking.runs.ending import ended
from tsuiseki.tracking.runs.options import PlottedFile

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.mark.parametrize("number", SIGNALS)
def test_a_file_that_is_whole_is_told_and_half_a_file_vanishes(
    number: signal.Signals, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def half(path: Path) -> None:
        path.write_text("half")
        signal.raise_signal(number)

    def command() -> None:
        output = PlottedFile(out=tmp_path / "a.json", plot=tmp_path / "a.png")
        output.write(output.out, lambda path: path.write_text("whole"))
        output.draw(half)

    assert ended(command) == 128 + number
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]
    assert capsys.readouterr().err == f"tsuiseki: interrupted; {tmp_path / 'a.json'} is written\n"
