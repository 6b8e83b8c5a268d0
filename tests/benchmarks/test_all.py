"""The table of a release: its smallest rows, with and without peers."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import benchmarks.all
from benchmarks.all import Pair, Row, Turn, measured, table

FOLDER = Path(benchmarks.all.__file__).parent


def _absent() -> Turn:
    raise ImportError


def test_an_absent_peer_is_named() -> None:
    row = measured(Pair("a task", lambda: None, "a peer", _absent), 2)
    assert row.theirs is None
    assert row.ours >= 0
    assert table([row]).splitlines()[1].split()[-1] == "absent"


def test_a_row_says_how_many_times_as_long_the_peer_takes() -> None:
    assert measured(Pair("a task", lambda: None, "a peer", lambda: lambda: None), 1).theirs is not None
    assert table([Row("a task", 2.0, "a peer", 3.0)]).splitlines()[1].split()[-1] == "1.50"


def test_every_benchmark_with_a_main_runs_it() -> None:
    mains = [text for path in FOLDER.rglob("*.py") if "\ndef main(" in (text := path.read_text(encoding="utf-8"))]
    assert len(mains) > 10
    assert all('if __name__ == "__main__":' in text for text in mains)


@pytest.mark.slow
def test_the_smallest_rows_are_json() -> None:
    command = [sys.executable, "-m", "benchmarks.all", "--small", "--json", "--repeat", "1"]
    done = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert {"task", "ours", "peer", "theirs"} == set(done["rows"][0])
    assert {row["peer"] for row in done["rows"]} >= {"OR-tools", "ARC-SORT", "Stone Soup", "supervision"}
