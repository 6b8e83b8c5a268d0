"""A graph model of TensorFlow.js as one frozen graph of TensorFlow, which is the same graph in another writing.

The JSON holds a ``GraphDef`` in protobuf's own JSON form, and which bytes of the weights file each constant has. Here
it is written as protobuf's bytes. Numbers of fields are those of TensorFlow's ``graph.proto``, ``node_def.proto``,
``attr_value.proto``, ``tensor.proto``, ``tensor_shape.proto`` and ``types.proto``.
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RunError

# Numbers of the fields that graphs of inference have. A key stands for one number in all messages but ``name``.
_FIELDS = {
    **{"node": 1, "op": 2, "input": 3, "attr": 5, "key": 1, "value": 2},
    **{"list": 1, "s": 2, "i": 3, "f": 4, "b": 5, "type": 6, "shape": 7, "tensor": 8},
    **{"dtype": 1, "tensorShape": 2, "tensorContent": 4, "dim": 2, "size": 1, "unknownRank": 3, "name": 1},
}
# Numbers of the types of values in TensorFlow's messages.
_TYPES = {"DT_FLOAT": 1, "DT_INT32": 3, "DT_STRING": 7, "DT_INT64": 9, "DT_BOOL": 10}
# Of constants, by the name that the weights' manifest has.
_CONSTANTS = {"float32": "DT_FLOAT", "int32": "DT_INT32"}
# Of which nothing is left out: what a device or a debugger would want.
_LEFT_OUT = ("device", "experimentalDebugInfo")


def frozen_graph(model: bytes, weights: bytes) -> bytes:
    """The ``GraphDef`` with its constants.

    Args:
        model: the JSON of a graph model.
        weights: its one file of weights, float32, or float16 that stands for it, and int32.

    Raises:
        RunError: it is no graph model, or has what no graph of inference needs.
    """
    try:
        graph = json.loads(model)
        values = _constants(graph["weightsManifest"], weights)
        nodes = [_with_constant(node, values) for node in graph["modelTopology"]["node"]]
        return _message({"node": nodes})
    except (KeyError, TypeError, ValueError, struct.error) as error:
        raise RunError(f"expected a graph model of TensorFlow.js, got one with {error!r}; it is not kept") from error


def _constants(manifest: Iterable[Mapping[str, Any]], weights: bytes) -> dict[str, dict[str, Any]]:
    """A tensor in JSON form, but with its bytes as they are, for each name."""
    values, start = {}, 0
    for weight in (weight for group in manifest for weight in group["weights"]):
        stored = np.dtype(weight.get("quantization", {}).get("dtype", weight["dtype"]))
        if stored.name not in ("float16", *_CONSTANTS):
            raise ValueError(f"weights of {stored.name}")
        count = int(np.prod(weight["shape"]))
        array = np.frombuffer(weights, stored.newbyteorder("<"), count, start).astype(weight["dtype"])
        start += count * stored.itemsize
        shape = {"dim": [{"size": size} for size in weight["shape"]]}
        kind = _CONSTANTS[weight["dtype"]]
        values[weight["name"]] = {"dtype": kind, "tensorShape": shape, "tensorContent": array.tobytes()}
    if start != len(weights):
        raise ValueError(f"{len(weights)} bytes of weights for {start}")
    return values


def _with_constant(node: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    attributes = dict(node.get("attr", {}))
    if node["op"] == "Const":
        attributes["value"] = {"tensor": values[node["name"]]}
    entries = [{"key": key, "value": value} for key, value in attributes.items()]
    return {**{key: x for key, x in node.items() if key not in _LEFT_OUT}, "attr": entries}


def _message(fields: Mapping[str, Any]) -> bytes:
    items = ((key, x) for key, value in fields.items() for x in (value if isinstance(value, list) else [value]))
    return b"".join(_field(key, item) for key, item in items)


def _field(key: str, value: Any) -> bytes:
    """One field: its number and kind, then its value; raises KeyError for one that no graph of inference has."""
    number = _FIELDS[key] << 3
    if key == "f":
        return bytes([number | 5]) + struct.pack("<f", float(value))
    if isinstance(value, bool) or key in ("i", "size", "type", "dtype"):
        whole = _TYPES[value] if key in ("type", "dtype") else int(value)
        return bytes([number]) + _varint(whole % 2**64)
    if isinstance(value, Mapping):
        content = _message(value)
    elif isinstance(value, bytes):
        content = value
    else:
        content = base64.b64decode(value) if key == "s" else value.encode()
    return bytes([number | 2]) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    """Seven bits a byte, the lowest first."""
    groups = []
    while value >= 128:
        groups.append(value % 128 + 128)
        value //= 128
    return bytes([*groups, value])
