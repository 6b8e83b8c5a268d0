"""`tsuiseki export detector`."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Literal

from tsuiseki.tracking.cli.commands import needs_train_extra
from tsuiseki.tracking.cli.export.options import ModelFile
from tsuiseki.tracking.errors import RequestError


def detector(
    output: ModelFile,
    checkpoint: Path | None = None,
    weights: Literal["coco"] | None = None,
    architecture: Literal["ssdlite320", "ssd300"] = "ssdlite320",
    state: Path | None = None,
    calibrate: Path | None = None,
    int8: Path | None = None,
    height: int | None = None,
    width: int | None = None,
) -> None:
    """Write a person detector as ONNX, and check that it gives what torch gives.

    Either from a checkpoint of your own, or from torchvision's COCO-trained weights, of which the person class is kept:
    with those, your own street video works on the first day.

    Args:
        checkpoint: best.ckpt of tsuiseki train detector.
        weights: coco downloads torchvision's weights.
        architecture: of the COCO weights.
        state: file of those weights, for a machine that cannot download them.
        calibrate: MOTChallenge folder of labelled pictures; scores become probabilities of a person there.
        int8: MOTChallenge folder of labelled pictures; weights and activations become 8-bit numbers whose ranges are
            taken there, and the average precision before and after is measured there.
        height: of the input, pixels, where another than in training; with --width.
        width: likewise; a larger input finds smaller people and takes longer.
    """
    if (height is None) != (width is None):
        raise RequestError("expected `height` and `width` together, got one of them")
    if output.float16 and int8:
        raise RequestError("expected `float16` or `int8`, got both")
    with needs_train_extra():
        from tsuiseki.trainers.exporting.export import export_detector
        from tsuiseki.trainers.exporting.export_int8 import quantise_detector
    with tempfile.TemporaryDirectory() as folder:
        whole = output.out if int8 is None else Path(folder) / "whole.onnx"
        difference = export_detector(
            checkpoint,
            weights,
            architecture,
            whole,
            output.training_data,
            float16=output.float16,
            overwrite=output.overwrite,
            state=state,
            calibrate=calibrate,
            size=None if height is None or width is None else (height, width),
        )
        if int8 is not None:
            before, after = quantise_detector(whole, output.out, int8, output.overwrite)
            print(f"AP50 on {int8}: {before:.3f} with float weights, {after:.3f} with 8-bit ones")
    output.report(output.out, difference)
