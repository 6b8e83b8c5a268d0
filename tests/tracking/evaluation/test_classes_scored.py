"""`evaluate people --classes`: cars and others in every layout that labels them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.types import Track

CAR, WALKER, VAN = (0, (10.0, 20.0, 60.0, 30.0)), (1, (100.0, 20.0, 15.0, 40.0)), (2, (200.0, 20.0, 60.0, 40.0))
LENGTH = 6


def rows() -> list[tuple[int, int, float, float, float, float]]:
    return [(t, kind, x + 2 * t, y, w, h) for t in range(LENGTH) for kind, (x, y, w, h) in (CAR, WALKER, VAN)]


def mot(folder: Path, mark: int = 0) -> Path:
    (folder / "gt").mkdir(parents=True)
    numbers = {0: (mark, 3), 1: (1, 1), 2: (0, 13)}
    lines = [
        f"{t + 1},{k + 1},{x + 1},{y + 1},{w},{h},{numbers[k][0]},{numbers[k][1]},1" for t, k, x, y, w, h in rows()
    ]
    (folder / "gt" / "gt.txt").write_text("\n".join(lines))
    return folder / "gt" / "gt.txt"


def visdrone(folder: Path) -> Path:
    from PIL import Image

    (folder / "annotations").mkdir(parents=True)
    (folder / "sequences" / "clip").mkdir(parents=True)
    for t in range(LENGTH):
        Image.new("RGB", (300, 100)).save(folder / "sequences" / "clip" / f"{t + 1:07}.jpg")
    lines = [f"{t + 1},{k + 1},{x},{y},{w},{h},1,{[4, 1, 5][k]},0,0" for t, k, x, y, w, h in rows()]
    (folder / "annotations" / "clip.txt").write_text("\n".join(lines))
    return folder


def kitti(folder: Path) -> Path:
    (folder / "label_02").mkdir(parents=True)
    names = ("Car", "Pedestrian", "Van")
    lines = [f"{t} {k} {names[k]} 0 0 0 {x} {y} {x + w} {y + h} 1 1 1 0 0 0 0" for t, k, x, y, w, h in rows()]
    (folder / "label_02" / "0000.txt").write_text("\n".join(lines))
    return folder


def bdd(folder: Path) -> Path:
    place = folder / "labels" / "box_track_20" / "val"
    place.mkdir(parents=True)
    names = ("car", "pedestrian", "truck")
    frames = [{"name": f"v-{t}.jpg", "videoName": "v", "frameIndex": t, "labels": []} for t in range(LENGTH)]
    for t, k, x, y, w, h in rows():
        box = {"x1": x, "y1": y, "x2": x + w, "y2": y + h}
        frames[t]["labels"].append({"id": f"000{k}", "category": names[k], "attributes": {}, "box2d": box})
    (place / "v.json").write_text(json.dumps(frames))
    return folder


LAYOUTS = {"mot": mot, "visdrone": visdrone, "kitti": kitti, "bdd": bdd}
# Column 8 as each layout numbers classes, and the class of the large vehicle.
NUMBERS = {"mot": (3, 1), "visdrone": (4, 1)}


def tracks(numbers: tuple[int, int] | None, missed: int = 0) -> list[Track]:
    found = []
    for k, (x, y, w, h) in (CAR, WALKER):
        times = np.arange(missed if k == 0 else 0, LENGTH)
        boxes = np.array([[x + 2 * t, y, x + w + 2 * t, y + h] for t in times])
        origin = np.column_stack([times * 0, np.full(len(times), -1 if numbers is None else numbers[k])])
        found.append(Track(k + 1, times, boxes, np.ones(len(times)), origin=origin))
    return found


def scored(truth: Path, result: Path, classes: str, out: Path) -> dict[str, float]:
    assert main(["evaluate", "people", str(truth), str(result), "--classes", classes, "--json", str(out)]) == 0
    return {name: one["combined"]["mota"] for name, one in json.loads(out.read_text()).items()}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_cars_are_scored_apart_from_people(tmp_path: Path, layout: str) -> None:
    truth = LAYOUTS[layout](tmp_path / "data")
    result = tmp_path / "run" / "tracks.txt"
    write_tracks(result, tracks((2, 0), missed=2))
    (tmp_path / "run" / "run.json").write_text(json.dumps({"facts": {"classes": {"0": "person", "2": "car"}}}))
    mota = scored(truth, tmp_path / "run", "car,person", tmp_path / "out.json")
    assert mota == pytest.approx({"run car": 4 / 6, "run person": 1.0})
    one = tmp_path / "one.txt"
    write_tracks(one, tracks(None)[:1])
    assert scored(truth, one, "Car", tmp_path / "one.json") == {"one car": 1.0}


@pytest.mark.parametrize("layout", NUMBERS)
def test_numbers_are_those_of_the_labels(tmp_path: Path, layout: str) -> None:
    truth, result = LAYOUTS[layout](tmp_path / "data"), tmp_path / "r.txt"
    write_tracks(result, tracks(NUMBERS[layout], missed=3))
    car = NUMBERS[layout][0]
    assert scored(truth, result, f"{car},pedestrian", tmp_path / "o.json") == {f"r {car}": 0.5, "r pedestrian": 1.0}


def test_rows_that_are_marked_count_where_some_are(tmp_path: Path) -> None:
    truth = mot(tmp_path / "data", mark=1)
    text = truth.read_text().splitlines()
    truth.write_text("\n".join([text[0].replace(",1,3,1", ",0,3,1"), *text[1:]]))
    (video,) = open_labelled(truth)
    assert (int(video.people(kind="car").evaluated.sum()), int(video.people().evaluated.sum())) == (5, 6)


def test_what_lacks_a_class_is_told_and_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = kitti(tmp_path / "data")
    (folder / "label_02" / "0001.txt").write_text("0 1 Pedestrian 0 0 0 1 2 30 40 1 1 1 0 0 0 0\n")
    for name in ("0000", "0001"):
        write_tracks(tmp_path / "run" / f"{name}.txt", tracks(None)[:1])
    scores = scored(folder, tmp_path / "run", "car", tmp_path / "o.json")
    assert scores == {"run car": 1.0}
    assert "0001.txt: no usable box: expected Car; left out" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("classes", "numbers", "line"),
    [
        ("dragon", None, "--classes: expected classes of"),
        ("car,Car", None, "--classes: expected each class once, got car twice"),
        ("tram", None, "no usable box: expected Tram"),
        ("car", (2, 0), "expected names of the classes 0, 2 in column 8"),
    ],
)
def test_wrong_classes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], classes: str, numbers: tuple[int, int] | None, line: str
) -> None:
    write_tracks(tmp_path / "r.txt", tracks(numbers))
    truth = kitti(tmp_path / "data")
    assert main(["evaluate", "people", str(truth), str(tmp_path / "r.txt"), "--classes", classes]) == 2
    (told,) = capsys.readouterr().err.strip().splitlines()
    assert line in told


def test_crowds_and_others_of_bdd100k_are_neither_right_nor_wrong(tmp_path: Path) -> None:
    (file,) = (bdd(tmp_path)).rglob("*.json")
    frames = json.loads(file.read_text())
    frames[0]["labels"][0]["attributes"] = {"crowd": True, "occluded": True}
    frames[1]["labels"][2]["category"] = "other vehicle"
    file.write_text(json.dumps(frames))
    (video,) = open_labelled(file)
    truth = video.people(kind="car")
    assert (int(truth.evaluated.sum()), int(truth.ignored.sum()), truth.visibility.min()) == (5, 2, 0.5)
    file.write_text(file.read_text().replace('"x2"', '"right"'))
    with pytest.raises(ValueError, match="18 of 18 cannot: 18 without a finite number as x2"):
        video.people()
