"""`report.html` of answers, and their tables as files."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from tsuiseki.tracking.answers.counting import Answers, Table
from tsuiseki.tracking.answers.plots import FIGURES
from tsuiseki.tracking.report.page import html_page, html_table, scrolling, section
from tsuiseki.tracking.report.plots import inline_svg

MOST_ROWS = 50
HEADINGS = {
    "lines": "Crossings of lines",
    "zones": "Zones",
    "turns": "From line to line",
    "gatherings": "Gatherings",
    "people": "People",
}


def write_csv(path: Path, table: Table) -> None:
    """Write a table with a heading."""
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(table)
        rows.writerows(zip(*table.values(), strict=True))


def write_json(path: Path, answers: Answers) -> None:
    """Write all tables, each as columns by name."""
    path.write_text(json.dumps(answers.tables, indent=1) + "\n", encoding="utf-8")


def answers_page(answers: Answers, source: str) -> str:
    """The page as HTML, self-contained.

    Args:
        answers: to show.
        source: what was counted in, for the heading.
    """
    tables = {name: _shown(answers.tables[name]) for name in HEADINGS}
    note = "<p class=note>low and high are the ends of an interval that holds the true number in 9 of 10 cases.</p>"

    def shown(name: str) -> str:
        return scrolling(inline_svg(partial(FIGURES[name], answers), name))

    sections = [
        section(HEADINGS["lines"], tables["lines"] and tables["lines"] + note + shown("crossings")),
        section(HEADINGS["zones"], tables["zones"] and tables["zones"] + shown("occupancy")),
        section("Where people were", shown("places")),
        *(section(HEADINGS[name], tables[name]) for name in ("turns", "gatherings", "people")),
    ]
    seconds = answers.length / answers.frame_rate
    introduction = f"{len(answers.tables['people']['id'])} people in {seconds:.0f} seconds."
    return html_page(f"Counted in {source}", introduction, sections)


def _shown(table: Table) -> str:
    """A table for the page; nothing where it has no row."""
    rows = list(zip(*table.values(), strict=True))
    if not rows:
        return ""
    more = f"<p class=note>and {len(rows) - MOST_ROWS} more</p>" if len(rows) > MOST_ROWS else ""
    lines = [(str(row[0]), [_cell(value) for value in row[1:]], [False] * (len(row) - 1)) for row in rows[:MOST_ROWS]]
    return html_table([name.replace("_", " ") for name in table], lines) + more


def _cell(value: Any) -> str:
    return "" if value is None else escape(f"{value:g}" if isinstance(value, float) else str(value))


def files_of(answers: Answers, source: str) -> dict[str, Any]:
    """What writes each file of a result, as for `Result.files`."""

    def figure(draw: Any, path: Path) -> None:
        draw(answers).savefig(path, facecolor="white")

    files: dict[str, Any] = {"answers.json": lambda path, _: write_json(path, answers)}
    for name, table in answers.tables.items():
        files[f"{name}.csv"] = lambda path, _, table=table: write_csv(path, table)
    for name, draw in FIGURES.items():
        files[f"{name}.png"] = lambda path, _, draw=draw: figure(draw, path)
    files["report.html"] = lambda path, _: path.write_text(answers_page(answers, source), encoding="utf-8")
    return files


def summary(answers: Answers) -> Sequence[str]:
    """A line for each line and zone."""
    table, zones = answers.tables["lines"], answers.tables["zones"]
    told = [
        f"{line} {way}: {number} ({low}-{high})" if low != high else f"{line} {way}: {number}"
        for line, way, number, low, high in zip(*table.values(), strict=True)
    ]
    rows = zip(*(zones[name] for name in ("zone", "people", "most", "stay")), strict=True)
    return [
        *told,
        *(f"{zone}: {people:g} people on average, {most} at most, {stay:g} s" for zone, people, most, stay in rows),
    ]
