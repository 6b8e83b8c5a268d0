"""SLEAP's HDF5 files, which the tests write themselves as SLEAP does."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats import sleap_hdf5
from tsuiseki.tracking.formats.body_points import read_poses_file
from tsuiseki.tracking.formats.sleap_hdf5 import write_sleap_analysis
from tsuiseki.tracking.types.tracks import PointTable

FRAME = [("frame_id", "u8"), ("video", "u4"), ("frame_idx", "u8"), ("instance_id_start", "u8"),
         ("instance_id_end", "u8")]  # fmt: skip
INSTANCE = [("instance_id", "i8"), ("instance_type", "u1"), ("frame_id", "u8"), ("skeleton", "u4"), ("track", "i4"),
            ("from_predicted", "i8"), ("score", "f4"), ("point_id_start", "u8"), ("point_id_end", "u8")]  # fmt: skip
POINT = [("x", "f8"), ("y", "f8"), ("visible", "?"), ("complete", "?")]


def project(path: Path, format_id: float = 1.2) -> Path:
    """Two frames: one animal the network found and a user moved, another that it found; then the first alone."""
    with h5py.File(path, "w") as file:
        names = {"nodes": [{"name": "tail"}, {"name": "head"}], "skeletons": [{"nodes": [{"id": 1}, {"id": 0}]}]}
        group = file.create_group("metadata")
        group.attrs["json"], group.attrs["format_id"] = json.dumps(names), format_id
        file["tracks_json"] = np.array([json.dumps([0, "anna"]), json.dumps([0, "bert"])], dtype="S")
        file["frames"] = np.array([(0, 0, 4, 0, 3), (1, 0, 9, 3, 4), (2, 1, 9, 4, 5)], dtype=FRAME)
        file["instances"] = np.array(
            [
                (0, 1, 0, 0, 0, -1, 0.9, 0, 2),
                (1, 0, 0, 0, 0, 0, 0.0, 0, 2),
                (2, 1, 0, 0, 1, -1, 0.8, 2, 4),
                (3, 1, 1, 0, -1, -1, 0.7, 4, 6),
                (4, 1, 2, 0, 0, -1, 0.7, 6, 8),
            ],
            dtype=INSTANCE,
        )
        file["points"] = np.array([(10, 11, True, True), (12, 13, True, True)], dtype=POINT)
        rows = [(90 + n, 91 + n, n != 3, False, 0.5 + 0.05 * n) for n in range(8)]
        file["pred_points"] = np.array(rows, dtype=[*POINT, ("score", "f8")])
    return path


def test_a_project_gives_its_first_video_and_users_points_before_predictions(tmp_path: Path) -> None:
    table = read_poses_file(project(tmp_path / "a.slp"))
    assert table.nodes == ("head", "tail")
    assert table.frames.tolist() == [4, 4, 9]
    assert table.tracks == ("anna", "bert", "")
    np.testing.assert_array_equal(table.points[0], [[10, 11], [12, 13]])
    np.testing.assert_array_equal(table.points[1], [[92, 93], [np.nan, np.nan]])
    assert np.isnan(table.scores[0]).all()
    assert table.scores[1, 0] == pytest.approx(0.6)


def test_old_projects_count_from_the_pixels_corner(tmp_path: Path) -> None:
    table = read_poses_file(project(tmp_path / "a.slp", format_id=1.0))
    np.testing.assert_array_equal(table.points[0], [[9.5, 10.5], [11.5, 12.5]])


def test_an_analysis_file_comes_back(tmp_path: Path) -> None:
    points = np.random.default_rng(0).uniform(0, 100, (3, 2, 2))
    points[1, 1] = np.nan
    scores = np.where(np.isfinite(points[:, :, 0]), 0.5, np.nan)
    table = PointTable(("head", "tail"), np.array([2, 2, 5]), ("anna", "bert", "anna"), points, scores)
    write_sleap_analysis(tmp_path / "a.h5", table, 8)
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["tracks"].shape == (2, 2, 2, 8)
        assert file["track_occupancy"].shape == (8, 2)
    back = read_poses_file(tmp_path / "a.h5")
    assert (back.nodes, back.tracks, back.frames.tolist()) == (table.nodes, table.tracks, [2, 2, 5])
    np.testing.assert_array_equal(back.points, points)
    np.testing.assert_array_equal(back.scores, scores)


@pytest.mark.parametrize("axes", list(itertools.permutations(("frame", "node", "xy", "track")))[::5])
def test_an_analysis_file_says_what_its_axes_are(tmp_path: Path, axes: tuple[str, ...]) -> None:
    points = np.random.default_rng(0).uniform(0, 100, (6, 3, 2, 2))
    scores, order = points[:, :, 0] / 100, ("frame", "node", "xy", "track")
    of_scores, rest = [axis for axis in axes if axis != "xy"], ("frame", "node", "track")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["tracks"] = points.transpose([order.index(axis) for axis in axes])
        file["tracks"].attrs["dims"] = json.dumps(axes)
        file["point_scores"] = scores.transpose([rest.index(axis) for axis in of_scores])
        file["point_scores"].attrs["dims"] = json.dumps(of_scores)
        file["node_names"], file["track_names"] = [b"nose", b"mid", b"tail"], [b"anna", b"bert"]
    back = read_poses_file(tmp_path / "a.h5")
    assert back.frames.tolist() == np.repeat(range(6), 2).tolist()
    assert back.tracks == ("anna", "bert") * 6
    np.testing.assert_array_equal(back.points, points.transpose(0, 3, 1, 2).reshape(12, 3, 2))
    np.testing.assert_array_equal(back.scores, scores.transpose(0, 2, 1).reshape(12, 3))


def test_an_analysis_file_whose_axes_are_others_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["tracks"] = np.ones((60, 2, 3, 2))
        file["node_names"], file["track_names"] = [b"nose", b"mid", b"tail"], [b"anna", b"bert"]
    with pytest.raises(RequestError, match=r"shape \(60, 2, 3, 2\) with axes track, xy, node, frame"):
        read_poses_file(tmp_path / "a.h5")


def test_both_orders_of_sleap_io_hold_the_same(data_folder: Path) -> None:
    one, other = (read_poses_file(data_folder / "cases" / "animals" / f"an_{n}.h5") for n in ("default", "standard"))
    assert (one.nodes, one.tracks, one.frames.tolist()) == (other.nodes, other.tracks, other.frames.tolist())
    np.testing.assert_array_equal(one.points, other.points)
    np.testing.assert_array_equal(one.scores, other.scores)


def test_deeplabcut_and_broken_files_get_one_line(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "dlc.h5", "w") as file:
        file.create_group("df_with_missing")
    with pytest.raises(RequestError, match="give the CSV beside it"):
        read_poses_file(tmp_path / "dlc.h5")
    (tmp_path / "cut.slp").write_bytes(project(tmp_path / "a.slp").read_bytes()[:900])
    with pytest.raises(RequestError, match="broken"):
        read_poses_file(tmp_path / "cut.slp")


def test_without_h5py_it_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sleap_hdf5, "hdf5_installed", lambda: False)
    with pytest.raises(RequestError, match="needs h5py: pip install h5py"):
        read_poses_file(project(tmp_path / "a.slp"))
