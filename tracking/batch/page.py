"""`index.html` and `summary.csv` of a batch: every video with what became of it, and the counts over all."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

from tsuiseki.tracking.batch.schedule import Row
from tsuiseki.tracking.output import whole_file
from tsuiseki.tracking.report.page import html_page, html_table, listing, section

COLUMNS = ("name", "status", "frames", "tracks", "seconds", "source", "line")
PAGES = ("report.html", "run.json", "scores.json")


def write_pages(batch: Path, command: str, rows: Sequence[Row]) -> None:
    """Write both files, each whole."""
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows([round(value, 1) if isinstance(value, float) else value for value in _values(row)] for row in rows)
    for name, text in (("summary.csv", table.getvalue()), ("index.html", _page(batch, command, rows))):
        with whole_file(batch / name) as file:
            file.write(text.encode())


def _values(row: Row) -> list[object]:
    return [getattr(row, name) for name in COLUMNS]


def summary_of(rows: Sequence[Row]) -> str:
    """How many videos are done, failed and so on, and frames and tracks of all."""
    counts = Counter(row.status for row in rows)
    told = [f"{counts[name]} {name}" for name in ("done", "kept", "failed", "running", "waiting") if counts[name]]
    told.append(f"{sum(row.frames for row in rows)} frames")
    if any(row.tracks is not None for row in rows):
        told.append(f"{sum(row.tracks or 0 for row in rows)} tracks")
    return ", ".join(told)


def _page(batch: Path, command: str, rows: Sequence[Row]) -> str:
    shown = [
        (
            row.name,
            [
                escape(row.status),
                str(row.frames),
                "" if row.tracks is None else str(row.tracks),
                f"{row.seconds:.1f} s",
                _linked(batch, row),
            ],
            [False] * 5,
        )
        for row in rows
    ]
    head = ["Video", "Status", "Frames", "Tracks", "Work", "Result"]
    failed = {row.name: row.line for row in rows if row.status == "failed"}
    sections = [
        section("Crossings of all", listing(_crossings(batch, rows))),
        section("Videos", html_table(head, shown)),
        section("What failed", listing(failed)),
    ]
    return html_page(f"{len(rows)} videos: {command}", f"{summary_of(rows)}.", sections)


def _crossings(batch: Path, rows: Sequence[Row]) -> dict[str, str]:
    """Of each line in each direction over all results of `tsuiseki count`; empty where there is none."""
    sums: Counter[str] = Counter()
    for row in rows:
        path = batch / row.name / "answers.json"
        if row.status != "failed" and path.is_file():
            lines = json.loads(path.read_text(encoding="utf-8")).get("lines", {})
            for line, way, count in zip(*(lines.get(name, []) for name in ("line", "direction", "count")), strict=True):
                sums[f"{line}, {way}"] += count
    return {name: str(count) for name, count in sorted(sums.items())}


def _linked(batch: Path, row: Row) -> str:
    """A link to the best page of a result."""
    there = next((name for name in PAGES if (batch / row.name / name).exists()), None)
    return "" if there is None else f'<a href="{quote(f"{row.name}/{there}")}">{there}</a>'
