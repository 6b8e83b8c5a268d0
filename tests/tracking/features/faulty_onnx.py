"""Faults put into small ONNX files: a batch that is baked in, results that mix the batch, a loop without an end."""

from __future__ import annotations

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

# Kinds of files that give for two at once something else than for one at a time.
BATCH_FAULTS = ("first only", "refuses", "weaker", "mixed", "swapped")


def _constant(model, name, value):
    model.graph.initializer.append(numpy_helper.from_array(np.asarray(value), name))
    return name


def spoil_batch(path, fault, outputs=None):
    """Change the file at ``path`` so that it is right for one row at a time, and for two is not.

    ``first only``: an output has one row whatever the batch. ``refuses``: onnxruntime fails. ``weaker``: values fall
    with the batch. ``mixed``: each row goes half way to the mean of the batch. ``swapped``: rows in reverse order.
    """
    model = onnx.load(path)
    graph = model.graph
    source = graph.input[0].name
    for name in outputs or [output.name for output in graph.output]:
        node = next(node for node in graph.node if name in node.output)
        raw = f"{name}_raw"
        node.output[list(node.output).index(name)] = raw
        nought, single = _constant(model, f"{name}_0", np.array([0])), _constant(model, f"{name}_1", np.array([1]))
        if fault == "first only":
            nodes = [helper.make_node("Slice", [raw, nought, single, nought], [name])]
        elif fault == "swapped":
            last = _constant(model, f"{name}_last", np.array([-1]))
            far, step = _constant(model, f"{name}_far", np.array([-(1 << 30)])), last
            nodes = [helper.make_node("Slice", [raw, last, far, nought, step], [name])]
        elif fault == "mixed":
            nodes = [
                helper.make_node("ReduceMean", [raw, nought], [f"{name}_mean"], keepdims=1),
                helper.make_node("Add", [raw, f"{name}_mean"], [f"{name}_sum"]),
                helper.make_node("Mul", [f"{name}_sum", _constant(model, f"{name}_half", np.float32(0.5))], [name]),
            ]
        else:
            count = [
                helper.make_node("Shape", [source], [f"{name}_rows"], start=0, end=1),
                helper.make_node("Cast", [f"{name}_rows"], [f"{name}_count"], to=TensorProto.FLOAT),
            ]
            if fault == "weaker":
                nodes = [*count, helper.make_node("Div", [raw, f"{name}_count"], [name])]
            else:
                # Noughts, one a row, that only a single row can be reshaped to.
                nought_at = _constant(model, f"{name}_f", np.float32(0))
                nodes = [
                    *count,
                    helper.make_node("Expand", [nought_at, f"{name}_rows"], [f"{name}_noughts"]),
                    helper.make_node("Reshape", [f"{name}_noughts", single], [f"{name}_nought"]),
                    helper.make_node("Add", [raw, f"{name}_nought"], [name]),
                ]
        graph.node.extend(nodes)
    for output in graph.output:
        output.type.tensor_type.ClearField("shape")
    onnx.save(model, path)
    return path


def add_endless_loop(path):
    """Change the file at ``path`` so that it never ends: a loop whose condition stays true."""
    model = onnx.load(path)
    graph = model.graph
    name = graph.output[0].name
    node = next(node for node in graph.node if name in node.output)
    node.output[list(node.output).index(name)] = f"{name}_raw"
    kind = graph.output[0].type.tensor_type.elem_type
    body = helper.make_graph(
        [helper.make_node("Identity", ["goes_on"], ["on"]), helper.make_node("Abs", ["value"], ["next_value"])],
        "body",
        [
            helper.make_tensor_value_info("turn", TensorProto.INT64, []),
            helper.make_tensor_value_info("goes_on", TensorProto.BOOL, []),
            helper.make_tensor_value_info("value", kind, None),
        ],
        [
            helper.make_tensor_value_info("on", TensorProto.BOOL, []),
            helper.make_tensor_value_info("next_value", kind, None),
        ],
    )
    true = _constant(model, "true", np.array(True))
    graph.node.append(helper.make_node("Loop", ["", true, f"{name}_raw"], [name], body=body))
    onnx.save(model, path)
    return path
