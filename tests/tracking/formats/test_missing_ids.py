"""Rows without an id among rows with one: left out and counted; refused where most have none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.point_distances import read_points
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.tracking.formats.mot import read_ground_truth, read_tracks

TAILS = {"gt": "1,1,1", "result": "0.9,-1,-1,-1"}


def rows(kind: str, *ids: int) -> str:
    """A box of each id in frames 2 to 5, far from each other."""
    boxes = [(frame, number, 100 * k + frame) for frame in range(2, 6) for k, number in enumerate(ids)]
    return "".join(f"{frame},{number},{left},20,30,80,{TAILS[kind]}\n" for frame, number, left in boxes)


def write(path: Path, kind: str, *ids: int) -> Path:
    path.write_text(rows(kind, *ids))
    return path


def test_58_13_labels_of_id_minus_1_are_left_out_and_counted(tmp_path: Path) -> None:
    path = write(tmp_path / "gt.txt", "gt", 1, 2, -1)
    (video,) = open_labelled(path)
    with pytest.warns(InputWarning, match=r"4 of 12 labelled boxes are left out: 4 without an id \(the first in"):
        labels = video.people()
    assert sorted({*labels.ids.tolist()}) == [1, 2]
    with pytest.warns(InputWarning, match="4 of 12 labelled boxes are left out: 4 without an id"):
        assert len(read_points(path, labelled=True)) == 8


def test_58_13_several_labels_of_id_minus_1_in_a_frame_are_several_boxes(tmp_path: Path) -> None:
    path = write(tmp_path / "gt.txt", "gt", 1, 2, 3, -1, -1)
    assert np.bincount(read_ground_truth(path).ids + 1).tolist() == [8, 0, 4, 4, 4]
    (video,) = open_labelled(path)
    with pytest.warns(InputWarning, match="8 of 20 labelled boxes are left out: 8 without an id"):
        video.people()
    assert len(video.people(single=True)) == 20


def test_58_13_labels_most_of_which_have_no_id_are_refused(tmp_path: Path) -> None:
    (video,) = open_labelled(write(tmp_path / "gt.txt", "gt", 1, -1, -1))
    with pytest.raises(RequestError, match=r"expected an id of each box .* found none of 8 among 12"):
        video.people()


def test_58_13_tracks_of_id_minus_1_are_left_out_and_counted(tmp_path: Path) -> None:
    with pytest.warns(InputWarning, match=r"res.txt: 4 of 12 rows are left out: 4 without an id \(the first in line 2"):
        tracks = read_tracks(write(tmp_path / "res.txt", "result", 7, -1, 3))
    assert [(track.id, len(track)) for track in tracks] == [(3, 4), (7, 4)]
    with pytest.raises(RequestError, match=r"res.txt:2: expected ids of tracks, got -1; are these detections\?"):
        read_tracks(write(tmp_path / "res.txt", "result", 7, -1, -1))


def test_58_13_the_scores_say_what_they_leave_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth, result = write(tmp_path / "gt.txt", "gt", 1, 2, -1), write(tmp_path / "res.txt", "result", 5, 6)
    assert main(["evaluate", "people", str(truth), str(result)]) == 0
    output = capsys.readouterr()
    assert "4 of 12 labelled boxes are left out: 4 without an id (the first in frame 2)" in output.err
    assert " 1.000  1.000  1.000  1.000 " in output.out


def test_58_40_an_id_0_changes_no_other_id(tmp_path: Path) -> None:
    assert [track.id for track in read_tracks(write(tmp_path / "res.txt", "result", 0, 1, 5))] == [1, 2, 5]
    assert [int(track.boxes[0, 0]) // 100 for track in read_tracks(tmp_path / "res.txt")] == [1, 0, 2]
