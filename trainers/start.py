"""Networks that start from a file: what they are built of, and the weights that they take over."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from torch import nn

from tsuiseki.tracking.errors import RequestError
from tsuiseki.trainers.exporting.exported_weights import Normalisation, arrays_of, fill_network, opened_onnx
from tsuiseki.trainers.network_module import read_checkpoint


def completed(
    asked: Mapping[str, Any],
    usual: Mapping[str, Any],
    held: Mapping[str, Any] | None,
    path: Path | None,
    fixed: Sequence[str],
) -> dict[str, Any]:
    """What a network is built of: what is ``asked``, else what its start has, else the ``usual``.

    Args:
        asked: parts by name; None for those that are not asked for.
        usual: without a start.
        held: parts of the start; None without one.
        path: of the start, for the error.
        fixed: names of parts that must be those of the start.

    Raises:
        RequestError: another part is asked for than the start has.
    """
    parts = {**usual, **(held or {})}
    for name, value in asked.items():
        if value is None:
            continue
        if held is not None and name in fixed and value != held[name]:
            raise RequestError(
                f"`{name}`: expected that of the `start` {path}, {held[name]}, got {value}; leave it out, or give "
                "another `start`"
            )
        parts[name] = value
    return parts


def begin_network(network: nn.Module, path: Path, kind: str, prefix: str = "") -> list[Normalisation]:
    """Fill ``network`` with all weights of the file at ``path``.

    Args:
        network: to fill; it then computes what the file does.
        path: exported network (``.onnx``), or checkpoint of a training.
        kind: of the network, for the error.
        prefix: of the names in an exported file.

    Returns:
        Its normalisations that are part of the layer before in an exported file, see `fill_network`.

    Raises:
        RequestError: the file is missing, or its weights do not fit.
    """
    try:
        if path.suffix == ".onnx":
            model, _ = opened_onnx(path)
            return fill_network(network, arrays_of(model, prefix))
        state = read_checkpoint(path, "state_dict")
        network.load_state_dict({name.removeprefix("network."): v for name, v in state.items() if "network." in name})
    except (RuntimeError, ValueError) as error:
        if isinstance(error, RequestError):
            raise
        reason = " ".join(str(error).split())[:200]
        raise RequestError(f"{path}: expected weights of this {kind} network, got others: {reason}") from error
    return []
