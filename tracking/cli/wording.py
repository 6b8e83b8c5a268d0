"""The words of the command line: what help says of an option, and what is wrong with one, for people.

jsonargparse names the types and keys of Python; here are the options and their values as they are typed.
"""

from __future__ import annotations

import difflib
import re
import shutil
import textwrap
from argparse import SUPPRESS, Action
from collections.abc import Callable, Iterable
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

from jsonargparse import DefaultHelpFormatter, Namespace

KINDS = {"int": "a whole number", "float": "a number", "bool": "true or false", "str": "text"}
METAVARS = {"int": "N", "float": "X", "str": "TEXT", "Path": "FILE"}
# What jsonargparse says of a value, and the words of people for it, one after the other.
EXPECTATIONS: tuple[tuple[str, str | Callable[[re.Match[str]], str]], ...] = (
    (r"<class '(?:\w+\.)*(\w+)'>", r"\1"),
    # An option that may be left out is a union with None.
    (r"^Does not validate against any of the Union subtypes Subtypes: \[(.*), NoneType\].*Given value: (.*)$",
     r"expected \1. Got value: \2"),
    (r"\. Got value: ?(.*)$", r", got '\1'"),
    (r"^[Ee]xpected (?:an? )?", "expected "),
    (r"(?:typing\.)?Literal\[(.*?)\]", r"one of \1"),
    (r"^expected tuple\[(.*?)\]", lambda found: f"expected tuple with {found[1].count(',') + 1} elements"),
    (r"^expected tuple with (\d+) elements", r"expected \1 values separated by commas"),
    (r"^expected \w+Settings\b", "expected null or options of its own below it"),
    (r"^expected (?:list\[)+float\]+", "expected numbers separated by commas"),
    (r"^expected list\[int\]", "expected whole numbers separated by commas"),
    (r", got '\[(.*)\]'$", lambda found: f", got '{found[1].replace(chr(39), '')}'"),
    (r"^expected (int|float|bool|str)\b", lambda found: f"expected {KINDS[found[1]]}"),
)  # fmt: skip


class HelpFormatter(DefaultHelpFormatter):
    """Options with dashes, their kind in place of their name, and defaults only where there is one."""

    def __init__(self, prog: str) -> None:
        width = min(100, shutil.get_terminal_size().columns - 2)
        super().__init__(prog, max_help_position=30, width=width)  # type: ignore[no-untyped-call]

    def _get_help_string(self, action: Action) -> str:
        text = (action.help or "").removesuffix(".").replace("``", "")
        if action.required and action.option_strings:
            return f"{text} (required)"
        default = action.default
        if not action.option_strings or default in (None, "", SUPPRESS) or isinstance(default, bool | dict | Namespace):
            return text
        shown = ",".join(map(str, default)) if isinstance(default, tuple | list) else default
        return f"{text} (default: {shown})"

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        # Paragraphs stay apart.
        parts = text.split("\n\n")
        return "\n\n".join(textwrap.fill(" ".join(part.split()), width, initial_indent=indent) for part in parts)

    def _get_default_metavar_for_optional(self, action: Action) -> str:
        return shown_value(action.dest, getattr(action, "_typehint", action.type), action.help or "")

    def _format_args(self, action: Action, default_metavar: str) -> str:
        # Lists are given as one word, 1,2: jsonargparse would show [ITEM,...].
        several = is_several(getattr(action, "_typehint", None)) and action.option_strings
        return default_metavar if several else super()._format_args(action, default_metavar)


def shown_value(name: str, kind: Any, description: str) -> str:
    """What stands for the value of the option ``name`` in the help."""
    shown = metavar(kind)
    if shown == "FILE" and description.startswith("folder"):
        return "DIR"
    return "FIRST-LAST" if (name, shown) == ("frames", "TEXT") else shown


def metavar(kind: Any) -> str:
    """What to show for a value of type ``kind``.

    >>> metavar(float | None)
    'X'
    """
    parts = [part for part in get_args(kind) if part is not NoneType]
    if parts and all(isinstance(part, str) for part in parts):
        return "{" + ",".join(parts) + "}"
    if get_origin(kind) in (tuple, list):
        several = [metavar(part) for part in parts if part is not Ellipsis]
        return ",".join(several if len(several) > 1 else [*several, "…"])
    return metavar(parts[0]) if parts else METAVARS.get(getattr(kind, "__name__", ""), "VALUE")


def is_several(kind: Any, lists: bool = False) -> bool:
    """Whether ``kind`` is a list or tuple, of ``lists`` where that is asked, maybe an optional one."""
    if get_origin(kind) in (Union, UnionType):
        return is_several(get_args(kind)[0], lists)
    return get_origin(kind) in (tuple, list) and (not lists or any(map(is_several, get_args(kind))))


def friendly(message: str, options: Iterable[str]) -> str:
    """One line that says which option is wrong and what it takes, from a message of jsonargparse."""
    text = " ".join(message.split()).replace('Parser key "config": ', "")
    # The options of a group that may be null have been found wrong by a parser of their own, without its name; what
    # null would be is beside the point.
    if match := re.search(r"(?:[Pp]arser key \"(.+?)\": .*)?subtypes.* Errors: - (.*?) - Expected .*NestedArg\(", text):
        return match[2] if match[1] is None else match[2].replace("--", f"{option_shown(match[1])}.", 1)
    if match := re.search(r"[Pp]arser key \"(.+?)\": (.*)", text):
        return f"{option_shown(match[1])}: {_expectation(match[2])}"
    if match := re.search(r"(?:Group '(.+?)' does not accept o|O)ption '(.+?)'", text):
        return _unknown(f"{match[1]}.{match[2]}" if match[1] else match[2], options)
    if match := re.search(r"unrecognized arguments: ([^\s=]+)", text, re.IGNORECASE):
        return _unknown(match[1], options) if match[1][0] == "-" else f"expected no further words, got {match[1]!r}"
    if match := re.search(r"the following arguments are required: (.*)", text):
        shown = [(name, option_shown(name)) for name in match[1].split(", ")]
        return f"missing: {', '.join(option if option in options else name.upper() for name, option in shown)}"
    return text[:1].lower() + text[1:]


def with_option(message: str, words: Iterable[str]) -> str:
    """What a group of settings says of a value, with the option of the group that was typed for it.

    >>> with_option("expected a gain from 0, got -1", ["clip.mp4", "--filter.gain", "-1"])
    '--filter.gain: expected a gain from 0, got -1'
    """
    names = {word.partition("=")[0] for word in words if word.startswith("--")}
    # A message speaks of the field: of `min_time` for --flow.min-time.
    fields = {name: name.rpartition(".")[2].replace("-", "_") for name in names if "." in name}
    meant = [name for name, field in fields.items() if re.search(rf"\b{re.escape(field)}\b", message)]
    return message if message.startswith(("--", "unknown")) or len(meant) != 1 else f"{meant[0]}: {message}"


def _expectation(text: str) -> str:
    """What a value should have been and what it was."""
    for pattern, words in EXPECTATIONS:
        text = re.sub(pattern, words, text)
    return text[:1].lower() + text[1:]


def _unknown(name: str, options: Iterable[str]) -> str:
    shown = option_shown(name.lstrip("-"))
    close = difflib.get_close_matches(shown, list(options), n=1, cutoff=0.6)
    return f"unknown option {shown}" + (f"; did you mean {close[0]}?" if close else "; --help lists them")


def option_shown(name: str) -> str:
    return "--" + name.replace("_", "-")
