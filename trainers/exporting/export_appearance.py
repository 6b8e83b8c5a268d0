"""`tsuiseki export appearance`: an appearance network as ONNX."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import torch

from tsuiseki.trainers.exporting.export import export_onnx, load_module
from tsuiseki.trainers.exporting.model_file import ModelFile
from tsuiseki.trainers.networks.appearance import AppearanceTraining


def export_appearance(output: ModelFile, checkpoint: Path) -> float:
    """Write an appearance network as ONNX, and check that it gives what torch gives.

    Args:
        checkpoint: best.ckpt of tsuiseki train appearance.

    Returns:
        The largest relative difference to torch that the parity check saw.

    Raises:
        RequestError: a missing or foreign file.
        RunError: the exported file does not give what torch gives.
    """
    module = load_module(AppearanceTraining, checkpoint)
    card = dataclasses.replace(module.card, training_data=output.training_data)
    network = module.network.to(memory_format=torch.contiguous_format)
    example = torch.zeros(2, 3, card.input_height, card.input_width)
    difference = export_onnx(network, card, output.out, example, ("features",), output.float16, output.overwrite)
    output.report(output.out, difference)
    return difference
