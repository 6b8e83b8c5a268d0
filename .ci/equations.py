"""Which file computes which numbered equation of the papers, and which others name it, read from docstrings.

The docstring of the function or class that computes an equation says ``Eq. (2.14)`` or ``Eqs. (63)-(66) and (68)``. A
mention elsewhere is written otherwise. `python .ci/equations.py --write` brings the tables of
docs/reference/equations.md up to date; without the option it says whether they are.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
PAGE = REPOSITORY / "docs/reference/equations.md"
NUMBER = r"\d+(?:\.\d+)?"
# (7), (16)-(18), eq. 2.12-2.14
SPAN = re.compile(
    rf"\(({NUMBER})\)(?:\s?[-–]\s?\(({NUMBER})\))?|[Ee]q(?:uations?)?\.?\s({NUMBER})(?:\s?[-–]\s?({NUMBER}))?"
)
COMPUTED = re.compile(rf"\bEqs?\.\s+\({NUMBER}\)(?:(?:-|,\s|\sand\s)\({NUMBER}\))*")
DOCTEST = re.compile(r"^\s*>>>.*$", re.MULTILINE)
TABLE = re.compile(r"(<!-- equations of (.*) -->\n)[^#]*")
# Files named in a row.
MOST_FILES = 3


@dataclass(frozen=True)
class Paper:
    """Numbered equations, and the files and folders whose docstrings mean them."""

    numbers: tuple[str, ...]
    places: tuple[str, ...]


def _chapters(last: dict[int, int]) -> tuple[str, ...]:
    return tuple(f"{chapter}.{k}" for chapter, count in last.items() for k in range(1, count + 1))


PAPERS = {
    "thesis": Paper(_chapters({2: 17, 3: 8, 4: 5, 5: 3}), ("tracking", "trainers", "models")),
    "goldfish": Paper(
        tuple(map(str, range(1, 19))),
        (
            "tracking/bodies",
            "tracking/filters/body_motion.py",
            "tracking/filters/learnt_motion.py",
            "trainers/learn_motion.py",
        ),
    ),
    "finite sets": Paper(
        tuple(map(str, range(1, 69))),
        (
            "tracking/features/colour_region.py",
            "tracking/filters/base.py",
            "tracking/filters/particle_filter.py",
            "tracking/filters/resampling.py",
            "tracking/filters/finite_sets",
            "tracking/filters/point_motion.py",
            "tracking/points",
        ),
    ),
}


@dataclass(frozen=True, order=True)
class Mention:
    """A file that names an equation; those that compute it come first, then those that name the fewest."""

    only_named: bool
    equations: int
    path: str


def mentions(paper: Paper) -> dict[str, list[Mention]]:
    """The files that name each equation, the computing ones first."""
    rows: dict[str, list[Mention]] = {number: [] for number in paper.numbers}
    for path in _files(paper.places):
        texts = list(_docstrings(path))
        named = {number for text in texts for number in _numbers(text)} & rows.keys()
        computed = {number for text in texts for mark in COMPUTED.findall(text) for number in _numbers(mark)}
        for number in named:
            place = path.relative_to(REPOSITORY).as_posix()
            rows[number].append(Mention(number not in computed, len(named), place))
    return {number: sorted(files) for number, files in rows.items()}


def table(name: str) -> str:
    """The rows of a paper as Markdown; neighbours in the same files share one."""
    rows: list[tuple[list[str], list[str]]] = []
    for number, files in mentions(PAPERS[name]).items():
        paths = [mention.path for mention in files[:MOST_FILES]]
        if rows and rows[-1][1] == paths:
            rows[-1][0].append(number)
        else:
            rows.append(([number], paths))
    lines = ["| equation | file |", "|---|---|"]
    for numbers, paths in rows:
        shown = numbers[0] if len(numbers) == 1 else f"{numbers[0]} to {numbers[-1]}"
        lines.append(f"| {shown} | {', '.join(f'`{path}`' for path in paths)} |")
    return "\n".join(lines)


def page() -> str:
    """The text of the page with today's tables."""
    return TABLE.sub(lambda place: f"{place[1]}\n{table(place[2])}\n\n", PAGE.read_text(encoding="utf-8"))


def _files(places: tuple[str, ...]) -> Iterator[Path]:
    for place in places:
        path = REPOSITORY / place
        yield from [path] if path.is_file() else sorted(path.rglob("*.py"))


def _docstrings(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            yield DOCTEST.sub("", ast.get_docstring(node) or "")


def _numbers(text: str) -> Iterator[str]:
    for match in SPAN.finditer(text):
        first, last = (match[1], match[2]) if match[1] else (match[3], match[4])
        chapter, dot, start = first.rpartition(".")
        end = start if last is None else last.rpartition(".")[2]
        yield from (f"{chapter}{dot}{k}" for k in range(int(start), int(end) + 1))


def main() -> int:
    """Write the page, or say whether it is current."""
    text = page()
    if "--write" in sys.argv:
        PAGE.write_text(text, encoding="utf-8")
    elif text != PAGE.read_text(encoding="utf-8"):
        print(f"{PAGE.relative_to(REPOSITORY)} is not current; give `python .ci/equations.py --write`")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
