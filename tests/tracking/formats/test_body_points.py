"""Points of animals in the files of SLEAP, DeepLabCut and ours."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.body_points import read_poses_file, write_deeplabcut, write_sleap
from tsuiseki.tracking.formats.sleap_hdf5 import write_sleap_project
from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.types.tracks import PointTable


@pytest.fixture
def table():
    points = np.arange(12, dtype=float).reshape(3, 2, 2) + 0.25
    points[1, 1] = np.nan
    scores = np.array([[0.9, 0.8], [0.7, np.nan], [1.0, 0.5]])
    return PointTable(("head", "tail"), np.array([0, 0, 2]), ("a", "b", "a"), points, scores)


@pytest.mark.parametrize("write", [write_sleap, lambda path, table: write_deeplabcut(path, table, 4)])
def test_what_is_written_is_read(table, tmp_path, write):
    write(tmp_path / "points.csv", table)
    read = read_poses_file(tmp_path / "points.csv")
    assert (read.nodes, read.tracks, read.frames.tolist()) == (table.nodes, table.tracks, [0, 0, 2])
    np.testing.assert_allclose(read.points, table.points)
    np.testing.assert_allclose(read.scores, table.scores)


def test_deeplabcut_predictions_of_one_animal_and_labels(tmp_path):
    head = "scorer,net,net,net,net,net,net\nbodyparts,nose,nose,nose,tail,tail,tail\n"
    head += "coords,x,y,likelihood,x,y,likelihood\n"
    (tmp_path / "one.csv").write_text(head + "0,1,2,.9,3,4,.8\n1,,,,5,6,.7\n")
    one = read_poses_file(tmp_path / "one.csv")
    assert (one.nodes, one.frames.tolist(), one.tracks) == (("nose", "tail"), [0, 1], ("", ""))
    assert np.isnan(one.points[1, 0]).all()
    labels = "scorer,,,me,me\nindividuals,,,m1,m1\nbodyparts,,,nose,nose\ncoords,,,x,y\n"
    (tmp_path / "labels.csv").write_text(labels + "labeled-data,film2,img0017.png,3.5,4.5\n")
    own = read_poses_file(tmp_path / "labels.csv")
    assert (own.frames.tolist(), own.tracks, own.points.tolist()) == ([17], ("m1",), [[[3.5, 4.5]]])
    assert np.isnan(own.scores).all()


def test_parts_that_deeplabcut_calls_single_are_landmarks(tmp_path):
    who, part = "individuals,m1,m1,single,single", "bodyparts,nose,nose,corner,corner"
    (tmp_path / "u.csv").write_text(f"scorer,n,n,n,n\n{who}\n{part}\ncoords,x,y,x,y\n0,1,2,5,5\n1,2,3,5,5\n")
    with pytest.warns(InputWarning, match=r"u\.csv: corner are landmarks, no animal; left out"):
        read = read_poses_file(tmp_path / "u.csv")
    assert (read.nodes, read.tracks, read.points.tolist()) == (("nose",), ("m1", "m1"), [[[1, 2]], [[2, 3]]])
    (tmp_path / "one.csv").write_text("scorer,n,n\nindividuals,single,single\nbodyparts,nose,nose\ncoords,x,y\n0,1,2\n")
    assert read_poses_file(tmp_path / "one.csv").tracks == ("single",)


def test_ours_counts_frames_from_one(tmp_path):
    (tmp_path / "states.csv").write_text("frame,id,x,y,head_x,head_y,tail_x,tail_y\n1,4,0,0,1,2,,\n")
    read = read_poses_file(tmp_path / "states.csv")
    assert (read.nodes, read.frames.tolist(), read.tracks) == (("head", "tail"), [0], ("4",))


NODES = ("head", "thorax", "tail")


def by_frame(names, tracked):
    """A line a frame, two animals of three points; the second is missing in frame 5."""
    heads = [f"{name}.{node}.{part}" for name in names for node in NODES for part in ("x", "y", "score")]
    cells = [[*(f"{10 * k + n},{n},.5" for n in range(3))] for k in range(2)]
    missing = [",,"] * 3
    heading = ["frame_idx", *heads, *([f"{name}.track" for name in names] if tracked else [])]
    ends = [["b", "a"], ["b", ""]] if tracked else [[], []]
    rows = [["0", *cells[0], *cells[1], *ends[0]], ["5", *cells[0], *missing, *ends[1]]]
    return "\n".join(",".join(row) for row in [heading, *rows]) + "\n"


@pytest.mark.parametrize(
    ("names", "tracked", "tracks"),
    [
        (("inst0", "inst1"), True, ("b", "a", "b")),
        (("mouse1", "mouse2"), False, ("mouse1", "mouse2", "mouse1")),
        (("inst0", "inst1"), False, ("", "", "")),
    ],
)
def test_58_16_a_line_a_frame_is_of_all_its_animals(tmp_path, names, tracked, tracks):
    (tmp_path / "frames.csv").write_text(by_frame(names, tracked))
    read = read_poses_file(tmp_path / "frames.csv")
    assert (read.nodes, read.frames.tolist(), read.tracks) == (NODES, [0, 0, 5], tracks)
    assert read.points[:, :, 0].tolist() == [[0, 1, 2], [10, 11, 12], [0, 1, 2]]
    assert (read.scores == 0.5).all()


def test_58_16_nodes_may_have_points_in_their_names(tmp_path):
    for heading in ("left.ear.x,left.ear.y,right.ear.x,right.ear.y", "ear.left.x,ear.left.y,nose.x,nose.y"):
        (tmp_path / "a.csv").write_text(f"frame_idx,{heading}\n3,1,2,3,4\n")
        read = read_poses_file(tmp_path / "a.csv")
        assert (len(read.nodes), read.frames.tolist(), read.points.tolist()) == (2, [3], [[[1, 2], [3, 4]]])


@pytest.mark.parametrize("skeletons", ["kept", "none"])
def test_58_16_a_project_without_instances_says_so(table, tmp_path, skeletons):
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    write_sleap_project(tmp_path / "labels.slp", TrackedVideo([], points=table))
    with h5py.File(tmp_path / "labels.slp", "r+") as file:
        for name in ("instances", "pred_points", *(["frames"] if skeletons == "none" else [])):
            kind = file[name].dtype
            del file[name]
            file.create_dataset(name, shape=(0,), dtype=kind)
        if skeletons == "none":
            about = json.loads(file["metadata"].attrs["json"])
            file["metadata"].attrs["json"] = np.bytes_(json.dumps(about | {"skeletons": [], "nodes": []}))
    with pytest.raises(RequestError, match=r"labels\.slp: expected at least one animal .* got none"):
        read_poses_file(tmp_path / "labels.slp")


def test_58_16_frames_of_further_videos_are_counted(table, tmp_path):
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    write_sleap_project(tmp_path / "labels.slp", TrackedVideo([], points=table))
    with h5py.File(tmp_path / "labels.slp", "r+") as file:
        frames = file["frames"][()]
        frames["video"] = [1, 4]
        file["frames"][...] = frames
    with pytest.warns(InputWarning, match="1 of 2 frames are of further videos, and are left out"):
        assert read_poses_file(tmp_path / "labels.slp").frames.tolist() == [0, 0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a,b\n", "SLEAP's analysis CSV"),
        ("", "SLEAP's analysis CSV"),
        ("track,frame_idx,head.x,head.y\na,0,one,2\n", ":2: expected a number or nothing, got 'one'"),
        ("track,frame_idx,head.x,head.y\na,zero,1,2\n", ":2: .* from 0 to 10000000 in column frame_idx, got 'zero'"),
        ("track,frame_idx,head.x,head.y\na,0,,\n", "at least one point"),
        ("track,frame_idx\na,0\n", "expected columns such as head.x and head.y"),
        ("scorer,me\n0,1\n", "lines scorer, bodyparts and coords"),
    ],
)
def test_broken_files_are_refused(tmp_path, text, expected):
    (tmp_path / "points.csv").write_text(text)
    with pytest.raises(RequestError, match=expected):
        read_poses_file(tmp_path / "points.csv")


def test_a_broken_hdf5_file_is_refused(tmp_path):
    (tmp_path / "labels.slp").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(8))
    with pytest.raises(RequestError, match="one that is broken"):
        read_poses_file(tmp_path / "labels.slp")
    with pytest.raises(RequestError, match="found no file"):
        read_poses_file(tmp_path / "none.csv")
