"""The ONNX file that an export writes: what all of `tsuiseki export` take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from tsuiseki.tracking.options import OutputFile


@dataclass(frozen=True, kw_only=True)
class ModelFile(OutputFile):
    """The ONNX file that an export writes.

    Attributes:
        out: ONNX file to write.
        training_data: what the model was trained on, in words; kept in the file.
        float16: store weights as 16-bit numbers, half the size.
    """

    training_data: str = ""
    float16: bool = False

    def report(self, path: Path, difference: float) -> None:
        """Say what was written: the largest ``difference`` to torch is a share of the range."""
        size = path.stat().st_size / 2**20
        print(f"{path}: {size:.1f} MiB; differs from torch by {difference:.1g} of the range at most")


@dataclass(frozen=True, kw_only=True)
class ModelFiles(ModelFile):
    """Likewise, where several files get their names from one.

    Attributes:
        overwrite: replace existing files.
    """

    # The library checks the files by the names that they get.
    file_options: ClassVar[Sequence[str]] = ()
