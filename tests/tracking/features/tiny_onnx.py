"""Tiny ONNX files that give the same for every picture, as detectors of other projects would."""

from __future__ import annotations

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

HEIGHT, WIDTH = 64, 96


def save_constant(
    path, outputs, *, shape=("batch", 3, HEIGHT, WIDTH), kind=TensorProto.FLOAT, metadata=None, opset=18, plain=()
):
    """A network whose ``outputs`` (name to array without batch axis) do not depend on the picture.

    Those named in ``plain`` have no batch axis, as torchvision's.
    """
    constants, nodes, infos = {}, [], []
    constants["axes"] = np.arange(1 if len(shape) == 4 and not plain else 0, len(shape))
    constants["nothing"] = np.zeros(1, np.float32)
    nodes += [
        helper.make_node("Cast", ["images"], ["floats"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMean", ["floats", "axes"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "nothing"], ["zero"]),
    ]
    for name, value in outputs.items():
        batched = name not in plain
        value = value[None] if batched else value
        constants[f"{name}_value"] = value
        constants[f"{name}_shape"] = np.array([-1] + [1] * (value.ndim - 1))
        type_ = helper.np_dtype_to_tensor_dtype(value.dtype)
        nodes += [
            helper.make_node("Reshape", ["zero", f"{name}_shape"], [f"{name}_zero"]),
            helper.make_node("Cast", [f"{name}_zero"], [f"{name}_typed"], to=type_),
            helper.make_node("Add", [f"{name}_typed", f"{name}_value"], [name]),
        ]
        infos.append(helper.make_tensor_value_info(name, type_, [None] * value.ndim))
    graph = helper.make_graph(
        nodes,
        "tiny",
        [helper.make_tensor_value_info("images", kind, shape)],
        infos,
        [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=9)
    if metadata:
        helper.set_model_props(model, metadata)
    onnx.save(model, path)
    return path


def cells(height=HEIGHT, width=WIDTH):
    """Column, row and stride ``(N, 3)`` of every cell at strides 8, 16 and 32."""
    rows = [
        (column, row, stride)
        for stride in (8, 16, 32)
        for row in range(height // stride)
        for column in range(width // stride)
    ]
    return np.array(rows, dtype=np.float32)
