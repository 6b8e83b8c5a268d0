"""Help in plain text: a column of options and one of what they are."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, get_origin

if TYPE_CHECKING:
    from cyclopts.help import HelpEntry, HelpPanel
    from rich.console import Console, ConsoleOptions

# Characters of the widest line.
WIDTH = 100
# Characters of the column of options; a longer option has a line of its own.
COLUMN = 30
# Stands in a usage for what comes behind the command, in its place.
PLACES = "PLACES"
PROGRAM_OPTIONS = (
    ("--config FILE", "YAML of options, or run.json of an earlier run; options here win"),
    ("--print-config", "print all options as YAML for --config, and end"),
)
NESTED, NESTED_TEXT = "--help, --help-all", "show this help; --help-all also {}"


class PlainHelp:
    """Prints what cyclopts knows of a command.

    Args:
        nested: also show the options of groups, such as ``--sort.max-age``.

    Attributes:
        head: what stands above the options and is not printed yet: the usage, which names what the first of them says.
    """

    def __init__(self, nested: bool = False) -> None:
        self.nested = nested
        self.head = list[str]()

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Print the options of a command, or the commands of a group."""
        del options
        if not panel.entries:
            return
        self.print_head(console, [entry for entry in panel.entries if entry.positional_label])
        rows, groups = list[tuple[str, str]](), dict[str, None]()
        for entry in panel.entries:
            name = next((name for name in entry.positive_names if "." in name), "")
            if name and not self.nested:
                groups[f"{name.partition('.')[0]}.*"] = None
            elif not {"--help", "--version"} & {*entry.names}:
                rows.append((_label(entry), _description(entry)))
        if panel.title == "Parameters":
            rows += PROGRAM_OPTIONS
            rows += [(NESTED, NESTED_TEXT.format(", ".join(groups)))] if groups else [("--help", "show this help")]
        width = min(WIDTH, console.width)
        for label, text in rows:
            lines = textwrap.wrap(text, width - COLUMN) or [""]
            first = f"  {label:{COLUMN - 4}}  "
            if len(first) > COLUMN:
                _print(console, first.rstrip())
                first = " " * COLUMN
            _print(console, (first + lines[0]).rstrip())
            for line in lines[1:]:
                _print(console, " " * COLUMN + line)

    def render_usage(self, console: Console, options: ConsoleOptions, usage: Any) -> None:
        """Keep what to type."""
        del console, options
        self.head.append(f"usage: {str(usage).strip().removeprefix('Usage: ')}\n")

    def render_description(self, console: Console, options: ConsoleOptions, description: Any) -> None:
        """Keep what the command does, paragraph by paragraph."""
        del options
        for paragraph in _text(description).strip().split("\n\n"):
            filled = textwrap.fill(" ".join(paragraph.split()), min(WIDTH, console.width))
            self.head.append(f"{filled}\n")

    def print_head(self, console: Console, places: Sequence[HelpEntry] = ()) -> None:
        """Print what was kept; ``places`` are what stands behind the command."""
        words = " ".join(f"{place.positional_label}{'...' * _takes_several(place)}" for place in places)
        for text in self.head:
            _print(console, text.replace(f" {PLACES}", f" {words}" if words else ""))
        self.head.clear()


def _takes_several(entry: HelpEntry) -> bool:
    return get_origin(entry.type) is list


def _print(console: Console, text: str) -> None:
    console.print(text, highlight=False, markup=False, emoji=False, soft_wrap=True)


def _text(renderable: Any) -> str:
    """The characters of what cyclopts would show with colours."""
    renderable = getattr(renderable, "primary_renderable", renderable)
    return str(getattr(renderable, "plain", renderable or "")).replace("``", "")


def _label(entry: HelpEntry) -> str:
    if entry.positional_label:
        return entry.positional_label
    if not entry.positive_names:
        return entry.negative_names[0] if entry.negative_names else ""
    name = ", ".join(entry.names) if entry.default is None else entry.positive_names[0]
    return f"{name} {_choices(entry) or (entry.metavar or '').replace(' ', ',')}".strip()


def _choices(entry: HelpEntry) -> str:
    """What may be chosen, where that fits beside the option."""
    choices = "{" + ",".join(entry.choices or ()) + "}"
    return choices if 2 < len(choices) < COLUMN - 4 - len(entry.positive_names[0]) else ""


def _description(entry: HelpEntry) -> str:
    text = " ".join(_text(entry.description).split()).removesuffix(".")
    if entry.choices and not _choices(entry):
        text = f"{', '.join(entry.choices)}: {text}"
    if entry.required and not entry.positional_label:
        return f"{text} (required)"
    if entry.default in (None, "", "()", "[]", "False") or entry.positional_label:
        return text
    if entry.default == "True":
        return f"{text} (on by default; {entry.negative_names[0]} turns it off)"
    return f"{text} (default: {entry.default.strip('()').replace(', ', ',')})"
