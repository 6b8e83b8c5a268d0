"""Boxes of a file beside their picture: shares, corners and other pictures' boxes are said, good boxes are not."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.result_files import match_results, read_truths
from tsuiseki.tracking.formats.label_checks import Sieve, UnusableError, compare_with_picture
from tsuiseki.tracking.formats.mot import read_detections, read_ground_truth, read_tracks
from tsuiseki.tracking.formats.single import read_boxes
from tsuiseki.tracking.people.given_detections import given_detections
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.video.source import open_source

SIZE = (640, 480)


def boxes_in(width: float, height: float, count: int = 60) -> FloatArray:
    """``(count, 4)`` people all over a picture, some of them cut by its borders."""
    rng = np.random.default_rng(0)
    centres = rng.uniform([0, 0], [width, height], (count, 2))
    half = rng.uniform(0.02, 0.1, (count, 1)) * height * [0.4, 1.0]
    return np.concatenate([centres - half, centres + half], axis=1)


def as_widths(corners: FloatArray) -> FloatArray:
    """The corners that a reader of x, y, width, height makes of a file of corners."""
    corners = np.clip(corners, 0, [*SIZE, *SIZE])
    return np.concatenate([corners[:, :2], corners[:, :2] + corners[:, 2:]], axis=1)


def test_boxes_of_the_picture_pass_silently() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compare_with_picture("det.txt", boxes_in(*SIZE), SIZE)
        compare_with_picture("det.txt", boxes_in(*SIZE))
        compare_with_picture("det.txt", np.empty((0, 4)), SIZE)
        # One person before the camera, cut below; a target out of view.
        compare_with_picture("det.txt", np.tile([20.0, 40, 400, 500], (30, 1)), SIZE)
        compare_with_picture("gt.txt", np.array([[9.0, 9, 20, 20], [np.nan] * 4]), SIZE)


@pytest.mark.parametrize(
    ("boxes", "said"),
    [
        (boxes_in(1, 1).clip(0, 1) - 1.0, "look like shares of the picture from 0 to 1; multiply"),
        (as_widths(boxes_in(*SIZE)), "leave the picture of 640x480, but fit as corners x1, y1, x2, y2"),
        (boxes_in(*SIZE) + 2000, "expected boxes in the picture of 640x480, got all 60 outside of it"),
    ],
)
def test_boxes_that_are_no_pixels_of_the_picture_are_refused(boxes: FloatArray, said: str) -> None:
    with pytest.raises(RequestError, match=said):
        compare_with_picture("det.txt", boxes, SIZE)


def test_boxes_of_a_larger_picture_are_told() -> None:
    with pytest.warns(InputWarning, match=r"\d+ of 60 boxes lie outside the picture of 640x480; they reach 1\d{3},"):
        compare_with_picture("det.txt", boxes_in(1920, 1080), SIZE)


ROWS = {
    "gt.txt": "{},{},{},{},{},{},1,1,1\n",
    "tracks.txt": "{},{},{},{},{},{},1,-1,-1,-1\n",
    "boxes.txt": "{2} {3} {4} {5}\n",
}


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("gt.txt", read_ground_truth),
        ("tracks.txt", read_tracks),
        ("tracks.txt", read_detections),
        ("boxes.txt", read_boxes),
    ],
)
def test_shares_are_refused_where_no_size_is_known(tmp_path: Path, name: str, read: object) -> None:
    (tmp_path / name).write_text("".join(ROWS[name].format(t, 1, 0.1, 0.2, 0.3, 0.4) for t in range(1, 4)))
    with pytest.raises(RequestError, match="look like shares"):
        read(tmp_path / name)  # type: ignore[operator]


def rows_of(boxes: FloatArray, name: str) -> str:
    return "".join(
        ROWS[name].format(k // 20 + 1, k % 20 + 1, *row) for k, row in enumerate(np.round(boxes, 2).tolist())
    )


def test_the_picture_of_a_video_and_of_labels_is_compared(tmp_path: Path) -> None:
    sequence = tmp_path / "S"
    (sequence / "gt").mkdir(parents=True)
    (sequence / "seqinfo.ini").write_text("[Sequence]\nimWidth=640\nimHeight=480\nseqLength=3\n")
    corners = boxes_in(*SIZE).clip(1, [*SIZE, *SIZE])
    sizes = np.concatenate([corners[:, :2], corners[:, 2:] - corners[:, :2]], axis=1)
    (sequence / "gt/gt.txt").write_text(rows_of(sizes, "gt.txt"))
    (tmp_path / "tracks.txt").write_text(rows_of(corners, "tracks.txt"))
    with pytest.raises(RequestError, match=r"tracks\.txt: .* fit as corners"):
        match_results(read_truths(sequence), tmp_path / "tracks.txt")
    with pytest.raises(RequestError, match=r"tracks\.txt: .* fit as corners"):
        given_detections(tmp_path / "tracks.txt", open_source(str(sequence)))
    (sequence / "gt/gt.txt").write_text(rows_of(corners, "gt.txt"))
    with pytest.raises(RequestError, match=r"S: .* fit as corners"):
        read_truths(sequence)


def test_what_cannot_be_used_is_left_out_counted_and_named() -> None:
    sieve = Sieve("a.json")

    def label_of(name: str, entry: int) -> int:
        if entry % 3 == 0:
            raise UnusableError("divisible by 3")
        if entry == 1:
            sieve.mend(name, "taken as 1.5")
        return entry

    assert list(sieve.read([(f"entry {n}", n) for n in range(8)], label_of)) == [1, 2, 4, 5, 7]
    usable = sieve.usable(["line 9", "line 10"], (np.array([False, True]), "without an area"))
    assert usable.tolist() == [True, False]
    with pytest.warns(InputWarning) as said:
        sieve.tell()
    assert [str(line.message) for line in said] == [
        "a.json: 4 of 10 labelled boxes are left out: "
        "3 divisible by 3 (the first entry 0), 1 without an area (line 10)",
        "a.json: 1 of 10 labelled boxes are not used as they stand: 1 taken as 1.5 (entry 1)",
    ]


def test_a_file_of_which_most_cannot_be_used_is_refused() -> None:
    sieve = Sieve("a.txt", "rows")
    for number in range(6):
        sieve.usable([f"line {number}"], (np.ones(1, np.bool_), f"of kind {number}"))
    message = r"a.txt: expected rows that can be used, but 6 of 6 cannot: 1 of kind 0 \(line 0\), .*kind 3.*, …; mend"
    with pytest.raises(RequestError, match=message):
        sieve.tell()


def test_half_of_a_file_may_be_unusable_and_nothing_is_said_of_a_good_one() -> None:
    sieve = Sieve("a.txt", "rows")
    sieve.usable(["line 1", "line 2"], (np.array([True, False]), "of no use"))
    with pytest.warns(InputWarning, match="1 of 2 rows are left out"):
        sieve.tell()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Sieve("b.txt").tell()
