"""Appearance networks of other projects: crops in, rows of unit length out, whatever the batch."""

from __future__ import annotations

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from tests.tracking.features.tiny_onnx import save_constant
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.features import exported
from tsuiseki.tracking.features.exported import ForeignAppearance, as_describer
from tsuiseki.tracking.features.foreign_options import AppearanceOptions

BOXES = np.array([[i, i, i + 10.0, i + 20] for i in range(5)])
RAW = AppearanceOptions(mean=(0, 0, 0), std=(1, 1, 1))


def mean_colour(path, shape=("n", 3, 24, 12), keep=0):
    """Feature: the mean colour of the crop, not of unit length."""
    graph = helper.make_graph(
        [helper.make_node("ReduceMean", ["crops", "axes"], ["features"], keepdims=keep)],
        "mean",
        [helper.make_tensor_value_info("crops", TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info("features", TensorProto.FLOAT, None)],
        [numpy_helper.from_array(np.array([2, 3]), "axes")],
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9), path)
    return path


def two_inputs(path):
    crops = helper.make_tensor_value_info("crops", TensorProto.FLOAT, ["n", 3, 24, 12])
    other = helper.make_tensor_value_info("other", TensorProto.FLOAT, [1, 1, 1, 1])
    features = helper.make_tensor_value_info("features", TensorProto.FLOAT, None)
    graph = helper.make_graph(
        [helper.make_node("Add", ["crops", "other"], ["features"])], "two", [crops, other], [features]
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9), path)
    return path


def clashing(path, told=True):
    """Three means a crop by a matrix of five rows; seen when the file is read, or only when it runs."""
    graph = helper.make_graph(
        [
            helper.make_node("ReduceMean", ["crops", "axes"], ["means"], keepdims=0),
            helper.make_node("Reshape", ["means", "shape"], ["rows"]),
            helper.make_node("MatMul", ["rows", "matrix"], ["features"]),
        ],
        "clash",
        [helper.make_tensor_value_info("crops", TensorProto.FLOAT, ["n", 3, 24, 12])],
        [helper.make_tensor_value_info("features", TensorProto.FLOAT, None)],
        [
            numpy_helper.from_array(np.array([2, 3]), "axes"),
            numpy_helper.from_array(np.array([-1, 3] if told else [-1]), "shape"),
            numpy_helper.from_array(np.ones((5, 4), np.float32), "matrix"),
        ],
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9), path)
    return path


@pytest.mark.parametrize("shape", [("n", 3, 24, 12), (1, 3, 24, 12), ("n", 3, "h", "w")])
@pytest.mark.parametrize("keep", [0, 1])
def test_features_are_mean_colours_of_unit_length(tmp_path, shape, keep, monkeypatch):
    monkeypatch.setattr(exported, "BATCH", 2)
    options = AppearanceOptions(height=24, width=12, mean=(0, 0, 0), std=(1, 1, 1))
    network = as_describer(mean_colour(tmp_path / "a.onnx", shape, keep), options=options)
    assert isinstance(network, ForeignAppearance)
    image = np.full((40, 40, 3), (0, 150, 200), np.uint8)
    np.testing.assert_allclose(network.describe(image, BOXES), np.tile([0, 0.6, 0.8], (5, 1)), atol=1e-6)
    assert network.describe(image, np.empty((0, 4))).shape == (0, 3)


def test_colours_range_and_normalisation_are_as_the_user_says(tmp_path):
    path = mean_colour(tmp_path / "a.onnx")
    image = np.full((40, 40, 3), (0, 150, 200), np.uint8)
    options = AppearanceOptions(colour="BGR", pixels="bytes", mean=(100, 0, 0), std=(1, 1, 1))
    expected = np.array([100, 150, 0]) / np.hypot(100, 150)
    np.testing.assert_allclose(
        ForeignAppearance(path, options=options).describe(image, BOXES[:1]), [expected], atol=1e-6
    )
    usual = (np.array([0, 150, 200]) / 255 - AppearanceOptions().mean) / AppearanceOptions().std
    np.testing.assert_allclose(
        ForeignAppearance(path).describe(image, BOXES[:1]), [usual / np.linalg.norm(usual)], atol=1e-5
    )


def test_files_that_are_no_appearance_network_are_refused_in_one_line(tmp_path):
    size = (3, 24, 12)
    cases = {
        "height and width of its input are open": mean_colour(tmp_path / "open.onnx", ("n", 3, "h", "w")),
        "one output of features, got 4 axes and 2 outputs": save_constant(
            tmp_path / "two.onnx", {"a": np.ones(3, np.float32), "b": np.ones(3, np.float32)}, shape=("n", *size)
        ),
        r"expected features \(N, D\), got \(1, 2, 3\)": save_constant(
            tmp_path / "map.onnx", {"a": np.ones((2, 3), np.float32)}, shape=("n", *size)
        ),
        "expected a float32 or float16 input, got uint8": save_constant(
            tmp_path / "bytes.onnx", {"a": np.ones(3, np.float32)}, shape=("n", *size), kind=TensorProto.UINT8
        ),
        "expected one input, the crops, got crops, other": two_inputs(tmp_path / "inputs.onnx"),
        "got the same for two crops": save_constant(
            tmp_path / "constant.onnx", {"a": np.ones(3, np.float32)}, shape=("n", *size)
        ),
        "not a readable ONNX model; export it again; onnxruntime says: .*Incompatible dimensions": clashing(
            tmp_path / "clash.onnx"
        ),
        "the network refuses its input; onnxruntime says: ": clashing(tmp_path / "late.onnx", told=False),
        "channels before the rows": save_constant(
            tmp_path / "last.onnx", {"a": np.ones(3, np.float32)}, shape=("n", 24, 12, 3)
        ),
    }
    for message, path in cases.items():
        with pytest.raises(RequestError, match=message) as caught:
            as_describer(path)
        assert "\n" not in str(caught.value)


def test_features_without_length_are_an_error(tmp_path):
    network = ForeignAppearance(mean_colour(tmp_path / "a.onnx"), options=RAW)
    with pytest.raises(RunError, match="got zero or NaN"):
        network.describe(np.zeros((40, 40, 3), np.uint8), BOXES)
