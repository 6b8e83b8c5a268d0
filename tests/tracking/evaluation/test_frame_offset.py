"""A result whose frames count otherwise than the labels': the note that finds it, and what it proposes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tsuiseki
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.frame_offset import frame_offset, moved
from tsuiseki.tracking.formats.mot import read_ground_truth, write_ground_truth, write_tracks
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.types.labels import GroundTruth

LENGTH, PART = 90, 60


def walkers() -> list[Track]:
    """Three people through `LENGTH` frames."""
    frames = np.arange(LENGTH)
    tracks = []
    for number, speed in ((1, 3.0), (2, -4.0), (3, 5.0)):
        left = 500 * number + speed * frames
        boxes = np.column_stack([left, np.full(LENGTH, 50.0), left + 30, np.full(LENGTH, 130.0)])
        tracks.append(Track(number, frames, boxes, np.ones(LENGTH)))
    return tracks


def labels() -> GroundTruth:
    rows = [(frame, track.id, track.boxes[frame]) for frame in range(LENGTH) for track in walkers()]
    frames, ids, boxes = (np.array(column) for column in zip(*rows, strict=True))
    return GroundTruth.of_boxes(frames, ids, boxes)


def part(first: int, last: int) -> list[Track]:
    """The people of frames ``first`` to ``last - 1``, counted anew."""
    return [Track(t.id, t.frames[: last - first], t.boxes[first:last], t.scores[first:last]) for t in walkers()]


@pytest.mark.parametrize("first", [1, 13, 40])
def test_58_37_the_offset_of_a_part_is_found(first: int) -> None:
    fit = frame_offset(labels(), part(first, first + 50))
    # One frame is little: boxes are on the labels next to theirs, too.
    assert (fit and (fit.frames, fit.share)) == (None if first == 1 else (first, 1.0))


def test_58_37_the_offset_of_a_whole_against_labels_of_a_part_is_found() -> None:
    fit = frame_offset(replace(labels(), frames=labels().frames - 40).between(0, 49), walkers())
    assert fit is not None
    assert (fit.frames, fit.share) == (-40, 1.0)


def test_58_37_a_right_and_a_foreign_result_have_no_offset() -> None:
    assert frame_offset(labels(), walkers()) is None
    elsewhere = [replace(track, boxes=track.boxes + np.array([0, 300, 0, 300])) for track in walkers()]
    assert frame_offset(labels(), elsewhere) is None
    assert frame_offset(labels(), []) is None


@pytest.fixture
def files(tmp_path: Path) -> tuple[str, str]:
    """Labels of all frames, and tracks from frame `PART` on, counted anew."""
    write_ground_truth(tmp_path / "gt.txt", labels())
    write_tracks(tmp_path / "part.txt", part(PART, LENGTH))
    return str(tmp_path / "gt.txt"), str(tmp_path / "part.txt")


def test_58_37_a_part_that_counts_anew_is_scored_as_the_note_proposes(
    files: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evaluate", "people", *files]) == 0
    note = "part.txt: 100% of its boxes are on labels 60 frames later, 0% as they are counted; if it is a part that"
    assert f"{note} counts anew, give --offset 60" in " ".join(capsys.readouterr().err.split())
    options = ["--offset", "60", "--frames", "61-90", "--json", str(tmp_path / "s.json")]
    assert main(["evaluate", "people", *files, *options]) == 0
    scores = json.loads((tmp_path / "s.json").read_text())["part"]["combined"]
    assert (scores["hota"], scores["labelled"], scores["false_positives"]) == (1, 90, 0)
    assert "offset" not in capsys.readouterr().err


def test_58_37_a_whole_result_is_scored_on_labels_of_a_part(files: tuple[str, str], tmp_path: Path) -> None:
    truth = read_ground_truth(files[0])
    renumbered = replace(truth, frames=truth.frames - 40).between(0, 29)
    with pytest.warns(InputWarning, match="180 of 270 boxes lie outside frames 1-30 with `offset` -40, and are left"):
        tracks = moved("whole", walkers(), -40, FrameRange(0, 29))
    assert tsuiseki.evaluate_people(renumbered, tracks).hota == 1
    write_tracks(tmp_path / "whole.txt", walkers())
    assert tsuiseki.evaluate_people(renumbered, tmp_path / "whole.txt", "1-30", offset=-40).hota == 1
    assert tsuiseki.evaluate_people(renumbered, walkers(), "1-30", offset=-40).hota == 1


def test_58_37_an_offset_that_leaves_nothing_is_refused(files: tuple[str, str]) -> None:
    with pytest.raises(RequestError, match="expected boxes in frames 1- with `offset` -500, got none"):
        tsuiseki.evaluate_people(*files, offset=-500)
