"""Whether frames count from 0 or 1: one convention a format, or the name of the column; never what a file holds."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest

from tsuiseki.tracking.cameras.multicamera import read_floor_folder, read_placed_truth, read_standing
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.on_floor import evaluate_on_floor
from tsuiseki.tracking.floor.run import track_floor
from tsuiseki.tracking.formats.measurement_tables import is_point_file, read_point_tracks, read_points, read_scans
from tsuiseki.tracking.formats.track_tables import read_table
from tsuiseki.tracking.formats.world_tables import read_ball_points
from tsuiseki.tracking.result import Result

READERS: dict[str, tuple[str, str, Callable[[Path], Any]]] = {
    "boxes": ("x1,y1,x2,y2", "1,2,30,40", lambda path: [k for k, seen in enumerate(read_standing(path)) if len(seen)]),
    "points": ("x,y", "1,2", lambda path: [k for k, seen in enumerate(read_points(path)) if len(seen)]),
    "tracks": ("id,x,y", "7,1,2", lambda path: read_point_tracks(path)[0].tolist()),
    "ball": ("x,y", "1,2", lambda path: np.flatnonzero(np.isfinite(read_ball_points(path)[:, 0])).tolist()),
}


def write(path: Path, column: str, kind: str, *numbers: int) -> Path:
    heading, cells, _ = READERS[kind]
    path.write_text(f"{column},{heading}\n" + "".join(f"{number},{cells}\n" for number in numbers))
    return path


@pytest.mark.parametrize("kind", READERS)
def test_58_40_frames_count_from_1_whether_or_not_something_is_in_the_first(kind: str, tmp_path: Path) -> None:
    read = READERS[kind][2]
    assert read(write(tmp_path / "a.csv", "frame", kind, 1, 3)) == [0, 2]
    assert read(write(tmp_path / "b.csv", "frame", kind, 2, 3)) == [1, 2]


@pytest.mark.parametrize("kind", READERS)
def test_58_40_a_column_frame_idx_counts_from_0_whether_or_not_something_is_there(kind: str, tmp_path: Path) -> None:
    read = READERS[kind][2]
    path = write(tmp_path / "a.csv", "frame_idx", kind, 0, 2)
    assert is_point_file(path)
    assert read(path) == [0, 2]
    assert read(write(tmp_path / "b.csv", "frame_idx", kind, 1, 2)) == [1, 2]


@pytest.mark.parametrize("kind", READERS)
def test_58_40_frame_0_in_a_file_that_counts_from_1_is_refused_with_what_to_do(kind: str, tmp_path: Path) -> None:
    with pytest.raises(RequestError, match=r"a\.csv:2: expected .* from 1 to .* got '0'; name the column frame_idx"):
        READERS[kind][2](write(tmp_path / "a.csv", "frame", kind, 0, 2))


def test_58_40_scans_count_from_1_whether_or_not_something_was_measured_in_the_first(tmp_path: Path) -> None:
    for column, numbers in (("frame", (3, 5)), ("frame_idx", (2, 4))):
        path = tmp_path / f"{column}.csv"
        path.write_text(f"{column},x,y\n" + "".join(f"{number},1,2\n" for number in numbers))
        scans = read_scans(path, ("x", "y"), period=0.5)
        assert [len(scan.measurements) for scan in scans] == [0, 0, 1, 0, 1]
        assert [scan.time for scan in scans] == [0.5, 1.0, 1.5, 2.0, 2.5]
    (tmp_path / "zero.csv").write_text("frame,x,y\n0,1,2\n1,2,3\n")
    with pytest.raises(RequestError, match=r"zero\.csv:2: .* got '0'; name the column frame_idx"):
        read_scans(tmp_path / "zero.csv", ("x", "y"))


def test_58_40_two_columns_of_frames_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("frame,frame_idx,x,y\n1,0,2,3\n")
    with pytest.raises(RequestError, match=r"expected a column frame \(from 1\) or frame_idx \(from 0\), got both"):
        read_points(tmp_path / "a.csv")


def test_58_40_a_table_of_tracks_with_a_frame_0_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("frame,id,x1,y1,x2,y2\n0,1,2,3,40,50\n")
    with pytest.raises(RequestError, match=r"a\.csv: expected frames counted from 1, got frame 0"):
        read_table(tmp_path / "a.csv")
    with pytest.raises(RequestError, match="expected frames counted from 1"):
        Result.load(tmp_path / "a.csv")


def test_58_40_a_world_csv_of_shelf_with_a_frame_0_is_refused(tmp_path: Path) -> None:
    (tmp_path / "truth.csv").write_text("frame,person,x,y\n0,1,2,3\n")
    with pytest.raises(RequestError, match=r"expected a whole number from 1 to .* in column frame, got '0'"):
        read_placed_truth(tmp_path / "truth.csv")


@pytest.fixture
def part_of_wildtrack(data_folder: Path, tmp_path: Path) -> Path:
    """WILDTRACK's moments 320 to 329, with their own numbers."""
    folder = Path(copytree(data_folder / "multicamera/wildtrack", tmp_path / "part"))
    for path in (*folder.glob("view*.csv"), folder / "floor.csv"):
        heading, *rows = path.read_text().splitlines()
        inside = [row for row in rows if 1600 <= int(row.split(",")[0]) < 1650]
        path.write_text("\n".join([heading, *inside]) + "\n")
    return folder


@pytest.mark.slow
@pytest.mark.integration
def test_58_40_a_part_of_wildtrack_without_frame_0_is_not_shifted(part_of_wildtrack: Path) -> None:
    recording = read_floor_folder(part_of_wildtrack)
    assert np.unique(recording.truth.times).tolist() == [160 + k / 2 for k in range(10)]
    for people in recording.people:
        assert [k for k, standing in enumerate(people) if len(standing)][:: len(people)] == [320]
    track_floor([part_of_wildtrack]).save(part_of_wildtrack / "out")
    scores = evaluate_on_floor(recording.truth, read_placed_truth(part_of_wildtrack / "out" / "world.csv"))
    assert min(scores.idf1, scores.moda) > 0.95


@pytest.mark.integration
def test_58_40_other_numbers_than_those_of_wildtracks_frames_are_refused(part_of_wildtrack: Path) -> None:
    path = part_of_wildtrack / "view1_CVLab1.csv"
    path.write_text(path.read_text().replace("\n1605,", "\n1606,", 1))
    with pytest.raises(RequestError, match=r"view1_CVLab1\.csv:\d+: expected frames 0, 5, 10, …, got 1606"):
        read_floor_folder(part_of_wildtrack)


@pytest.mark.parametrize(
    ("columns", "reason"),
    [
        ({"x1": [1]}, "x1 of another length"),
        ({"frame": [1, 1.5]}, "frame of something else than whole numbers"),
        ({"frame": ["a", "b"]}, "frame of something else than numbers"),
        ({"y2": [[1], [2]]}, "y2 of another length"),
    ],
)
def test_58_15_a_table_whose_columns_are_others_is_refused(
    columns: dict[str, Any], reason: str, tmp_path: Path
) -> None:
    table = {"frame": [1, 2], "id": [1, 1], **{name: [1, 1] for name in ("x1", "y1")}, "x2": [5, 5], "y2": [5, 5]}
    (tmp_path / "t.json").write_text(json.dumps({"tsuiseki": {}, "columns": table | columns}))
    with pytest.raises(RequestError, match=reason):
        read_table(tmp_path / "t.json")
