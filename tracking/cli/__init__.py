"""The command line, `tsuiseki`: `main` finds the command among those of `commands` and runs it."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from functools import partial

from tsuiseki.tracking.cli.commands import COMMANDS, Command, Group, Tree
from tsuiseki.tracking.errors import RequestError, hint_at
from tsuiseki.tracking.runs.ending import DONE, WRONG_REQUEST, ended

PROGRAM = "tsuiseki"


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``tsuiseki`` with ``argv`` (by default the process's words); returns the exit status."""
    words = list(sys.argv[1:] if argv is None else argv)
    return ended(partial(_dispatch, words, [], COMMANDS))


def _dispatch(words: list[str], typed: list[str], tree: Tree) -> int:
    """Go down ``tree`` by ``words``; ``typed`` led here."""
    if not words or words[0] in ("-h", "--help"):
        print(_overview(typed, tree))
        return DONE if words else WRONG_REQUEST
    if words[0] == "--version" and not typed:
        from importlib import metadata

        print(f"{PROGRAM} {metadata.version('tsuiseki')}")
        return DONE
    entry = tree.get(words[0])
    if entry is None:
        unknown = " ".join([PROGRAM, *typed, words[0]])
        raise RequestError(f"unknown command `{unknown}`; {hint_at(words[0], [*tree])}")
    typed, rest = [*typed, words[0]], words[1:]
    return _dispatch(rest, typed, entry.commands) if isinstance(entry, Group) else _run(entry, typed, rest)


def _run(command: Command, typed: list[str], words: list[str]) -> int:
    # OpenCV and FFmpeg write lines of their own to stderr; errors are worded here.
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    function = command.load()
    from tsuiseki.tracking.cli.parser import call

    status = function(words) if command.forwarded else call(" ".join([PROGRAM, *typed]), function, words)
    return status if isinstance(status, int) else DONE


def _overview(typed: list[str], tree: Tree) -> str:
    """What follows ``typed``, one line each."""
    width, before = max(map(len, tree)), " ".join([PROGRAM, *typed])
    summary = COMMANDS[typed[0]].summary if typed else "track people and objects in video"
    lines = [f"usage: {before} {'WHAT' if typed else 'COMMAND'} …", "", f"{summary[:1].upper()}{summary[1:]}.", ""]
    lines += [f"  {name:{width}}  {entry.summary}" for name, entry in tree.items()]
    example = f"{before} {next(iter(tree))}" if typed else "tsuiseki track people"
    lines += ["", f"`{example} --help` lists the options of one."]
    return "\n".join(lines if typed else [*lines, "To see it all at work: tsuiseki demo"])
