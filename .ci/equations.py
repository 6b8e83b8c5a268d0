"""Which file holds which numbered equation of the papers, read from the docstrings that name them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
NUMBER = r"\d+(?:\.\d+)?"
# (7), (16)-(18), eq. 2.12-2.14
SPAN = re.compile(
    rf"\(({NUMBER})\)(?:\s?[-–]\s?\(({NUMBER})\))?|[Ee]q(?:uations?)?\.?\s({NUMBER})(?:\s?[-–]\s?({NUMBER}))?"
)


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
        ("tracking/bodies", "tracking/filters/body_motion.py", "tracking/filters/learnt_motion.py"),
    ),
    "finite sets": Paper(
        tuple(map(str, range(1, 69))),
        (
            "tracking/filters/base.py",
            "tracking/filters/particle_filter.py",
            "tracking/filters/resampling.py",
            "tracking/filters/finite_sets",
            "tracking/filters/point_motion.py",
            "tracking/points",
        ),
    ),
}


def rooms(paper: Paper) -> dict[str, list[str]]:
    """The files that name each equation, those first that name the fewest."""
    found: dict[str, list[tuple[int, str]]] = {number: [] for number in paper.numbers}
    for path in _files(paper.places):
        named = {number for text in _docstrings(path) for number in _named(text)} & found.keys()
        for number in named:
            found[number].append((len(named), path.relative_to(REPOSITORY).as_posix()))
    return {number: [path for _, path in sorted(every)] for number, every in found.items()}


def table(name: str) -> str:
    """The rows of a paper as Markdown; neighbours in the same files share one."""
    rows: list[tuple[list[str], list[str]]] = []
    for number, paths in rooms(PAPERS[name]).items():
        if rows and rows[-1][1] == paths[:3]:
            rows[-1][0].append(number)
        else:
            rows.append(([number], paths[:3]))
    lines = ["| equation | file |", "|---|---|"]
    for numbers, paths in rows:
        shown = numbers[0] if len(numbers) == 1 else f"{numbers[0]} to {numbers[-1]}"
        lines.append(f"| {shown} | {', '.join(f'`{path}`' for path in paths)} |")
    return "\n".join(lines)


def _files(places: tuple[str, ...]) -> Iterator[Path]:
    for place in places:
        path = REPOSITORY / place
        yield from [path] if path.is_file() else sorted(path.rglob("*.py"))


def _docstrings(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            yield ast.get_docstring(node) or ""


def _named(text: str) -> Iterator[str]:
    for match in SPAN.finditer(text):
        first, last = (match[1], match[2]) if match[1] else (match[3], match[4])
        chapter, dot, start = first.rpartition(".")
        end = start if last is None else last.rpartition(".")[2]
        yield from (f"{chapter}{dot}{k}" for k in range(int(start), int(end) + 1))
