"""Networks of the three layouts that learn nothing: mean squares of differences to the template's middle part.

Pictures are averaged over cells of 16 pixels. The score falls with the mean square of the differences between the
template's middle cells, about what the target covers, and the cells about each place.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from tsuiseki.tracking.onnx import METADATA_KEY, ModelCard

STRIDE = 16
# Cells of the template that are compared, in each direction: half of its side.
CELLS = 4
# Mean square of differences, of values in [0, 1], at which the score is 1 / e.
WIDTH = 0.01


def constant(name, values):
    return numpy_helper.from_array(np.asarray(values), name)


def pooled(picture, name, largest):
    """Nodes from a picture to ``(1, 4, S, S)``: mean values in [0, 1] of cells, and the mean of all channels."""
    return [
        helper.make_node("AveragePool", [picture], [f"{name}_cells"], kernel_shape=[STRIDE] * 2, strides=[STRIDE] * 2,
                         ceil_mode=1, count_include_pad=0),
        helper.make_node("Div", [f"{name}_cells", largest], [f"{name}_unit"]),
        helper.make_node("ReduceMean", [f"{name}_unit", "channel_axis"], [f"{name}_grey"]),
        helper.make_node("Concat", [f"{name}_unit", f"{name}_grey"], [name], axis=1),
    ]  # fmt: skip


def compared(template, search, pads):
    """Nodes from features to ``difference`` ``(1, 1, S, S)``, mean squares over ``WIDTH``."""
    convolved = {"pads": pads, "kernel_shape": [CELLS] * 2}
    return [
        helper.make_node("Slice", [template, "begin", "end", "axes"], ["middle"]),
        helper.make_node("Conv", [search, "middle"], ["products"], **convolved),
        helper.make_node("Mul", [search, search], ["squares"]),
        helper.make_node("Conv", ["squares", "ones"], ["energy"], **convolved),
        helper.make_node("Mul", ["middle", "middle"], ["middle_squares"]),
        helper.make_node("ReduceSum", ["middle_squares", "all_axes"], ["middle_energy"]),
        helper.make_node("Mul", ["products", "two"], ["twice"]),
        helper.make_node("Sub", ["energy", "twice"], ["partly"]),
        helper.make_node("Add", ["partly", "middle_energy"], ["sums"]),
        helper.make_node("Div", ["sums", "scale"], ["difference"]),
    ]


COMPARISON = [
    constant("begin", np.array([2, 2], dtype=np.int64)), constant("end", np.array([6, 6], dtype=np.int64)),
    constant("axes", np.array([2, 3], dtype=np.int64)), constant("all_axes", np.array([0, 1, 2, 3], dtype=np.int64)),
    constant("ones", np.ones((1, 4, CELLS, CELLS), dtype=np.float32)), constant("two", np.float32(2)),
    constant("scale", np.float32(WIDTH * 4 * CELLS**2)),
]  # fmt: skip
POOLING = [constant("channel_axis", np.array([1], dtype=np.int64))]


def saved(path: Path, nodes, inputs, outputs, constants, card=None) -> Path:
    """An ONNX file of ``nodes``; inputs and outputs are shapes by name."""
    infos = [
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in of.items()]
        for of in (inputs, outputs)
    ]
    graph = helper.make_graph(nodes, "tiny", *infos, constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=8)
    if card is not None:
        helper.set_model_props(model, {METADATA_KEY: card.to_json()})
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())
    return path


def nanotrack(folder: Path) -> list[Path]:
    """Backbone and head; a target is as large as half the template's side."""
    backbone = saved(
        folder / "backbone.onnx", pooled("input", "output", "largest"), {"input": [1, 3, 255, 255]},
        {"output": [1, 4, 16, 16]}, [*POOLING, constant("largest", np.float32(255))],
    )  # fmt: skip
    half = np.full((1, 4, 16, 16), STRIDE * CELLS / 2, dtype=np.float32)
    head = saved(
        folder / "head.onnx",
        [
            *compared("input1", "input2", [CELLS // 2, CELLS // 2, CELLS // 2 - 1, CELLS // 2 - 1]),
            helper.make_node("Sub", ["four", "difference"], ["logit"]),
            helper.make_node("Concat", ["difference", "logit"], ["output1"], axis=1),
            helper.make_node("Identity", ["half"], ["output2"]),
        ],
        {"input1": [1, 4, 8, 8], "input2": [1, 4, 16, 16]},
        {"output1": [1, 2, 16, 16], "output2": [1, 4, 16, 16]},
        [*COMPARISON, constant("half", half), constant("four", np.float32(4))],
    )
    return [backbone, head]


def vittrack(folder: Path) -> list[Path]:
    """One file of two pictures, normalised as ImageNet's are."""
    unit = {"template": [1, 3, 128, 128], "search": [1, 3, 256, 256]}
    share = np.full((1, 2, 16, 16), 0.25, dtype=np.float32)
    return [
        saved(
            folder / "vittrack.onnx",
            [
                *pooled("template", "template_features", "largest"),
                *pooled("search", "search_features", "largest"),
                *compared("template_features", "search_features", [2, 2, 1, 1]),
                helper.make_node("Neg", ["difference"], ["exponent"]),
                helper.make_node("Exp", ["exponent"], ["output1"]),
                helper.make_node("Identity", ["share"], ["output2"]),
                helper.make_node("Identity", ["nothing"], ["output3"]),
            ],
            unit,
            {"output1": [1, 1, 16, 16], "output2": [1, 2, 16, 16], "output3": [1, 2, 16, 16]},
            [*COMPARISON, *POOLING, constant("share", share), constant("nothing", 0 * share),
             constant("largest", np.float32(4))],
        )
    ]  # fmt: skip


def own(folder: Path) -> list[Path]:
    """``template.onnx`` and ``search.onnx``, with their cards."""
    cards = {
        part: ModelCard(
            "tracker", "siamese", input_height=side, input_width=side, mean=(0.0,) * 3, std=(1.0,) * 3,
            settings={"part": part, "stride": STRIDE},
        )
        for part, side in (("template", 127), ("search", 255))
    }  # fmt: skip
    largest = constant("largest", np.float32(1))
    template = saved(
        folder / "template.onnx", pooled("template", "features", "largest"), {"template": [1, 3, 127, 127]},
        {"features": [1, 4, 8, 8]}, [*POOLING, largest], cards["template"],
    )  # fmt: skip
    half = np.full((1, 4, 15, 15), STRIDE * CELLS / 2, dtype=np.float32)
    search = saved(
        folder / "search.onnx",
        [
            *pooled("search", "search_features", "largest"),
            *compared("features", "search_features", [1, 1, 1, 1]),
            helper.make_node("Neg", ["difference"], ["exponent"]),
            helper.make_node("Exp", ["exponent"], ["scores"]),
            helper.make_node("Identity", ["half"], ["boxes"]),
        ],
        {"features": [1, 4, 8, 8], "search": [1, 3, 255, 255]},
        {"scores": [1, 1, 15, 15], "boxes": [1, 4, 15, 15]},
        [*COMPARISON, *POOLING, largest, constant("half", half)],
        cards["search"],
    )
    return [template, search]


LAYOUTS = {"nanotrack": nanotrack, "vittrack": vittrack, "own": own}
