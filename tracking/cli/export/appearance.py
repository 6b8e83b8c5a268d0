"""`tsuiseki export appearance`."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.cli.commands import needs_train_extra
from tsuiseki.tracking.cli.export.options import ModelFile


def appearance(output: ModelFile, checkpoint: Path) -> None:
    """Write an appearance network as ONNX, and check that it gives what torch gives.

    Args:
        checkpoint: best.ckpt of tsuiseki train appearance.
    """
    with needs_train_extra():
        from tsuiseki.trainers.exporting.export import export_appearance
    difference = export_appearance(
        checkpoint, output.out, output.training_data, float16=output.float16, overwrite=output.overwrite
    )
    output.report(output.out, difference)
