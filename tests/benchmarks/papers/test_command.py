"""`python -m benchmarks.papers`: what an experiment leaves and says, whole and interrupted; its help."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cyclopts.types import NonNegativeInt

from benchmarks.papers import __main__ as papers
from benchmarks.papers.outcome import Outcome
from benchmarks.papers.store import Cached
from benchmarks.papers.tables import Table


def experiment(*, store: Cached, interrupted: bool = False, seed: NonNegativeInt = 0) -> Outcome:
    """An experiment of no work.

    Args:
        store: keeps what was computed.
        interrupted: by the user.
        seed: of nothing.
    """
    del store
    if interrupted:
        raise KeyboardInterrupt
    return Outcome({"seed": seed}, [Table("Table 1", ("what", "here"), [("row", "1.0")])], notes=["a note"])


papers.app.command(experiment, name="none", show=False)


def reproduced(folder: Path, *words: str) -> int:
    return papers.main(["none", "--out", str(folder / "out"), "--cache", str(folder / "cache"), *words])


def test_an_experiment_writes_its_tables_and_where_they_are_from(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert reproduced(tmp_path, "--seed", "3") == 0
    out = tmp_path / "out"
    assert json.loads((out / "results.json").read_text()) == {"seed": 3}
    assert (out / "tables.md").read_text() == "Table 1\n\n| what | here |\n| --- | --- |\n| row | 1.0 |\n\na note\n"
    record = json.loads((out / "tables.json").read_text())
    assert record["command"] == "python -m benchmarks.papers none --seed 3"
    assert record["options"] == {"interrupted": False, "seed": 3}
    assert record["tables"]["Table 1"]["rows"] == [["row", "1.0"]]
    assert "a note" in capsys.readouterr().out
    assert reproduced(tmp_path) == 2
    assert "already holds" in capsys.readouterr().err
    assert reproduced(tmp_path, "--overwrite") == 0


def test_an_experiment_that_is_interrupted_says_how_it_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert reproduced(tmp_path, "--interrupted") == 130
    assert not list((tmp_path / "out").rglob("*.*"))
    assert capsys.readouterr().err == "papers: interrupted; run the same command again to go on\n"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["none", "--seed", "-1"], 'Invalid value "-1" for --seed. Must be >= 0.'),
        (["nobody"], 'Unknown command "nobody".'),
        (["none", "--sead", "1"], "Unknown option: --sead."),
    ],
)
def test_a_wrong_request_gets_one_line(words: list[str], line: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert papers.main(words) == 2
    (written,) = capsys.readouterr().err.splitlines()
    assert line in written


@pytest.mark.parametrize("name", papers.EXPERIMENTS)
def test_help_names_the_options(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert papers.main([name, "--help"]) == 0
    assert "--cache" in capsys.readouterr().out
