"""Fisheye cameras from the command line: a small room there and back, and mistakes in one line."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import numpy as np
import pytest
import yaml

import tsuiseki
from tests.tracking.features.tiny_onnx import save_constant
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.fisheye.view import CeilingSource
from tsuiseki.tracking.report import overlay
from tsuiseki.tracking.video import live as video

LENS = "2 -100 0\n2 150 60\n120 160\n1 0 0\n240 320\n"
ROOM = ["--room", "small", "--people", "3", "--frames", "4", "--frame-rate", "2", "--width", "320", "--height", "240"]


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("room") / "clip"
    assert main(["simulate", "fisheye", "--out", str(folder), *ROOM]) == 0
    for camera in ("camera1", "camera2"):
        rows = [line.split(",") for line in (folder / camera / "gt" / "gt.txt").read_text().splitlines()]
        text = "".join(f"{r[0]},-1,{','.join(r[2:6])},0.9,-1,-1,-1\n" for r in sorted(rows, key=lambda r: int(r[0])))
        (folder / f"{camera}.txt").write_text(text)
    return folder


def track(room, out, *more, sources=("camera1", "camera2")):
    words = ["track", "fisheye", *(str(room / s) for s in sources), "--out", str(out), "--tables", str(out) + "-tables"]
    return main([*words, *more])


def given(room):
    return ["--detections", f"{room / 'camera1.txt'},{room / 'camera2.txt'}", "--cameras", str(room / "cameras.yaml")]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["hungarian", "flow"])
def test_given_boxes_become_places(room, tmp_path, method, capsys):
    out = tmp_path / "out"
    assert track(room, out, *given(room), "--appearance", "none", "--method", method) == 0
    assert "camera1" in capsys.readouterr().out
    assert {p.name for p in out.iterdir()} == {"camera1", "camera2", "report.html", "run.json"}
    rows = np.genfromtxt(out / "camera1" / "world.csv", delimiter=",", names=True)
    truth = np.genfromtxt(room / "camera1" / "gt" / "world.csv", delimiter=",", names=True)
    assert len(rows) == len(truth)
    away = [np.hypot(truth["x"] - x, truth["y"] - y).min() for x, y in zip(rows["x"], rows["y"], strict=True)]
    # The model is 1.7 m high and stands still; people differ, and lift their arms.
    assert np.median(away) < 0.5
    assert main(["evaluate", "people", str(room / "camera1"), str(out / "camera1")]) == 0


@pytest.mark.slow
def test_the_call_gives_and_saves_what_the_command_writes(room, tmp_path):
    out, tables = tmp_path / "out", tmp_path / "out-tables"
    assert track(room, out, *given(room), "--appearance", "none") == 0
    options = tsuiseki.CeilingOptions(tables=tables)
    files = {"cameras": room / "cameras.yaml", "detections": room / "camera2.txt"}
    found = tsuiseki.track_fisheye(room / "camera2", **files, camera="camera2", appearance="none", options=options)
    assert [person.id for person in found] == list(found.by_id)
    saved = found.save(tmp_path / "saved")
    for name in ("tracks.txt", "world.csv", "floor.png", "dwell.png"):
        assert (saved / name).read_bytes() == (out / "camera2" / name).read_bytes(), name
    assert "camera2" in (saved / "report.html").read_text()
    with pytest.raises(tsuiseki.RequestError, match=r"expected one of camera1, camera2 in .*, got c"):
        tsuiseki.track_fisheye(room / "camera2", **files, camera="c")


@pytest.mark.slow
def test_the_pictures_are_looked_at_with_the_shipped_appearance(room, tmp_path):
    out = tmp_path / "out"
    assert track(room, out, *given(room), "--overlay") == 0
    assert (out / "camera2" / "overlay.webm").stat().st_size > 1000
    assert json.loads((out / "run.json").read_text())["seconds"]["describe"] > 0


@pytest.mark.slow
def test_detectors_look_at_unrolled_views_and_at_images(room, tmp_path):
    for view in ("unrolled", "image"):
        out = tmp_path / view
        more = [
            "--view",
            view,
            "--appearance",
            "none",
            "--cameras",
            str(room / "cameras.yaml"),
        ]
        assert track(room, out, *more) == 0
        assert json.loads((out / "run.json").read_text())["seconds"]["detect"] > 0


def rotated(room, tmp_path, change=lambda rows: rows):
    """The boxes of the first camera as a network of rotated boxes writes them: each as a diamond."""
    rows = [
        {"image_id": f"{int(r[0]):06d}", "bbox": [x + w / 2, y + h / 2, w, h, 45.0], "score": 0.9}
        for r in (line.split(",") for line in (room / "camera1.txt").read_text().splitlines())
        for x, y, w, h in [map(float, r[2:6])]
    ]
    path = tmp_path / "rotated.json"
    path.write_text(json.dumps(change(rows)))
    content = yaml.safe_load((room / "cameras.yaml").read_text())
    (tmp_path / "one.yaml").write_text(yaml.safe_dump({"cameras": content["cameras"][:1]}))
    return ["--detections", str(path), "--cameras", str(tmp_path / "one.yaml"), "--appearance", "none"]


@pytest.mark.slow
def test_rotated_boxes_of_a_network_are_tracked(room, tmp_path):
    out = tmp_path / "out"
    assert track(room, out, *rotated(room, tmp_path), sources=("camera1",)) == 0
    rows = np.genfromtxt(out / "world.csv", delimiter=",", names=True)
    assert len(rows) == len((room / "camera1.txt").read_text().splitlines())
    # The model turns a box by half a turn where the feet are at its other end.
    assert set(rows["degrees"].tolist()) <= {45.0, -135.0}


@pytest.mark.slow
def test_a_network_of_turned_boxes_keeps_their_angles(room, tmp_path):
    rows = np.zeros((300, 7), np.float32)
    rows[0] = [150, 60, 40, 16, 0.9, 0, np.radians(20)]  # it lies: the longer side is the height of a person
    metadata = {"task": "obb", "names": "{0: 'person'}"}
    path = save_constant(tmp_path / "o.onnx", {"output0": rows}, shape=("n", 3, 240, 320), metadata=metadata)
    more = ["--view", "image", "--detector", str(path), "--save-detections", *rotated(room, tmp_path)[2:]]
    assert track(room, tmp_path / "out", *more, sources=("camera1",)) == 0
    found = json.loads((tmp_path / "out" / "detections.json").read_text())
    assert len(found) == 4
    np.testing.assert_allclose(found[0]["bbox"], [150, 60, 16, 40, -70], atol=1e-3)


@pytest.mark.slow
def test_scores_too_low_to_start_a_track_are_told(room, tmp_path, capsys):
    weak = rotated(room, tmp_path, lambda rows: [{**row, "score": 0.42} for row in rows])
    number = len((room / "camera1.txt").read_text().splitlines())
    told = f"none of {number} detections scores 0.5, from which a track starts: the best has 0.42"
    out = tmp_path / "out"
    assert track(room, out, *weak, "--method", "hungarian", sources=("camera1",)) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "0 people" in printed
    assert told in printed
    for name, more in (
        ("lower", ["--method", "hungarian", "--hungarian.start-score", "0.4"]),
        ("flow", ["--method", "flow"]),
    ):
        assert track(room, tmp_path / name, *weak, *more, sources=("camera1",)) == 0
        assert "none of" not in capsys.readouterr().out
    assert len((tmp_path / "lower" / "tracks.txt").read_text().splitlines()) == number


@pytest.mark.slow
def test_detections_are_written_as_they_are_read(room, tmp_path, capsys):
    given = rotated(room, tmp_path)
    rows = json.loads((tmp_path / "rotated.json").read_text())
    labels = [{"image_id": row["image_id"], "bbox": row["bbox"], "person_id": k} for k, row in enumerate(rows)]
    (tmp_path / "labels.json").write_text(json.dumps({"annotations": labels}))
    out = tmp_path / "out"
    assert track(room, out, *given, "--save-detections", sources=("camera1",)) == 0
    written = json.loads((out / "detections.json").read_text())
    assert len(written) == len(rows)
    # The model may turn a box by half a turn, which is the same box.
    for one in written:
        same = [row for row in rows if row["image_id"] == one["image_id"]]
        assert min(np.abs(np.array(one["bbox"]) - row["bbox"]).max() for row in same) < 0.01
    capsys.readouterr()
    assert main(["evaluate", "detection", str(tmp_path / "labels.json"), str(out / "detections.json")]) == 0
    assert "1.000" in capsys.readouterr().out
    more = ["--detections", str(out / "detections.json"), *given[2:]]
    assert track(room, tmp_path / "again", *more, sources=("camera1",)) == 0
    assert (tmp_path / "again/world.csv").read_text() == (out / "world.csv").read_text()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda rows: [rows[0] | {"image_id": "other"}],
            "expected boxes of the 4 images of camera1, got some of other",
        ),
        (lambda rows: [rows[0] | {"score": 7}], "expected scores from 0 to 1, got 7"),
        (lambda rows: [rows[0] | {"bbox": [1, 2, 3]}], "1 without cx, cy, w, h and degrees"),
        (lambda rows: [rows[0] | {"bbox": [900, 9, 9, 9, 0]}], "frame 1: expected boxes in images of 320x240, got one"),
        (lambda rows: {"a": rows}, "expected a JSON list of detections"),
    ],
)
def test_rotated_boxes_that_do_not_fit_are_named(room, tmp_path, capsys, change, message):
    assert track(room, tmp_path / "out", *rotated(room, tmp_path, change), sources=("camera1",)) == 2
    one_line(capsys, message)


def one_line(capsys, text):
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1, lines
    assert text in lines[0]


def test_sources_and_cameras_of_different_number(room, tmp_path, capsys):
    more = ["--detections", str(room / "camera1.txt"), "--cameras", str(room / "cameras.yaml")]
    assert track(room, tmp_path / "out", *more, sources=("camera1",)) == 2
    one_line(capsys, "got 1 sources and 2 cameras")


def changed(room, tmp_path, change):
    content = yaml.safe_load((room / "cameras.yaml").read_text())
    change(content["cameras"][0])
    path = tmp_path / "cameras.yaml"
    path.write_text(yaml.safe_dump(content))
    return [*given(room)[:2], "--cameras", str(path)]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.update(image_size=[640, 480]), "expected images of 640x480 as calibrated, got 320x240"),
        (lambda c: c["position"].__setitem__(2, 1.5), "above the person of 1.7 m"),
        (lambda c: c["position"].__setitem__(2, 0.0), "above the person of 1.7 m"),
        (lambda c: c.update(floor=[0, 0, 3, 3]), "one floor for all cameras"),
        (lambda c: c.update(direct=[-1.0, 0.0]), "direct polynomial"),
        (lambda c: c.update(floor=[90, 90, 91, 91]), "one floor for all cameras"),
        (lambda c: c.pop("floor"), "of camera2 and none of camera1; give all of them the whole room's"),
    ],
)
def test_cameras_that_do_not_fit_are_named(room, tmp_path, capsys, change, message):
    assert track(room, tmp_path / "out", *changed(room, tmp_path, change)) == 2
    one_line(capsys, message)


def only_text(room, tmp_path, size):
    """The first camera's sequence without images, its images said to be of a size, and its calibration."""
    folder = tmp_path / "text"
    folder.mkdir()
    width, height = size
    lines = ["[Sequence]", "name=text", "frameRate=2", "seqLength=4", f"imWidth={width}", f"imHeight={height}"]
    (folder / "seqinfo.ini").write_text("\n".join(lines))
    content = yaml.safe_load((room / "cameras.yaml").read_text())
    (tmp_path / "one.yaml").write_text(yaml.safe_dump({"cameras": content["cameras"][:1]}))
    return [
        "track", "fisheye", str(folder), "--detections", str(room / "camera1.txt"), "--appearance", "none",
        "--cameras", str(tmp_path / "one.yaml"), "--tables", str(tmp_path / "tables"), "--out", str(tmp_path / "out"),
    ]  # fmt: skip


def test_text_of_another_size_than_calibrated(room, tmp_path, capsys):
    assert main(only_text(room, tmp_path, (640, 480))) == 2
    one_line(capsys, "expected images of 320x240 as calibrated, got 640x480 in text")


@pytest.mark.slow
def test_videos_are_linked_by_the_flow_unless_asked_otherwise(room, tmp_path):
    words = only_text(room, tmp_path, (320, 240))
    for method in ([], ["--method", "hungarian"]):
        assert main([*words, *method, "--overwrite"]) == 0
        assert f'"method": "{method[-1] if method else "flow"}"' in (tmp_path / "out/run.json").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("size", [(320, 240), (0, 0)])
def test_text_of_the_calibrations_or_no_size_is_taken(room, tmp_path, size):
    assert main(only_text(room, tmp_path, size)) == 0


class FakeCamera:
    """Stands for `cv2.VideoCapture` of a webcam that shows four empty pictures of a size, then ends."""

    size = (320, 240)

    def __init__(self, _):
        self.next = 0

    def isOpened(self):  # noqa: N802
        return True

    def get(self, _):
        return 15.0

    def grab(self):
        self.next += 1
        return self.next <= 4

    def retrieve(self):
        return True, np.zeros((*self.size[::-1], 3), dtype=np.uint8)

    def release(self):
        pass


@pytest.mark.slow
@pytest.mark.parametrize(("size", "resize", "status"), [
    ((320, 240), "no", 0), ((640, 480), "no", 2), ((640, 480), "cut", 0),
])  # fmt: skip
def test_a_webcam_is_asked_for_its_size(room, tmp_path, monkeypatch, capsys, size, resize, status):
    monkeypatch.setattr(video.cv2, "VideoCapture", FakeCamera)
    monkeypatch.setattr(FakeCamera, "size", size)
    content = yaml.safe_load((room / "cameras.yaml").read_text())
    (tmp_path / "one.yaml").write_text(yaml.safe_dump({"cameras": content["cameras"][:1]}))
    more = ["--appearance", "none", "--tables", str(tmp_path / "tables"), "--resize", resize]
    words = ["track", "fisheye", "0", "--cameras", str(tmp_path / "one.yaml"), "--out", str(tmp_path / "out"), *more]
    assert main(words) == status
    if status:
        one_line(capsys, "expected images of 320x240 as calibrated, got 640x480 in webcam 0")
    else:
        assert json.loads((tmp_path / "out" / "run.json").read_text())["facts"]["camera1"]["frames"] == 4


def test_two_webcams_are_two_runs(room, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(video.cv2, "VideoCapture", FakeCamera)
    words = ["track", "fisheye", "0", "1", "--cameras", str(room / "cameras.yaml"), "--out", str(tmp_path / "out")]
    assert main(words) == 2
    one_line(capsys, "webcam 0 is live and never ends; track each live source in a run of its own")


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--stand", "2,0"], "expected a foot position on the floor [-1.5, -1.5, 1.5, 1.5], got [2.0, 0.0]"),
        (["--stand", "1,1", "--floor=-9,-9,9,9", "--height", "1.75"], "partly beyond it"),
        (["--stand", "1,1", "--height", "1.6"], "expected a camera above the person of 1.7 m"),
    ],
)
def test_nobody_stands_where_the_camera_cannot_see(tmp_path, capsys, more, message):
    lens = tmp_path / "calib_results.txt"
    lens.write_text(LENS)
    given = [] if any(word.startswith("--floor") for word in more) else ["--floor=-1.5,-1.5,1.5,1.5"]
    height = [] if "--height" in more else ["--height", "2.5"]
    words = ["calibrate", "pose", str(lens), *given, *height, *more, "--out", str(tmp_path / "a.yaml")]
    assert main(words) == 2
    one_line(capsys, message)
    assert not (tmp_path / "a.yaml").exists()


def test_where_somebody_stands_is_told(tmp_path, capsys):
    lens = tmp_path / "calib_results.txt"
    lens.write_text(LENS)
    words = ["calibrate", "pose", str(lens), "--height", "2.5", "--stand", "1,0", "--out", str(tmp_path / "a.yaml")]
    assert main(words) == 0
    line = capsys.readouterr().out.splitlines()[0]
    assert line.startswith("1.7 m tall at 1,0: upright ")
    # At +x the head points to the right: a quarter of a turn clockwise.
    assert float(line.split("rotated ")[1].split(" ")[0].split(",")[4]) == pytest.approx(90, abs=0.2)


def with_box(room, tmp_path, box, change=lambda _: None):
    """The first camera with its given boxes and one more in the first frame, centre x, y and size."""
    content = yaml.safe_load((room / "cameras.yaml").read_text())
    change(content["cameras"][0])
    (tmp_path / "one.yaml").write_text(yaml.safe_dump({"cameras": content["cameras"][:1]}))
    x, y, w, h = box
    text = f"1,-1,{x - w / 2},{y - h / 2},{w},{h},0.9,-1,-1,-1\n" + (room / "camera1.txt").read_text()
    (tmp_path / "more.txt").write_text(text)
    more = ["--cameras", str(tmp_path / "one.yaml"), "--appearance", "none"]
    return ["--detections", str(tmp_path / "more.txt"), *more]


def test_a_box_beyond_the_rim_is_nobodys(room, tmp_path, capsys):
    assert track(room, tmp_path / "out", *with_box(room, tmp_path, (6, 6, 8, 8)), sources=("camera1",)) == 2
    one_line(capsys, "frame 1: expected boxes of people on the floor, got one about")


@pytest.mark.slow
def test_people_outside_the_floor_are_left_out_and_counted(room, tmp_path, capsys):
    def one_metre(camera):
        camera.update(floor=[*(v - 0.5 for v in camera["position"][:2]), *(v + 0.5 for v in camera["position"][:2])])

    # At half the image's height from its middle somebody stands metres away.
    words = with_box(room, tmp_path, (160, 16, 10, 20), one_metre)
    assert track(room, tmp_path / "out", *words, sources=("camera1",)) == 0
    left_out = json.loads((tmp_path / "out" / "run.json").read_text())["facts"]["camera1"]["outside_floor"]
    assert left_out >= 1
    assert f"{left_out} detection" in capsys.readouterr().out


@pytest.mark.slow
def test_a_calibration_is_scaled_on_request(room, tmp_path):
    def twice(camera):
        camera.update(image_size=[640, 480], centre=[2 * v for v in camera["centre"]])
        camera["direct"] = [a * 2 ** (1 - k) for k, a in enumerate(camera["direct"])]

    more = [*changed(room, tmp_path, twice), "--appearance", "none"]
    assert track(room, tmp_path / "out", *more, "--resize", "cut") == 0


def test_lenses_are_converted_with_a_residual(tmp_path, capsys):
    (tmp_path / "calib_results.txt").write_text(LENS)
    words = [
        "calibrate",
        "convert",
        str(tmp_path / "calib_results.txt"),
        "--to",
        "opencv",
        "--out",
        str(tmp_path / "l.yaml"),
    ]
    assert main(words) == 0
    assert "opencv: 0." in capsys.readouterr().out
    # What reading another model loses is told, too.
    assert (
        main(["calibrate", "convert", str(tmp_path / "l.yaml"), "--to", "ocam", "--out", str(tmp_path / "b.txt")]) == 0
    )
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("l.yaml as Scaramuzza's model: 0.")
    # What was written is read again: its digits are fewer than a number's in memory.
    assert 0 < float(lines[1].removeprefix("that as ocam: ").split(" ")[0]) < 1e-6


def test_a_pose_from_height_and_from_points(tmp_path, capsys):
    lens = tmp_path / "calib_results.txt"
    lens.write_text(LENS)
    assert main(["calibrate", "pose", str(lens), "--height", "2.5", "--out", str(tmp_path / "a.yaml")]) == 0
    (tmp_path / "p.csv").write_text(
        "u,v,x,y\n160.5,120.5,0,0\n200.5,120.5,1,0\n160.5,80.5,0,1\n200.5,80.5,1,1\n180.5,100.5,0.5,0.5\n"
    )
    words = ["calibrate", "pose", str(lens), "--points", str(tmp_path / "p.csv"), "--out", str(tmp_path / "b.yaml")]
    assert main(words) == 0
    assert "at 0.000, 0.000, 2.500 m" in capsys.readouterr().out.splitlines()[-1]
    assert main(["calibrate", "pose", str(lens), "--height", "0", "--out", str(tmp_path / "c.yaml")]) == 2
    one_line(capsys, "--height: expected a number greater than 0")
    words = ["calibrate", "pose", str(lens), "--height", "1.5", "--out", str(tmp_path / "c.yaml")]
    assert main(words) == 2
    one_line(capsys, "expected a camera above the person of 1.7 m, got one at a height of 1.5 m")
    assert not (tmp_path / "c.yaml").exists()
    # Somebody smaller stands under it.
    assert main([*words, "--person-height", "1.2"]) == 0


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("when", ["tracking", "drawing"])
def test_an_interrupt_in_the_second_camera_keeps_the_first(room, tmp_path, monkeypatch, capsys, when, number):
    seen = []

    def begins(*values, **named):
        seen.append(None)
        if len(seen) == 2:
            signal.raise_signal(number)
        return original(*values, **named)

    where, name = (overlay, "write_drawn") if when == "drawing" else (CeilingSource, "view")
    original = getattr(where, name)
    monkeypatch.setattr(where, name, begins)
    out = tmp_path / "out"
    assert track(room, out, *given(room), "--appearance", "none", "--overlay") == 128 + number
    record = json.loads((out / "run.json").read_text())
    assert record["partial"] is True
    assert {"camera1/tracks.txt", "camera1/world.csv", "camera1/overlay.webm"} <= set(record["files"])
    assert ("camera2/tracks.txt" in record["files"]) == (when == "drawing")
    assert "camera2/overlay.webm" not in record["files"]
    # A line before it says that the rest is being written.
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("tsuiseki: interrupted")]
    (line,) = [line for line in lines if "what is finished is being written" not in line]
    assert f"is in {out}, marked in its run.json" in line
    assert [p.name for p in out.iterdir() if p.name.startswith(".")] == []
