"""The association's experiment on small generated sequences, with a stand-in for the peers' package."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.papers import association
from benchmarks.papers.__main__ import main
from benchmarks.papers.association import (
    DATA_SETS,
    combined_scores,
    find_sequences,
    linked,
    score_table,
    sequence_detections,
    sequence_labels,
    track_sums,
    write_streets,
)
from benchmarks.papers.peer_programs import LINKERS
from benchmarks.papers.peers import find_peer
from tsuiseki.datamodules.scenes.people.walkers import Motion
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info

LENGTH, RATE = 24, 20.0


def write_crowd(folder: Path, seed: int, people: int = 4) -> None:
    """A MOT17 sequence of people in lanes of their own, each missed now and then, a distractor and false boxes."""
    rng = np.random.default_rng(seed)
    labels, found = [], []
    for frame in range(1, LENGTH + 1):
        for person in range(people):
            x, y = 100 + 4 * frame + 10 * person, 1 + 150 * person
            labels.append(f"{frame},{person + 1},{x},{y},40,100,1,1,1")
            if rng.random() > 0.1:
                box = np.array([x, y, 40, 100]) + rng.normal(0, 1, 4)
                found.append([frame, *box, rng.uniform(0.9, 1)])
        labels.append(f"{frame},99,900,750,40,100,0,8,1")
        found.append([frame, 900, 750, 40, 100, 0.9])
        if rng.random() < 0.2:
            found.append([frame, rng.uniform(0, 800), rng.uniform(0, 600), 40, 100, 0.3])
    found.append([LENGTH, 10, 10, 0, 30, 0.9])  # no width: as in one of the real files
    rows = [f"{f:.0f},-1,{x:.2f},{y:.2f},{w:.2f},{h:.2f},{s:.4f},-1,-1,-1" for f, x, y, w, h, s in found]
    for name, lines in (("gt", labels), ("det", rows)):
        (folder / name).mkdir(parents=True)
        (folder / name / f"{name}.txt").write_text("\n".join(lines) + "\n")
    write_sequence_info(folder, folder.name, RATE, LENGTH, 1000, 900)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("data")
    for seed, name in enumerate(("ONE", "TWO")):
        write_crowd(home / "mot" / "mot17-val-half" / name, seed)
    return home


def words(data: Path, tmp_path: Path, *more: str) -> list[str]:
    folders = ["--data", str(data), "--cache", str(tmp_path / "cache"), "--out", str(tmp_path / "out")]
    return ["association", *folders, *more]


@pytest.mark.slow
def test_every_row_is_measured_and_kept(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words(data, tmp_path, "--sets", "mot17", "tud")) == 0
    printed = capsys.readouterr().out
    assert "TUD: no mot in the data, passed over" in printed
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "results.json",
        "tables.md",
        "tables.json",
    }
    values = json.loads((tmp_path / "out/results.json").read_text())["sets"]["mot17"]
    assert {"sort", "bytetrack", "ocsort", "flow", "flow, nothing filled in"} <= set(values)
    for row in values.values():
        assert set(row["sequences"]) == {"ONE", "TWO"}
        # Lanes are far apart: only what is missed is lost, and the distractor counts for nothing.
        assert row["idf1"] > 0.85
        assert row["labelled"] == 2 * 4 * LENGTH
        assert row["false_positives"] < 0.05 * row["labelled"]
    assert values["flow"]["mota"] > values["flow, nothing filled in"]["mota"]
    kept = sorted((path, path.stat().st_mtime_ns) for path in (tmp_path / "cache").rglob("*.npz"))
    tables = (tmp_path / "out/tables.md").read_text()
    assert main(words(data, tmp_path, "--sets", "mot17", "tud", "--overwrite")) == 0
    assert sorted((path, path.stat().st_mtime_ns) for path in (tmp_path / "cache").rglob("*.npz")) == kept
    assert (tmp_path / "out/tables.md").read_text() == tables


def short_clip(home: Path, clips: int, frames: int, motion: Motion) -> None:
    """A clip of eight frames instead of many."""
    assert min(clips, frames) > 1
    write_streets(home, 1, 8, motion)


@pytest.mark.slow
def test_generated_motion_is_measured_without_real_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(association, "write_streets", short_clip)
    assert main(words(tmp_path, tmp_path, "--sets", "dance", "sport", "--parts", "methods")) == 0
    values = json.loads((tmp_path / "out/results.json").read_text())["sets"]
    assert set(values) == {"dance", "sport"}
    assert values["dance"]["flow"]["labelled"] != values["sport"]["flow"]["labelled"]


STAND_IN = '''
class Tracker:
    """Every detection of a sure score bears the number of its lane."""
    def __init__(self, frame_rate):
        assert frame_rate == 20.0
    def update(self, found):
        found.tracker_id = [int(round(box[1] / 150)) if s > 0.5 else -1 for box, s in zip(found.xyxy, found.confidence)]
        return found
ByteTrackTracker = CBIoUTracker = SORTTracker = OCSORTTracker = Tracker
'''
SUPERVISION = """
class Detections:
    def __init__(self, xyxy, confidence, class_id):
        self.xyxy, self.confidence, self.class_id = xyxy, confidence, class_id
"""


ARCSORT = """
class ARCTracker:
    @classmethod
    def from_preset(cls, name, use_cmc):
        assert not use_cmc
        return cls()
    def update(self, found):
        return [[*box[:4], round(box[1] / 150) + 1] for box in found if box[4] > 0.5 and box[5] == 0]
"""


@pytest.fixture(scope="module")
def stand_in(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A python whose packages trackers, supervision and arcsort are those above."""
    home = tmp_path_factory.mktemp("peer")
    (home / "trackers.py").write_text(STAND_IN)
    (home / "supervision.py").write_text(SUPERVISION)
    (home / "arcsort.py").write_text(ARCSORT)
    for name in ("trackers", "arcsort"):
        (home / f"{name}-0.1.dist-info").mkdir()
        card = f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.1\n"
        (home / f"{name}-0.1.dist-info" / "METADATA").write_text(card)
    python = home / "python"
    python.write_text(f'#!/bin/sh\nPYTHONPATH={home} exec {sys.executable} "$@"\n')
    python.chmod(0o755)
    return str(python)


@pytest.mark.slow
def test_peers_are_run_where_they_are_installed(data: Path, tmp_path: Path, stand_in: str) -> None:
    assert main(words(data, tmp_path, "--sets", "mot17", "--parts", "methods", "--peer", stand_in)) == 0
    values = json.loads((tmp_path / "out/results.json").read_text())
    assert values["peer"] == "trackers 0.1, arcsort 0.1"
    for name in LINKERS:
        assert values["sets"]["mot17"][f"{name} (peer)"]["id_switches"] == 0
        assert values["sets"]["mot17"][f"{name} (peer)"]["idf1"] > 0.9


def test_a_python_without_the_peers_is_named(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="`peer`: expected the python of an environment with the packages trackers"):
        find_peer(str(tmp_path / "no-python"), "links")


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (["--sets", "mot99"], '"mot99" for --sets. Choose from: "mot17"'),
        (["--parts", "speed"], '"speed" for --parts. Choose from: "methods"'),
        (["--sets", "tud"], "`data`: expected mot/mot17-val-half or another"),
    ],
)
def test_wrong_requests(
    data: Path, tmp_path: Path, more: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words(data, tmp_path, *more)) == 2
    assert line in capsys.readouterr().err


def test_frames_are_left_out_evenly(data: Path) -> None:
    (given, _) = find_sequences(data, DATA_SETS[0])
    slow = given.at(5)
    assert (slow.stride, slow.rate, len(slow.kept)) == (4, 5.0, 6)
    assert (given.at(100).stride, given.at(12).stride) == (1, 2)
    whole, some = sequence_detections(given), sequence_detections(slow)
    assert [len(found) for found in some] == [len(found) for found in whole[::4]]
    every, few = sequence_labels(given), sequence_labels(slow)
    assert few.frames.max() == 5
    np.testing.assert_array_equal(few.boxes[few.frames == 3], every.boxes[every.frames == 12])


def test_boxes_without_an_area_are_left_out(data: Path) -> None:
    (given, _) = find_sequences(data, DATA_SETS[0])
    boxes = np.concatenate([found.boxes for found in sequence_detections(given)])
    assert len(boxes)
    assert (boxes[:, 2] > boxes[:, 0]).all()


@pytest.mark.slow
@pytest.mark.integration
def test_sort_on_mot17_scores_as_known(data_folder: Path) -> None:
    """HOTA .510, MOTA .645, IDF1 .616 and 207 switches, as measured apart from this experiment."""
    sequences = find_sequences(data_folder, DATA_SETS[0])
    found = combined_scores(np.stack([track_sums(given, linked("sort", given)) for given in sequences]))
    assert found["hota"] == pytest.approx(0.510, abs=5e-4)
    assert found["mota"] == pytest.approx(0.645, abs=5e-4)
    assert found["idf1"] == pytest.approx(0.616, abs=5e-4)
    assert found["id_switches"] == 207


def test_a_gain_of_nothing_is_nothing() -> None:
    sums = np.random.default_rng(0).uniform(1, 9, (3, 83))
    table = score_table("set", {"a": sums, "b": sums}, "a")
    assert table.rows[1][9:13] == ["+0.000 [+0.000, +0.000]"] * 3 + ["+0% [+0%, +0%]"]
