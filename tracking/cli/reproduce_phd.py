"""Shared by the experiments' commands."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError


def at_least_one(**numbers: int) -> None:
    """Refuse options below 1."""
    for name, value in numbers.items():
        if value < 1:
            raise RequestError(f"--{name}: expected at least 1, got {value}")


def finish(work: Path, values: dict[str, Any], name: str, settings: dict[str, Any]) -> None:
    """Write ``results.json`` and ``run.json``."""
    import json

    from tsuiseki.tracking.output import RunRecord

    (work / "results.json").write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")
    RunRecord(["tsuiseki", "reproduce", name], settings).write(work)


def show_rows(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table; nothing where it has no row."""
    from rich.console import Console
    from rich.table import Table

    if not rows:
        return
    table = Table()
    for name in heading:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(*row)
    Console(width=160).print(table)
