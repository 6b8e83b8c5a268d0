"""Rotated boxes: overlaps against closed forms, average precision, label files."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.datamodules.labelled_images import labelled_images
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.detection import evaluate_rotated
from tsuiseki.tracking.evaluation.result_files import read_truths
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.tracking.formats.rotated import (
    RotatedBoxes,
    about_bodies,
    half_turned,
    is_rotated,
    read_rotated_detections,
    read_rotated_labels,
    write_rotated_detections,
)
from tsuiseki.tracking.geometry import iou_matrix, rotated_iou
from tsuiseki.tracking.weights import shipped


def boxes_of(*rows):
    return np.array(rows, dtype=np.float64).reshape(-1, 5)


def annotations(path, rows):
    entries = [{"image_id": image, "bbox": box, "person_id": person} for image, box, person in rows]
    path.write_text(json.dumps({"annotations": entries}))
    return path


def test_upright_boxes_overlap_as_ever():
    rng = np.random.default_rng(0)
    a, b = (np.column_stack([rng.uniform(0, 60, (12, 2)), rng.uniform(5, 40, (12, 2)), np.zeros(12)]) for _ in "ab")
    # OpenCV's intersection is in single precision.
    assert np.allclose(rotated_iou(a, b), iou_matrix(about_bodies(a), about_bodies(b)), atol=1e-5)


def test_a_square_turned_by_an_eighth():
    shared = 8 * (np.sqrt(2) - 1)  # a regular octagon about a circle of radius 1, twice over
    got = rotated_iou(boxes_of([500, 500, 2, 2, 0]), boxes_of([500, 500, 2, 2, np.pi / 4]))[0, 0]
    assert np.isclose(got, shared / (8 - shared), atol=1e-5)


def test_half_a_turn_and_exchanged_sides_are_the_same_box():
    a = boxes_of([10, 10, 4, 9, 0.4])
    assert np.isclose(rotated_iou(a, boxes_of([10, 10, 4, 9, 0.4 + np.pi]))[0, 0], 1, atol=1e-5)
    assert np.isclose(rotated_iou(a, boxes_of([10, 10, 9, 4, 0.4 + np.pi / 2]))[0, 0], 1, atol=1e-5)


def test_a_quarter_turn_becomes_minus_a_quarter():
    assert np.allclose(np.degrees(half_turned(np.radians([90.0, -90.0, 89.0, 100.0]))), [-90, -90, 89, -80])


def test_average_precision_by_hand():
    box = boxes_of([0, 0, 10, 20, 0.5])
    truth = {"a": RotatedBoxes(box, np.array([-1]), np.ones(1)), "b": RotatedBoxes(box + 1, np.array([-1]), np.ones(1))}
    found = {
        "a": RotatedBoxes(np.concatenate([box, box]), np.array([-1, -1]), np.array([0.9, 0.8])),
        "b": RotatedBoxes(box + 1, np.array([-1]), np.array([0.7])),
    }
    # Right, double, right: precision 1, 1/2, 2/3 at recall 1/2, 1/2, 1.
    assert np.isclose(evaluate_rotated(truth, found).average_precision, 0.5 + 0.5 * 2 / 3)
    assert evaluate_rotated(truth, {}).average_precision == 0
    with pytest.raises(RequestError, match="labelled images"):
        evaluate_rotated(truth, {"c": found["a"]})


def test_ids_that_come_twice_in_an_image_stay_apart(tmp_path):
    path = annotations(
        tmp_path / "a.json", [("x", [5, 5, 2, 4, 90], 3), ("x", [9, 9, 2, 4, 0], 3), ("y", [5, 5, 2, 4, 0], 3)]
    )
    labels = read_rotated_labels(path)
    assert labels["x"].ids.tolist() == [3, 4]
    assert labels["y"].ids.tolist() == [3]
    assert np.isclose(np.degrees(labels["x"].boxes[0, 4]), -90)
    truth = read_truths(path)[0]
    assert truth.labels.frames.tolist() == [0, 0, 1]
    assert truth.labels.ids.tolist() == [4, 5, 4]
    assert np.allclose(truth.labels.boxes[0], [3, 4, 7, 6])


def test_habbof_is_a_folder_of_text(tmp_path):
    (tmp_path / "1.txt").write_text("person 10 20 4 8 -45\n\nperson 30 20 4 8 90\n")
    (tmp_path / "0.txt").write_text("")
    (tmp_path / "2.txt").write_text("")
    assert is_rotated(tmp_path)
    labels = read_rotated_labels(tmp_path)
    assert [len(labels[name].boxes) for name in ("1", "2")] == [2, 0]


def test_detections_come_back(tmp_path):
    found = {"a": RotatedBoxes(boxes_of([1, 2, 3, 4, 0.5]), np.array([-1]), np.array([0.25]))}
    write_rotated_detections(tmp_path / "d.json", found)
    back = read_rotated_detections(tmp_path / "d.json")["a"]
    assert np.allclose(back.boxes, found["a"].boxes, atol=1e-5)
    assert back.scores.tolist() == [0.25]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"annotations": [{"image_id": "a", "bbox": [1, 2, 3, 4]}]}', "1 without cx, cy, w, h and degrees"),
        ('{"annotations": [{"image_id": "a", "bbox": [1, 2, 0, 4, 5]}]}', "positive w and h"),
        ('{"annotations": [{"bbox": [1, 2, 3, 4, 5]}]}', "an image_id"),
        ('{"annotations": []}', "labelled boxes"),
        ("[", "expected JSON"),
    ],
)
def test_broken_labels_are_named(tmp_path, text, message):
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(RequestError, match=message):
        read_rotated_labels(path)


def test_the_command_scores_rotated_boxes(tmp_path, capsys):
    truth = annotations(tmp_path / "truth.json", [("x", [50, 50, 20, 40, 30], None)])
    found = tmp_path / "found.json"
    found.write_text(json.dumps([{"image_id": "x", "bbox": [50, 50, 20, 40, 31], "score": 0.9}]))
    assert main(["evaluate", "detection", str(truth), str(found)]) == 0
    assert "1.000" in capsys.readouterr().out
    # A network is scored by the upright boxes, as it learns from them.
    cv2.imwrite(str(tmp_path / "x.jpg"), np.zeros((90, 90, 3), np.uint8))
    assert main(["evaluate", "detection", str(truth), str(shipped("detector_street"))]) == 0
    assert "0.000" in capsys.readouterr().out


@pytest.mark.integration
def test_the_real_labels_are_read(data_folder):
    folder = Path(data_folder) / "fisheye"
    assert sum(len(e.boxes) for e in read_rotated_labels(folder / "rotated-boxes" / "annotations.json").values()) == 125
    truth = read_truths(folder / "cepdof-sample" / "annotations.json")[0]
    # Seven people; in two frames one of their ids comes a second time, which makes two more.
    assert (truth.length, len(set(truth.labels.ids.tolist()))) == (10, 9)


def test_people_in_rotated_boxes_teach_by_upright_ones(tmp_path):
    for folder in ("Lunch", "Meeting"):
        (tmp_path / folder).mkdir()
        for name in ("b", "a"):
            cv2.imwrite(str(tmp_path / folder / f"{name}.jpg"), np.zeros((90, 90, 3), np.uint8))
    (tmp_path / "annotations").mkdir()
    rows = [("b", [30, 40, 10, 20, 90], 0), ("a", [20, 20, 8, 8, 0], None)]
    path = annotations(tmp_path / "annotations" / "Lunch.json", rows)
    (tmp_path / "Meeting" / "a.txt").write_text("person 20 20 8 8 0\n")
    (tmp_path / "Meeting" / "b.txt").write_text("person 30 40 20 10 0\n")
    (video,) = open_labelled(tmp_path)
    assert video.files == (tmp_path / "Lunch" / "a.jpg", tmp_path / "Lunch" / "b.jpg")
    with pytest.warns(InputWarning, match="1 of 2 labelled boxes are left out: 1 without an id"):
        assert video.people().boxes.round(6).tolist() == [[20, 35, 40, 45]]
    upright = [[[16, 16, 24, 24]], [[20, 35, 40, 45]]]
    for place in (path, tmp_path / "Meeting"):
        assert [one.boxes.round(6).tolist() for one in labelled_images(place)] == upright
    # As whole data sets lie: a folder of folders, and pictures under frames.
    path.unlink()
    assert [one.name for one in open_labelled(tmp_path)] == ["Meeting"]
    (tmp_path / "frames").mkdir()
    (tmp_path / "Lunch").rename(tmp_path / "frames" / "Lunch")
    annotations(path, rows)
    (video,) = open_labelled(tmp_path)
    assert [image.name for image in video.files] == ["a.jpg", "b.jpg"]
    with pytest.raises(RequestError, match="expected labelled video, such as"):
        open_labelled(tmp_path / "frames")


def test_rotated_labels_that_cannot_be_used_are_left_out_and_images_are_in_the_order_of_numbers(tmp_path):
    rows = [(str(n), [30, 40, 10, 20, n], n) for n in (10, 9, 1)]
    rows += [("1", [30, 40, 0, 20, 0], 4), ("1", [30, 40, None, 20, 0], 5), ("1", [30, 40, 10, 20], 6)]
    path = annotations(tmp_path / "a.json", rows)
    assert is_rotated(path)
    with pytest.warns(
        InputWarning, match=r"3 of 6 annotations are left out: 1 without a positive w and h .annotation 4"
    ):
        labels = read_rotated_labels(path)
    assert {name: image.ids.tolist() for name, image in labels.items()} == {"1": [1], "9": [9], "10": [10]}
    assert [*labels] == ["1", "9", "10"]
    found = tmp_path / "d.json"
    found.write_text(
        json.dumps([{"image_id": "1", "bbox": box, "score": 1} for box in ([1, 2, 3, 4, 5], [1, 2, 0, 4, 5])])
    )
    with pytest.warns(InputWarning, match="1 of 2 detections are left out"):
        assert len(read_rotated_detections(found)["1"].boxes) == 1
