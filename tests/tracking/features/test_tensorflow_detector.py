"""Detectors of TensorFlow's Object Detection API: bytes with the channels last, boxes with y before x."""

from __future__ import annotations

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from tests.tracking.features.test_foreign_detector import BYTES, CORNERS, saved, tensorflow
from tests.tracking.features.tiny_onnx import HEIGHT, WIDTH, save_constant
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import open_detector
from tsuiseki.tracking.features.foreign_options import DetectorOptions


def test_a_frozen_graph_of_tensorflow_takes_bytes_of_any_size_and_may_give_more(tmp_path):
    outputs = tensorflow(":0") | {"raw_detection_boxes": np.zeros((7, 4), np.float32)}
    path = save_constant(tmp_path / "frozen.onnx", outputs, shape=("n", "h", "w", 3), kind=TensorProto.UINT8)
    with pytest.raises(RequestError, match="an unknown number of classes without names; say which one is people"):
        open_detector(path)
    detector = open_detector(path, options=DetectorOptions(person=1))
    assert str(detector) == "layout tensorflow, people are class 1; pictures as-is, RGB, bytes, any size"
    large = np.zeros((4 * HEIGHT, 2 * WIDTH, 3), np.uint8)
    for found in detector.detect([large, large]):
        np.testing.assert_allclose(found.boxes, CORNERS[:2] * [2, 4, 2, 4], atol=1e-3)
    # Tiles of a frame are not all of one size.
    for found, factor in zip(detector.detect([large, large[:HEIGHT, :WIDTH]]), (4, 1), strict=True):
        np.testing.assert_allclose(found.boxes[:, 1::2], CORNERS[:2, 1::2] * factor, atol=1e-3)
    with pytest.raises(RequestError, match=r"normalises them itself; leave `detector_options\.mean` out"):
        open_detector(path, options=DetectorOptions(person=1, mean=(0.5, 0.5, 0.5)))
    floats = save_constant(tmp_path / "floats.onnx", tensorflow(), shape=("n", "h", "w", 3))
    several = save_constant(tmp_path / "several.onnx", tensorflow(), **BYTES | {"shape": (4, HEIGHT, WIDTH, 3)})
    for bad, got in ((floats, "nxhxwx3 float"), (several, f"4x{HEIGHT}x{WIDTH}x3 uint8")):
        with pytest.raises(RequestError, match=rf"3\) of uint8, N 1 or any, .* got images {got}; convert it again"):
            open_detector(bad, options=DetectorOptions(person=1))
    with pytest.raises(RequestError, match=r"layout tensorflow asks for outputs detection_boxes, .*, got output0"):
        open_detector(saved(tmp_path, "yolov8"), options=DetectorOptions(layout="tensorflow", person=1))


def test_bytes_come_as_they_are_in_the_order_that_the_user_says_and_each_picture_has_its_own_rows(tmp_path):
    """The score of a picture's one box is the mean of its first channel."""
    wanted = {"detection_boxes": [0.25, 0.25, 0.75, 0.5], "detection_classes": 1.0, "num_detections": 1.0}
    shapes = {"detection_boxes": [-1, 1, 1], "detection_classes": [-1, 1], "num_detections": [-1]}
    nodes = [
        helper.make_node("Cast", ["image_tensor"], ["floats"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMean", ["floats", "axes"], ["means"], keepdims=0),
        helper.make_node("Slice", ["means", "from", "to", "axis"], ["first"]),
        helper.make_node("Div", ["first", "white"], ["detection_scores"]),
        helper.make_node("Mul", ["first", "nothing"], ["zero"]),
    ]
    constants = {"axes": [1, 2], "from": [0], "to": [1], "axis": [1]}
    numbers = {"white": 255.0, "nothing": 0.0}
    for name, value in wanted.items():
        nodes.append(helper.make_node("Reshape", ["zero", f"{name}_shape"], [f"{name}_zero"]))
        nodes.append(helper.make_node("Add", [f"{name}_zero", f"{name}_value"], [name]))
        constants[f"{name}_shape"], numbers[f"{name}_value"] = shapes[name], value
    graph = helper.make_graph(
        nodes,
        "mean",
        [helper.make_tensor_value_info("image_tensor", TensorProto.UINT8, ["n", None, None, 3])],
        [
            helper.make_tensor_value_info(name, TensorProto.FLOAT, [None] * len(shapes.get(name, [1, 1])))
            for name in (*wanted, "detection_scores")
        ],
        [onnx.numpy_helper.from_array(np.array(v), k) for k, v in constants.items()]
        + [onnx.numpy_helper.from_array(np.array(v, np.float32), k) for k, v in numbers.items()],
    )
    path = tmp_path / "first.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9), path)
    images = [np.full((HEIGHT, WIDTH, 3), colour, np.uint8) for colour in ((204, 51, 102), (51, 0, 153))]
    for colour, scores in (("RGB", (0.8, 0.2)), ("BGR", (0.4, 0.6))):
        detector = open_detector(path, 0.1, options=DetectorOptions(person=1, colour=colour))
        for found, score in zip(detector.detect(images), scores, strict=True):
            np.testing.assert_allclose(found.boxes, [[24, 16, 48, 48]], atol=1e-3)
            np.testing.assert_allclose(found.scores, [score], atol=1e-5)
