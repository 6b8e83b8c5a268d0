"""Tracks go into the files of other programs, whose own readers open them, and come back."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.datamodules.labelled_images import labelled_images
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.calls import evaluate_people
from tsuiseki.tracking.formats.box_labels import read_kitti
from tsuiseki.tracking.formats.exports import FORMATS, format_at, read_exported
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.formats.sleap_hdf5 import read_sleap_hdf5
from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.types import Track

FRAMES = {2: [0, 1, 2, 5, 6], 7: [3, 4], 9: [8, 9]}
# Those that hold more than rows: the name, the size and the length of the video.
READ = [name for name, one in FORMATS.items() if one.read and name != "kitti"]


def tracks() -> list[Track]:
    rng, found = np.random.default_rng(0), []
    for number, frames in FRAMES.items():
        corner, size = rng.uniform(0, 400, (len(frames), 2)), rng.uniform(10, 60, (len(frames), 2))
        boxes = np.concatenate([corner, corner + size], axis=1).round(1)
        scores = rng.uniform(0.3, 1, len(frames)).round(2)
        kind = {"names": {2: "car"}, "origin": np.array([[3, 2], [-1, 2]])} if number == 7 else {}
        found.append(Track(number, np.array(frames), boxes, scores, np.arange(len(frames)) != 1, **kind))
    return found


@pytest.fixture
def video() -> TrackedVideo:
    """Three tracks of ten frames: one with a gap, one that ends before the video, one that does not; one is a car."""
    return TrackedVideo(tracks(), "street.mp4", 25.0, (640, 480), 10)


def written(name: str, video: TrackedVideo, folder: Path) -> Path:
    path = folder / f"annotations{FORMATS[name].suffix}"
    if not FORMATS[name].suffix:
        path.mkdir()
    FORMATS[name].write(path, video)
    return path


@pytest.mark.parametrize("name", READ)
def test_what_is_written_comes_back(name: str, video: TrackedVideo, tmp_path: Path) -> None:
    path = written(name, video, tmp_path)
    assert format_at(path) == name
    back = read_exported(path)
    assert (back.stem, back.size, back.length) == ("street", (640, 480), 10)
    assert back.frame_rate == (0 if name == "cvat" else 25)
    assert back.kind == {2: "person", 7: "car", 9: "person"}
    assert [track.id for track in back.tracks] == [2, 7, 9]
    for one, other in zip(video.tracks, back.tracks, strict=True):
        np.testing.assert_array_equal(one.frames, other.frames)
        # Half of the last digit: a thousandth of a pixel, or a millionth of the width.
        np.testing.assert_allclose(one.boxes, other.boxes, atol=0.001)
        scores = np.full(len(one), one.scores.mean().round(4)) if name == "label-studio" else one.scores
        np.testing.assert_allclose(other.scores, scores)
        if name in ("coco", "cvat"):
            np.testing.assert_array_equal(one.observed, other.observed)
            np.testing.assert_array_equal(one.detection, other.detection)


@pytest.mark.parametrize("name", READ)
def test_labels_score_and_people_among_cars_count(name: str, video: TrackedVideo, tmp_path: Path) -> None:
    path = written(name, video, tmp_path)
    (labelled,) = open_labelled(path)
    assert (labelled.name, labelled.length, labelled.size) == ("street", 10, (640, 480))
    truth = labelled.people()
    assert set(truth.ids[truth.evaluated].tolist()) == {2, 9}
    cars = labelled.people(kind="car")
    assert cars.ids[cars.evaluated].tolist() == [7, 7]
    with pytest.raises(RequestError, match=r"\d car, \d person\), got bus"):
        labelled.people(kind="bus")
    people = [track for track in video.tracks if track.id != 7]
    assert evaluate_people(path, people).mota == 1
    # As a result, the car is wrong.
    assert evaluate_people(people, path).mota == pytest.approx(1 - 2 / 7)


@pytest.mark.parametrize("name", READ)
def test_labels_train_with_the_images_beside_them(name: str, video: TrackedVideo, tmp_path: Path) -> None:
    names = tuple(f"{frame + 1:06d}.jpg" for frame in range(10))
    (tmp_path / "images").mkdir()
    for image in names:
        cv2.imwrite(str(tmp_path / "images" / image), np.zeros((480, 640, 3), np.uint8))
    known = TrackedVideo(video.tracks, "street.mp4", 25.0, (640, 480), 10, names)
    if FORMATS[name].suffix:
        written(name, known, tmp_path)
    else:
        FORMATS[name].write(tmp_path, known)
    samples = labelled_images(tmp_path)
    assert [sample.picture.name for sample in samples] == list(names)
    assert [sample.ids.tolist() for sample in samples] == [[2], [2], [2], [], [], [2], [2], [], [9], [9]]


@pytest.mark.parametrize("name", READ)
def test_markup_in_names_stays_text(name: str, tmp_path: Path) -> None:
    kind = '<b a="1">&amp; é, 車'
    track = Track(1, np.array([0]), np.array([[1.0, 2, 9, 9]]), np.ones(1), names={4: kind}, origin=np.array([[-1, 4]]))
    path = written(name, TrackedVideo([track], '<a href="x">.mp4', 25.0, (64, 48), 1), tmp_path)
    assert read_exported(path).kind == {1: kind}


def test_mot_dancetrack_and_kitti_come_back(video: TrackedVideo, tmp_path: Path) -> None:
    mot, sequence, kitti = (written(name, video, tmp_path / name) for name in _folders(tmp_path))
    for one, other in zip(video.tracks, read_tracks(mot), strict=True):
        np.testing.assert_allclose(one.boxes, other.boxes, atol=0.01)
    (labelled,) = open_labelled(sequence)
    assert (labelled.length, labelled.size, len(labelled.people())) == (10, (640, 480), 9)
    truth = read_kitti(kitti, 10)
    np.testing.assert_allclose(truth.boxes, video.boxes.boxes, atol=0.005)
    assert truth.ids[truth.evaluated].tolist() == [2, 2, 2, 2, 2, 9, 9]
    assert {len(line.split()) for line in kitti.read_text().splitlines()} == {18}


def _folders(folder: Path) -> tuple[str, ...]:
    names = ("mot", "dancetrack", "kitti")
    for name in names:
        (folder / name).mkdir()
    return names


def test_cvat_closes_tracks(video: TrackedVideo, tmp_path: Path) -> None:
    path = written("cvat", video, tmp_path)
    outside = [
        line.split('frame="')[1].split('"')[0] for line in path.read_text().splitlines() if 'outside="1"' in line
    ]
    assert outside == ["3", "7", "5"]


def test_cocos_reader_opens_its_file(video: TrackedVideo, tmp_path: Path) -> None:
    coco = pytest.importorskip("pycocotools.coco", reason="pycocotools is not installed (the extra dev)")
    opened = coco.COCO(str(written("coco", video, tmp_path)))
    assert len(opened.getImgIds()) == 10
    (found,) = opened.loadAnns(opened.getAnnIds(imgIds=[6]))
    x, y, x2, y2 = video.tracks[0].boxes[3]
    np.testing.assert_allclose(found["bbox"], [x, y, x2 - x, y2 - y], atol=0.001)
    assert (found["track_id"], opened.loadCats(found["category_id"])[0]["name"]) == (2, "person")


def test_sleaps_project_comes_back_and_its_reader_opens_it(video: TrackedVideo, tmp_path: Path) -> None:
    path = written("sleap", video, tmp_path)
    table = read_sleap_hdf5(path)
    assert (table.nodes, table.tracks[:2]) == (("centre",), ("track_2", "track_2"))
    np.testing.assert_allclose(table.points[0, 0], video.tracks[0].boxes[0].reshape(2, 2).mean(axis=0) - 0.5)
    sleap = pytest.importorskip("sleap_io", reason="sleap-io is not installed")
    labels = sleap.load_slp(str(path))
    assert [frame.frame_idx for frame in labels] == [0, 1, 2, 3, 4, 5, 6, 8, 9]
    assert [track.name for track in labels.tracks] == ["track_2", "track_7", "track_9"]


def test_movement_reads_boxes_and_points(video: TrackedVideo, tmp_path: Path) -> None:
    via, points = written("via", video, tmp_path), written("sleap", video, tmp_path)
    assert via.read_text().count("rect") == 9
    load = pytest.importorskip("movement.io", reason="movement is not installed")
    boxes = load.load_bboxes.from_via_tracks_file(str(via), fps=25)
    np.testing.assert_allclose(boxes.position.values[0, :, 0], video.tracks[0].boxes[0].reshape(2, 2).mean(axis=0))
    assert load.load_poses.from_sleap_file(str(points), fps=25).sizes["individuals"] == 3


def test_geff_holds_a_node_for_each_box(video: TrackedVideo, tmp_path: Path) -> None:
    path = written("geff", video, tmp_path)
    about = json.loads((path / "nodes/props/x/values/.zarray").read_text())
    x = np.frombuffer((path / "nodes/props/x/values/0").read_bytes(), about["dtype"])
    np.testing.assert_array_equal(x, video.boxes.boxes[:, [0, 2]].mean(axis=1))
    geff = pytest.importorskip("geff", reason="geff is not installed")
    graph, _ = geff.read(str(path), structure_validation=True)
    assert sorted(graph.edges) == [(0, 1), (1, 2), (2, 5), (3, 4), (5, 6), (7, 8)]
    assert (graph.nodes[5]["track_id"], graph.nodes[5]["t"]) == (2, 5)


def test_key_frames_hold_on_straight_lines(tmp_path: Path) -> None:
    box = '<box frame="{}" outside="{}" occluded="0" xtl="{}" ytl="0" xbr="{}" ybr="9"/>'
    rows = "".join(box.format(*row) for row in ((0, 0, 10, 20), (4, 0, 50, 60), (6, 1, 50, 60), (8, 0, 1, 2)))
    cvat = tmp_path / "a.xml"
    cvat.write_text(f'<annotations><track id="0" label="person">{rows}</track></annotations>')
    (track,) = read_exported(cvat).tracks
    assert (track.id, track.frames.tolist()) == (1, [0, 1, 2, 3, 4, 5, 8])
    assert track.boxes[:, 0].tolist() == [10, 20, 30, 40, 50, 50, 1]
    assert track.observed.tolist() == [True, False, False, False, True, False, True]
    keys = [(1, True, 10), (3, False, 30), (5, True, 0)]
    sequence = [{"frame": f, "enabled": e, "x": x, "y": 0, "width": 10, "height": 10} for f, e, x in keys]
    region = {"id": "aB3", "type": "videorectangle", "value": {"framesCount": 7, "sequence": sequence}}
    studio = tmp_path / "a.json"
    studio.write_text(json.dumps([{"data": {"video": "/d/a.mp4?x=1"}, "annotations": [{"result": [region]}]}]))
    known = read_exported(studio)
    with pytest.raises(RequestError, match="expected the `size` of it"):
        known.in_pixels(studio)
    with pytest.raises(RequestError, match="expected the `size` of it"):
        open_labelled(studio)[0].people()
    (track,) = known.in_pixels(studio, (200, 100)).tracks
    assert (known.name, track.id, track.frames.tolist()) == ("a.mp4", 1, [0, 1, 2, 4, 5, 6])
    assert track.boxes[:, 0].tolist() == [20, 40, 60, 0, 0, 0]
    assert len(open_labelled(studio)[0].people(size=(200, 100))) == 6


KEY = '<box frame="{}" xtl="1" ytl="1" xbr="{}" ybr="9"/>'
LONG = f'<annotations><track id="1">{KEY.format(0, 9)}{KEY.format("{}", "nan")}</track></annotations>'
COCO = '{{"images": [{{"id": 1}}], "categories": [{{"id": 1, "name": "person"}}], "annotations": [{}]}}'
BOX = '{"id": 4, "image_id": 1, "category_id": 1, "bbox": [1, 2, 3, 4]'


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        (
            "a.xml",
            "<annotations><image/></annotations>",
            "expected labelled boxes, found none",
        ),
        ("a.xml", "<annotations>", "expected CVAT's XML, got a broken one"),
        ("a.xml", '<!DOCTYPE a [<!ENTITY b "c">]><annotations/>', "which defines no entities"),
        (
            "a.xml",
            '<annotations><track id="1"><box frame="0"/></track></annotations>',
            "1 of 1 cannot: 1 without a finite number as xtl",
        ),
        ("a.xml", '<annotations><track id="3"/></annotations>', r"1 of 1 cannot: 1 without a frame .*track 3"),
        ("a.xml", LONG.format(1).replace('"9"', '"inf"'), "2 of 2 cannot: 2 without a finite number as xbr"),
        ("a.xml", LONG.format(5_000_000).replace("nan", "9"), "a track of at most 1000000 frames, got one of 5000001"),
        ("a.json", COCO.format(BOX + "}"), "expected an id of each box .COCO: track_id"),
        ("a.json", COCO.format(f'{BOX}, "track_id": 1}}, {BOX}, "track_id": 1}}'), "id 1 stands twice in frame 0"),
        (
            "a.json",
            COCO.format(BOX.replace("4]", '0], "track_id": 1') + "}"),
            "1 of 1 cannot: 1 without an area .annotation 4",
        ),
        ("a.json", COCO.format(BOX.replace("[1, 2", "[1") + ', "track_id": 1}'), "without x, y, width and height"),
        ("a.json", COCO.format(""), "expected labelled boxes, found none"),
        ("a.json", "{", "expected COCO's JSON, got no JSON"),
        ("a.json", "[]", "expected one task of Label Studio's JSON of video, got 0"),
        ("a.json", '[{"data": {}}]', "expected `videorectangle` in Label Studio's JSON of video, found none"),
        ("labels/a_1.txt", "0 0.5 0.5 0.1\n", "expected class x y width height"),
        ("labels/a_1.txt", "0 0.5 0.5 0.1 0.1 0.93 0.5\n", "with a whole number as id"),
        ("labels/a.txt", "0 0.5 0.5 0.1 0.1 0.9 1\n", "expected the number of a frame at the end of its name"),
    ],
)
def test_what_is_broken_is_refused_in_a_line(name: str, text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    with pytest.raises(RequestError, match=message) as error:
        evaluate_people(tmp_path if name.startswith("labels") else path, tracks())
    assert "\n" not in str(error.value)


def pictures(folder: Path, count: int = 4) -> None:
    """Black pictures of two sizes."""
    folder.mkdir(parents=True, exist_ok=True)
    for n in range(count):
        cv2.imwrite(str(folder / f"{n:03d}.png"), np.zeros((100, 200 if n % 2 else 100, 3), np.uint8))


def single_coco(folder: Path) -> Path:
    """As COCO itself: pictures of other sizes, no tracks, a crowd."""
    pictures(folder / "val2017")
    sides = [{"width": 200 if n % 2 else 100, "height": 100} for n in range(4)]
    images = [{"id": 7 + n, "file_name": f"{n:03d}.png", **sides[n]} for n in range(4)]
    boxes = [(7, 1, [10, 20, 30, 40], 0), (8, 1, [20, 20, 60, 40], 0), (7, 3, [5, 5, 5, 5], 0), (8, 1, [0, 0, 9, 9], 1)]
    rows = [{"image_id": i, "category_id": c, "bbox": box, "iscrowd": crowd} for i, c, box, crowd in boxes]
    kinds = [{"id": 1, "name": "person"}, {"id": 3, "name": "car"}]
    (folder / "annotations").mkdir()
    content = {"images": images, "categories": kinds, "annotations": rows}
    (folder / "annotations" / "instances_val2017.json").write_text(json.dumps(content))
    return folder


def single_fiftyone(folder: Path) -> Path:
    """COCO as FiftyOne exports it."""
    single_coco(folder)
    (folder / "val2017").rename(folder / "data")
    (folder / "annotations" / "instances_val2017.json").rename(folder / "labels.json")
    return folder


def single_yolo(folder: Path) -> Path:
    """As ultralytics and Roboflow keep them: five numbers a row, parts in folders."""
    pictures(folder / "images" / "train")
    (folder / "labels" / "train").mkdir(parents=True)
    (folder / "labels" / "train" / "000.txt").write_text("0 0.25 0.4 0.3 0.4\n2 0.075 0.075 0.05 0.05\n")
    (folder / "labels" / "train" / "001.txt").write_text("0 0.25 0.4 0.3 0.4\n")
    (folder / "data.yaml").write_text("train: images/train\nnames: {0: person, 2: car}\n")
    return folder


def single_cvat(folder: Path) -> Path:
    """CVAT for images."""
    pictures(folder / "images")
    box = '<box label="{}" xtl="{}" ytl="{}" xbr="{}" ybr="{}"/>'
    first = box.format("person", 10, 20, 40, 60) + box.format("car", 5, 5, 10, 10)
    second = box.format("person", 20, 20, 80, 60)
    images = "".join(f'<image id="{n}" name="{n:03d}.png">{b}</image>' for n, b in enumerate((first, second, "", "")))
    (folder / "annotations.xml").write_text(f"<annotations><version>1.1</version>{images}</annotations>")
    return folder


def test_settings_of_yolo_stand_for_their_folder_and_folders_are_looked_into(tmp_path: Path) -> None:
    folder = single_yolo(tmp_path / "set")
    for place in (folder / "data.yaml", tmp_path):
        assert [one.files for one in open_labelled(place)] == [open_labelled(folder)[0].files]


@pytest.mark.parametrize("make", [single_coco, single_fiftyone, single_yolo, single_cvat])
def test_pictures_labelled_one_by_one_have_boxes_and_no_ids(make: Callable[[Path], Path], tmp_path: Path) -> None:
    (video,) = open_labelled(make(tmp_path / "set"))
    assert [path.name for path in video.files] == ["000.png", "001.png", "002.png", "003.png"]
    truth = video.people(single=True)
    people, cars = truth.select(truth.evaluated), video.people(kind="car", single=True)
    assert people.frames.tolist() == [0, 1]
    np.testing.assert_allclose(people.boxes, [[10, 20, 40, 60], [20, 20, 80, 60]])
    np.testing.assert_allclose(cars.boxes[cars.evaluated], [[5, 5, 10, 10]])
    assert int(truth.ignored.sum()) == (make in (single_coco, single_fiftyone))
    with pytest.raises(RequestError, match="expected an id of each box"):
        video.people()
