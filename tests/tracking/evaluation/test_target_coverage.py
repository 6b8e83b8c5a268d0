"""Tracks of many against the one person who is labelled."""

import json

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.evaluation.coverage import TargetCoverage, target_coverage
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.formats.single import write_boxes
from tsuiseki.tracking.types import Track

TARGET = np.array([[10.0, 20, 30, 60]]) + np.arange(10)[:, None]


def track(number, frames, shift=0.0):
    frames = np.array(frames)
    return Track(number, frames, TARGET[frames] + shift, np.ones(len(frames)))


def test_frames_tracks_and_switches_are_counted():
    tracks = [track(4, [1, 2, 3]), track(7, [5, 6]), track(4 + 5, range(10), shift=100)]
    assert target_coverage(TARGET, tracks) == TargetCoverage(
        labelled=10, covered=5, tracks=2, switches=1, longest=3, first=1, others=1
    )


def test_the_same_track_after_a_gap_is_no_switch():
    found = target_coverage(TARGET, [track(3, [0, 1, 8, 9])])
    assert (found.switches, found.longest, found.covered) == (0, 2, 4)


def test_frames_without_label_do_not_count():
    boxes = TARGET.copy()
    boxes[:4] = np.nan
    found = target_coverage(boxes, [track(1, range(10))])
    assert (found.labelled, found.covered, found.first) == (6, 6, 4)


def test_a_lower_overlap_counts_looser_boxes():
    loose = [track(1, range(10), shift=6)]  # overlap of 14 x 34 in 2 x 800 - 476, .42
    assert target_coverage(TARGET, loose).covered == 0
    assert target_coverage(TARGET, loose, 0.4).covered == 10


def test_nothing_labelled_or_nobody_tracked():
    assert target_coverage(np.full((5, 4), np.nan), []).first is None
    assert target_coverage(TARGET, []) == TargetCoverage(10, 0, 0, 0, 0, None, 0)


@pytest.fixture
def files(tmp_path):
    (tmp_path / "truth").mkdir()
    write_boxes(tmp_path / "truth" / "walk.txt", TARGET)
    (tmp_path / "result").mkdir()
    write_tracks(tmp_path / "result" / "walk.txt", [track(2, range(5)), track(3, range(5, 10))])
    return tmp_path


def test_the_command_prints_a_row_and_writes_it(files, capsys):
    command = ["evaluate", "single", "--of-many", str(files / "truth"), str(files / "result")]
    assert main([*command, "--json", str(files / "found.json")]) == 0
    row = next(line for line in capsys.readouterr().out.splitlines() if "walk" in line)
    assert row.split() == ["walk", "result", "10", "100.0", "2", "1", "5", "1", "0"]
    assert '"switches": 1' in (files / "found.json").read_text()


def test_a_missing_result_is_refused(files, capsys):
    assert main(["evaluate", "single", "--of-many", str(files / "truth"), str(files)]) == 2
    assert "the result of walk" in capsys.readouterr().err


def test_a_result_of_a_stretch_is_said_and_can_be_scored_alone(files, capsys):
    (files / "part").mkdir()
    write_tracks(files / "part" / "tracks.txt", [track(2, range(3, 7))])
    run = {"files": ["tracks.txt"], "frames": {"frame": [4, 5, 6, 7]}, "partial": False}
    (files / "part" / "run.json").write_text(json.dumps(run))
    command = ["evaluate", "single", "--of-many", str(files / "truth" / "walk.txt"), str(files / "part")]

    def row(*more):
        assert main([*command, *more]) == 0
        printed = capsys.readouterr()
        return next(line for line in printed.out.splitlines() if "walk" in line).split()[2:4], printed.err

    numbers, said = row()
    assert numbers == ["10", "40.0"]
    assert "is of frames 4-7 alone, but 1-10 are scored; for its own use --frames 4-7" in said
    assert row("--frames", "4-7") == (["4", "100.0"], "")
    assert row("--frames", "4-5")[0] == ["2", "100.0"]
    assert main([*command, "--frames", "4-70"]) == 2
    assert "expected frames within 1-10, got --frames 4-70" in capsys.readouterr().err


def test_tracks_outside_the_stretch_are_not_counted(files, capsys):
    command = ["evaluate", "single", "--of-many", str(files / "truth"), str(files / "result"), "--frames", "1-5"]
    assert main(command) == 0
    row = next(line for line in capsys.readouterr().out.splitlines() if "walk" in line)
    assert row.split() == ["walk", "result", "5", "100.0", "1", "0", "5", "1", "0"]
