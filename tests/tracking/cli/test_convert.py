"""`tsuiseki convert`: a result of a run into files of other programs, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import tsuiseki
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats import sleap_hdf5
from tsuiseki.tracking.formats.body_points import read_poses_file
from tsuiseki.tracking.formats.exports import FORMATS
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.formats.track_tables import read_table
from tsuiseki.tracking.result import Result, convert
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.tracks import BodyTrack, FloorTrack, PointTable

BOXES = np.array([[10.0, 20, 30, 60], [12, 20, 32, 60], [14, 20, 34, 60]])


@pytest.fixture
def result() -> Result[Track]:
    one = Track(7, np.array([0, 1, 4]), BOXES, np.full(3, 0.5), np.array([True, False, True]))
    return Result([one], source="street.mp4", frame_rate=25.0, size=(640, 480), frames={"frame": list(range(10))})


@pytest.mark.parametrize("name", FORMATS)
def test_a_folder_becomes_a_file_of_each_format(name: str, result: Result[Track], tmp_path: Path) -> None:
    if name == "parquet":
        pytest.importorskip("pyarrow", reason="pyarrow is not installed (the extra tables)")
    folder, out = result.save(tmp_path / "run"), tmp_path / f"out{FORMATS[name].suffix}"
    assert main(["convert", str(folder), "--to", name, "--out", str(out)]) == 0
    assert out.is_file() if FORMATS[name].suffix else any(out.iterdir())
    if FORMATS[name].read or name in ("csv", "json", "parquet", "mot"):
        back = Result.load(out)
        np.testing.assert_array_equal(back.by_id[7].frames, [0, 1, 4])
        np.testing.assert_allclose(back.by_id[7].boxes, BOXES, atol=0.001)
    # KITTI's text tells neither the size of the pictures nor how many there are.
    if FORMATS[name].read and name != "kitti":
        assert (back.size, len(back.frames["frame"])) == ((640, 480), 10)
    assert main(["convert", str(folder), "--to", name, "--out", str(out)]) == 2, "there is one already"
    assert main(["convert", str(folder), "--to", name, "--out", str(out), "--overwrite"]) == 0


def test_the_video_tells_the_size_that_a_text_does_not(result: Result[Track], tmp_path: Path) -> None:
    text, images = tmp_path / "tracks.txt", tmp_path / "street"
    write_tracks(text, result.tracks)
    with pytest.raises(RequestError, match="expected the size of the frames, which this result does not tell; give"):
        convert(text, "cvat", tmp_path / "a.xml")
    images.mkdir()
    for frame in range(6):
        cv2.imwrite(str(images / f"f{frame:03d}.png"), np.zeros((120, 160, 3), np.uint8))
    coco = json.loads(convert(text, "coco", tmp_path / "a.json", video=images).read_text())
    assert [image["file_name"] for image in coco["images"]] == [f"f{frame:03d}.png" for frame in range(6)]
    assert coco["videos"][0]["width"] == 160
    with pytest.raises(RequestError, match="expected frames of 640x480 pixels as in the result, got 160x120"):
        convert(result, "coco", tmp_path / "b.json", video=images)


def test_animals_go_with_their_points_or_ends(tmp_path: Path) -> None:
    states = np.array([[50.5, 40.5, np.pi / 2, 10.0, 4.0]])
    body = BodyTrack(3, np.array([2]), states, np.array([0.9]), ("tracking",))
    animals = Result([body], names=("a", "b", "theta", "length", "width"))
    table = points_in(convert(animals, "sleap", tmp_path / "a.slp"))
    assert (table.nodes, table.frames.tolist(), table.tracks) == (("head", "centre", "tail"), [2], ("track_3",))
    np.testing.assert_allclose(table.points[0], [[50, 45], [50, 40], [50, 35]], atol=1e-9)
    points = PointTable(("nose",), np.array([2]), ("anna",), np.array([[[8.0, 9.0]]]), np.array([[0.7]]))
    named = Result([body], names=animals.names, points=points)
    assert points_in(convert(named, "sleap", tmp_path / "b.slp")).tracks == ("anna",)
    about = json.loads((convert(animals, "geff", tmp_path / "g") / ".zattrs").read_text())["geff"]
    assert {"t", "y", "x", "track_id", "theta", "score"} <= about["node_props_metadata"].keys()
    with pytest.raises(RequestError, match=r"coco holds boxes, and these tracks have none; save as \.csv"):
        convert(Result([body], size=(640, 480)), "coco", tmp_path / "a.json")


def test_a_table_has_time_class_box_score_and_place(tmp_path: Path) -> None:
    kind = {"origin": np.tile([-1, 2], (3, 1)), "names": {2: "car"}}
    track = Track(7, np.array([0, 1, 4]), BOXES, np.full(3, 0.5), **kind)
    floor = Result([FloorTrack(track, np.ones((3, 5)), np.array([[1.0, 2], [1, 3], [1, 4]]))], frame_rate=25.0)
    names, *rows = [line.split(",") for line in convert(floor, "csv", tmp_path / "a.csv").read_text().splitlines()]
    last = dict(zip(names, rows[-1], strict=True))
    assert (last["frame"], last["id"], last["class_name"], last["x1"], last["score"]) == ("5", "7", "car", "14", "0.5")
    assert (float(last["time"]), last["x"], last["y"]) == (0.16, "1", "4")
    (back,) = Result.load(tmp_path / "a.csv")
    assert (back.track.class_name, back.places.tolist()) == ("car", [[1, 2], [1, 3], [1, 4]])


@pytest.mark.parametrize(("file", "name"), [("t.csv", "csv"), ("t.xml", "cvat"), ("t.txt", "mot"), ("t.JSON", "json")])
def test_the_ending_names_the_format(result: Result[Track], file: str, name: str, tmp_path: Path) -> None:
    folder = str(result.save(tmp_path / "run"))
    assert main(["convert", folder, str(tmp_path / file)]) == 0
    assert main(["convert", folder, "--to", name, "--out", str(tmp_path / f"o{file}")]) == 0
    one, other = ((tmp_path / begin).read_text() for begin in (file, f"o{file}"))
    assert one == other


@pytest.mark.parametrize("name", ["sleap", "sleap-analysis"])
def test_what_needs_a_package_says_so(
    name: str, result: Result[Track], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sleap_hdf5, "hdf5_installed", lambda: False)
    with pytest.raises(RequestError, match="which needs h5py: pip install h5py"):
        convert(result, name, tmp_path / f"a{FORMATS[name].suffix}")


def points_in(path: Path) -> PointTable:
    return read_poses_file(path)


def test_what_cannot_be_written_is_said_in_a_line(
    result: Result[Track], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(result.save(tmp_path / "run"))
    for words, message in (
        (["--to", "voc", "--out", str(tmp_path / "a.xml")], f"expected one of {', '.join(FORMATS)}, got voc"),
        (["--to", "cvat", "--out", str(tmp_path / "a.json")], "expected the name of a .xml for cvat, got"),
        ([str(tmp_path / "a.voc")], "expected --to, or the name of a file ending in .csv, .json"),
        (["--to", "yolo", "--out", str(tmp_path / "run/run.json")], "expected the name of a folder for yolo, got"),
        (["--to", "cvat", "--out", str(tmp_path / "run/run.json/a.xml")], "cannot write to"),
    ):
        assert main(["convert", folder, *words]) == 2
        line = capsys.readouterr().err.strip()
        assert message in line
        assert "\n" not in line
    nobody = Track(4, np.empty(0, np.int64), np.empty((0, 4)), np.empty(0))
    with pytest.raises(RequestError, match="expected a frame of each track, got none of id 4; leave it out"):
        tsuiseki.convert(Result([*result, nobody], size=(640, 480)), "coco", tmp_path / "c.json")


def test_animals_have_seconds_and_come_back(tmp_path: Path) -> None:
    track = BodyTrack(1, np.arange(2, 5), np.arange(18.0).reshape(3, 6), np.ones(3), ("tracking",) * 3)
    names = ("a", "b", "theta", "length", "width", "bend")
    file = tmp_path / "animals.csv"
    convert(Result([track], frame_rate=10.0, names=names), "csv", file)
    assert read_table(file)[0]["time"].tolist() == pytest.approx([0.2, 0.3, 0.4])
    back = Result.load(file)
    assert back.names == names
    assert back.tracks[0].states.tolist() == track.states.tolist()
