"""One reader for all rows of text: separators, marks, headings and whole numbers, the same in every format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.acting_tracks import read_acting_tracks
from tsuiseki.tracking.formats.body_states import read_states
from tsuiseki.tracking.formats.box_labels import read_kitti, read_visdrone
from tsuiseki.tracking.formats.measurement_tables import is_point_file, read_point_tracks, read_scans
from tsuiseki.tracking.formats.mot import read_detections, read_ground_truth, read_tracks
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.formats.okutama import read_okutama
from tsuiseki.tracking.formats.rotated import read_rotated_labels
from tsuiseki.tracking.formats.rows import finite_number, read_named_rows, read_rows
from tsuiseki.tracking.formats.single import read_boxes
from tsuiseki.tracking.formats.world_tables import read_correspondences

LINES = ["1,-1,11,21,30,40,0.5,-1,-1,-1", "2,-1,12.5,21,30,40,0.25,-1,-1,-1"]
TEXT = "\n".join(LINES)
BIG = 2**53 + 1

VARIANTS: dict[str, bytes] = {
    "spaces": TEXT.replace(",", "  ").encode(),
    "tabs": TEXT.replace(",", "\t").encode(),
    "semicolons": TEXT.replace(",", " ; ").encode(),
    "two separators": (LINES[0] + "\n" + LINES[1].replace(",", " ")).encode(),
    "separators at the ends": (LINES[0] + ",\n" + LINES[1] + ", ,\t").encode(),
    "blank lines": ("\n\n" + LINES[0] + "\n  \n" + LINES[1] + "\n,,\n\n").encode(),
    "returns of two programs": (LINES[0] + "\r\r\n" + LINES[1] + "\r\r\n").encode(),
    "returns alone": TEXT.replace("\n", "\r").encode(),
    "comments": ("# tracker: x, y\n% of today\n" + TEXT.replace("\n", "\n# half\n")).encode(),
    "Latin-1": b"# Z\xfcrich\n" + TEXT.encode(),
    "quotes": "\n".join('"' + line.replace(",", '","') + '"' for line in LINES).encode(),
    "UTF-8": b"\xef\xbb\xbf" + TEXT.replace("\n", "\r\n").encode(),
    "UTF-16": TEXT.encode("utf-16"),
    "UTF-16 without a mark": TEXT.encode("utf-16-be"),
    "exponents": TEXT.replace("1,-1,", "1.000e+00,-1.000e+00,").replace("2,-1,", "2.0,-1.0,").encode(),
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_way_to_write_rows_is_read_alike(tmp_path: Path, variant: str) -> None:
    (tmp_path / "det.txt").write_bytes(VARIANTS[variant])
    first, second = read_detections(tmp_path / "det.txt")
    assert (first.boxes.tolist(), first.scores.tolist()) == ([[10, 20, 40, 60]], [0.5])
    assert (second.boxes.tolist(), second.scores.tolist()) == ([[11.5, 20, 41.5, 60]], [0.25])


def test_decimal_commas_and_further_columns_are_read_and_told(tmp_path: Path) -> None:
    (tmp_path / "tracks.txt").write_text("1;7;11;21,5;30;40;0,9;-1;-1;-1;3\n")
    with pytest.warns(InputWarning) as told:
        (track,) = read_tracks(tmp_path / "tracks.txt")
    assert (track.id, track.boxes.tolist(), track.scores.tolist()) == (7, [[10, 20.5, 40, 60.5]], [0.9])
    assert "decimal commas, such as 21,5, are read as 21.5" in str(told[0].message)
    assert "11 columns; those after column 10 are left out" in str(told[1].message)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 -1 11 21 30\n", ":1: expected 6 or more numbers separated by spaces, got 5"),
        ("1;-1;11;21;x;40\n", ":1: expected numbers separated by semicolons, got 'x'"),
        ("# a\n\n1\t-1\t11\t21\t30\t40\n1\t-1\t11\n", ":4: expected 6 or more numbers separated by tabs, got 3"),
        ("id,frame,x,y,w,h\n1,1,11,21,30,40\n", "expected the frame in the first column, got the heading id,frame"),
        ("frame,id,x1,y1,x2,y2\n1,1,11,21,30,40\n", "got corners by the heading frame,id,x1,y1,x2,y2"),
        ("\0\1\2\3", "expected a text file of detections, got something binary"),
    ],
)
def test_what_cannot_be_read_names_line_and_separator(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "det.txt").write_text(text)
    with (
        pytest.raises(RequestError, match=said),
        pytest.warns(InputWarning) if "frame" in text else np.errstate(),
    ):
        read_detections(tmp_path / "det.txt")


def test_a_heading_alone_is_an_empty_result_and_no_ground_truth(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("frame,id,bb_left,bb_top,bb_width,bb_height,conf,x,y,z\n")
    with pytest.warns(InputWarning, match="is a heading"):
        assert read_tracks(tmp_path / "a.txt") == []
    with pytest.warns(InputWarning, match="nothing was detected"):
        assert [len(one) for one in read_detections(tmp_path / "a.txt", 2)] == [0, 0]
    with pytest.warns(InputWarning), pytest.raises(RequestError, match="is empty"):
        read_ground_truth(tmp_path / "a.txt")
    (tmp_path / "a.txt").write_text("Not Found\n")
    with pytest.raises(RequestError, match="expected 6 or more numbers separated by spaces, got 2"):
        read_tracks(tmp_path / "a.txt")


def test_named_columns_are_read_in_every_way(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    for text in (
        "frame,id,x,y\n1,7,2.5,3\n",
        "\ufeffframe;id;x;y\r\r\n\r\r\n1;7;2,5;3\r\r\n",
        "# made today\n# frame,id,x,y\n1,7,2.5,3",
        '"frame"\t"id"\t"x"\t"y"\n1\t7\t"2.5"\t3\n',
        "frame id x y\n1 7 2.5 3\n",
    ):
        path.write_text(text, encoding="utf-8")
        assert is_point_file(path)
        frames, ids, places = read_point_tracks(path)
        assert (frames.tolist(), ids.tolist(), places.tolist()) == ([0], [7], [[2.5, 3.0]])


def test_named_columns_name_what_is_wrong(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("x;y;u;v\n1;2;3;4\n")
    with pytest.raises(RequestError, match="found no z among x,y,u,v, separated by semicolons"):
        read_correspondences(path)
    path.write_text("time,x,y\n0,1,5,2\n")
    with pytest.raises(RequestError, match=":2: expected 3 cells separated by commas, as in the heading, got 4"):
        read_scans(path, ("x", "y"))


def test_a_mark_in_the_settings_of_a_sequence_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / "seqinfo.ini").write_text("\ufeff[Sequence]\r\nname=s\r\nframeRate=29.97\r\nseqLength=10\r\n")
    assert read_sequence(tmp_path).frame_rate == 29.97


KITTI = "{frame} {id} Pedestrian 0 0 -2.5 10 20 30 70 1.7 0.6 0.8 1 1.5 9 -1.6\n"
VISDRONE = "{frame},{id},10,20,30,40,1,1,0,0\n"
OKUTAMA = '{id} 10 20 300 400 {frame} 0 0 0 "Person"\n'
MOT = "{frame},{id},10,20,30,40,1,1,1\n"
ACTING = (
    '{{"version": 1, "actions": ["a"], "tracks": [{{"id": {id}, "frames": [{frame}], "boxes": [[1, 1, 2, 2]], '
    '"scores": [1], "observed": [true]}}]}}\n'
)
ROTATED = '{{"annotations": [{{"image_id": {frame}, "bbox": [9, 9, 4, 4, 0], "person_id": {id}}}]}}\n'
Reader = Callable[[Path], list[Any]]
WITH_IDS: dict[str, tuple[str, Reader]] = {
    "mot": (MOT, lambda path: read_ground_truth(path).ids.tolist()),
    "mot tracks": (MOT, lambda path: [track.id for track in read_tracks(path)]),
    "kitti": (KITTI, lambda path: read_kitti(path).ids.tolist()),
    "visdrone": (VISDRONE, lambda path: read_visdrone(path).ids.tolist()),
    "okutama": (OKUTAMA, lambda path: read_okutama(path, (3840, 2160)).ids.tolist()),
    "points": ("frame,id,x,y\n{frame},{id},1,2\n", lambda path: read_point_tracks(path)[1].tolist()),
    "states": ("frame,id,a\n{frame},{id},1\n", lambda path: [track.id for track in read_states(path)]),
    "acting": (ACTING, lambda path: [person.track.id for person in read_acting_tracks(path)[0]]),
    "rotated": (ROTATED, lambda path: [i for one in read_rotated_labels(path).values() for i in one.ids.tolist()]),
}


@pytest.mark.parametrize("name", WITH_IDS)
def test_ids_are_kept_to_the_last_of_64_bits(tmp_path: Path, name: str) -> None:
    form, read = WITH_IDS[name]
    path = tmp_path / ("labels.json" if name == "rotated" else "labels.txt")
    for identity in (BIG, 2**63 - 1):
        path.write_text(form.format(frame=1, id=identity))
        assert read(path) == [identity]
    path.write_text(form.format(frame=1, id=f"{7.0}"))
    assert read(path) == [7]


@pytest.mark.parametrize("name", WITH_IDS)
@pytest.mark.parametrize("wrong", ["1.4", "a3f-0", "18446744073709551616", "nan"])
def test_ids_that_are_no_whole_numbers_are_refused(tmp_path: Path, name: str, wrong: str) -> None:
    form, read = WITH_IDS[name]
    path = tmp_path / ("labels.json" if name == "rotated" else "labels.txt")
    quoted = f'"{wrong}"' if name in ("acting", "rotated") else wrong
    path.write_text(form.format(frame=1, id=quoted))
    with pytest.raises(RequestError, match=r"labels\.(txt|json)") as caught:
        read(path)
    assert wrong in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", [name for name in WITH_IDS if name not in ("acting", "rotated")])
def test_frames_that_are_no_whole_numbers_are_refused(tmp_path: Path, name: str) -> None:
    form, read = WITH_IDS[name]
    path = tmp_path / "labels.txt"
    path.write_text(form.format(frame=1.5, id=1))
    with pytest.raises(RequestError, match=r"labels\.txt:\d: expected a .*frame"):
        read(path)


def test_boxes_and_times_of_the_shared_cases(data_folder: Path) -> None:
    """What stands in the files of reports is two people in ten frames, or is refused by line."""
    for path in sorted((data_folder / "cases" / "text").rglob("res*.txt")):
        if path.stem in ("res_empty", "res_onlyheader", "res_uuid", "res_1e19", "res_frac", "res_frac2"):
            continue
        tracks = read_tracks(path)
        assert [len(track) for track in tracks] == [10, 10], path
        assert tracks[1].boxes[0].tolist() == [199, 49.5, 239, 129.5], path
    assert {track.id for track in read_tracks(data_folder / "cases/text/06-ids/res_big.txt")} == {2**53, BIG}


def test_rows_of_boxes_keep_hidden_targets(tmp_path: Path) -> None:
    (tmp_path / "gt.txt").write_text("\ufeffx y w h\n1 1 5 5\nNaN NaN NaN NaN\n2\t2\t5\t5\n", encoding="utf-8")
    with pytest.warns(InputWarning, match="heading"):
        boxes = read_boxes(tmp_path / "gt.txt")
    assert np.isnan(boxes).all(axis=1).tolist() == [False, True, False]
    assert read_rows(tmp_path / "gt.txt", "boxes").lines == [1, 2, 3, 4]


@pytest.mark.parametrize("text", ["1e300", "-1e21", "inf", "nan", "", "abc"])
def test_what_nobody_measures_is_refused_by_its_line(text: str) -> None:
    with pytest.raises(RequestError, match=r"a\.csv:7: expected a finite number in column x"):
        finite_number(Path("a.csv"), 7, "x", text)


@pytest.mark.parametrize("name", ["a;b", ";", "bus\tstop"])
def test_a_sign_in_a_name_separates_no_cells_where_the_heading_has_another(tmp_path: Path, name: str) -> None:
    (tmp_path / "tracks.csv").write_text(f"frame,id,class_name\n1,2,{name}\n3,4,{name}\n")
    table = read_named_rows(tmp_path / "tracks.csv", "tracks")
    assert table.separator == "commas"
    assert [row for _, row in table.rows] == [
        {"frame": frame, "id": number, "class_name": name} for frame, number in ("12", "34")
    ]
