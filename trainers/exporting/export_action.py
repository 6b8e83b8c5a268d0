"""`tsuiseki export action`: one ONNX file a stream, in float32 or in int8 with its loss of accuracy measured."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from tsuiseki.datamodules.action_crops import (
    ActionCrops,
    CropSettings,
    action_sequences,
    clips_to_cut,
    cut_clip,
    load_crops,
)
from tsuiseki.datamodules.action_data import centre_crops
from tsuiseki.models.action import StreamProbability
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.action_inputs import ActionInput, StreamName
from tsuiseki.tracking.onnx import OnnxModel
from tsuiseki.tracking.output import check_output_file, output_file
from tsuiseki.tracking.preprocessing import normalise
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.exporting.export import export_onnx, load_module
from tsuiseki.trainers.exporting.model_file import ModelFiles
from tsuiseki.trainers.exporting.quantisation import quantise_file, write_card
from tsuiseki.trainers.networks.action import ActionTraining, mean_average_precision

CALIBRATION_CROPS = 256
BATCH = 64


@dataclass(frozen=True)
class ExportedStream:
    """What was written.

    Attributes:
        path: of the file.
        difference: largest relative difference to torch that the parity check saw, of the float32 weights.
        map_float32: mAP on the clips given for int8; None without.
        map_int8: likewise.
    """

    path: Path
    difference: float
    map_float32: float | None = None
    map_int8: float | None = None


def export_action(output: ModelFiles, checkpoint: Path, int8: list[Path] | None = None) -> list[ExportedStream]:
    """Write the streams of an action network as ONNX, a file each, and check that they give what torch gives.

    Args:
        out: ONNX file to write; action.onnx becomes action_rgb_local.onnx, action_rgb_global.onnx and so on.
        checkpoint: best.ckpt of tsuiseki train action.
        int8: folders of labelled clips; the network computes with 8-bit numbers calibrated there, and says what mean
            average precision that costs there.

    Raises:
        RequestError: a missing or foreign file, clips with other actions.
        RunError: an exported file does not give what torch gives.
    """
    if output.float16 and int8:
        raise RequestError("expected `float16` or `int8`, got both")
    module = load_module(ActionTraining, checkpoint)
    paths = {name: output.out.with_name(f"{output.out.stem}_{name}.onnx") for name in module.inputs}
    for path in paths.values():
        check_output_file(path, output.overwrite)
    crops = labelled_crops(int8, module) if int8 else None
    module.network.to(memory_format=torch.contiguous_format)
    written = []
    for name, path in paths.items():
        stream = module.network.streams[name]
        card = dataclasses.replace(module.card(name), training_data=output.training_data)
        example = torch.zeros(2, module.inputs[name].channels, card.input_height, card.input_width)
        # Flow is nearly nothing nearly everywhere; noise as strong as in colours would saturate every sigmoid.
        spread = 0.1 if module.inputs[name].is_flow else 1.0
        probability = StreamProbability(stream)  # type: ignore[arg-type]
        if crops is None:
            how = output.float16, output.overwrite, spread
            worst = export_onnx(probability, card, path, example, ("probability",), *how)
            written.append(ExportedStream(path, worst))
            continue
        with tempfile.TemporaryDirectory() as folder:
            whole = Path(folder) / "float32.onnx"
            worst = export_onnx(probability, card, whole, example, ("probability",), spread=spread)
            written.append(ExportedStream(path, worst, *quantise(whole, path, crops, name, output.overwrite)))
    for one in written:
        output.report(one.path, one.difference)
        if one.map_float32 is not None and one.map_int8 is not None:
            print(f"  mAP {one.map_float32:.4f} in float32, {one.map_int8:.4f} in int8")
    return written


def labelled_crops(folders: Sequence[Path], module: ActionTraining) -> ActionCrops:
    """The crops of labelled clips, cut as the network wants them; kept for this call only."""
    one: ActionInput = next(iter(module.inputs.values()))
    settings = CropSettings(one.size, 0.0, one.enlargement, one.flow_limit, one.stack, one.flow, one.compensate)
    clips = [clip for folder in folders for clip in action_sequences(folder)]
    for clip in clips:
        if clip.labels.class_names != module.names:
            raise RequestError(
                f"{clip.name}: expected the actions of the network, {', '.join(module.names)}; got "
                f"{', '.join(clip.labels.class_names)}"
            )
    clips = clips_to_cut(clips, settings, "calibration")
    with tempfile.TemporaryDirectory() as folder:
        places = [Path(folder) / str(number) for number in range(len(clips))]
        for clip, place in zip(clips, places, strict=True):
            cut_clip(clip, settings, place)
        # The pictures are held in memory, for the folder goes away.
        found = load_crops(places, tuple(module.inputs))
        return dataclasses.replace(
            found, images={name: [np.array(part) for part in parts] for name, parts in found.images.items()}
        )


def quantise(
    whole: Path, path: Path, crops: ActionCrops, stream: StreamName, overwrite: bool = False
) -> tuple[float, float]:
    """Write an exported stream with 8-bit weights and activations.

    Args:
        whole: the stream in float32.
        path: of the file to write.
        crops: to calibrate the ranges on, and to measure on.
        stream: which it is.
        overwrite: replace an existing file.

    Returns:
        mAP on the crops before and after; both go into the card.
    """
    card = OnnxModel(whole, "action", threads=1).card
    rows = np.random.default_rng(0).permutation(len(crops))[:CALIBRATION_CROPS]
    inputs = [
        normalise(centre_crops(crops.crops(stream, some), card.input_height), card)
        for some in np.array_split(rows, max(1, len(rows) // BATCH))
    ]
    before = mean_average_precision(_probabilities(whole, crops, stream), crops.actions)
    with output_file(path, overwrite) as work:
        quantise_file(whole, work, inputs)
        write_card(work, card)
        after = mean_average_precision(_probabilities(work, crops, stream), crops.actions)
        measured = {"int8": True, "map_float32": round(before, 4), "map_int8": round(after, 4)}
        write_card(work, dataclasses.replace(card, settings={**card.settings, **measured}))
    return before, after


def _probabilities(path: Path, crops: ActionCrops, stream: StreamName) -> FloatArray:
    """``(N, A)`` what the file at ``path`` says of all crops."""
    model = OnnxModel(path, "action", threads=1)
    side = model.card.input_height
    parts = [
        model.run(normalise(centre_crops(crops.crops(stream, rows), side), model.card))[0]
        for rows in np.array_split(np.arange(len(crops)), -(-len(crops) // BATCH))
    ]
    return np.concatenate(parts).astype(np.float64)
