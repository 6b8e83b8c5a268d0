"""From a trained model to an ONNX file that runs without torch, and the proof that both agree."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import logging
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
import onnx
import onnxruntime
import torch
from numpy.typing import NDArray
from pydantic.dataclasses import dataclass as pydantic_dataclass
from torch import Tensor, nn

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.onnx import METADATA_KEY, ModelCard
from tsuiseki.tracking.output import output_file
from tsuiseki.tracking.runs.options import OutputFile
from tsuiseki.trainers.network_module import BEGINNINGS, NetworkModule
from tsuiseki.trainers.own_network import importable_here

# Largest difference to torch, relative to the largest value of an output: float32 sums in another order differ by a few
# 1e-6 a layer.
FLOAT32_TOLERANCE = 1e-3
# Likewise where weights are rounded to float16: by 5e-4 each, which some sixty layers add up to.
FLOAT16_TOLERANCE = 3e-2
# Batch sizes that are compared with torch: a file must take any.
_PARITY_BATCHES = (1, 3)
# Tensors smaller than this stay float32: biases and scales matter more than their bytes.
_SMALLEST_HALVED = 512

Module = TypeVar("Module", bound=NetworkModule)


@pydantic_dataclass(frozen=True, kw_only=True, config=SETTINGS)
class ModelFile(OutputFile):
    """The ONNX file that an export writes.

    Attributes:
        out: ONNX file to write.
        training_data: what the model was trained on, in words; kept in the file.
        licence: of its weights, such as Apache-2.0; kept in the file.
        float16: store weights as 16-bit numbers, half the size.
    """

    training_data: str = ""
    licence: str = ""
    float16: bool = False

    def report(self, path: Path, difference: float) -> None:
        """Say what was written: the largest ``difference`` to torch is a share of the range."""
        size = path.stat().st_size / 2**20
        print(f"{path}: {size:.1f} MiB; differs from torch by {difference:.1g} of the range at most")


@pydantic_dataclass(frozen=True, kw_only=True, config=SETTINGS)
class ModelFiles(ModelFile):
    """Likewise, where several files get their names from one.

    Attributes:
        overwrite: replace existing files.
    """

    # The library checks the files by the names that they get.
    file_options: ClassVar[Sequence[str]] = ()


def export_onnx(
    module: nn.Module,
    card: ModelCard,
    path: Path,
    example: Tensor | Mapping[str, Tensor],
    outputs: Sequence[str],
    float16: bool = False,
    overwrite: bool = False,
    spread: float | Sequence[float] = 1.0,
) -> float:
    """Write ``module`` as ONNX with ``card`` in its metadata, once it gives what torch gives.

    The batch is dynamic. The file appears under its name only when it is complete and checked.

    Args:
        module: takes the tensors of ``example``, gives one or several whose first axis is the batch, or constants.
        card: what the file will say about itself; the version of the project is filled in.
        path: of the file.
        example: ``(B, ...)`` an input, called ``images``, or several by name; tells the shapes.
        outputs: their names in order.
        float16: store weights as float16; computation stays float32.
        overwrite: replace an existing file.
        spread: standard deviation of the random inputs that both are compared on; of each input, or of all.

    Returns:
        The largest difference to torch over all outputs, relative to the largest value of the output.

    Raises:
        RequestError: the path cannot be written to.
        RunError: onnxruntime and torch disagree.
    """
    inputs = {"images": example} if isinstance(example, Tensor) else dict(example)
    # A batch of one would be taken for a constant.
    several = tuple(torch.cat((values, values)) if len(values) == 1 else values for values in inputs.values())
    batch = torch.export.Dim("batch")
    tolerance = FLOAT16_TOLERANCE if float16 else FLOAT32_TOLERANCE
    training = module.training
    module.eval()
    try:
        model = convert_module(module, several, tuple(inputs), outputs, tuple({0: batch} for _ in several))
        if float16:
            store_float16(model)
        return write_checked(
            model, card, path, lambda work: check_parity(module, work, several, tolerance, spread), overwrite
        )
    finally:
        module.train(training)


def write_checked(
    model: onnx.ModelProto, card: ModelCard, path: Path, check: Callable[[Path], float], overwrite: bool = False
) -> float:
    """Write ``model`` with ``card`` in its metadata; see `export_onnx`.

    Args:
        model: to write.
        card: what the file will say about itself; the version of the project is filled in.
        path: of the file, which appears only when complete and checked.
        check: gives the largest difference of a file to what was trained, and raises RunError where it is another.
        overwrite: replace an existing file.

    Returns:
        What ``check`` gave.

    Raises:
        RequestError: the path cannot be written to.
    """
    card = dataclasses.replace(card, project_version=metadata.version("tsuiseki"))
    model.metadata_props.add(key=METADATA_KEY, value=card.to_json())
    with output_file(path, overwrite) as work:
        work.parent.mkdir(parents=True, exist_ok=True)
        onnx.save(model, work)
        return check(work)


def load_module(kind: type[Module], checkpoint: Path, size: tuple[int, int] | None = None) -> Module:
    """The module in ``checkpoint`` for inference on a CPU; nothing but tensors and plain values is unpickled.

    Args:
        kind: of the module.
        checkpoint: its file.
        size: height and width of another input than it was trained with; where it takes any.

    Raises:
        RequestError: the file is missing, no checkpoint, or of another module.
    """
    # What the training started from is overwritten here; without it nothing is downloaded.
    changes = BEGINNINGS if size is None else {**BEGINNINGS, "height": size[0], "width": size[1]}
    with importable_here():
        return kind.load_from_checkpoint(checkpoint, map_location="cpu", weights_only=True, **changes).eval()


def check_parity(
    module: nn.Module, path: Path, examples: Sequence[Tensor], tolerance: float, spread: float | Sequence[float] = 1.0
) -> float:
    """The largest relative difference between ``module`` and the file on random inputs, batch 1 and 3.

    Raises:
        RunError: it is larger than ``tolerance``, or an output does not depend on the input.
    """
    session = onnxruntime.InferenceSession(path.read_bytes(), providers=["CPUExecutionProvider"])
    names = [tensor.name for tensor in session.get_inputs()]
    spreads = [spread] * len(names) if isinstance(spread, float) else spread
    generator = torch.Generator().manual_seed(0)
    worst = 0.0
    for batch in _PARITY_BATCHES:
        # Normal numbers are what normalised images look like: no unit of the network saturates on all of them.
        inputs = [
            scale * torch.randn((batch, *tensor.shape[1:]), generator=generator)
            for scale, tensor in zip(spreads, examples, strict=True)
        ]
        with torch.no_grad():
            outputs = module(*inputs)
        expected = [x.numpy() for x in ((outputs,) if isinstance(outputs, Tensor) else outputs)]
        got = session.run(None, {name: tensor.numpy() for name, tensor in zip(names, inputs, strict=True)})
        for output, a, b in zip(session.get_outputs(), expected, got, strict=True):
            worst = max(worst, _difference(path.name, output.name, a, b, tolerance))
    return worst


def store_float16(model: onnx.ModelProto) -> None:
    """Turn the large float32 weights of ``model`` into float16 ones followed by a cast, in place.

    onnxruntime folds the casts when it loads the file: half the bytes, the same speed.
    """
    outputs = {output.name for output in model.graph.output}
    casts = []
    for weight in model.graph.initializer:
        values = onnx.numpy_helper.to_array(weight)
        if values.dtype != np.float32 or values.size < _SMALLEST_HALVED or weight.name in outputs:
            continue
        name = weight.name
        limit = np.finfo(np.float16).max
        weight.CopyFrom(onnx.numpy_helper.from_array(values.clip(-limit, limit).astype(np.float16), f"{name}_half"))
        casts.append(onnx.helper.make_node("Cast", [f"{name}_half"], [name], to=onnx.TensorProto.FLOAT))
    nodes = [*casts, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    halved = {cast.output[0] for cast in casts}
    described = [v for v in model.graph.value_info if v.name not in halved]
    del model.graph.value_info[:]
    model.graph.value_info.extend(described)


def convert_module(
    module: nn.Module,
    inputs: tuple[Tensor, ...],
    names: Sequence[str],
    outputs: Sequence[str],
    dynamic: tuple[Mapping[int, Any], ...],
) -> onnx.ModelProto:
    """``module`` as an ONNX model without the traces of the machine that made it.

    Args:
        module: takes ``inputs``.
        inputs: examples.
        names: of the inputs.
        outputs: names of what comes out.
        dynamic: for each input the axes whose length may vary.
    """
    # The exporter prints its progress and notices about itself.
    with quiet("torch.onnx", "onnxscript", "onnx_ir"), contextlib.redirect_stdout(io.StringIO()):
        program = torch.onnx.export(
            module,
            inputs,
            dynamo=True,
            input_names=list(names),
            output_names=list(outputs),
            dynamic_shapes=dynamic,
            verbose=False,
        )
    assert program is not None
    model: onnx.ModelProto = program.model_proto
    for node in model.graph.node:
        # The exporter leaves the Python stack of every node, with the paths of this machine.
        del node.metadata_props[:]
        node.doc_string = ""
    return model


def _difference(file: str, output: str, expected: NDArray[Any], got: NDArray[Any], tolerance: float) -> float:
    scale = float(np.abs(expected).max())
    if expected.shape != got.shape:
        raise RunError(f"{file}: output {output} has shape {got.shape} in onnxruntime and {expected.shape} in torch")
    if not np.isfinite(expected).all() or scale == 0 or float(np.ptp(expected)) == 0:
        raise RunError(f"{file}: output {output} is constant or not finite; is the network trained? not exported")
    difference = float(np.abs(expected - got).max()) / scale
    if not difference <= tolerance:
        raise RunError(
            f"{file}: output {output} differs from torch by {difference:.2g} of its range, expected at most "
            f"{tolerance:.2g}; not exported"
        )
    return difference


@contextlib.contextmanager
def quiet(*names: str) -> Iterator[None]:
    """Without warnings, and without what loggers of these ``names`` say below an error."""
    loggers = [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
