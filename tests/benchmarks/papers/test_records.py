"""Tables on pages are those of their data files, and data files are those that a command wrote."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.papers import records
from benchmarks.papers.tables import Table

PAGES = sorted(records.DOCS.rglob("*.md"))
FILES = sorted(path.stem for path in records.RECORDS.glob("*.json"))
PAGE = """# Title

<!-- table none: Table 1 -->
old
<!-- end of table -->

Words.
"""
TABLE = Table("Table 1", ("what", "here"), [("row", "1.0"), ("row | two", "2.0")])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of pages with one page, and the data file of its table."""
    monkeypatch.setattr(records, "DOCS", tmp_path)
    monkeypatch.setattr(records, "RECORDS", tmp_path)
    (tmp_path / "page.md").write_text(PAGE)
    options = {"seeds": 3, "data": Path("data"), "peer": "/usr/bin/python"}
    text = records.record(["none", "--peer", "/usr/bin/python"], options, [TABLE], ["a note"])
    (tmp_path / "none.json").write_text(text)
    return tmp_path


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(records.DOCS).as_posix())
def test_the_tables_of_a_page_are_current(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert records.refreshed(text) == text, "give `python -m benchmarks.papers.records`"


@pytest.mark.parametrize("name", FILES)
def test_a_data_file_is_on_a_page_and_as_its_command_wrote_it(name: str) -> None:
    titles = {mark[1] for page in PAGES for mark in records.MARK.findall(page.read_text("utf-8")) if mark[0] == name}
    assert titles
    content = json.loads((records.RECORDS / f"{name}.json").read_text(encoding="utf-8"))
    for title in content["tables"]:
        records.recorded_table(name, title)
    assert content["command"].startswith(("python -m benchmarks.papers ", "python -m benchmarks.all "))
    assert {"python", "numpy"} <= content["versions"].keys(), "the command writes its versions with `--record`"


def test_a_table_gets_into_its_page_with_where_it_is_from(folder: Path) -> None:
    assert records.refresh_pages() == [folder / "page.md"]
    assert records.refresh_pages() == []
    text = (folder / "page.md").read_text()
    inputs = f"python -m benchmarks.papers none --peer PYTHON; seeds 3; {records.digest(TABLE)}"
    assert f"<!-- table none: Table 1 -->\n<!-- {inputs} -->\n\n| what | here |\n" in text
    assert "| row | 1.0 |\n| row \\| two | 2.0 |\n\n<!-- end of table -->\n\nWords." in text


def test_rows_that_were_changed_by_hand_are_refused(folder: Path) -> None:
    (folder / "none.json").write_text((folder / "none.json").read_text().replace("2.0", "3.0"))
    with pytest.raises(ValueError, match="the rows of 'Table 1' are not those"):
        records.refresh_pages()


def test_a_table_that_the_command_does_not_write_is_named(folder: Path) -> None:
    (folder / "page.md").write_text(PAGE.replace("Table 1", "Table 2"))
    with pytest.raises(ValueError, match="expected the table 'Table 2', found Table 1"):
        records.refresh_pages()
