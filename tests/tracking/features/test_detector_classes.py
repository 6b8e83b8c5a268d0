"""Detectors that are asked for classes: each layout gives them, by number or name, apart or together."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.tracking.features.test_exported import fake_detector
from tests.tracking.features.test_foreign_detector import CELLS, CORNERS, LAYOUTS, NAMES, saved
from tests.tracking.features.tiny_onnx import HEIGHT, WIDTH, save_constant
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import open_detector
from tsuiseki.tracking.features.foreign_options import DetectorOptions
from tsuiseki.tracking.features.tiles import merge
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.class_choice import ClassChoice

IMAGE = np.zeros((HEIGHT, WIDTH, 3), np.uint8)


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_layout_gives_the_classes_that_are_asked_for(tmp_path, name):
    path, first = saved(tmp_path, name, metadata=NAMES), int(name == "tensorflow")
    for wanted in (["Dog", "person"], [first + 1, "person"]):
        detector = open_detector(path, classes=ClassChoice(wanted))
        (found,) = detector.detect([IMAGE])
        order = np.argsort(-found.scores)
        np.testing.assert_allclose(found.boxes[order], CORNERS[[3, 0, 1]], atol=1e-3)
        assert (found.classes[order] - first).tolist() == [1, 0, 0]
        assert found.names == {first: "person", first + 1: "dog"}
        assert not detector.people_only
    assert len(open_detector(path, classes=ClassChoice(["car"])).detect([IMAGE])[0]) == 0
    assert open_detector(path).detect([IMAGE])[0].classes is None
    with pytest.raises(RequestError, match=f"\\({first} person, {first + 1} dog, {first + 2} car\\), got cat$"):
        open_detector(path, classes=ClassChoice(["cat"]))


def test_numbers_do_where_nothing_has_a_name(tmp_path):
    path = saved(tmp_path, "yolov8")
    (found,) = open_detector(path, classes=ClassChoice([1])).detect([IMAGE])
    assert (found.classes.tolist(), found.names) == ([1], {1: ""})
    with pytest.raises(RequestError, match=r"\(0, 1, 2\), got dog; it names none, so give numbers, or their names"):
        open_detector(path, classes=ClassChoice(["dog"]))
    with pytest.raises(RequestError, match=r"\(0, 1, 2\), got 3$"):
        open_detector(path, classes=ClassChoice([3]))
    told = DetectorOptions(classes=("person", "dog", "car"))
    assert open_detector(path, options=told, classes=ClassChoice(["dog"])).wanted == {1: "dog"}


def test_coco_is_known_by_its_number_of_classes(tmp_path):
    rows = np.zeros((84, len(CELLS)), np.float32)
    path = save_constant(tmp_path / "coco.onnx", {"o": rows})
    assert open_detector(path, classes=ClassChoice(["bus", "car", 79])).wanted == {5: "bus", 2: "car", 79: "toothbrush"}
    with pytest.raises(RequestError, match=r"…\), got pedestrian"):
        open_detector(path, classes=ClassChoice(["pedestrian"]))


@pytest.mark.parametrize("across", [False, True])
def test_boxes_of_two_classes_suppress_each_other_only_across(tmp_path, across):
    rows = np.zeros((7, len(CELLS)), np.float32)
    rows[:4, :2], rows[4:, :2] = np.array([[50, 30, 20, 40], [51, 30, 20, 40]]).T, np.diag([0, 0.6, 0.8])[:, 1:]
    path = save_constant(tmp_path / "two.onnx", {"o": rows}, metadata=NAMES)
    (found,) = open_detector(path, classes=ClassChoice(["dog", "car"], across)).detect([IMAGE])
    assert found.classes.tolist() == ([2] if across else [2, 1])
    tiles = np.array([[0, 0, WIDTH, HEIGHT]] * 2)
    joined = merge([found, found], tiles, across=across)
    assert (joined.classes.tolist(), joined.names) == (found.classes.tolist(), found.names)


def test_a_detector_of_this_toolkit_numbers_its_classes_from_1(tmp_path):
    path = fake_detector(tmp_path / "people.onnx")
    (people,) = open_detector(path).detect([IMAGE])
    detector = open_detector(path, classes=ClassChoice(["person"]))
    (found,) = detector.detect([IMAGE])
    np.testing.assert_array_equal(found.boxes, people.boxes)
    assert (people.classes, found.classes.tolist(), found.names) == (None, [1] * len(people), {1: "person"})
    assert detector.people_only
    with pytest.raises(RequestError, match=r"expected classes of .*people.onnx \(1 person\), got car"):
        open_detector(path, classes=ClassChoice(["person", "car"]))


def test_rows_stay_those_of_the_detector_through_selections():
    found = Detections(np.tile([0.0, 0, 5, 5], (4, 1)), np.array([0.1, 0.9, 0.2, 0.8]), classes=np.array([2, 1, 1, 1]))
    assert found.select(found.scores > 0.15).select(np.array([2, 0])).origin.tolist() == [[3, 1], [1, 1]]
    with pytest.raises(ValueError, match="expected 4 classes"):
        dataclasses.replace(found, classes=np.array([1]))
