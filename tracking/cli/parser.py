"""From a typed function to its options: jsonargparse. The words of its help and errors are in `wording`.

Options are shown with dashes and taken with dashes or underscores; a switch needs no value. In a YAML file they carry
underscores, as the function's parameters do.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
import re
from argparse import SUPPRESS, Action
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, TypeGuard, get_origin, get_type_hints

from jsonargparse import ArgumentError, ArgumentParser, Namespace

from tsuiseki.tracking.cli.config import config_text
from tsuiseki.tracking.cli.options import Output
from tsuiseki.tracking.cli.sensible import check_sensible
from tsuiseki.tracking.cli.wording import HelpFormatter, friendly, is_several, shown_value, with_option
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.options import Shared

CONFIG_HELP = "YAML file of options, with underscores in their names; options given here win over it"
PRINT_HELP = "print all options as YAML, as a start for --config, and exit"


class Parser(ArgumentParser):
    """A jsonargparse parser that fails with `RequestError`, also inside of groups of options."""

    def error(self, message: str, ex: Exception | None = None) -> NoReturn:
        raise RequestError(friendly(message, _names(self))) from ex


def call(prog: str, function: Callable[..., Any], words: Sequence[str]) -> Any:
    """What ``function`` makes of the words of a command line; see `parse`."""
    arguments = parse(prog, function, words)
    by_place = [arguments.pop(p.name) for p in _parameters(function) if p.kind is p.POSITIONAL_ONLY]
    return function(*by_place, **arguments)


def parse(prog: str, function: Callable[..., Any], words: Sequence[str], config: str = "") -> dict[str, Any]:
    """The arguments of ``function`` from the words of a command line.

    Args:
        prog: what the user typed so far, for the help.
        function: typed, with Google-style docstring. Its positional-only parameters and the `BY_PLACE` fields of its
            `Shared` ones are given by place; a list takes all that follow.
        words: the rest of the command line.
        config: YAML of options, over which ``words`` win.

    Raises:
        RequestError: an unknown option, a wrong type, a missing option, a broken YAML file.
        SystemExit: help was asked for.
    """
    # jsonargparse also leaves out of --print-config what its help does not show: hide options for --help alone.
    parser = build_parser(prog, function, every_option=not {"-h", "--help"} & set(words))

    try:
        given = [f"--config={config}"] if config else []
        found = parser.parse_args([*given, *_normalised(words, parser, prog.split())])
        for name, kind, *_ in options_of(function):
            if dataclasses.is_dataclass(kind) and not isinstance(found[name], Namespace):
                raise RequestError(f"{name}: expected options of its own below it, got {found[name]!r}")
        values = parser.instantiate(found)
    except (ArgumentError, ValueError) as error:  # such as of a settings dataclass that refuses a value
        raise RequestError(with_option(friendly(str(error), _names(parser)), words)) from error
    return _arguments(function, values, prog)


class Option(NamedTuple):
    """A parameter of a command, or a field of a `Shared` one: its name with underscores, type and text for the help.

    It has a ``default`` unless it must be given, and is given ``by_place`` or by its name. A dataclass is a group of
    options below its name; of a list by place, several words may be given.
    """

    name: str
    kind: Any
    text: str
    default: Any
    by_place: bool


def options_of(function: Callable[..., Any]) -> list[Option]:
    """The options of ``function``, those of its `Shared` parameters last, worded and with defaults as it says."""
    texts, own, shared = _documentation(function)[1], [], []
    for one in _parameters(function):
        if not is_shared(one.annotation):
            default = dataclasses.MISSING if one.default is one.empty else one.default
            by_place = one.kind is one.POSITIONAL_ONLY
            own.append(Option(one.name, one.annotation, texts.get(one.name, ""), default, by_place))
            continue
        inherited: dict[str, str] = {}
        for base in reversed(one.annotation.__mro__):
            inherited |= _documentation(base)[1] if dataclasses.is_dataclass(base) else {}
        hints = get_type_hints(one.annotation)
        for field in _fields_of(one.annotation):
            text = texts.get(field.name, inherited.get(field.name, ""))
            value = field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
            value = value if one.default is one.empty else getattr(one.default, field.name)
            by_place = field.metadata.get("positional", False)
            shared.append(Option(field.name, hints[field.name], text, value, by_place))
    return own + shared


def _parameters(function: Callable[..., Any]) -> Iterable[inspect.Parameter]:
    return inspect.signature(function, eval_str=True).parameters.values()


def is_shared(kind: Any) -> TypeGuard[type[Shared]]:
    """Whether the parameters of type ``kind`` are options of the command itself."""
    return isinstance(kind, type) and issubclass(kind, Shared)


def _fields_of(kind: type[Shared]) -> list[dataclasses.Field[Any]]:
    """The fields of a shared dataclass that are options."""
    return [field for field in dataclasses.fields(kind) if field.metadata.get("option", True)]  # type: ignore[arg-type]


def _arguments(function: Callable[..., Any], values: Any, prog: str) -> dict[str, Any]:
    """What ``function`` is called with, from the values of all options."""
    settings: dict[str, Any] = {}
    arguments: dict[str, Any] = {}
    for one in _parameters(function):
        if is_shared(one.annotation):
            fields = {field.name: values[field.name] for field in _fields_of(one.annotation)}
            arguments[one.name] = one.annotation(**fields)
            settings |= fields
        else:
            arguments[one.name] = settings[one.name] = values[one.name]
    settings = _plain(settings)
    for name, value in arguments.items():
        if isinstance(value, Shared):
            value.check()
        if isinstance(value, Output):
            arguments[name] = dataclasses.replace(value, command=prog.split(), settings=settings)
    for option in options_of(function):
        check_sensible("" if option.by_place else option.name, settings[option.name], _plain(option.default))
    return arguments


def _plain(value: Any) -> Any:
    """As ``run.json`` has it: dataclasses as mappings, paths as text."""

    def simple(part: Any) -> Any:
        return dataclasses.asdict(part) if dataclasses.is_dataclass(part) else str(part)  # type: ignore[arg-type]

    return json.loads(json.dumps(value, default=simple))


def build_parser(prog: str, function: Callable[..., Any], every_option: bool = False) -> Parser:
    """A parser whose options are the parameters of ``function``.

    The options of its dataclass parameters are shown in the help only with ``every_option``.
    """
    options = options_of(function)
    parser = Parser(
        prog=prog,
        description=_documentation(function)[0],
        formatter_class=HelpFormatter,
        exit_on_error=False,
        print_config="--print_config",
        allow_abbrev=False,
    )
    usage = [prog]
    for name, kind, text, default, _ in (option for option in options if option.by_place):
        some: dict[str, Any] = {}
        if get_origin(kind) is list:
            kind, some = kind.__args__[0], {"nargs": "*", "default": []}
            some = {"nargs": "+"} if default is dataclasses.MISSING else some
        parser.add_argument(name, type=kind, metavar=name.upper(), help=text, **some)
        usage.append(name.upper() + (" …" if some else ""))
    for name, kind, text, default, _ in (option for option in options if not option.by_place):
        needed = default is dataclasses.MISSING
        parser.add_argument(f"--{name}", type=kind, help=text, **{"required": True} if needed else {"default": default})
        usage += [f"--{name} {shown_value(name, kind, text)}"] if needed else []
    parser.add_argument("--config", action="config", metavar="FILE", help=CONFIG_HELP)
    if groups := [f"--{option.name}.*" for option in options if dataclasses.is_dataclass(option.kind)]:
        parser.add_argument("--help_all", action="help", help=f"also show {', '.join(groups)}")
    _show_as_typed(parser._actions, parser._option_string_actions, every_option)
    parser.usage = " ".join([*usage, "[options]"])
    return parser


def _names(parser: Parser, matches: Callable[[Any], bool] = lambda _: True) -> list[str]:
    """Options whose type ``matches``, as they are shown: ``--seed`` and so on."""
    hinted = [action for action in parser._actions if matches(getattr(action, "_typehint", None))]
    return [name for action in hinted for name in action.option_strings if name.startswith("--")]


def _normalised(words: Sequence[str], parser: Parser, command: Sequence[str]) -> list[str]:
    """``--some-option`` as ``--some_option``, switches with their value, and ``1,2`` for several numbers as a list.

    An option for a list of such lists is given once for each of them, ``--init 1,2 --init 3,4``. The contents of files
    of options come first, so that what is given here wins over them wherever it stands.
    """
    switches, several = _names(parser, lambda kind: kind is bool), _names(parser, is_several)
    lists_of_lists = _names(parser, partial(is_several, lists=True))
    repeated: dict[str, list[str]] = {}
    result, configs, rest = list[str](), list[str](), list(words)
    while rest:
        word = rest.pop(0)
        if word == "--":
            result += [word, *rest]
            break
        if not re.match(r"--[a-zA-Z]", word):
            result.append(word)
            continue
        name, equals, value = word.partition("=")
        shown, name = name.replace("_", "-"), "--" + name[2:].replace("-", "_")
        if name == "--config" and (equals or rest):
            configs.append("--config=" + config_text(Path(value if equals else rest.pop(0)), command))
            continue
        if shown in switches and not equals:
            equals, value = "=", "true"
        if shown == "--hide" and not equals and rest[:1] == ["all-but"]:
            ids = [word for word in rest[1:2] if not word.startswith("--")]
            equals, value, rest = "=", " ".join(["all-but", *ids]), rest[1 + len(ids) :]
        if shown in several and (equals or rest):
            value = value if equals else rest.pop(0)
            equals, value = "=", value if value.startswith("[") else f"[{value}]"
            if shown in lists_of_lists and not value.startswith("[["):
                repeated.setdefault(name, []).append(value)
                continue
        result.append(name + equals + value)
    return [*configs, *(f"{name}=[{','.join(values)}]" for name, values in repeated.items()), *result]


def _show_as_typed(actions: Iterable[Action], by_option: dict[str, Action], every_option: bool) -> None:
    """Show options with dashes, and leave out what jsonargparse adds on its own."""
    for action in actions:
        if action.dest == "help":
            action.help = "show this help and exit"
        elif action.dest.endswith(".help") or action.metavar == "CONFIG" or ("." in action.dest and not every_option):
            action.help = SUPPRESS
        elif "print_config" in action.dest:
            action.help, action.metavar = PRINT_HELP, ""
        names = [name for name in action.option_strings if not name.endswith("+")]
        action.option_strings = ["--" + n[2:].replace("_", "-") if n.startswith("--") else n for n in names]
        if getattr(action, "_typehint", None) is bool:
            action.metavar = ""
        by_option |= dict.fromkeys(action.option_strings, action)


def _documentation(function: Callable[..., Any]) -> tuple[str, dict[str, str]]:
    """The description of ``function`` and of its parameters."""
    from docstring_parser import parse as parse_docstring

    found = parse_docstring(inspect.getdoc(function) or "")
    text = [(part or "").replace("``", "") for part in (found.short_description, found.long_description)]
    parameters = {p.arg_name: " ".join((p.description or "").split()) for p in found.params}
    return "\n\n".join(part for part in text if part), parameters
