"""YOLOs that give key points or masks beside boxes, and those with finer or coarser maps, are detectors, too."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tracking.features.test_foreign_detector import CENTRES, CLASSES, CORNERS, NAMES, PER_CLASS, SCORES
from tests.tracking.features.tiny_onnx import HEIGHT, WIDTH, cells, save_constant
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.detector_layouts import STRIDE_SETS, cell_count
from tsuiseki.tracking.features.exported import open_detector
from tsuiseki.tracking.features.foreign_options import DetectorOptions
from tsuiseki.tracking.types.class_choice import ClassChoice

BLANK = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
PERSON = "{0: 'person'}"
KEPT = [0, 1, 3]
POSE = {"task": "pose", "names": PERSON, "kpt_shape": "[17, 3]"}
SEGMENT = {"task": "segment", **NAMES}
MAPS = {"output1": np.full((32, HEIGHT // 4, WIDTH // 4), 0.5, np.float32)}
PEOPLE_ONLY = PER_CLASS[:, :1]


def in_cells(values, more, *, count=None, objectness=False):
    """A row for each cell: the first four hold a box, scores and then ``more`` values, as of noise."""
    count = len(cells()) if count is None else count
    rng = np.random.default_rng(0)
    columns = [
        np.zeros((count, 4)),
        *([np.zeros((count, 1))] if objectness else []),
        np.zeros((count, values.shape[1])),
    ]
    rows = np.concatenate([*columns, rng.normal(0, 40, (count, more))], axis=1).astype(np.float32)
    rows[:4, :4] = CENTRES
    scores = [np.ones((4, 1)), values] if objectness else [values]
    rows[:4, 4 : 4 + sum(x.shape[1] for x in scores)] = np.concatenate(scores, axis=1)
    return rows


def suppressed(more, filled=KEPT):
    rows = np.zeros((300, 6 + more), np.float32)
    values = [CORNERS[filled], SCORES[filled, None], CLASSES[filled, None]]
    rows[: len(filled)] = np.concatenate([*values, np.full((len(filled), more), 33.0)], axis=1)
    return rows


POSE_ROWS = in_cells(PEOPLE_ONLY, 51)
SEGMENT_ROWS = in_cells(PER_CLASS, 32)
# By what is exported: the outputs, the metadata, the user's options, the layout.
FILES = {
    "YOLOv8 pose": ({"output0": POSE_ROWS.T.copy()}, POSE, {}, "yolov8"),
    "YOLOv8 pose of two classes and five points": (
        {"output0": in_cells(PER_CLASS[:, :2], 10).T.copy()},
        {"task": "pose", "names": "{0: 'person', 1: 'dog'}", "kpt_shape": "[5, 2]"},
        {},
        "yolov8",
    ),
    "the same, of which the file says only the task": (
        {"output0": POSE_ROWS.T.copy()},
        {"task": "pose", "names": PERSON},
        {},
        "yolov8",
    ),
    "the same, of which the file says nothing": ({"output0": POSE_ROWS.T.copy()}, {}, {}, "yolov8"),
    "the same, of which the user says the classes": (
        {"output0": POSE_ROWS.T.copy()},
        {},
        {"classes": ("person",)},
        "yolov8",
    ),
    "the same, of which the user says the class": ({"output0": POSE_ROWS.T.copy()}, {}, {"person": 0}, "yolov8"),
    "the same, of which the user says the layout": (
        {"output0": POSE_ROWS.T.copy()},
        {},
        {"layout": "yolov8"},
        "yolov8",
    ),
    "YOLOv8 segmentation": ({"output0": SEGMENT_ROWS.T.copy(), **MAPS}, SEGMENT, {}, "yolov8"),
    "the same, without metadata": ({"output0": SEGMENT_ROWS.T.copy(), **MAPS}, {}, {"person": 0}, "yolov8"),
    "the same, masks first": ({**MAPS, "output0": SEGMENT_ROWS.T.copy()}, NAMES, {}, "yolov8"),
    "the same, masks cut off": ({"output0": SEGMENT_ROWS.T.copy()}, SEGMENT, {}, "yolov8"),
    "YOLOv5 segmentation": (
        {"output0": in_cells(PER_CLASS, 32, count=3 * len(cells()), objectness=True), **MAPS},
        NAMES,
        {},
        "yolov5",
    ),
    "YOLOv7 pose": ({"output": in_cells(PEOPLE_ONLY, 51, count=3 * len(cells()), objectness=True)}, {}, {}, "yolov5"),
    "YOLO26 pose": ({"output0": suppressed(51)}, POSE, {}, "yolo-suppressed"),
    "YOLO26 segmentation": ({"output0": suppressed(32), **MAPS}, SEGMENT, {}, "yolo-suppressed"),
    "YOLO26 segmentation without metadata": (
        {"output0": suppressed(32), **MAPS},
        {},
        {"person": 0},
        "yolo-suppressed",
    ),
}


@pytest.mark.parametrize("file", FILES)
def test_boxes_and_scores_are_read_and_what_comes_after_them_is_left(tmp_path, file):
    outputs, metadata, options, layout = FILES[file]
    path = save_constant(tmp_path / "d.onnx", outputs, metadata=metadata)
    detector = open_detector(path, options=DetectorOptions(**options))
    assert (detector.layout, detector.person, detector.scores) == (layout, 0, None)
    for found in detector.detect([BLANK, BLANK]):
        order = np.argsort(-found.scores)
        np.testing.assert_allclose(found.boxes[order], CORNERS[:2], atol=1e-3)
        np.testing.assert_allclose(found.scores[order], SCORES[:2], atol=1e-4)


def test_classes_are_those_of_the_names_alone(tmp_path):
    path = save_constant(tmp_path / "d.onnx", {"output0": SEGMENT_ROWS.T.copy(), **MAPS}, metadata=SEGMENT)
    (found,) = open_detector(path, classes=ClassChoice(["dog", "person"])).detect([BLANK])
    assert sorted(found.classes.tolist()) == [0, 0, 1]
    with pytest.raises(RequestError, match=r"\(0 person, 1 dog, 2 car\), got 3$"):
        open_detector(path, classes=ClassChoice([3]))
    plain = save_constant(tmp_path / "plain.onnx", {"output0": SEGMENT_ROWS.T.copy(), **MAPS})
    with pytest.raises(RequestError, match=r"as many classes as .* have, 3 \(layout yolov8\), got 2"):
        open_detector(plain, options=DetectorOptions(classes=("person", "car")))


def test_rows_that_noise_leaves_empty_are_known_by_the_task(tmp_path):
    detector = open_detector(save_constant(tmp_path / "e.onnx", {"output0": suppressed(51, [])}, metadata=POSE))
    assert detector.layout == "yolo-suppressed"
    assert [len(found) for found in detector.detect([BLANK, BLANK])] == [0, 0]


@pytest.mark.parametrize("strides", STRIDE_SETS, ids=str)
@pytest.mark.parametrize("kind", ["yolov8", "yolov5", "yolov8-rows", "pose"])
def test_networks_of_finer_and_coarser_maps_are_detectors(tmp_path, strides, kind):
    count = cell_count((HEIGHT, WIDTH), strides)
    if kind == "yolov5":
        outputs, metadata = in_cells(PER_CLASS, 0, count=3 * count, objectness=True), NAMES
    elif kind == "pose":
        outputs, metadata = in_cells(PEOPLE_ONLY, 51, count=count).T.copy(), POSE
    elif kind == "yolov8":
        outputs, metadata = in_cells(PER_CLASS, 0, count=count).T.copy(), NAMES
    else:
        outputs, metadata = in_cells(PER_CLASS, 0, count=count), NAMES
        middles = [
            ((column + 0.5) * stride, (row + 0.5) * stride)
            for stride in strides
            for row in range(-(-HEIGHT // stride))
            for column in range(-(-WIDTH // stride))
        ]
        outputs[4:, :2] = middles[4:]
    detector = open_detector(save_constant(tmp_path / "d.onnx", {"output0": outputs}, metadata=metadata))
    assert detector.layout == ("yolov8" if kind == "pose" else kind)
    (found,) = detector.detect([BLANK])
    order = np.argsort(-found.scores)
    np.testing.assert_allclose(found.boxes[order], CORNERS[:2], atol=1e-3)
