"""What a command without steps leaves and says when it is interrupted; and an experiment that ends by its own limit."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest

from tsuiseki.tracking.cli.parser import call
from tsuiseki.tracking.options import PlottedFile
from tsuiseki.tracking.runs.ending import ended
from tsuiseki.trainers.experiments.study import Outcome, Store, Table
from tsuiseki.trainers.experiments.study import command as reproduction

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


def experiment(store: Store, end: int | None = None, seed: int = 0) -> Outcome:
    """An experiment of no work.

    Args:
        store: keeps what was computed.
        end: signal with which it is ended.
        seed: of nothing.
    """
    del store, seed
    if end:
        signal.raise_signal(signal.Signals(end))
    table = Table("found", ("what", "here"), [("one", "1.0")])
    return Outcome({"one": 1.0}, [table], notes=["a note"])


def reproduce(tmp_path: Path, *words: str) -> int:
    given = ["--out", str(tmp_path / "out"), "--cache", str(tmp_path / "cache"), *words]
    status: int = ended(lambda: call("tsuiseki reproduce none", reproduction("none", experiment), given))
    return status


def test_an_experiment_writes_its_tables_and_its_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert reproduce(tmp_path, "--seed", "3") == 0
    out = tmp_path / "out"
    assert json.loads((out / "results.json").read_text()) == {"one": 1.0}
    assert (out / "tables.md").read_text().startswith("found")
    record = json.loads((out / "run.json").read_text())
    assert (record["command"], record["seed"]) == (["tsuiseki", "reproduce", "none"], 3)
    assert record["files"] == ["results.json", "tables.md"]
    assert "a note" in capsys.readouterr().out


@pytest.mark.parametrize("number", SIGNALS)
def test_an_experiment_that_is_interrupted_says_where_it_goes_on(
    number: signal.Signals, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert reproduce(tmp_path, "--end", str(int(number))) == 128 + number
    assert not (tmp_path / "out").exists()
    kept = f"what was computed is kept in {tmp_path / 'cache'}: run the same command again to go on"
    assert capsys.readouterr().err == f"tsuiseki: interrupted; {kept}\n"
