"""From the words of a command line and files of options to a call of a command's function."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import yaml
from cyclopts.argument import Argument, ArgumentCollection, update_argument_collection
from cyclopts.exceptions import (
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
)
from cyclopts.utils import UNSET
from pydantic import ValidationError

from tsuiseki.tracking.bounds import refusal
from tsuiseki.tracking.cli.commands import APP, PROGRAM, command_of, takes_all
from tsuiseki.tracking.cli.config import check_regular, read_config
from tsuiseki.tracking.errors import RequestError, hint_at
from tsuiseki.tracking.fields import refused
from tsuiseki.tracking.openers.yaml_files import yaml_of
from tsuiseki.tracking.runs.options import Files, Output

if TYPE_CHECKING:
    from tsuiseki.tracking.result import Result

CONFIG, PRINT = "--config", "--print-config"


@dataclass(frozen=True)
class Request:
    """A command with its arguments, checked.

    Attributes:
        function: of the command.
        arguments: all of them, defaults too.
        settings: every option with its value, plain, as a file for ``--config`` has them.
        chosen: names of the options that words or files gave.
        spare: words by place that were left over.
    """

    function: Callable[..., Any]
    arguments: inspect.BoundArguments
    settings: Mapping[str, Any]
    chosen: Sequence[str] = ()
    spare: Sequence[str] = ()

    def run(self, **extra: Any) -> Any:
        """Call the function, with ``extra`` arguments."""
        with refused():
            return self.function(*self.arguments.args, **self.arguments.kwargs, **extra)


def request_of(words: Sequence[str], options: Mapping[str, Any] | None = None, spare: bool = False) -> Request:
    """The request that words make.

    Args:
        words: of the command line, after the program's name.
        options: more, by their names with underscores; the words win over them.
        spare: words by place may be left over.

    Raises:
        RequestError: an unknown option, a wrong value, a missing option, a broken file of options.
        SystemExit: the options were to be printed.
    """
    chain, command = command_of(words)
    arguments, files = (list(words), []) if takes_all(command) else _split_off(words, CONFIG)
    if not all(file.strip() for file in files):
        raise RequestError(f"{CONFIG}: expected a file, got an empty name")
    below = [read_config(Path(file), [PROGRAM, *chain]) for file in reversed(files)] + [options or {}]
    collections: list[ArgumentCollection] = []
    printed = PRINT in arguments
    APP.config = (partial(_fill, below=below, collections=collections, printed=printed),)
    try:
        arguments = [word for word in arguments if word != PRINT]
        function, bound, *left = APP.parse_known_args(arguments) if spare else APP.parse_args(arguments)
    except CycloptsError as error:
        raise RequestError(worded(error)) from error
    finally:
        APP.config = ()
    bound.apply_defaults()
    settings, chosen = _settings(collections[0], bound) if collections else ({}, [])
    for name, value in settings.items():
        _check_files(name, value)
    for name, value in bound.arguments.items():
        if isinstance(value, Output):
            value = bound.arguments[name] = replace(
                value, command=(PROGRAM, *chain), settings=recorded(settings), chosen=tuple(chosen), page=_paged
            )
        if isinstance(value, Output | Files):
            value.check()
    return Request(function, bound, settings, chosen, list(left[0]) if spare else ())


def _paged(result: Result[Any]) -> Result[Any]:
    """A result with its page, which is loaded when there is one to write."""
    from tsuiseki.tracking.counts.page import with_page

    return with_page(result)


def recorded(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings as files keep them: without the name and password that a receiver of events asks for."""
    if settings.get("events") is None:
        return dict(settings)
    from tsuiseki.tracking.events.event import public_name

    return {**settings, "events": public_name(settings["events"])}


def _split_off(words: Sequence[str], name: str) -> tuple[list[str], list[str]]:
    """The words without an option of the program itself, and its values."""
    remaining, values, left = list[str](), list[str](), list(words)
    while left:
        word = left.pop(0)
        if word.startswith(f"{name}="):
            values.append(word.partition("=")[2])
        elif word == name:
            if not left:
                raise RequestError(f"{name}: expected a file, got nothing")
            values.append(left.pop(0))
        else:
            remaining.append(word)
    return remaining, values


def _fill(
    _: Any,
    chain: Sequence[str],
    arguments: ArgumentCollection,
    below: Iterable[Mapping[str, Any]],
    collections: list[ArgumentCollection],
    printed: bool,
) -> None:
    """Give ``arguments`` what files say where the words leave it open."""
    del chain
    collections.append(arguments)
    for options in below:
        update_argument_collection(dict(options), "", arguments, root_keys=(), allow_unknown=False)
    for argument in arguments:
        _check_not_empty(argument)
    if printed:
        values: dict[str, Any] = {}
        for argument in (argument for argument in arguments if not argument.keys and argument.parse):
            value = _described(argument, argument.field_info.default)
            values |= value if argument.positives == ("*",) else {argument.field_info.name: value}
        print(yaml.safe_dump(plain(values), sort_keys=False, allow_unicode=True), end="")
        raise SystemExit(0)


def _check_not_empty(argument: Argument) -> None:
    """Refuse an empty word, which stands for the current folder as a path; a file may empty an option of text."""
    words = [token for token in argument.tokens if token.implicit_value is UNSET and not token.value.strip()]
    if any(token.source == "cli" or argument.index is not None or Path in _kinds(argument.hint) for token in words):
        raise RequestError(f"{_called(argument)}: expected a value, got an empty one; leave it out or fill it in")


def _kinds(hint: Any) -> list[Any]:
    """A type and those that it is made of."""
    return [hint, *(kind for inner in get_args(hint) for kind in _kinds(inner))]


def _called(argument: Argument) -> str:
    """How a message calls an argument."""
    name = argument.name.removeprefix("--") if argument.index is None else argument.field_info.name.upper()
    return f"`{name.replace('-', '_')}`" if argument.index is None else name


def _described(argument: Argument, default: Any) -> Any:
    """What words and files say for an option, or its default; of a group for each of its fields. None for none."""
    if argument.children:
        fields = [(child, child.field_info) for child in argument.children if child.parse]
        return {field.name: _described(child, getattr(default, field.name, field.default)) for child, field in fields}
    if not argument.tokens:
        return None if default is argument.field_info.empty else default
    values = [
        yaml_of(token.value, argument.name, "a value") if token.implicit_value is UNSET else token.implicit_value
        for token in argument.tokens
    ]
    return values if argument.token_count()[1] or len(values) > 1 else values[0]


def _shown(argument: Argument, value: Any) -> Any:
    """The value of an option; of a group only what the command line has."""
    if not (argument.children and is_dataclass(value)):
        return value
    return {c.field_info.name: _shown(c, getattr(value, c.field_info.name)) for c in argument.children if c.parse}


def _over(default: Any, value: Any, argument: Argument) -> Any:
    """A group of settings: its default, in which what was given is changed."""
    changes = {}
    for child in (child for child in argument.children if child.has_tokens):
        name = child.field_info.name
        usual, chosen = getattr(default, name), getattr(value, name)
        changes[name] = _over(usual, chosen, child) if is_dataclass(usual) and is_dataclass(chosen) else chosen
    return replace(default, **changes)


def _settings(arguments: ArgumentCollection, bound: inspect.BoundArguments) -> tuple[dict[str, Any], list[str]]:
    """Every option with its value: those of the command alone, then those that it shares; and which were given."""
    own, shared, chosen = dict[str, Any](), dict[str, Any](), list[str]()
    for argument in (argument for argument in arguments if not argument.keys):
        group = bound.arguments[argument.field_info.name]
        flat, default = argument.positives == ("*",), argument.field_info.default
        if argument.children and argument.has_tokens and is_dataclass(default):
            group = bound.arguments[argument.field_info.name] = _over(default, group, argument)
        for option in argument.children if flat else [argument]:
            name = option.field_info.name
            if option.parse:
                (shared if flat else own)[name] = _shown(option, getattr(group, name) if flat else group)
                chosen += [name] if option.has_tokens else []
    settings: dict[str, Any] = plain(own | shared)
    return settings, chosen


def plain(value: Any) -> Any:
    """As ``run.json`` has it: dataclasses as mappings, paths as text."""
    return json.loads(json.dumps(value, default=lambda x: vars(x) if is_dataclass(x) else str(x)))


def _check_files(name: str, value: Any) -> None:
    """Refuse values that name a device or a pipe."""
    if isinstance(value, str):
        check_regular("" if name == "source" else name, Path(value))
    for inner in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        _check_files(name, inner)


def worded(error: CycloptsError) -> str:
    """What is wrong, in a line: the option, what was expected, what came."""
    argument, cause = error.argument, error.__cause__
    if isinstance(error, UnknownCommandError) and error.app is not None and error.unused_tokens:
        typed = " ".join([PROGRAM, *(error.command_chain or ()), error.unused_tokens[0]])
        commands = [name for name in error.app if not name.startswith("-")]
        return f"unknown command `{typed}`; {hint_at(error.unused_tokens[0], commands)}"
    if isinstance(error, UnknownOptionError):
        name = (error.token.keyword or error.token.value).replace("][", ".").strip("[]")
        return unknown(name, [name for option in error.argument_collection if option.parse for name in option.names])
    if isinstance(error, UnusedCliTokensError) and error.unused_tokens:
        return f"expected no further words, got {error.unused_tokens[0]!r}"
    if argument is None:
        return str(error)
    name, option = argument.name.removeprefix("--"), _called(argument)
    if isinstance(error, MissingArgumentError):
        return f"missing: {option}" if error.keyword is None else f"{option}: expected a value after it"
    if isinstance(cause, ValidationError):
        if argument.positives == ("*",):
            return refusal(cause)
        group = name.replace("-", "_")
        text = refusal(cause, group)
        # What a group says by itself names its own field.
        text = f"`{group}.{text[1:]}" if text.startswith("`") and not text.startswith(f"`{group}") else text
        return text if text.startswith("`") else f"{option}: {text}"
    if isinstance(error, CoercionError) and error.token is not None:
        from cyclopts.annotations import get_hint_name

        return f"{option}: expected {get_hint_name(error.target_type)}, got {error.token.value!r}"
    return str(error)


# Options of ultralytics and of other trackers, and what they are called here.
ELSEWHERE = {
    "--conf": "--score-threshold", "--imgsz": "--view", "--model": "--detector",
    "--tracker": "--method", "--weights": "--detector", "--save": "--overlay",
}  # fmt: skip


def unknown(name: str, options: Iterable[str]) -> str:
    """What to say of an option that is not among ``options``."""
    typed, options = "--" + name.lstrip("-").replace("_", "-"), list(options)
    if (ours := ELSEWHERE.get(typed)) in options:
        return f"unknown option {typed}; here it is {ours}"
    if typed == "--iou" and "--detector" in options:
        from tsuiseki.tracking.features.foreign_detector import SAME

        return f"unknown option --iou; of boxes with an IoU above {SAME} the best score stays, and no option changes it"
    hint = hint_at(typed, [option for option in options if option.startswith("--")])
    return f"unknown option {typed}; {hint if hint.startswith('did') else '--help lists them'}"
