"""From a typed function to its options: jsonargparse. The words of its help and errors are in `wording`.

Options are shown with dashes and taken with dashes or underscores; a switch needs no value. In a YAML file they carry
underscores, as the function's parameters do.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from argparse import SUPPRESS, Action
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeGuard, get_type_hints

from jsonargparse import ArgumentError, ArgumentParser, Namespace
from jsonargparse._actions import ActionConfigFile, _ActionConfigLoad

from tsuiseki.tracking.cli.config import config_text
from tsuiseki.tracking.cli.options import Given, Output
from tsuiseki.tracking.cli.wording import HelpFormatter, friendly, is_several, parts_of, shown_value
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.options import Shared

CONFIG_HELP = "YAML file of options, with underscores in their names; options given here win over it"
PRINT_HELP = "print all options as YAML, as a start for --config, and exit"


class Parser(ArgumentParser):
    """A jsonargparse parser that fails with `RequestError` and takes ``--some-option`` for ``some_option``."""

    def error(self, message: str, ex: Exception | None = None) -> NoReturn:
        raise RequestError(friendly(message, self.option_names())) from ex

    def option_names(self) -> list[str]:
        """All options as they are shown, ``--seed`` and so on."""
        return [name for action in self._actions for name in action.option_strings if name.startswith("--")]

    def of_kind(self, matches: Callable[[Any], bool]) -> set[str]:
        """Options whose type ``matches``, as they are shown."""
        hinted = [action for action in self._actions if matches(getattr(action, "_typehint", None))]
        return {name for action in hinted for name in action.option_strings}


def call(prog: str, function: Callable[..., Any], words: Sequence[str]) -> Any:
    """What ``function`` makes of the words of a command line; see `parse`."""
    arguments = parse(prog, function, words)
    by_place = [arguments.pop(p.name) for p in _parameters(function) if p.kind is p.POSITIONAL_ONLY]
    return function(*by_place, **arguments)


def parse(prog: str, function: Callable[..., Any], words: Sequence[str]) -> dict[str, Any]:
    """The arguments of ``function`` from the words of a command line.

    Args:
        prog: what the user typed so far, for the help.
        function: typed, with Google-style docstring. Its positional-only parameters and the `BY_PLACE` fields of its
            `Shared` ones are given by place; a list takes all that follow.
        words: the rest of the command line.

    Raises:
        RequestError: an unknown option, a wrong type, a missing option, a broken YAML file.
        SystemExit: help was asked for.
    """
    # jsonargparse also leaves out of --print-config what its help does not show: hide options for --help alone.
    parser = build_parser(prog, function, every_option=not {"-h", "--help"} & set(words))
    try:
        found = parser.parse_args(_normalised(words, parser, prog.split()))
    except ArgumentError as error:
        raise RequestError(friendly(str(error), parser.option_names())) from error
    for name, kind in inspect.get_annotations(function, eval_str=True).items():
        if dataclasses.is_dataclass(kind) and not is_shared(kind) and not isinstance(found[name], Namespace):
            raise RequestError(f"{name}: expected options of its own below it, got {found[name]!r}")
    try:
        values = parser.instantiate(found)
    except ValueError as error:  # a settings dataclass refuses a value
        raise RequestError(friendly(str(error), parser.option_names())) from error
    return _arguments(function, values, prog)


def is_shared(kind: Any) -> TypeGuard[type[Shared]]:
    """Whether the parameters of type ``kind`` are options of the command itself."""
    return isinstance(kind, type) and issubclass(kind, Shared)


def _arguments(function: Callable[..., Any], values: Any, prog: str) -> dict[str, Any]:
    """What ``function`` is called with, from the values of all options."""
    settings: dict[str, Any] = {}
    arguments: dict[str, Any] = {}
    for name, kind in inspect.get_annotations(function, eval_str=True).items():
        if name == "return":
            continue
        if is_shared(kind):
            own = {field.name: values[field.name] for field in _options_of(kind)}
            arguments[name] = kind(**own)
            settings |= own
        else:
            arguments[name] = settings[name] = values[name]
    given = Given(prog.split(), {name: plain(value) for name, value in settings.items()})
    for name, value in arguments.items():
        if isinstance(value, Shared):
            value.check()
        if isinstance(value, Output):
            arguments[name] = dataclasses.replace(value, given=given)
    return arguments


def _options_of(kind: type[Shared]) -> list[dataclasses.Field[Any]]:
    """The fields of a shared dataclass that are options."""
    return [field for field in dataclasses.fields(kind) if field.metadata.get("option", True)]  # type: ignore[arg-type]


def plain(value: Any) -> Any:
    """Settings for ``run.json``: dataclasses as mappings, paths as text."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return plain(dataclasses.asdict(value))
    if isinstance(value, dict):
        return {name: plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def build_parser(prog: str, function: Callable[..., Any], every_option: bool = False) -> Parser:
    """A parser whose options are the parameters of ``function``.

    The options of its dataclass parameters are shown in the help only with ``every_option``.
    """
    description, places = _documentation(function)
    parser = Parser(
        prog=prog,
        description=description,
        formatter_class=HelpFormatter,
        exit_on_error=False,
        print_config="--print_config",
        allow_abbrev=False,
    )
    hints = inspect.get_annotations(function, eval_str=True)
    shared = {name: kind for name, kind in hints.items() if is_shared(kind)}
    positional = _positional(function, shared)
    options = _shared_options(function, shared, places)
    places = {name: option.text for name, option in options.items()} | places
    kinds = hints | {name: option.kind for name, option in options.items()}
    for name in positional:
        many = getattr(kinds[name], "__origin__", None) is list
        kind = kinds[name].__args__[0] if many else kinds[name]
        some = {"nargs": "+"} if name in _required(function) or name in options else {"nargs": "*", "default": []}
        number: dict[str, Any] = some if many else {}
        parser.add_argument(name, type=kind, metavar=name.upper(), help=places.get(name), **number)
    parser.add_function_arguments(function, as_group=False, skip={*positional, *shared}, sub_configs=False)
    for name, option in options.items():
        if name not in positional:
            needed = {"required": True} if option.required else {"default": option.default}
            parser.add_argument(f"--{name}", type=option.kind, help=option.text, **needed)
    parser.add_argument("--config", action=ActionConfigFile, metavar="FILE", help=CONFIG_HELP)
    groups = [n for n, kind in hints.items() if dataclasses.is_dataclass(kind) and n not in shared]
    if groups:
        parser.add_argument(
            "--help_all", action="help", help=f"also show {', '.join(f'--{name}.*' for name in groups)}"
        )
    _show_as_typed(parser._actions, parser._option_string_actions)
    if not every_option:
        for action in parser._actions:
            action.help = SUPPRESS if "." in action.dest else action.help
    missing = [n for n in _required(function) if n not in positional and n not in shared]
    missing += [name for name, option in options.items() if option.required and name not in positional]
    required = [f"--{name} {shown_value(name, kinds[name], places.get(name, ''))}" for name in missing]
    several = [n.upper() + (" …" if getattr(kinds[n], "__origin__", None) is list else "") for n in positional]
    parser.usage = " ".join([prog, *several, *required, "[options]"])
    return parser


@dataclasses.dataclass(frozen=True)
class _Option:
    """An option that a shared dataclass has."""

    kind: Any
    text: str
    default: Any
    required: bool


def _shared_options(
    function: Callable[..., Any], shared: dict[str, type[Shared]], places: dict[str, str]
) -> dict[str, _Option]:
    """The options in the shared dataclasses of ``function``, with its own texts and defaults where it has some."""
    options = {}
    for name, kind in shared.items():
        default = inspect.signature(function).parameters[name].default
        texts: dict[str, str] = {}
        for base in reversed(kind.__mro__):
            texts |= _documentation(base)[1] if dataclasses.is_dataclass(base) else {}
        hints = get_type_hints(kind)
        for field in _options_of(kind):
            value = field.default if default is inspect.Parameter.empty else getattr(default, field.name)
            text = places.get(field.name, texts.get(field.name, ""))
            options[field.name] = _Option(hints[field.name], text, value, value is dataclasses.MISSING)
    return options


def _parameters(function: Callable[..., Any]) -> Iterable[inspect.Parameter]:
    return inspect.signature(function).parameters.values()


def _positional(function: Callable[..., Any], shared: dict[str, type[Shared]]) -> list[str]:
    """The options that are given by place, in their order."""
    names = [p.name for p in _parameters(function) if p.kind is p.POSITIONAL_ONLY]
    fields = [field for kind in shared.values() for field in _options_of(kind)]
    return names + [field.name for field in fields if field.metadata.get("positional")]


def _required(function: Callable[..., Any]) -> list[str]:
    """Parameters without a default."""
    return [p.name for p in _parameters(function) if p.default is p.empty]


def _normalised(words: Sequence[str], parser: Parser, command: Sequence[str]) -> list[str]:
    """``--some-option`` as ``--some_option``, switches with their value, and ``1,2`` for several numbers as a list.

    An option for a list of such lists is given once for each of them, ``--init 1,2 --init 3,4``. The contents of files
    of options come first, so that what is given here wins over them wherever it stands.
    """
    switches, several = parser.of_kind(lambda kind: kind is bool), parser.of_kind(is_several)
    lists_of_lists = parser.of_kind(lambda kind: is_several(kind) and any(map(is_several, parts_of(kind))))
    repeated: dict[str, list[str]] = {}
    result: list[str] = []
    configs: list[str] = []
    rest = list(words)
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
        if shown in several and (equals or rest):
            value = value if equals else rest.pop(0)
            equals, value = "=", value if value.startswith("[") else f"[{value}]"
            if shown in lists_of_lists and not value.startswith("[["):
                repeated.setdefault(name, []).append(value)
                continue
        result.append(name + equals + value)
    return [*configs, *(f"{name}=[{','.join(values)}]" for name, values in repeated.items()), *result]


def _show_as_typed(actions: Iterable[Action], by_option: dict[str, Action]) -> None:
    """Show options with dashes, and leave out what jsonargparse adds on its own."""
    for action in actions:
        if action.dest == "help":
            action.help = "show this help and exit"
        elif action.dest.endswith(".help") or isinstance(action, _ActionConfigLoad):
            action.help = SUPPRESS
        elif "print_config" in action.dest:
            action.help = PRINT_HELP
            action.metavar = ""
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
