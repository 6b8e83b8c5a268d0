"""KITTI tracking: who counts, places and frames, pictures, and what is refused with one line."""

from __future__ import annotations

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.box_labels import read_kitti
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.trainers.flow.videos import detected_videos

SPACE = "1.7 0.6 0.8 1.0 1.5 9.0 -1.6"
ROWS = f"""\
0 -1 DontCare -1 -1 -10 219.3 188.4 245.5 218.5 -1000 -1000 -1000 -10 -1 -1 -1
0 2 Pedestrian 0 0 -2.5 1106.1 166.5 1204.4 323.8 {SPACE}
0 3 Cyclist 0 0 -1.9 737.6 161.5 931.1 374 {SPACE}
1 2 Pedestrian 0 1 -2.5 1073.3 164.9 1186.2 325.0 {SPACE}
1 5 Person 0 2 -2.5 10 20 30 70 {SPACE}
1 6 Pedestrian 1 3 -2.5 40 20 60 70 {SPACE}
"""


@pytest.fixture
def kitti(tmp_path: Path) -> Path:
    """Two frames of one drive, in the published layout."""
    (tmp_path / "label_02").mkdir()
    (tmp_path / "label_02" / "0007.txt").write_text(ROWS)
    for frame in range(2):
        path = tmp_path / "image_02" / "0007" / f"{frame:06d}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.full((375, 1242, 3), 90, dtype=np.uint8))
    return tmp_path


def test_pedestrians_count_and_those_who_sit_are_neither_right_nor_wrong(kitti: Path) -> None:
    for path in (kitti, kitti / "label_02" / "0007.txt"):
        (video,) = open_labelled(path)
        truth = video.people()
        assert (video.name, video.length, len(video.files)) == ("0007", 2, 2)
        assert truth.frames.tolist() == [0, 0, 0, 1, 1, 1]
        assert truth.ids[truth.evaluated].tolist() == [2, 2, 6]
        assert truth.ids[truth.ignored].tolist() == [-1, 5]
        np.testing.assert_allclose(truth.boxes[1], [1106.1, 166.5, 1204.4, 323.8])
        assert truth.visibility.tolist() == [1.0, 1.0, 1.0, 0.75, 0.25, 0.5]


def test_it_trains_the_association(kitti: Path) -> None:
    (video,) = detected_videos([kitti], "simulated", frame_rate=10.0)
    assert (video.size, video.frame_rate, len(video.detections)) == ((1242, 375), 10.0, 2)
    with pytest.raises(RequestError, match=r"expected det/det\.txt beside the labels of 0007, found none"):
        list(detected_videos([kitti], "given"))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0 3 Cyclist 0 0 -1.9 737.6", "0 3 Cyclist 0 0 -1.9 wide", "0007.txt:3: expected frame track type"),
        (f"40 20 60 70 {SPACE}", "40 20 60", "0007.txt:6: expected frame track type"),
        ("1 5 Person", "-1 5 Person", "0007.txt:5: expected a frame number from 0"),
        ("1 6 Pedestrian", "1 2 Pedestrian", "got track 2 twice in frame 1"),
        ("1 6 Pedestrian", "9 6 Pedestrian", "labels reach frame 9, but the drive has 2 images"),
        ("Pedestrian", "Van", "no usable box: expected pedestrians"),
    ],
)
def test_one_line_says_what_is_wrong(kitti: Path, old: str, new: str, message: str) -> None:
    path = kitti / "label_02" / "0007.txt"
    path.write_text(ROWS.replace(old, new))
    (video,) = open_labelled(kitti)
    with pytest.raises(RequestError, match=message):
        video.people()


def test_kittis_boxes_that_span_nothing_are_left_out_and_most_refuse(kitti: Path) -> None:
    path = kitti / "label_02" / "0007.txt"
    path.write_text(ROWS.replace(" 10 20 30 70", " 10 20 10 70").replace("40 20 60 70", "nan 20 60 70"))
    (video,) = open_labelled(kitti)
    reasons = r"1 without finite corners .line 6., 1 without an area .line 5."
    with pytest.warns(InputWarning, match=f"2 of 6 rows are left out: {reasons}"):
        assert video.people().ids.tolist() == [-1, 2, 3, 2]
    for left, right in (("1106.1", "2000"), ("1073.3", "2000"), (" 10 20 ", " 30 20 "), (" nan 20 ", " 60 20 ")):
        path.write_text(path.read_text().replace(left, right))
    with pytest.raises(RequestError, match="expected rows that can be used, but 4 of 6 cannot"):
        video.people()


def bdd(folder: Path, *labels: object, **more: object) -> Path:
    """Two good labels in two frames, and others in the third."""
    box = {"x1": 1, "y1": 2, "x2": 30, "y2": 40}
    good = {"id": "a", "category": "pedestrian", "box2d": box}
    frames = [{"frameIndex": n, "labels": [good]} for n in range(2)]
    frames.append({"frameIndex": 2, "labels": list(labels), **more})
    path = folder / "b.json"
    path.write_text(json.dumps(frames))
    return path


def test_bdd100ks_labels_that_cannot_be_used_are_left_out_and_named(tmp_path: Path) -> None:
    box = {"x1": 1, "y1": 2, "x2": 30, "y2": 40}
    bad = {
        "without an area ('b' in frame 2)": {"id": "b", "category": "pedestrian", "box2d": {**box, "x2": 1}},
        "without an id (None in frame 2)": {"category": "pedestrian", "box2d": box},
        "without a category ('c' in frame 2)": {"id": "c", "box2d": box},
        "without a finite number as y1 ('d' in frame 2)": {"id": "d", "category": "car", "box2d": {**box, "y1": None}},
    }
    for reason, label in bad.items():
        (video,) = open_labelled(bdd(tmp_path, label))
        with pytest.warns(InputWarning, match=re.escape(f"1 of 3 labels are left out: 1 {reason}")):
            assert video.people().frames.tolist() == [0, 1]
    (video,) = open_labelled(bdd(tmp_path, *bad.values()))
    with pytest.raises(RequestError, match="expected labels that can be used, but 4 of 6 cannot"):
        video.people()
    (video,) = open_labelled(bdd(tmp_path, videoName="another"))
    with pytest.raises(RequestError, match="expected the frames of one video, got those of 2"):
        video.people()


def test_what_is_missing_is_said(tmp_path: Path) -> None:
    (tmp_path / "label_02").mkdir()
    with pytest.raises(RequestError, match=r"expected label files 0000\.txt of KITTI tracking"):
        open_labelled(tmp_path)
    with pytest.raises(RequestError, match="found no such file"):
        read_kitti(tmp_path / "0000.txt")


def test_a_label_file_by_itself_is_known_by_its_rows(tmp_path: Path) -> None:
    (tmp_path / "drive.txt").write_text(ROWS)
    (video,) = open_labelled(tmp_path / "drive.txt")
    assert video.people().ids.tolist() == [-1, 2, 3, 2, 5, 6]
    rows = "1,4,100,50,20,60,1,4,0,1\n2,4,103,50,20,60,1,4,1,2\n2,0,5,5,90,90,0,0,0,0\n"
    (tmp_path / "clip.txt").write_text(rows)
    (video,) = open_labelled(tmp_path / "clip.txt")
    assert video.people(kind="car").visibility.tolist() == [0.75, 0.25, 1.0]
    # Rows of MOTChallenge have nine columns, or end in -1, and their file is called gt.txt.
    for name, text in (("gt.txt", rows), ("mot.txt", rows.replace(",1\n", ",-1\n")), ("m.txt", "1,4,9,5,2,6,1,1,1\n")):
        (tmp_path / name).write_text(text)
        (video,) = open_labelled(tmp_path / name)
        assert video.classes[2] == "person on vehicle"
