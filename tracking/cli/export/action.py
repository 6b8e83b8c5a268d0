"""`tsuiseki export action`."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.cli.commands import needs_train_extra
from tsuiseki.tracking.cli.export.options import ModelFiles


def action(output: ModelFiles, checkpoint: Path, int8: list[Path] | None = None) -> None:
    """Write the streams of an action network as ONNX, a file each, and check that they give what torch gives.

    Args:
        out: ONNX file to write; action.onnx becomes action_rgb_local.onnx, action_rgb_global.onnx and so on.
        checkpoint: best.ckpt of tsuiseki train action.
        int8: folders of labelled clips; the network computes with 8-bit numbers calibrated there, and says what mean
            average precision that costs there.
    """
    with needs_train_extra():
        from tsuiseki.trainers.exporting.export_action import export_action
    exported = export_action(
        checkpoint,
        output.out,
        output.training_data,
        float16=output.float16,
        int8=int8 or (),
        overwrite=output.overwrite,
    )
    for one in exported:
        output.report(one.path, one.difference)
        if one.map_float32 is not None and one.map_int8 is not None:
            print(f"  mAP {one.map_float32:.4f} in float32, {one.map_int8:.4f} in int8")
