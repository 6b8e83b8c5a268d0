"""What the README and the pages beside it name exists: links, configurations, benchmarks, commands."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
PAGES = [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").glob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_a_page_links_to_exist(page: Path) -> None:
    for name in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        assert "://" in name or (page.parent / name).exists(), name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_configurations_and_benchmarks_that_a_page_names_exist(page: Path) -> None:
    named = re.findall(r"\b((?:configs|benchmarks)/[\w./]+\.(?:yaml|py))", page.read_text(encoding="utf-8"))
    modules = re.findall(r"python -m (benchmarks(?:\.\w+)+)", page.read_text(encoding="utf-8"))
    named += [module.replace(".", "/") + ".py" for module in modules]
    assert [name for name in named if not (REPOSITORY / name).exists()] == []


def test_the_first_screen_says_what_a_stranger_needs() -> None:
    screen = "\n".join(PAGES[0].read_text(encoding="utf-8").splitlines()[:40])
    for needed in ("make demo", "make test", "docs/images/demo.jpg", "pip install", "import tsuiseki", "## Methods"):
        assert needed in screen, needed
