"""Networks in other formats than ONNX, read by OpenVINO: its own, TensorFlow Lite's and frozen graphs of TensorFlow.

OpenVINO reads the three of them, so that none needs a converter. A session here has what is used of onnxruntime's.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from tsuiseki.tracking.errors import RequestError

if TYPE_CHECKING:
    import onnxruntime
    import openvino

# Endings of files that OpenVINO reads: its own graph, whose weights lie beside it as .bin, and those of TensorFlow.
FORMATS = (".xml", ".tflite", ".pb")
# Milliseconds between two looks at whether a call is to end.
LOOK = 100
# onnxruntime's names of types, by OpenVINO's.
_TYPES = {"f32": "float", "f16": "float16", "u8": "uint8", "i32": "int32", "i64": "int64"}
# The network gives the same with any number of threads, and its threads go where the system puts them.
_SETTINGS = {"PERFORMANCE_HINT": "LATENCY", "INFERENCE_PRECISION_HINT": "f32", "ENABLE_CPU_PINNING": False}
# What OpenVINO imports where it is there.
_TELEMETRY = "openvino_telemetry"


class OpenvinoSession:
    """A network in a file of one of `FORMATS`, on the CPU.

    Pictures of floats with the channels last, as TensorFlow has them, are taken with the channels first.

    Args:
        path: the file.
        threads: CPU threads of a call, at least 1.

    Raises:
        RequestError: the file or its weights are missing, OpenVINO is not installed, or cannot read it.
    """

    def __init__(self, path: Path, threads: int) -> None:
        for file in (path, path.with_suffix(".bin")) if path.suffix == ".xml" else (path,):
            if not file.is_file():
                raise RequestError(f"expected a network at {path}, found no {file}; keep its files together")
        try:
            core = _core()
        except ImportError as error:
            raise RequestError(
                f"{path} needs openvino, which is not installed; install the extra: pip install 'tsuiseki[openvino]'"
            ) from error
        try:
            model = _channels_first(core.read_model(path))
            settings = {**_SETTINGS, "INFERENCE_NUM_THREADS": threads}
            self._compiled = core.compile_model(model, "CPU", settings)
        except RuntimeError as error:
            reason = " ".join(str(error).split())[-160:]
            raise RequestError(f"{path} is not a readable network; OpenVINO says: {reason}") from error
        self._inputs = {_name(port): port for port in self._compiled.inputs}
        self._outputs = {_name(port): port for port in self._compiled.outputs}

    def get_inputs(self) -> list[Any]:
        """Name, shape and type of each input, as onnxruntime has them."""
        return [_described(name, port) for name, port in self._inputs.items()]

    def get_outputs(self) -> list[Any]:
        """The same of the outputs."""
        return [_described(name, port) for name, port in self._outputs.items()]

    def get_providers(self) -> list[str]:
        """What it runs on, by onnxruntime's name."""
        return ["CPUExecutionProvider"]

    def get_modelmeta(self) -> Any:
        """No metadata: none of the formats has what this toolkit looks for."""
        return SimpleNamespace(custom_metadata_map={})

    def run(
        self, outputs: Sequence[str] | None, inputs: Mapping[str, NDArray[Any]], options: onnxruntime.RunOptions
    ) -> list[NDArray[Any]]:
        """The named outputs, by default all, for ``inputs`` by name; ``options.terminate`` ends the call.

        Raises:
            RuntimeError: the network refuses the inputs, or was ended.
        """
        request = self._compiled.create_infer_request()
        request.start_async({self._inputs[name]: values for name, values in inputs.items()})
        while not request.wait_for(LOOK):
            if options.terminate:
                request.cancel()
                raise RuntimeError("ended")
        return [request.get_tensor(self._outputs[name]).data.copy() for name in outputs or self._outputs]


@cache
def _core() -> openvino.Core:
    """OpenVINO's core, one for the whole process.

    Each core gives its thread a stack for signals. The end of the second core leaves that thread with freed memory,
    and the next signal ends the process.

    Without its package of telemetry, the import writes no number of this machine and calls nobody.

    Raises:
        ImportError: OpenVINO is not installed.
    """
    if "openvino" not in sys.modules:
        sys.modules[_TELEMETRY] = None  # type: ignore[assignment]  # how Python marks what cannot be imported
    import openvino

    return openvino.Core()


def _channels_first(model: openvino.Model) -> openvino.Model:
    """The network with pictures (N, 3, H, W) in, where it takes floats (N, H, W, 3)."""
    from openvino import Layout
    from openvino.preprocess import PrePostProcessor

    (first, *rest), shapes = model.inputs, [x.partial_shape for x in model.inputs]
    last = len(shapes[0]) == 4 and (str(shapes[0][3]), str(shapes[0][1])) == ("3", str(shapes[0][2]))
    if rest or not last or not first.element_type.is_real():
        return model
    steps = PrePostProcessor(model)
    steps.input().tensor().set_layout(Layout("NCHW"))
    steps.input().model().set_layout(Layout("NHWC"))
    return steps.build()


def _name(port: Any) -> str:
    """The name that the exporter chose, of all that a frozen graph has for an output: the longest outside any scope."""
    names = sorted(port.names) or [port.node.friendly_name]
    return str(max(names, key=lambda name: ("/" not in name, len(name))))


def _described(name: str, port: Any) -> Any:
    shape = [size.get_length() if size.is_static else "any" for size in port.partial_shape]
    kind = port.element_type.get_type_name()
    return SimpleNamespace(name=name, shape=shape, type=f"tensor({_TYPES.get(kind, kind)})")
