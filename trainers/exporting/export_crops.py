"""`tsuiseki export appearance` and `export action`: networks that look at crops of people, as ONNX."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import torch

from tsuiseki.models.action import StreamProbability
from tsuiseki.tracking.output import check_output_file
from tsuiseki.trainers.exporting.export import ModelFile, ModelFiles, export_onnx, load_module
from tsuiseki.trainers.networks.action_training import ActionTraining
from tsuiseki.trainers.networks.appearance_training import AppearanceTraining


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
    difference = write_appearance(load_module(AppearanceTraining, checkpoint), output)
    output.report(output.out, difference)
    return difference


def write_appearance(module: AppearanceTraining, output: ModelFile) -> float:
    """Write the appearance network of a training; the largest relative difference to torch."""
    card = dataclasses.replace(module.card, training_data=output.training_data)
    network = module.network.to(memory_format=torch.contiguous_format)
    example = torch.zeros(2, 3, card.input_height, card.input_width)
    return export_onnx(network, card, output.out, example, ("features",), output.float16, output.overwrite)


def export_action(output: ModelFiles, checkpoint: Path) -> dict[Path, float]:
    """Write the streams of an action network as ONNX, a file each, and check that they give what torch gives.

    Args:
        out: ONNX file to write; action.onnx becomes action_rgb_local.onnx, action_rgb_global.onnx and so on.
        checkpoint: best.ckpt of tsuiseki train action.

    Returns:
        Of each file that was written the largest relative difference to torch that the parity check saw.

    Raises:
        RequestError: a missing or foreign file.
        RunError: an exported file does not give what torch gives.
    """
    module = load_module(ActionTraining, checkpoint)
    paths = {name: output.out.with_name(f"{output.out.stem}_{name}.onnx") for name in module.inputs}
    for path in paths.values():
        check_output_file(path, output.overwrite)
    module.network.to(memory_format=torch.contiguous_format)
    written = {}
    for name, path in paths.items():
        card = dataclasses.replace(module.card(name), training_data=output.training_data)
        example = torch.zeros(2, module.inputs[name].channels, card.input_height, card.input_width)
        # Flow is nearly nothing nearly everywhere; noise as strong as in colours would saturate every sigmoid.
        spread = 0.1 if module.inputs[name].is_flow else 1.0
        probability = StreamProbability(module.network.streams[name])  # type: ignore[arg-type]
        how = output.float16, output.overwrite, spread
        written[path] = export_onnx(probability, card, path, example, ("probability",), *how)
    for path, difference in written.items():
        output.report(path, difference)
    return written
