"""A file of events as a table: a row an event, each once."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.events.event import PREFIX, SCHEMA, TYPES
from tsuiseki.tracking.formats.rows import write_csv
from tsuiseki.tracking.openers.json_files import json_of
from tsuiseki.tracking.openers.text import read_text, refusing

# How every line of ours begins.
_START = b'{"specversion":"'
WHAT = "events of tsuiseki, a line each"
# Columns of the envelope, of a person, and of what else an event says.
COLUMNS = (
    "id", "time", "camera", "type", "frame", "seconds", "person", "class", "support", "x1", "y1", "x2", "y2",
    "x_metres", "y_metres", "line", "direction", "zone", "stay", "gap", "start", "end", "frames", "people", "most",
    "lines", "zones", "corrects", "was", "withdrawn", "events",
)  # fmt: skip
LISTS = {"box": ("x1", "y1", "x2", "y2"), "metres": ("x_metres", "y_metres")}


def is_event_file(path: Path) -> bool:
    """Whether a file holds events, by its first letters."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(_START)) == _START


def read_events(path: Path) -> Iterator[dict[str, Any]]:
    """The events of a file in order, each once, with the fields of `COLUMNS` that it has.

    A last line that a killed process left unfinished is passed over, with a note.

    Raises:
        RequestError: a line is no event, or of another version of the schema.
    """
    lines, ids = read_text(path, WHAT).split("\n"), set[str]()
    if lines.pop():
        warnings.warn(f"{path}: the last line breaks off and is left out", InputWarning, stacklevel=2)
    for number, line in enumerate(lines, start=1):
        where = f"{path}:{number}"
        event = json_of(line, where, WHAT)
        with refusing(f"{where}: expected {WHAT}, got another object"):
            if (schema := event["dataschema"]) != SCHEMA:
                raise RequestError(
                    f"{where}: expected events of {SCHEMA}, got {str(schema)[:60]}; its own version reads it"
                )
            row = _row(event)
        if row["id"] not in ids:
            ids.add(row["id"])
            yield row


def _row(event: dict[str, Any]) -> dict[str, Any]:
    """The fields of an event; raises ValueError where it is none."""
    kind = event["type"].removeprefix(PREFIX)
    if kind not in TYPES:
        raise ValueError(kind)
    row = {"id": event["id"], "time": event.get("time"), "camera": unquote(event["source"]), "type": kind}
    for name, value in dict(event["data"]).items():
        if name in LISTS:
            row |= dict(zip(LISTS[name], value, strict=True))
        else:
            row[name] = json.dumps(value, ensure_ascii=False) if isinstance(value, dict) else value
    return row


def write_event_table(path: Path, events: Iterator[dict[str, Any]]) -> int:
    """Write events as CSV; returns how many."""
    rows = [[event.get(name) for name in COLUMNS] for event in events]
    write_csv(path, COLUMNS, rows)
    return len(rows)
