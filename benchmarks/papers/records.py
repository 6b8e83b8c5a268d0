"""Tables of the result pages: the data file of a run, and its Markdown between two marks of a page.

    <!-- table phd: Standard scenarios -->
    <!-- end of table -->

``docs/results/tables/phd.json`` holds what `python -m benchmarks.papers phd --record phd` found. With that option a
command writes its data file and renews the pages; `python -m benchmarks.papers.records` renews the pages alone.
"""

from __future__ import annotations

import hashlib
import json
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.papers.tables import Table
from tsuiseki.tracking.output import versions

REPOSITORY = Path(__file__).resolve().parents[2]
DOCS = REPOSITORY / "docs"
RECORDS = DOCS / "results" / "tables"
MARK = re.compile(r"^<!-- table ([\w-]+): ([^\n]+) -->\n(.*?)^<!-- end of table -->$", re.MULTILINE | re.DOTALL)


def record(
    words: Sequence[str],
    options: Mapping[str, Any],
    tables: Sequence[Table],
    notes: Sequence[str],
    module: str = "benchmarks.papers",
) -> str:
    """The data file of a run: its command, all options with their values, versions, and its tables by title.

    Args:
        words: name and options of the experiment.
        options: by name, defaults included.
        tables: that it wrote.
        notes: that stand below them.
        module: of the command.
    """
    # Where the peers are installed makes no difference.
    places = {options["peer"]: "PYTHON"} if options.get("peer") else {}
    content = {
        "command": shlex.join(["python", "-m", module, *(places.get(word, word) for word in words)]),
        "options": {name: places.get(str(value), value) for name, value in options.items()},
        "versions": versions(),
        "tables": {
            table.title: {"digest": digest(table), "columns": table.columns, "rows": table.rows} for table in tables
        },
        "notes": notes,
    }
    return as_text(content)


def as_text(content: Mapping[str, Any]) -> str:
    """A data file: JSON with the cells of a row on one line."""
    text = json.dumps(content, indent=1, ensure_ascii=False, default=str)
    return re.sub(r"\[\n +(\"[^\n]*\"(?:,\n +\"[^\n]*\")*)\n +\]", _on_one_line, text) + "\n"


def _on_one_line(cells: re.Match[str]) -> str:
    return "[" + re.sub(r",\n +", ", ", cells[1]) + "]"


def digest(table: Table) -> str:
    """Twelve hexadecimal digits for what stands in a table."""
    content = json.dumps([list(table.columns), [list(row) for row in table.rows]])
    return hashlib.sha256(content.encode()).hexdigest()[:12]


def recorded_table(name: str, title: str) -> tuple[Table, Mapping[str, Any]]:
    """A table of the data file ``name``, and all of that file.

    Raises:
        ValueError: the file has no such table, or its rows were changed by hand.
    """
    content = json.loads((RECORDS / f"{name}.json").read_text(encoding="utf-8"))
    if title not in content["tables"]:
        raise ValueError(f"{name}.json: expected the table {title!r}, found {', '.join(content['tables'])}")
    fields = content["tables"][title]
    table = Table(title, fields["columns"], fields["rows"])
    if digest(table) != fields["digest"]:
        raise ValueError(f"{name}.json: the rows of {title!r} are not those that the digest was made of")
    return table, content


def refreshed(page: str) -> str:
    """The text of a page with its tables as their data files have them."""
    return MARK.sub(_block, page)


def _block(mark: re.Match[str]) -> str:
    name, title, _ = mark.groups()
    table, content = recorded_table(name, title)
    seeds = {key: value for key, value in content["options"].items() if "seed" in key or key == "runs"}
    inputs = "; ".join([content["command"], *(f"{key} {value}" for key, value in seeds.items()), digest(table)])
    lines = [f"<!-- table {name}: {title} -->", f"<!-- {inputs} -->", "", table.markdown(), ""]
    return "\n".join([*lines, "<!-- end of table -->"])


def refresh_pages() -> list[Path]:
    """Write the tables of all data files into the pages; the pages that changed."""
    changed = []
    for path in sorted(DOCS.rglob("*.md")):
        text = path.read_text(encoding="utf-8")
        renewed = refreshed(text)
        if renewed != text:
            path.write_text(renewed, encoding="utf-8")
            changed.append(path)
    return changed


if __name__ == "__main__":
    for page in refresh_pages():
        print(page.relative_to(REPOSITORY), file=sys.stderr)
