"""The words of the command line: what help says of an option, and what is wrong with one, for people.

jsonargparse names the types and keys of Python; here are the options and their values as they are typed.
"""

from __future__ import annotations

import difflib
import re
import shutil
import textwrap
from argparse import SUPPRESS, Action
from collections.abc import Iterable
from typing import Any, Literal

from jsonargparse import DefaultHelpFormatter, Namespace

METAVARS = {"int": "N", "float": "X", "str": "TEXT", "Path": "FILE"}
# What a value means says more than its type.
METAVARS_BY_NAME = {"frames": "FIRST-LAST"}
KIND_NAMES = {
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
}


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
        if not action.option_strings or default in (None, "", SUPPRESS) or isinstance(default, bool | Namespace):
            return text
        if isinstance(default, dict):
            name, value = next(iter(default.items()))
            option = f"{action.dest}.{name}".replace("_", "-")
            return f"{text} (such as --{option} {value})"
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
    return METAVARS_BY_NAME.get(name, shown) if shown == "TEXT" else shown


def metavar(kind: Any) -> str:
    """What to show for a value of type ``kind``.

    >>> metavar(float | None)
    'X'
    """
    arguments = [a for a in getattr(kind, "__args__", ()) if a is not type(None)]
    if arguments and all(isinstance(a, str) for a in arguments):
        return "{" + ",".join(arguments) + "}"
    if getattr(kind, "__origin__", None) in (tuple, list):
        several = [metavar(a) for a in arguments if a is not Ellipsis]
        return ",".join(several if len(several) > 1 else [*several, "…"])
    if arguments:
        return metavar(arguments[0])
    return METAVARS.get(getattr(kind, "__name__", ""), "VALUE")


def parts_of(kind: Any) -> list[Any]:
    """Types inside a type, without None; those of a list that may be left out, not the list."""
    parts = [a for a in getattr(kind, "__args__", ()) if a is not type(None)]
    optional = len(parts) == 1 and getattr(kind, "__origin__", None) not in (tuple, list)
    return parts_of(parts[0]) if optional else parts


def is_several(kind: Any) -> bool:
    """Whether ``kind`` is a list or tuple, maybe an optional one."""
    parts = [a for a in getattr(kind, "__args__", ()) if a is not type(None)]
    origin = getattr(kind, "__origin__", None)
    return origin in (tuple, list) or (origin not in (Literal,) and len(parts) == 1 and is_several(parts[0]))


def friendly(message: str, options: Iterable[str]) -> str:
    """One line that says which option is wrong and what it takes, from a message of jsonargparse."""
    text = " ".join(message.split())
    text = text.replace('Parser key "config": ', "")
    # The options of a group that may be null have been found wrong by a parser of their own, without its name.
    if match := re.search(r"[Pp]arser key \"(.+?)\": .* Errors: - (.*?) - Expected .*NestedArg\(", text):
        return match[2].replace("--", f"{option_shown(match[1])}.", 1)
    # Settings that may be null refuse a value of theirs; what null would be is beside the point.
    refused = r"Does not validate against any of the Union subtypes.* Errors: - (.*?) - Expected an? "
    if match := re.match(refused, text):
        return match[1]
    if match := re.search(r"[Pp]arser key \"(.+?)\": (.*)", text):
        return f"{option_shown(match[1])}: {_expectation(match[2])}"
    if match := re.search(r"Group '(.+?)' does not accept option '(.+?)'", text):
        return _unknown(f"{match[1]}.{match[2]}", options)
    if match := re.search(r"Option '(.+?)' is not accepted", text):
        return _unknown(match[1], options)
    if match := re.search(r"unrecognized arguments: (\S+)", text, re.IGNORECASE):
        word = match[1].split("=")[0]
        return _unknown(word, options) if word.startswith("-") else f"expected no further words, got {word!r}"
    if match := re.search(r"the following arguments are required: (.*)", text):
        names = {option.lstrip("-") for option in options}
        missing = [option_shown(n) if n.replace("_", "-") in names else n.upper() for n in match[1].split(", ")]
        return f"missing: {', '.join(missing)}"
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
    return message if message.startswith("--") or len(meant) != 1 else f"{meant[0]}: {message}"


def _expectation(text: str) -> str:
    """What a value should have been and what it was."""
    text = re.sub(r"<class '(?:\w+\.)*(\w+)'>", r"\1", text[:1].lower() + text[1:])
    # An option that may be left out is a union with None in jsonargparse's words.
    optional = r"^does not validate against any of the Union subtypes Subtypes: \[(.*), NoneType\].*Given value: (.*)$"
    text = re.sub(optional, r"expected \1. Got value: \2", text)
    text = re.sub(r"\. Got value: (.*)$", r", got '\1'", text)
    text = re.sub(r"^expected an? ", "expected ", text)
    text = re.sub(r"(?:typing\.)?Literal\[(.*?)\]", r"one of \1", text)
    text = re.sub(
        r"^expected tuple\[(.*?)\]", lambda found: f"expected tuple with {len(found[1].split(','))} elements", text
    )
    text = re.sub(r"^expected \w+Settings\b", "expected null or options of its own below it", text)
    text = re.sub(r"^expected tuple with (\d+) elements", r"expected \1 values separated by commas", text)
    text = re.sub(r"^expected (?:list\[)+float\]+", "expected numbers separated by commas", text)
    text = re.sub(r"^expected list\[int\]", "expected whole numbers separated by commas", text)
    text = re.sub(r", got '\[(.*)\]'$", lambda found: ", got '" + found[1].replace("'", "") + "'", text)
    for name, words in KIND_NAMES.items():
        text = re.sub(rf"^expected {name}\b", f"expected {words}", text)
    return text


def _unknown(name: str, options: Iterable[str]) -> str:
    shown = option_shown(name.lstrip("-"))
    close = difflib.get_close_matches(shown, list(options), n=1, cutoff=0.6)
    return f"unknown option {shown}" + (f"; did you mean {close[0]}?" if close else "; --help lists them")


def option_shown(name: str) -> str:
    return "--" + name.replace("_", "-")
