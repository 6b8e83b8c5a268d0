"""The command line, `tsuiseki`: `main` finds the command among those of `commands` and runs it."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from functools import partial
from io import TextIOWrapper
from typing import TYPE_CHECKING

from tsuiseki.tracking.cli.commands import APP, PROGRAM, command_of, example_of, takes_all
from tsuiseki.tracking.cli.help import PLACES, PlainHelp
from tsuiseki.tracking.runs.ending import DONE, WRONG_REQUEST, ended

if TYPE_CHECKING:
    from cyclopts import App

HELP, NESTED = "--help", "--help-all"


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``tsuiseki`` with ``argv`` (by default the process's words); returns the exit status."""
    words = list(sys.argv[1:] if argv is None else argv)
    # Names of files, and words of help, may hold what the terminal cannot show.
    for stream, instead in ((sys.stdout, "replace"), (sys.stderr, "backslashreplace")):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors=instead)
    return ended(partial(_run, words))


def _run(words: list[str]) -> int:
    """The exit status of a command."""
    # OpenCV writes lines of its own to stderr; errors are worded here.
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    chain, command = command_of(words)
    function, arguments = command.default_command, words[len(chain) :]
    if function is not None and not command.help_flags:
        return _status(function(arguments))
    APP.help_formatter, APP.help_epilogue = PlainHelp(NESTED in arguments), "" if function else example_of(chain)
    if words == ["--version"]:
        APP.version_print()
    elif {*arguments} & {"-h", HELP, NESTED} or (function is None and not arguments):
        _help(chain, command)
        if takes_all(command) and (inner := command_of(arguments))[0]:
            print()
            _help(*inner)
        return DONE if arguments else WRONG_REQUEST
    else:
        from tsuiseki.tracking.cli.request import request_of

        return _status(request_of(words).run())
    return DONE


def _help(chain: Sequence[str], command: App) -> None:
    # Beside the others stands the summary, alone the docstring.
    function, summary = command.default_command, command.help
    places = "COMMAND" if function is None or takes_all(command) else PLACES
    command.usage = " ".join([PROGRAM, *chain, f"{places} [OPTIONS]" if function else places])
    command.help = None if function else summary
    APP.help_print(chain)
    command.help = summary
    if isinstance(APP.help_formatter, PlainHelp):
        APP.help_formatter.print_head(APP.console)


def _status(result: object) -> int:
    return result if isinstance(result, int) and not isinstance(result, bool) else DONE
