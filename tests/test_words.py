"""The words of the code: docstrings that say something, constants with their reason, names of what a value is."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
FOLDERS = ("models", "datamodules", "trainers", "tracking")

# Words that a docstring may have beside those of the name and still say nothing more.
SMALL = """
    a all an and are as at be been by each for from had has have his in is it its no not of on one or out so that the
    their them there they this to up was were what where which who whose with
"""
# Pronouns, participles and adjectives that say nothing of what a value is.
VAGUE = """
    after alike asked before each every found given kept known likest made meant more most nobody one other own rest
    said seen shown some somebody such taken told wanted whole
"""
# Largest share of vague names among all that are bound.
VAGUE_SHARE = 0.01

Documented = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def sources() -> Iterator[tuple[Path, str]]:
    """Each file of the four folders, with its text."""
    for folder in FOLDERS:
        for path in sorted((REPOSITORY / folder).rglob("*.py")):
            yield path.relative_to(REPOSITORY), path.read_text(encoding="utf-8")


def words(text: str) -> set[str]:
    """The words and numbers of a text or of a name, without endings and small words."""
    parts = re.findall(r"[a-z]+|[0-9]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text).lower())
    return {re.sub(r"(?<=...)(ing|ed|es|s|d|e)$", "", part) for part in parts if part not in SMALL.split()}


def documented(node: ast.AST, owner: str = "") -> Iterator[tuple[Documented, str]]:
    """The functions and classes in a tree that have a docstring, with the words that their names say."""
    for child in ast.iter_child_nodes(node):
        names = owner
        if isinstance(child, Documented):
            parameters = [] if isinstance(child, ast.ClassDef) else [argument.arg for argument in child.args.args]
            if ast.get_docstring(child):
                yield child, " ".join([child.name, owner, *parameters]).replace("_", " ")
            names = child.name if isinstance(child, ast.ClassDef) else owner
        yield from documented(child, names)


def empty_docstrings(text: str) -> list[str]:
    """Docstrings that send the reader elsewhere or say no more than the name."""
    lines = []
    for node, names in documented(ast.parse(text)):
        docstring = ast.get_docstring(node) or ""
        if re.match(r"See [`:A-Z]", docstring) or words(docstring) <= words(names):
            lines.append(f"{node.lineno} {node.name}: {docstring}")
    return lines


def numeric(value: ast.expr) -> bool:
    """Whether a number stands in an expression."""
    numbers = (part.value for part in ast.walk(value) if isinstance(part, ast.Constant))
    return any(isinstance(number, int | float) and not isinstance(number, bool) for number in numbers)


def bare_constants(text: str) -> list[str]:
    """Numbers of a module that share a line, or that neither a comment nor a string below explains."""
    tree, lines, bare = ast.parse(text), text.splitlines(), []
    for node, following in zip(tree.body, [*tree.body[1:], None], strict=True):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None or not numeric(node.value):
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        names = [part for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)]
        names = [name for name in names if name.id.strip("_").isupper()]
        explained = (
            "#" in lines[node.lineno - 1]
            or (node.lineno > 1 and lines[node.lineno - 2].lstrip().startswith("#"))
            or (isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant))
        )
        if names and (len(names) > 1 or not explained):
            bare.append(f"{node.lineno} {', '.join(name.id for name in names)}")
    return bare


def bound_names(text: str) -> Iterator[str]:
    """Every name that a file binds: variables, loop variables and parameters."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.arg):
            yield node.arg


def test_docstrings_say_something():
    assert [f"{path}:{line}" for path, text in sources() for line in empty_docstrings(text)] == []


def test_constants_stand_alone_with_their_reason():
    assert [f"{path}:{line}" for path, text in sources() for line in bare_constants(text)] == []


def test_names_say_what_a_value_is():
    names = [(path, name) for path, text in sources() for name in bound_names(text)]
    vague = [f"{path}: {name}" for path, name in names if name.strip("_") in VAGUE.split()]
    assert len(vague) <= VAGUE_SHARE * len(names), vague


@pytest.mark.parametrize(
    ("docstring", "empty"),
    [
        ("See `Base.moved`.", True),
        ("The moved boxes.", True),
        ("What the boxes moved to.", True),
        ("``(N, 4)`` boxes a second later, pixels.", False),
        ("Seen boxes.", False),
    ],
)
def test_an_empty_docstring_is_recognised(docstring, empty):
    assert bool(empty_docstrings(f'def moved(boxes):\n    """{docstring}"""\n')) == empty


@pytest.mark.parametrize(
    ("text", "bare"),
    [
        ("# Pixels.\nGATE = 3.0\n", False),
        ("GATE = 3.0\n", True),
        ('GATE = 3.0\n"""Pixels."""\n', False),
        ("# Pixels.\nGATE, REACH = 3.0, 4.0\n", True),
        ('NAMES = ("a", "b")\n', False),
    ],
)
def test_a_bare_constant_is_recognised(text, bare):
    assert bool(bare_constants(text)) == bare
