"""The simulated annotator: what it is asked on a street, and what its answers do."""

import shutil

import pytest

from benchmarks.papers import association
from benchmarks.papers.__main__ import main
from benchmarks.papers.association import STREETS, find_sequences, write_streets
from benchmarks.papers.corrections import reviewed

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def streets(tmp_path_factory):
    """A folder with one short street."""
    home = tmp_path_factory.mktemp("data") / "streets"
    write_streets(home, 1, 60)
    return home


@pytest.fixture(scope="module")
def course(streets):
    return reviewed(find_sequences(streets.parent, STREETS)[0], 6)


def test_answers_bring_the_tracks_nearer_to_what_the_detections_allow(course):
    idf1 = course["idf1"]
    assert course["errors"] > 0
    assert 2 <= len(idf1) == len(course["hota"]) <= 7
    assert 0 < idf1[0] <= max(idf1) <= course["allowed"] + 0.1


def short_street(home, *_):
    """A street of two frames instead of many."""
    write_streets(home, 1, 2)


def test_the_experiment_runs_to_its_table(streets, tmp_path, monkeypatch):
    monkeypatch.setattr(association, "write_streets", short_street)
    shutil.copytree(streets / "street-00", tmp_path / "mot/TUD-Campus")
    words = ["corrections", "--data", str(tmp_path), "--answers", "2", "--streets", "0"]
    out = tmp_path / "out"
    assert main([*words, "--out", str(out), "--cache", str(tmp_path / "cache")]) == 0
    rows = [line for line in (out / "tables.md").read_text().splitlines() if line.startswith("|")]
    assert len(rows) == 3
    assert "clicks by hand" in rows[0]
