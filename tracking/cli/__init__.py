"""The command line, `tsuiseki`: one tree of commands, each a typed function.

A command's module is imported when the command is chosen, and what it needs when it runs, so that help is quick and
the commands that track never import torch.
"""

from __future__ import annotations

import difflib
import importlib
import os
import re
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any, TypeAlias

from tsuiseki.tracking.errors import InputWarning, RequestError, RunError

DONE, FAILED, WRONG_REQUEST = 0, 1, 2
# Ways to ask a run to end, as far as the system knows them.
ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


@dataclass(frozen=True)
class Command:
    """A function of the command line.

    Attributes:
        summary: one line for the list of commands.
        module: the file in this package that holds it.
        function: its name there.
        positional: parameters given by place instead of by name; a list takes all that follow.
        forwarded: the function takes the words as they are, for a parser of its own.
    """

    summary: str
    module: str
    function: str
    positional: tuple[str, ...] = ()
    forwarded: bool = False


@dataclass(frozen=True)
class Group:
    """Commands of one kind."""

    summary: str
    commands: Mapping[str, Command]


Tree: TypeAlias = Mapping[str, Command | Group]

COMMANDS: Tree = {
    "demo": Command("run the whole path on a generated labelled clip and write a report", "demo", "demo"),
    "simulate": Group(
        "make labelled video with exact truth",
        {
            "street": Command("people on a street before a fixed camera", "simulate", "street"),
            "sphere": Command("a ball carried through a room before several cameras", "simulate", "sphere"),
            "blobs": Command("coloured objects over natural clutter", "simulate", "blobs"),
            "goldfish": Command("fish that bend, or balls that squash", "simulate", "goldfish"),
            "drone": Command("people who act, before a drone's camera", "simulate", "drone"),
            "fisheye": Command("people in a room, under ceiling fisheye cameras", "simulate", "fisheye"),
        },
    ),
    "train": Group(
        "fit a model to labelled video (all but body and motion need the train extra)",
        {
            "detector": Command("where people are", "train", "detector", forwarded=True),
            "appearance": Command("what they look like", "train", "appearance", forwarded=True),
            "action": Command("what they do", "train", "action", forwarded=True),
            "affinity": Command("whether two detections are the same person", "train", "affinity", forwarded=True),
            "objectness": Command("which boxes look like an object", "train_objectness", "objectness"),
            "body": Command("a body that bends, from silhouettes", "train_body", "train_body", ("clips",)),
            "motion": Command(
                "how a body that bends moves, from its tracks", "train_motion", "train_motion", ("tracks",)
            ),
            "affinity-drone": Command("the same, seen from a drone", "train", "affinity_drone", forwarded=True),
        },
    ),
    "export": Group(
        "turn a trained model into ONNX (needs the train extra)",
        {
            "detector": Command("from a checkpoint, or from torchvision's COCO weights", "export", "detector"),
            "appearance": Command("from a checkpoint", "export", "appearance"),
            "action": Command("from a checkpoint, one file a stream", "export", "action"),
        },
    ),
    "calibrate": Group(
        "find out where cameras are and how they see",
        {
            "points": Command("from known points in space", "calibrate", "points", ("file",)),
            "convert": Command("a fisheye calibration in another program's format", "calibrate", "convert", ("file",)),
            "pose": Command("over a floor, from height and tilt or from points", "calibrate", "pose", ("file",)),
        },
    ),
    "track": Group(
        "follow something through a video with exported models",
        {
            "people": Command("everyone in view, each with an id", "track.people", "people", ("source",)),
            "single": Command("one target, from its box in the first frame", "track.single", "single", ("source",)),
            "sphere": Command("a ball in space, from calibrated cameras", "track.sphere", "sphere", ("source",)),
            "drone": Command("people seen from a drone, and what they do", "track.drone", "drone", ("source",)),
            "blobs": Command("objects of a colour, or measured points", "track.blobs", "blobs", ("source",)),
            "deformable": Command(
                "bodies that bend, such as fish from above", "track.deformable", "deformable", ("source",)
            ),
            "fisheye": Command(
                "people under ceiling cameras, and where on the floor", "track.fisheye", "fisheye", ("source",)
            ),
        },
    ),
    "evaluate": Group(
        "score results against labels",
        {
            "people": Command("tracks: HOTA, MOTA, IDF1 and more", "evaluate", "people", ("truth", "results")),
            "detection": Command("detections: average precision", "evaluate", "detection", ("truth", "results")),
            "single": Command("one target: success and precision", "evaluate_single", "single", ("truth", "results")),
            "points": Command("tracked points: OSPA, GOSPA and more", "points", "evaluate", ("truth", "results")),
            "states": Command(
                "bodies that bend: position, heading, identity", "evaluate", "states", ("truth", "results")
            ),
            "action": Command("what people do: F1 and average precision", "evaluate", "action", ("truth", "results")),
        },
    ),
    "reproduce": Group(
        "a paper's table or figure: paper and here, plus the plot",
        {
            "multi-correlation-filter": Command(
                "correlation filters selected by a particle filter",
                "reproduce",
                "multi_correlation_filter",
                forwarded=True,
            ),
            "phd": Command("finite-set filters on the standard scenarios", "reproduce", "phd", forwarded=True),
            "pca-particle-filter": Command(
                "how many particles a goldfish needs", "reproduce", "pca_particle_filter", forwarded=True
            ),
            "drone-action-features": Command(
                "tracks and actions from a drone improve each other",
                "reproduce",
                "drone_action_features",
                forwarded=True,
            ),
            "phd-equalisation": Command(
                "equal likelihoods keep the weak target", "reproduce", "phd_equalisation", forwarded=True
            ),
            "association": Command(
                "people and cars linked on given detections, with peers", "reproduce", "association", forwarded=True
            ),
            "omnidirectional": Command(
                "people under ceiling fisheye cameras", "reproduce", "omnidirectional", forwarded=True
            ),
            "stereo-sphere": Command("a ball in space from two cameras", "reproduce", "stereo_sphere", forwarded=True),
            "multiview-drone": Command(
                "a drone in space from measured pixels", "reproduce", "multiview_drone", forwarded=True
            ),
        },
    ),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``tsuiseki`` with ``argv`` (by default the process's words); returns the exit status."""
    words = list(sys.argv[1:] if argv is None else argv)
    try:
        return _dispatch(words, "tsuiseki", COMMANDS)
    except RequestError as error:
        return complain(error, WRONG_REQUEST)
    except RunError as error:
        return complain(error, FAILED)
    except ImportError as error:
        from tsuiseki.tracking.opencv import explained

        known = explained(error)
        if known is None:
            raise
        return complain(known, FAILED)
    except BrokenPipeError:
        sys.stderr.close()
        return FAILED
    except OSError as error:
        place = f" ({error.filename})" if error.filename else ""
        return complain(f"{error.strerror or error}{place}", FAILED)
    except MemoryError as error:
        return complain(f"not enough memory{f': {error}' if str(error) else ''}", FAILED)
    except KeyboardInterrupt as error:
        number = error.args[0] if error.args and isinstance(error.args[0], int) else signal.SIGINT
        return complain("interrupted; nothing was written", 128 + number)


@contextmanager
def on_signals(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Within the ``with`` block `ENDING` goes to ``handler``, save what this process was started to ignore."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in ENDING}
    heard = [number for number, old in before.items() if old is not signal.SIG_IGN]
    try:
        for number in heard:
            signal.signal(number, handler)
        yield
    finally:
        for number in heard:
            signal.signal(number, before[number])


@contextmanager
def _warnings_in_a_line() -> Iterator[None]:
    """Within the ``with`` block every `InputWarning` is printed as a note."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", InputWarning)
        usual = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            if issubclass(category, InputWarning):
                complain(f"note: {message}", DONE)
            else:
                usual(message, category, *place, **more)

        warnings.showwarning = show
        yield


def _interrupt(number: int, _: FrameType | None) -> None:
    raise KeyboardInterrupt(number)


def _dispatch(words: list[str], typed: str, tree: Tree) -> int:
    if not words or words[0] in ("-h", "--help"):
        print(_overview(typed, tree))
        return DONE if words else WRONG_REQUEST
    if words[0] == "--version" and tree is COMMANDS:
        from importlib import metadata

        print(f"tsuiseki {metadata.version('tsuiseki')}")
        return DONE
    entry = tree.get(words[0])
    if entry is None:
        close = difflib.get_close_matches(words[0], list(tree), n=1)
        hint = f"did you mean {close[0]}?" if close else f"expected one of {', '.join(tree)}"
        raise RequestError(f"unknown command `{typed} {words[0]}`; {hint}")
    typed, rest = f"{typed} {words[0]}", words[1:]
    return _dispatch(rest, typed, entry.commands) if isinstance(entry, Group) else _run(entry, typed, rest)


def _run(command: Command, typed: str, words: list[str]) -> int:
    # OpenCV and FFmpeg write lines of their own to stderr; errors are worded here.
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    function = getattr(importlib.import_module(f"tsuiseki.tracking.cli.{command.module}"), command.function)
    if command.forwarded:
        return int(function(words) or DONE)
    from tsuiseki.tracking.cli.parser import parse

    try:
        with on_signals(_interrupt), _warnings_in_a_line():
            arguments = parse(typed, function, command.positional, words)
            return int(function(**arguments) or DONE)
    except SystemExit as done:
        return int(done.code or DONE)


def _overview(typed: str, tree: Tree) -> str:
    """What follows ``typed``, one line each."""
    width = max(len(name) for name in tree)
    heading = "Track people and objects in video." if tree is COMMANDS else ""
    if isinstance(group := COMMANDS.get(typed.split()[-1]), Group):
        heading = f"{group.summary[:1].upper()}{group.summary[1:]}."
    lines = [f"usage: {typed} {'COMMAND' if tree is COMMANDS else 'WHAT'} …", "", heading, ""]
    lines += [f"  {name:{width}}  {entry.summary}" for name, entry in tree.items()]
    example = f"{typed} {next(iter(tree))}" if tree is not COMMANDS else "tsuiseki track people"
    lines += ["", f"`{example} --help` lists the options of one."]
    if tree is COMMANDS:
        lines += ["To see it all at work: tsuiseki demo"]
    return "\n".join(lines)


def complain(message: object, status: int) -> int:
    """Print one line to stderr; returns ``status``."""
    # The library speaks of arguments, in backquotes.
    message = re.sub(r"`(\w+)`", lambda name: "--" + name[1].replace("_", "-"), str(message))
    print(f"tsuiseki: {' '.join(str(message).split())}", file=sys.stderr)
    return status
