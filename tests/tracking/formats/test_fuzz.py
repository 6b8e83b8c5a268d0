"""Changed files: whatever a reader gets, it gives a result, or one line that says what is wrong.

Each reader's own small file is changed in a fixed random order: bytes, lines and cells are cut, doubled, swapped or
replaced by what often breaks programs. Quick with 50 changes a reader; the slow test makes 2,000.
"""

from __future__ import annotations

import io
import json
import re
import shutil
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.tracking.formats.test_exports import tracks
from tsuiseki.tracking.association.solved_network import SolvedNetwork, network_of_tracks
from tsuiseki.tracking.batch.jobs import Job
from tsuiseki.tracking.batch.sources import jobs_of
from tsuiseki.tracking.bodies.body import read_body
from tsuiseki.tracking.cameras.camera_files import read_cameras
from tsuiseki.tracking.cameras.lens_files import read_intrinsics, read_lens
from tsuiseki.tracking.cli.config import read_config
from tsuiseki.tracking.counts.scene import read_scene
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.features.objectness import read_objectness
from tsuiseki.tracking.filters.learnt_motion import conditions, read_motion
from tsuiseki.tracking.formats.acting_tracks import read_acting_tracks
from tsuiseki.tracking.formats.body_points import read_poses_file
from tsuiseki.tracking.formats.body_states import read_states
from tsuiseki.tracking.formats.box_labels import read_bdd100k, read_kitti, read_visdrone
from tsuiseki.tracking.formats.correction_log import read_corrections
from tsuiseki.tracking.formats.exports import FORMATS
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.tracking.formats.measurement_tables import read_point_tracks, read_points, read_scans, read_sensing_model
from tsuiseki.tracking.formats.mot import read_detections, read_ground_truth, read_tracks
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.formats.okutama import read_okutama
from tsuiseki.tracking.formats.rotated import read_rotated_detections, read_rotated_labels
from tsuiseki.tracking.formats.single import read_boxes, read_result
from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.formats.world_tables import read_correspondences, read_floor_positions, read_path3d
from tsuiseki.tracking.openers.values import read_values, write_values
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types.tracks import PointTable
from tsuiseki.tracking.weights import shipped

# What often breaks programs, as words of a text.
WORDS = (
    "", "0", "-1", "1e999", "-1e999", "nan", "NaN", "inf", "Infinity", "9" * 25, "9" * 5000, "1e308", "1e-320", "0.5",
    "18446744073709551616", "9223372036854775808", "true", "null", "~", "[]", "{}", "[[]]", '""', "''", "x", "é",
    "[" * 200, "{" * 70, "]", "}", ":", "- ", ",", ";", "\t", '"', "'", "<", ">", "</a>", "<a>" * 80, "&b;", "&a", "*a",
    "!!python/object:os.system", "!!set", "2024-13-45", "%", "#", "\\u0000", "\\ud800", "../../x", "1:00:00",
    "0x" + "f" * 40,
)  # fmt: skip
_TOKEN = re.compile(r"[-+.\w]+|\"[^\"\n]*\"|[^\s\w]")
# The longest line that a person reads.
LONGEST_LINE = 1500


@dataclass(frozen=True)
class FuzzCase:
    """A reader and its file.

    Attributes:
        read: takes the file or folder.
        write: makes a good one, in an empty folder; gives what ``read`` takes.
        changed: name of the file that is changed, in that folder.
    """

    read: Callable[[Path], object]
    write: Callable[[Path], Path]
    changed: str


def of_text(read: Callable[[Path], object], name: str, text: str) -> FuzzCase:
    def write(folder: Path) -> Path:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
        return folder / name

    return FuzzCase(read, write, name)


def points() -> PointTable:
    rng = np.random.default_rng(0)
    places, scores = rng.uniform(0, 60, (8, 2, 2)).round(2), rng.random((8, 2)).round(2)
    return PointTable(("nose", "tail"), np.arange(8) // 2, ("a", "b") * 4, places, scores)


def video() -> TrackedVideo:
    return TrackedVideo(tracks(), "film.mp4", 25.0, (640, 480), 12, points=points())


def of_export(format_name: str, name: str, read: Callable[[Path], object], changed: str = "") -> FuzzCase:
    def write(folder: Path) -> Path:
        path = folder / name
        if not FORMATS[format_name].suffix:
            path.mkdir()
        FORMATS[format_name].write(path, video())
        return path

    return FuzzCase(read, write, changed or name)


def saved(folder: Path) -> Path:
    made = tracks()
    result: Result[Any] = Result(made, "film.mp4", 25.0, (640, 480), {"seed": 0}, frames={"frame": list(range(12))})
    return result.save(folder / "result")


def of_result(name: str, suffix: str) -> FuzzCase:
    def write(folder: Path) -> Path:
        return Result(tracks(), "film.mp4", 25.0, (640, 480)).save(folder / f"tracks{suffix}")

    return FuzzCase(lambda path: [*Result.load(path)], write, name)


def network(folder: Path) -> Path:
    network_of_tracks(tracks(), 25.0).write(folder / "network.npz")
    return folder / "network.npz"


def values(folder: Path) -> Path:
    with (folder / "values.npz").open("wb") as file:
        write_values(file, (tracks(), {"x": [1, 2.5, None]}))
    return folder / "values.npz"


def shipped_copy(folder: Path) -> Path:
    return Path(shutil.copy(shipped("objectness_scenes"), folder / "objectness.json"))


def labels(path: Path) -> object:
    return [opened.read() if hasattr(opened, "read") else opened for opened in open_labelled(path)]


MOT = "".join(f"{f},{t},{10 * f + t},{20 * t},30,60,0.9,1,0.8\n" for f in range(1, 6) for t in (1, 2, 3))
SCENE = """size: [640, 480]
unit: metres
scale: 0.02
lines:
- {name: gate, from: [300, 0], to: [300, 480], directions: [in, out]}
zones:
- name: shop
  corners: [[10, 10], [200, 10], [200, 200], [10, 200]]
region: [[0, 0], [640, 0], [640, 480], [0, 480]]
"""
CAMERAS = """cameras:
- name: a
  model: projective
  image_size: [640, 480]
  focal: [500.0, 500.0]
  principal_point: [320.0, 240.0]
  distortion: [0.1, 0.0, 0.0, 0.0, 0.0]
  rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
  position: [0.0, 0.0, 3.0]
  offset: 0.5
  frame_rate: 25.0
  floor: [0, 0, 8, 6]
- name: b
  model: omnidirectional
  image_size: [640, 640]
  direct: [200.0, 0.0, -0.001]
  centre: [320.0, 320.0]
  stretch: [[1.0, 0.0], [0.0, 1.0]]
  rotation: [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]
  position: [2.0, 0.0, 3.0]
  floor: [0, 0, 8, 6]
"""
OPENCV_XML = """<?xml version="1.0"?>
<opencv_storage>
<image_width>640</image_width>
<image_height>480</image_height>
<camera_matrix type_id="opencv-matrix">
  <rows>3</rows><cols>3</cols><dt>d</dt>
  <data>500. 0. 320. 0. 500. 240. 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix">
  <rows>1</rows><cols>5</cols><dt>d</dt>
  <data>0.1 -0.05 0. 0. 0.01</data></distortion_coefficients>
<distortion_model>"plumb_bob"</distortion_model>
</opencv_storage>
"""
OPENCV_YAML = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 500., 0., 320., 0., 500., 240., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0.1, -0.05, 0., 0., 0.01 ]
"""
OPENCV_FISHEYE = """<?xml version="1.0"?>
<opencv_storage><image_width>640</image_width><image_height>640</image_height><fisheye_model>1</fisheye_model>
<K type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt><data>200. 0. 320. 0. 200. 320. 0. 0. 1.</data></K>
<D type_id="opencv-matrix"><rows>4</rows><cols>1</cols><dt>d</dt><data>0.01 0.001 0. 0.</data></D></opencv_storage>
"""
KALIBR = """cam0:
  camera_model: omni
  intrinsics: [1.5, 500.0, 500.0, 320.0, 240.0]
  distortion_model: radtan
  distortion_coeffs: [-0.1, 0.01, 0.0, 0.0]
  resolution: [640, 480]
"""
OCAM = """#direct
4 -200.0 0.0 0.001 0.0000001

#inverse
5 300.0 150.0 -10.0 5.0 1.0

#centre
320.0 320.0

#affine
1.0 0.0 0.0

#size
640 640
"""
PY_OCAM = json.dumps({"taylor_coefficient": [200.0, 0.0, -0.001], "distortion_center": [320.0, 240.0],
                      "stretch_matrix": [[1.0, 0.0], [0.0, 1.0]], "inverse_poly": [1.0, -5.0, 150.0]})  # fmt: skip
CORRECTIONS = "\n".join(
    json.dumps(row)
    for row in (
        {"video": "film.mp4", "size": [640, 480], "frames": 12},
        {"kind": "box", "boxes": [[3, 10.0, 10.0, 30.0, 60.0]]},
        {"kind": "same", "boxes": [[1, 10.0, 10.0, 30.0, 60.0], [2, 12.0, 10.0, 30.0, 60.0]], "sentence": "same"},
        {"kind": "undo"},
        {"kind": "name", "boxes": [[1, 10.0, 10.0, 30.0, 60.0]], "name": "Ann"},
    )
)
RUN = json.dumps({"command": ["tsuiseki", "track", "people"], "partial": False, "seed": 0,
                  "settings": {"method": "flow", "flow": {"fill": 1.0}}, "versions": {"tsuiseki": "1"}, "seconds": {},
                  "files": ["tracks.txt"], "frames": {"frame": [1, 2, 3]}}, indent=1)  # fmt: skip
OPTIONS = "method: flow\nflow:\n  fill: 1.0\n  window: [1, 2]\nseed: 3\nclasses: [person, car]\n"
BDD = json.dumps([
    {"frameIndex": n, "labels": [{"id": "7", "category": "pedestrian", "attributes": {"occluded": False},
                                  "box2d": {"x1": 1.0 + n, "y1": 2.0, "x2": 20.0 + n, "y2": 60.0}}]}
    for n in range(4)])  # fmt: skip
ROTATED = json.dumps({"images": [{"id": 1, "file_name": "a.jpg"}], "annotations": [
    {"image_id": 1, "bbox": [50.0, 60.0, 10.0, 20.0, 30.0], "category_id": 1, "id": 1}]})  # fmt: skip
ROTATED_RESULT = json.dumps([{"image_id": "a", "bbox": [50.0, 60.0, 10.0, 20.0, 30.0], "score": 0.5}])
ACTING = json.dumps({"version": 1, "actions": ["Walking", "Running"], "tracks": [
    {"id": 3, "frames": [1, 2], "boxes": [[1, 2, 10, 20], [2, 2, 10, 20]], "scores": [0.5, 0.6],
     "observed": [True, False], "single": [[0.5, 0.2], [0.5, 0.2]], "multi": [[0.5, 0.2], [0.5, 0.2]]}]})  # fmt: skip
PART = {"mean": [0.0, 0.0, 0.0], "components": np.eye(3).tolist(), "variances": [2.0, 1.0, 0.5]}
TWO = {"mean": [0.0, 0.0], "components": np.eye(2).tolist(), "variances": [2.0, 1.0]}
GAIN = np.zeros((3, conditions(np.zeros((1, 3)), np.zeros((1, 3))).shape[1])).tolist()
MOTION = json.dumps(
    {"format": "tsuiseki-motion-1", "body": "ball", "columns": ["x", "y", "r"], "frame_rate": 25.0, "steps": 2,
     "velocity": TWO, "gain": GAIN, **dict.fromkeys(("walk", "image", "increments", "printed", "residual"), PART)}
)  # fmt: skip
RING = np.column_stack([np.cos(np.arange(8)), np.sin(np.arange(8))]).round(3).tolist()
BODY = json.dumps({"format": "tsuiseki-body-1", "body": "learnt", "name": "eel", "mean": RING, "modes": [RING],
                   "curves": [RING], "bends": [[-1.0, 1.0]]})  # fmt: skip
SENSOR = """sensor: {model: linear, deviation: [2.0, 2.0], position: [0, 0]}
motion: {model: constant-velocity, acceleration: 1.0}
births: {places: [{mean: [1, 0, 2, 0], deviation: 2.0, rate: 0.1}]}
detection: 0.9
clutter: 3.0
region: [[0, 100], [0, 100]]
"""
OKUTAMA = '0 120 60 129 81 0 0 0 0 "Person" "Walking"\n0 121 60 130 81 1 0 0 1 "Person" "Carrying" "Walking"\n'
KITTI = "".join(f"{n} 1 Pedestrian 0 0 -1.5 10.0 20.0 40.0 90.0 1.7 0.5 0.5 1 2 10 0.1\n" for n in range(4))
VISDRONE = "".join(f"{n},1,10,20,30,60,1,1,0,0\n" for n in range(1, 5))
STATES = "frame,id,a,b,length,score,status\n" + "".join(f"{n},1,{n}.5,20,12,0.9,tracking\n" for n in range(1, 6))
SLEAP = "track,frame_idx,instance.score,head.x,head.y,head.score,tail.x,tail.y,tail.score\n" + "".join(
    f"track_0,{n},0.9,{n}.5,2.5,0.8,{n}.25,9,0.7\n" for n in range(5)
)
DLC = (
    "scorer,net,net,net,net,net,net\nbodyparts,nose,nose,nose,tail,tail,tail\n"
    "coords,x,y,likelihood,x,y,likelihood\n0,1,2,.9,3,4,.8\n1,1.5,2,.9,5,6,.7\n"
)
SEQUENCE = "[Sequence]\nname=ONE\nimDir=img1\nframeRate=25\nseqLength=5\nimWidth=640\nimHeight=480\nimExt=.jpg\n"


def sequence(folder: Path) -> Path:
    (folder / "one" / "gt").mkdir(parents=True)
    (folder / "one" / "gt" / "gt.txt").write_text(MOT)
    (folder / "one" / "seqinfo.ini").write_text(SEQUENCE)
    return folder / "one"


def manifest(path: Path) -> object:
    for name in ("a.mp4", "b.mp4"):
        (path.parent / name).touch()
    return jobs_of([str(path)], Job(("track", "people"), "", ""))


CASES = {
    "mot tracks": of_text(read_tracks, "tracks.txt", MOT),
    "mot detections": of_text(read_detections, "det.txt", MOT),
    "mot labels": of_text(read_ground_truth, "gt.txt", MOT),
    "seqinfo.ini": FuzzCase(read_sequence, sequence, "one/seqinfo.ini"),
    "kitti": of_text(read_kitti, "0000.txt", KITTI),
    "visdrone": of_text(read_visdrone, "a.txt", VISDRONE),
    "okutama": of_text(lambda path: read_okutama(path, (1280, 720)), "1.1.1.txt", OKUTAMA),
    "bdd100k": of_text(read_bdd100k, "a.json", BDD),
    "otb": of_text(read_boxes, "groundtruth_rect.txt", "".join(f"{n},20,30,40\n" for n in range(1, 6))),
    "otb json": of_text(read_result, "a.json", json.dumps([{"resType": "rect", "res": [[1, 2, 3, 4], [2, 2, 3, 4]]}])),
    "rotated": of_text(read_rotated_labels, "a.json", ROTATED),
    "rotated result": of_text(read_rotated_detections, "a.json", ROTATED_RESULT),
    "acting tracks": of_text(read_acting_tracks, "tracks.json", ACTING),
    "coco": of_export("coco", "a.json", Result.load),
    "label studio": of_export("label-studio", "a.json", Result.load),
    "cvat": of_export("cvat", "a.xml", Result.load),
    "coco labels": of_export("coco", "a.json", labels),
    "cvat labels": of_export("cvat", "a.xml", labels),
    "yolo rows": of_export("yolo", "a", Result.load, "a/labels/film_1.txt"),
    "yolo data.yaml": of_export("yolo", "a", Result.load, "a/data.yaml"),
    "kitti tracks": of_export("kitti", "a.txt", read_kitti),
    "table csv": of_result("tracks.csv", ".csv"),
    "table json": of_result("tracks.json", ".json"),
    "run.json": FuzzCase(lambda path: [*Result.load(path)], saved, "result/run.json"),
    "result table": FuzzCase(lambda path: [*Result.load(path)], saved, "result/tracks.csv"),
    "corrections": of_text(read_corrections, "corrections.jsonl", CORRECTIONS),
    "sleap csv": of_text(read_poses_file, "a.csv", SLEAP),
    "deeplabcut": of_text(read_poses_file, "b.csv", DLC),
    "states": of_text(read_states, "states.csv", STATES),
    "points": of_text(read_points, "points.csv", "frame,x,y\n1,2.5,3\n1,4,5\n3,4,5\n"),
    "point tracks": of_text(read_point_tracks, "points.csv", "frame,id,x,y\n1,1,2.5,3\n2,1,4,5\n"),
    "scans": of_text(lambda path: read_scans(path, ("x", "y")), "a.csv", "time,x,y\n0,1,2\n0.5,1,2\n1,3,4\n"),
    "sensing model": of_text(read_sensing_model, "model.yaml", SENSOR),
    "correspondences": of_text(read_correspondences, "a.csv", "x,y,z,u,v\n" + "0,0,0,1,2\n1,0,0,3,4\n" * 3),
    "positions": of_text(read_floor_positions, "a.csv", "time,x,y,sd,id\n0,1,2,.1,1\n0.5,1,2,.1,1\n"),
    "path": of_text(read_path3d, "a.csv", "time,x,y,z\n0,1,2,3\n1,1,2,3\n"),
    "scene": of_text(read_scene, "scene.yaml", SCENE),
    "cameras": of_text(read_cameras, "cameras.yaml", CAMERAS),
    "opencv xml": of_text(read_intrinsics, "a.xml", OPENCV_XML),
    "opencv yaml": of_text(read_intrinsics, "a.yaml", OPENCV_YAML),
    "opencv fisheye": of_text(read_lens, "a.xml", OPENCV_FISHEYE),
    "kalibr": of_text(read_lens, "a.yaml", KALIBR),
    "ocam": of_text(read_lens, "a.txt", OCAM),
    "py-ocam": of_text(lambda path: read_lens(path, (640, 480)), "a.json", PY_OCAM),
    "options": of_text(lambda path: read_config(path, ("tsuiseki", "track", "people")), "a.yaml", OPTIONS),
    "options of a run": of_text(lambda path: read_config(path, ("tsuiseki", "track", "people")), "run.json", RUN),
    "manifest": of_text(manifest, "a.yaml", "- {source: a.mp4, name: a, flow.fill: 3}\n- source: b.mp4\n"),
    "manifest csv": of_text(manifest, "a.csv", "source,name,flow.fill\na.mp4,a,3\nb.mp4,b,4\n"),
    "motion": of_text(lambda path: read_motion(path, "ball", 3), "a.json", MOTION),
    "body": of_text(read_body, "a.json", BODY),
    "objectness": FuzzCase(read_objectness, shipped_copy, "objectness.json"),
    "network": FuzzCase(SolvedNetwork.read, network, "network.npz"),
    "values": FuzzCase(lambda path: read_values(path, "values"), values, "values.npz"),
}
NEEDS = {
    "parquet": ("pyarrow", of_result("tracks.parquet", ".parquet")),
    "sleap project": ("h5py", of_export("sleap", "a.slp", read_poses_file)),
    "sleap analysis": ("h5py", of_export("sleap-analysis", "a.h5", read_poses_file)),
}


def changed_text(text: str, rng: np.random.Generator) -> str:
    """A text with one to three changes of its lines and words."""
    for _ in range(rng.integers(1, 4)):
        lines = text.split("\n")
        line, other = (int(rng.integers(len(lines))) for _ in range(2))
        kind = int(rng.integers(8))
        if kind == 0:
            del lines[line]
        elif kind == 1:
            lines.insert(other, lines[line])
        elif kind == 2:
            lines[line], lines[other] = lines[other], lines[line]
        elif kind == 3:
            place = int(rng.integers(len(text) + 1))
            text = text[:place] if rng.random() < 0.3 else text[:place] + str(rng.choice(WORDS)) + text[place:]
            continue
        else:
            words = [*_TOKEN.finditer(text)]
            if words:
                word = words[int(rng.integers(len(words)))]
                new = str(rng.choice(WORDS)) if kind < 7 else words[int(rng.integers(len(words)))][0]
                text = text[: word.start()] + new + text[word.end() :]
            continue
        text = "\n".join(lines)
    return text


def changed_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes of which some are others, cut, doubled or left out."""
    for _ in range(rng.integers(1, 4)):
        place, length = int(rng.integers(len(data) + 1)), int(rng.geometric(0.1))
        part = data[place : place + length]
        new = (rng.bytes(length), b"", part * 2, b"\0" * length, b"\xff" * length)[int(rng.integers(5))]
        data = data[:place] if rng.random() < 0.1 else data[:place] + new + data[place + length :]
    return data


def changed_archive(data: bytes, rng: np.random.Generator) -> bytes:
    """An archive of arrays of which one is another, with sums that are right again."""
    content = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(content, "w") as new:
        names = old.namelist()
        victim = int(rng.integers(len(names)))
        for number, name in enumerate(names):
            member = old.read(name)
            if number == victim:
                kind = int(rng.integers(5))
                if kind == 0:
                    continue
                if kind == 1:
                    array = np.lib.format.read_array(io.BytesIO(member))
                    array = (array[:-1] if array.ndim else array, array.astype(str), -array if array.dtype != bool else
                             array, np.full(array.shape, np.nan), array[None])[int(rng.integers(5))]  # fmt: skip
                    stream = io.BytesIO()
                    np.save(stream, array)
                    member = stream.getvalue()
                else:
                    member = changed_bytes(member[:140], rng) + member[140:] if kind < 4 else changed_bytes(member, rng)
            new.writestr(name, member)
    return content.getvalue()


def changed(data: bytes, rng: np.random.Generator) -> bytes:
    if data.startswith(b"PK") and rng.random() < 0.6:
        return changed_archive(data, rng)
    try:
        text = data.decode()
    except UnicodeDecodeError:
        return changed_bytes(data, rng)
    if rng.random() < 0.2 or "\0" in text:
        return changed_bytes(data, rng)
    return changed_text(text, rng).encode("utf-8", "surrogatepass")


def check(case: FuzzCase, folder: Path, count: int) -> None:
    """Read so many changed files; anything but a result or one short line fails."""
    path, target = case.write(folder), folder / case.changed
    good, rng = target.read_bytes(), np.random.default_rng(0)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        case.read(path)
        for number in range(count):
            data = changed(good, rng)
            target.write_bytes(data)
            try:
                case.read(path)
            except (RequestError, RunError) as error:
                line = str(error)
                if "\n" in line.strip() or len(line) > LONGEST_LINE or not line:
                    pytest.fail(f"change {number}: {len(line)} characters, or several lines: {line[:2000]!r}")
            except Exception as error:
                raise AssertionError(f"change {number}: {type(error).__name__}: {error}\n{data[:3000]!r}") from error


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_changed_file_is_read_or_refused_in_a_line(name: str, tmp_path: Path) -> None:
    check(CASES[name], tmp_path, 50)


@pytest.mark.parametrize("name", NEEDS)
def test_a_changed_file_that_needs_a_package_is_read_or_refused_in_a_line(name: str, tmp_path: Path) -> None:
    package, case = NEEDS[name]
    pytest.importorskip(package)
    check(case, tmp_path, 50)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*CASES, *NEEDS])
def test_2000_changed_files_are_read_or_refused_in_a_line(name: str, tmp_path: Path) -> None:
    package, case = NEEDS.get(name, ("numpy", CASES.get(name)))
    pytest.importorskip(package)
    assert case is not None
    check(case, tmp_path, 2000)
