"""From a typed function to its options, and from words and YAML to its arguments.

Options are shown with dashes and taken with dashes or underscores; a switch needs no value. In a YAML file they carry
underscores, as the function's parameters do.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
import re
import shutil
import textwrap
from argparse import ArgumentParser, HelpFormatter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

import yaml
from pydantic import ValidationError

from tsuiseki.tracking.arguments import (
    check_regular,
    check_sensible,
    is_several,
    kinds_of,
    option_shown,
    typed,
    unknown,
    usual_of,
)
from tsuiseki.tracking.bounds import refusal
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.options import Shared
from tsuiseki.tracking.runs.options import Output

if TYPE_CHECKING:
    from tsuiseki.tracking.result import Result

CONFIG_HELP = "YAML file of options, with underscores in their names; options given here win over it"
# A word that names an option: no number below zero.
OPTION = r"-(?![\d.])\S"
METAVARS = {int: "N", float: "X", str: "TEXT", Path: "FILE"}
MOST_BYTES = 1_000_000
PRINT_HELP = "print all options as YAML, as a start for --config, and exit"


class Option(NamedTuple):
    """A parameter of a command, or a field of a `Shared` one: its name with underscores, type and text for the help.

    It has a ``default`` unless it must be given, and is given ``by_place`` or by its name. A dataclass is a group of
    options below its name; of a list by place, several words may be given.
    """

    name: str
    kind: Any
    text: str
    default: Any
    by_place: bool = False


def call(prog: str, function: Callable[..., Any], words: Sequence[str]) -> Any:
    """What ``function`` makes of the words of a command line; see `parse`."""
    arguments = parse(prog, function, words)
    by_place = [arguments.pop(p.name) for p in _parameters(function) if p.kind is p.POSITIONAL_ONLY]
    try:
        return function(*by_place, **arguments)
    except ValidationError as error:
        raise RequestError(refusal(error)) from error


def parse(
    prog: str, function: Callable[..., Any], words: Sequence[str], config: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """The arguments of ``function`` from the words of a command line.

    Args:
        prog: what the user typed so far, for the help.
        function: typed, with Google-style docstring. Its positional-only parameters and the `BY_PLACE` fields of its
            `Shared` ones are given by place; a list takes all that follow.
        words: the rest of the command line.
        config: options, over which ``words`` win.

    Raises:
        RequestError: an unknown option, a wrong type, a missing option, a broken YAML file.
        SystemExit: help was asked for.
    """
    values = read(prog, documentation(function)[0], options_of(function), words, config)
    return arguments_of(function, prog, values)


def options_of(function: Callable[..., Any]) -> list[Option]:
    """The options of ``function``, those of its `Shared` parameters last, worded and with defaults as it says."""
    texts, own, shared = documentation(function)[1], list[Option](), list[Option]()
    for one in _parameters(function):
        if not is_shared(one.annotation):
            default = MISSING if one.default is one.empty else one.default
            by_place = one.kind is one.POSITIONAL_ONLY
            own.append(Option(one.name, one.annotation, texts.get(one.name, ""), default, by_place))
            continue
        inherited = {name: text for base in reversed(one.annotation.__mro__) for name, text in _fields(base).items()}
        hints = get_type_hints(one.annotation)
        for field in _options_in(one.annotation):
            text = texts.get(field.name, inherited.get(field.name, ""))
            default = usual_of(field) if one.default is one.empty else getattr(one.default, field.name)
            by_place = field.metadata.get("positional", False)
            shared.append(Option(field.name, hints[field.name], text, default, by_place))
    return own + shared


def is_shared(kind: Any) -> bool:
    """Whether the parameters of type ``kind`` are options of the command itself."""
    return isinstance(kind, type) and issubclass(kind, Shared)


def _parameters(function: Callable[..., Any]) -> Iterable[inspect.Parameter]:
    return inspect.signature(function, eval_str=True).parameters.values()


def _options_in(kind: Any) -> list[dataclasses.Field[Any]]:
    return [field for field in dataclasses.fields(kind) if field.metadata.get("option", True)]


def _fields(kind: Any) -> dict[str, str]:
    """Texts of the fields of a dataclass by name; of another class none."""
    texts = documentation(kind)[1]
    return texts if dataclasses.is_dataclass(kind) else {}


@cache
def documentation(documented: Any) -> tuple[str, dict[str, str]]:
    """The description of a function or class, and of its parameters or attributes."""
    from docstring_parser import parse as parse_docstring

    found = parse_docstring(inspect.getdoc(documented) or "")
    text = [(part or "").replace("``", "") for part in (found.short_description, found.long_description)]
    parameters = {p.arg_name: " ".join((p.description or "").split()) for p in found.params}
    return "\n\n".join(part for part in text if part), parameters


def arguments_of(function: Callable[..., Any], prog: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """What ``function`` is called with, from the values of all its options.

    Raises:
        RequestError: a value is of no use; see `Shared.check`.
    """
    settings, arguments = dict[str, Any](), dict[str, Any]()
    for one in _parameters(function):
        names = [field.name for field in _options_in(one.annotation)] if is_shared(one.annotation) else [one.name]
        fields = {name: values[name] for name in names}
        settings |= fields
        try:
            arguments[one.name] = one.annotation(**fields) if is_shared(one.annotation) else values[one.name]
        except ValidationError as error:
            raise RequestError(refusal(error)) from error
    for name, value in arguments.items():
        if isinstance(value, Shared):
            value.check()
        if isinstance(value, Output):
            arguments[name] = dataclasses.replace(value, command=prog.split(), settings=plain(settings), page=paged)
    for option in options_of(function):
        check_sensible("" if option.by_place else option.name, settings[option.name], option.default)
    return arguments


def paged(result: Result[Any]) -> Result[Any]:
    """A result with its page, which is loaded when there is one to write."""
    from tsuiseki.tracking.counts.page import with_page

    return with_page(result)


def read(
    prog: str, about: str, options: Sequence[Option], words: Sequence[str], config: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """The values of ``options`` by name, typed; see `parse`. ``about`` says in the help what the command does."""
    kinds = {one.name: one.kind for option in options for one in _below(option)}
    found, given, places, printed = dict(config or {}), dict[str, Any](), list[str](), False
    rest = list(words)
    while rest:
        word = rest.pop(0)
        shown, equals, value = word.partition("=")
        name = shown[2:].replace("-", "_")
        if word == "--":
            places += rest
            break
        if word == "-h" or name == "help" or (name == "help_all" and _groups(options)):
            print(help_text(prog, about, options, name == "help_all"), end="")
            raise SystemExit(0)
        if not re.match(OPTION, word):
            places.append(word)
        elif name == "print_config":
            printed = True
        elif name != "config" and name not in kinds:
            raise unknown(shown, [*kinds, "config", "help"])
        elif kinds.get(name) is bool and not equals:
            put(given, name, True)
        elif not equals and (not rest or re.match(OPTION, rest[0])):
            raise RequestError(f"argument {shown}: expected one argument")
        else:
            value = value if equals else rest.pop(0)
            if name == "config":
                found = merged(found, read_config(Path(value), prog.split()))
            elif name == "hide" and value == "all-but" and rest and not rest[0].startswith("--"):
                given[name] = f"{value} {rest.pop(0)}"
            elif is_several(kinds[name], lists=True) and not value.startswith("[["):
                # A list of lists is given once for each of them, --init 1,2 --init 3,4.
                given.setdefault(name, []).append(value)
            else:
                put(given, name, value)
    return _complete(options, merged(found, given) | _by_place(options, places), kinds, printed)


def _complete(
    options: Sequence[Option], found: Mapping[str, Any], kinds: Iterable[str], printed: bool
) -> dict[str, Any]:
    """Values of all ``options``, typed, or their defaults; ``printed`` as YAML instead."""
    names, made = [one.name for one in options], dict[str, Any]()
    if wrong := [name for name in found if name not in names]:
        raise unknown(wrong[0], kinds)
    for one in options:
        value = found.get(one.name, MISSING)
        usual = value is MISSING or (value is None and one.default is MISSING)
        made[one.name] = one.default if usual else typed(one.kind, value, one.name, one.default)
    missing = [one for one in options if made[one.name] is MISSING]
    if printed:
        made |= dict.fromkeys([one.name for one in missing])
        print(yaml.safe_dump(plain(made), sort_keys=False, allow_unicode=True), end="")
        raise SystemExit(0)
    if missing:
        shown = [one.name.upper() if one.by_place else option_shown(one.name) for one in missing]
        raise RequestError(f"missing: {', '.join(shown)}")
    return made


def _by_place(options: Sequence[Option], places: Sequence[str]) -> dict[str, Any]:
    """What is given by place: a word each, a list all that follow."""
    found, rest = dict[str, Any](), list(places)
    for option in options:
        if option.by_place and rest:
            found[option.name], rest = (rest, []) if is_several(option.kind) else (rest[0], rest[1:])
    if rest:
        raise RequestError(f"expected no further words, got {rest[0]!r}")
    return found


def put(values: dict[str, Any], name: str, value: Any) -> None:
    """Set the option ``name``, such as ``flow.fill``, in nested values."""
    *above, last = name.split(".")
    for part in above:
        values = values.setdefault(part, {})
    values[last] = value


def merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Nested values, of which those of ``above`` win."""
    both = [name for name in above if isinstance(above[name], Mapping) and isinstance(below.get(name), Mapping)]
    return {**below, **above} | {name: merged(below[name], above[name]) for name in both}


def _below(option: Option) -> Iterator[Option]:
    """An option, and those in it where it is a group."""
    yield option
    kind = kinds_of(option.kind)[0]
    if dataclasses.is_dataclass(kind):
        hints, texts = get_type_hints(kind), _fields(kind)
        for one in dataclasses.fields(kind):
            usual = usual_of(one) if option.default in (MISSING, None) else getattr(option.default, one.name)
            yield from _below(Option(f"{option.name}.{one.name}", hints[one.name], texts.get(one.name, ""), usual))


def _groups(options: Sequence[Option]) -> list[Option]:
    return [option for option in options if dataclasses.is_dataclass(option.kind)]


def named_config(path: str | Path) -> Path:
    """A file of options as it is given; a bare word names one that ships, such as ``detector_mot``.

    Raises:
        RequestError: none of that name ships.
    """
    path = Path(path)
    if path.suffix or len(path.parts) != 1 or path.exists():
        return path
    shipped = Path(str(resources.files("tsuiseki.configs")))
    if (file := shipped / f"{path}.yaml").is_file():
        return file
    names = ", ".join(sorted(one.stem for one in shipped.glob("*.yaml")))
    raise RequestError(f"`config`: expected a YAML file or one of {names}; got {path}")


def read_config(path: Path, command: Sequence[str]) -> dict[str, Any]:
    """The options in a file: YAML, what ``--print-config`` prints, or the ``run.json`` of an earlier run.

    A ``run.json`` must be of the same ``command``, the program's words.

    Raises:
        RequestError: there is no such file, it is no YAML of options, or the record of another command.
    """
    path = named_config(path)
    check_regular("config", path)
    wrong = f"`config`: expected YAML of options, name: value, in {path}, got"
    try:
        if path.stat().st_size > MOST_BYTES:
            raise RequestError(f"{wrong} a file of {path.stat().st_size} bytes")
        text = path.read_text(encoding="utf-8-sig")
        # Nested aliases stand for billions of values in a few lines.
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, Loader=yaml.SafeLoader)):
            raise RequestError(f"{wrong} aliases; write their values out")
        found = yaml.safe_load(text)
    except OSError as error:
        raise RequestError(f"`config`: cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RequestError(f"{wrong} something binary") from error
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark is not None else ""
        raise RequestError(f"{wrong} something that cannot be read{where}") from error
    if not isinstance(found, dict | None):
        raise RequestError(f"{wrong} no such lines")
    if found is None or not found.keys() >= {"command", "settings", "versions"}:
        return found or {}
    if list(found["command"]) != list(command):
        wanted, got = " ".join(command), " ".join(found["command"])
        raise RequestError(f"`config`: expected the record of `{wanted}` in {path}, got one of `{got}`")
    # That the run replaced an earlier result is not taken over.
    return {name: value for name, value in found["settings"].items() if name != "overwrite"}


def plain(value: Any) -> Any:
    """As ``run.json`` has it: dataclasses as mappings, paths as text."""
    return json.loads(json.dumps(value, default=lambda x: vars(x) if dataclasses.is_dataclass(x) else str(x)))


class _Formatter(HelpFormatter):
    """Narrow enough to be read, with paragraphs apart."""

    def __init__(self, prog: str) -> None:
        width = min(100, shutil.get_terminal_size().columns - 2)
        super().__init__(prog, max_help_position=30, width=width)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        parts = text.split("\n\n")
        return "\n\n".join(textwrap.fill(" ".join(part.split()), width, initial_indent=indent) for part in parts)


def help_text(prog: str, about: str, options: Sequence[Option], every_option: bool = False) -> str:
    """The help of a command; the options of its groups are shown with ``every_option``."""
    named, groups = [one for one in options if not one.by_place], _groups(options)
    usage = [prog, *(one.name.upper() + " …" * is_several(one.kind) for one in options if one.by_place)]
    usage += [
        f"{option_shown(one.name)} {metavar(one.kind, one.name, one.text)}" for one in named if one.default is MISSING
    ]
    parser = ArgumentParser(
        usage=" ".join([*usage, "[options]"]), description=about, formatter_class=_Formatter, add_help=False
    )
    for one in (one for one in options if one.by_place):
        parser.add_argument(one.name, metavar=one.name.upper(), help=_help(one))
    parser.add_argument("-h", "--help", action="store_true", help="show this help and exit")
    for one in named:
        if one not in groups:
            _show(parser, one)
    parser.add_argument("--config", metavar="FILE", help=CONFIG_HELP)
    parser.add_argument("--print-config", action="store_true", help=PRINT_HELP)
    if groups:
        shown = ", ".join(f"--{one.name}.*" for one in groups)
        parser.add_argument("--help-all", action="store_true", help=f"also show {shown}")
    for one in groups if every_option else ():
        _show_group(parser, one)
    return parser.format_help()


def metavar(kind: Any, name: str = "", text: str = "") -> str:
    """What to show for the value of the option ``name`` of type ``kind``, which the help describes by ``text``.

    >>> metavar(float | None)
    'X'
    """
    first, parts = kinds_of(kind)[0], [metavar(part) for part in get_args(kinds_of(kind)[0]) if part is not Ellipsis]
    if named := [value for one in kinds_of(kind) if get_origin(one) is Literal for value in get_args(one)]:
        return "{" + ",".join(map(str, named)) + "}"
    if is_several(first):
        return ",".join(parts if len(parts) > 1 else [*parts, "…"])
    shown = "{true,false,null}" if first is bool else METAVARS.get(first, "VALUE")
    if shown == "FILE" and text.startswith("folder"):
        return "DIR"
    return "FIRST-LAST" if (name, shown) == ("frames", "TEXT") else shown


def _show_group(parser: ArgumentParser, group: Option) -> None:
    inside = [one for one in _below(group) if one.name.rpartition(".")[0] == group.name]
    shown = parser.add_argument_group(group.text.removesuffix("."))
    for one in inside:
        if not dataclasses.is_dataclass(one.kind):
            _show(shown, one)
    for one in _groups(inside):
        _show_group(parser, one)


def _show(place: Any, option: Option) -> None:
    how = (
        {"action": "store_true"} if option.kind is bool else {"metavar": metavar(option.kind, option.name, option.text)}
    )
    place.add_argument(option_shown(option.name), help=_help(option), **how)


def _help(option: Option) -> str:
    text, default = option.text.removesuffix(".").replace("``", "").replace("%", "%%"), option.default
    if option.by_place:
        return text
    if default is MISSING:
        return f"{text} (required)"
    if default is True:
        return f"{text} (on by default; =false turns it off)"
    if default in (None, "") or isinstance(default, bool) or dataclasses.is_dataclass(default):
        return text
    return f"{text} (default: {','.join(map(str, default)) if isinstance(default, tuple | list) else default})"
