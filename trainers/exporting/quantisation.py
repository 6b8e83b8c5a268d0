"""Exported networks with 8-bit weights and activations, their ranges calibrated on real inputs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process

from tsuiseki.tracking.onnx import METADATA_KEY, ModelCard


class _Calibration(CalibrationDataReader):  # type: ignore[misc]
    """Batches of inputs, as onnxruntime wants to be fed."""

    def __init__(self, inputs: Sequence[NDArray[np.float32]], name: str) -> None:
        self._rest = iter([{name: batch} for batch in inputs])

    def get_next(self) -> dict[str, NDArray[np.float32]] | None:
        return next(self._rest, None)


def quantise_file(whole: Path, path: Path, inputs: Sequence[NDArray[np.float32]]) -> None:
    """Write the float32 network at ``whole`` to ``path`` with 8-bit weights a channel and 8-bit activations.

    Args:
        whole: exported network; its input is called ``images``.
        path: file to write, without metadata.
        inputs: batches that tell the ranges of activations.
    """
    prepared = path.with_name("prepared.onnx")
    quant_pre_process(str(whole), str(prepared), skip_symbolic_shape=True)
    quantize_static(
        str(prepared),
        str(path),
        _Calibration(inputs, "images"),
        quant_format=QuantFormat.QDQ,
        per_channel=True,
        activation_type=QuantType.QUInt8,
        weight_type=QuantType.QInt8,
    )


def write_card(path: Path, card: ModelCard) -> None:
    """Give the file at ``path`` ``card`` as its only metadata."""
    model = onnx.load(path)
    del model.metadata_props[:]
    model.metadata_props.add(key=METADATA_KEY, value=card.to_json())
    onnx.save(model, path)
