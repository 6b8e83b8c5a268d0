"""The command line, `tsuiseki`: `main` finds the command among those of `commands` and runs it."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from functools import partial
from io import TextIOWrapper

from tsuiseki.tracking.runs.ending import DONE, WRONG_REQUEST, ended

HELP, NESTED = "--help", "--help-all"


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``tsuiseki`` with ``argv`` (by default the process's words); returns the exit status."""
    words = list(sys.argv[1:] if argv is None else argv)
    # Names of files may hold what the terminal cannot show.
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    return ended(partial(_run, words))


def _run(words: list[str]) -> int:
    """The exit status of a command."""
    # OpenCV writes lines of its own to stderr; errors are worded here.
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    from tsuiseki.tracking.cli.commands import APP, command_of
    from tsuiseki.tracking.cli.help import PlainHelp

    chain, command = command_of(words)
    function, arguments = command.default_command, words[len(chain) :]
    if function is not None and not command.help_flags:
        return _status(function(arguments))
    APP.help_formatter = PlainHelp(NESTED in arguments)
    if words == ["--version"]:
        APP.version_print()
        return DONE
    if function is None and arguments[:1] in ([], [HELP], ["-h"]):
        # Without what the commands need.
        APP.help_print(chain)
        return DONE if arguments else WRONG_REQUEST
    from tsuiseki.tracking.cli.request import request_of

    # Beside the others stands the summary, alone the docstring.
    summary, command.help = command.help, command.help if function is None else None
    try:
        request = request_of([HELP if word == NESTED else word for word in words])
        return _status(request.run())
    finally:
        command.help = summary


def _status(result: object) -> int:
    return result if isinstance(result, int) and not isinstance(result, bool) else DONE
