"""`tsuiseki export`: a trained model as ONNX, which runs without torch."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Literal

from tsuiseki.tracking.cli.extra import needs_train_extra
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.output import check_output_file


def detector(
    out: Path,
    checkpoint: Path | None = None,
    weights: Literal["coco"] | None = None,
    architecture: Literal["ssdlite320", "ssd300"] = "ssdlite320",
    state: Path | None = None,
    calibrate: Path | None = None,
    int8: Path | None = None,
    height: int | None = None,
    width: int | None = None,
    training_data: str = "",
    float16: bool = False,
    overwrite: bool = False,
) -> None:
    """Write a person detector as ONNX, and check that it gives what torch gives.

    Either from a checkpoint of your own, or from torchvision's COCO-trained weights, of which the person class is kept:
    with those, your own street video works on the first day.

    Args:
        out: ONNX file to write.
        checkpoint: best.ckpt of tsuiseki train detector.
        weights: coco downloads torchvision's weights.
        architecture: of the COCO weights.
        state: file of those weights, for a machine that cannot download them.
        calibrate: MOTChallenge folder of labelled pictures; scores become probabilities of a person there.
        int8: MOTChallenge folder of labelled pictures; weights and activations become 8-bit numbers whose ranges are
            taken there, and the average precision before and after is measured there.
        height: of the input, pixels, where another than in training; with --width.
        width: likewise; a larger input finds smaller people and takes longer.
        training_data: what the model was trained on, in words; kept in the file.
        float16: store weights as 16-bit numbers, half the size.
        overwrite: replace an existing file.
    """
    if (height is None) != (width is None):
        raise RequestError("expected --height and --width together, got one of them")
    if float16 and int8:
        raise RequestError("expected --float16 or --int8, got both")
    with needs_train_extra():
        from tsuiseki.trainers.exporting.export import export_detector
        from tsuiseki.trainers.exporting.export_int8 import quantise_detector
    check_output_file(out, overwrite)
    with tempfile.TemporaryDirectory() as folder:
        whole = out if int8 is None else Path(folder) / "whole.onnx"
        worst = export_detector(
            checkpoint,
            weights,
            architecture,
            whole,
            training_data,
            float16=float16,
            overwrite=overwrite,
            state=state,
            calibrate=calibrate,
            size=None if height is None or width is None else (height, width),
        )
        if int8 is not None:
            before, after = quantise_detector(whole, out, int8, overwrite)
            print(f"AP50 on {int8}: {before:.3f} with float weights, {after:.3f} with 8-bit ones")
    _say(out, worst)


def appearance(
    out: Path,
    checkpoint: Path,
    training_data: str = "",
    float16: bool = False,
    overwrite: bool = False,
) -> None:
    """Write an appearance network as ONNX, and check that it gives what torch gives.

    Args:
        out: ONNX file to write.
        checkpoint: best.ckpt of tsuiseki train appearance.
        training_data: what the model was trained on, in words; kept in the file.
        float16: store weights as 16-bit numbers, half the size.
        overwrite: replace an existing file.
    """
    with needs_train_extra():
        from tsuiseki.trainers.exporting.export import export_appearance
    _say(out, export_appearance(checkpoint, out, training_data, float16=float16, overwrite=overwrite))


def action(
    out: Path,
    checkpoint: Path,
    training_data: str = "",
    float16: bool = False,
    int8: list[Path] | None = None,
    overwrite: bool = False,
) -> None:
    """Write the streams of an action network as ONNX, a file each, and check that they give what torch gives.

    Args:
        out: ONNX file to write; action.onnx becomes action_rgb_local.onnx, action_rgb_global.onnx and so on.
        checkpoint: best.ckpt of tsuiseki train action.
        training_data: what the model was trained on, in words; kept in the files.
        float16: store weights as 16-bit numbers, half the size.
        int8: folders of labelled clips; the network computes with 8-bit numbers calibrated there, and says what mean
            average precision that costs there.
        overwrite: replace existing files.
    """
    with needs_train_extra():
        from tsuiseki.trainers.exporting.export_action import export_action
    for done in export_action(checkpoint, out, training_data, float16=float16, int8=int8 or (), overwrite=overwrite):
        _say(done.path, done.difference)
        if done.map_float32 is not None and done.map_int8 is not None:
            print(f"  mAP {done.map_float32:.4f} in float32, {done.map_int8:.4f} in int8")


def _say(out: Path, worst: float) -> None:
    print(f"{out}: {out.stat().st_size / 2**20:.1f} MiB; differs from torch by {worst:.1g} of the range at most")
