"""What an experiment found, and the files of it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.papers.tables import Table


@dataclass(frozen=True)
class Outcome:
    """What an experiment found.

    Attributes:
        values: all numbers, for results.json: dictionaries, lists, dataclasses, arrays and plain values.
        tables: the paper's and ours.
        plots: figures by name, written as NAME.png.
        files: what else is written, by name: text, or the bytes of a picture.
        notes: lines that stand below the tables.
    """

    values: Any = None
    tables: Sequence[Table] = ()
    plots: Mapping[str, Figure] = field(default_factory=dict)
    files: Mapping[str, str | bytes] = field(default_factory=dict)
    notes: Sequence[str] = ()

    def write(self, folder: Path) -> None:
        """Write results.json, tables.md, plots and files into ``folder``."""
        (folder / "results.json").write_text(json.dumps(self.values, indent=1, default=plain) + "\n", encoding="utf-8")
        titled = [f"{table.title}\n\n{table.markdown()}".strip() for table in self.tables]
        (folder / "tables.md").write_text("\n\n".join([*titled, *self.notes]) + "\n", encoding="utf-8")
        for name, figure in self.plots.items():
            figure.savefig(folder / f"{name}.png", facecolor="white")
        for name, content in self.files.items():
            (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())

    def text(self) -> str:
        """Tables and notes for a terminal."""
        return "\n".join([*(table.text() for table in self.tables if table.rows), *self.notes])


def plain(value: Any) -> Any:
    """What JSON cannot hold, in its terms."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return str(value) if isinstance(value, Path) else vars(value)
