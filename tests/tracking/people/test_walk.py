"""How far a frame goes through the house: the rooms that it visits, and how often it comes back to one.

A *room* is a folder of `tracking`, or a module that lies there. A *call* is a function that begins. What Python calls
by itself, such as ``__len__`` or the end of a ``with`` block, all within it, and a comprehension belong to their
caller, and a generator that goes on begins nothing. A *stay* is a run of calls within one room, and a *return* a stay
in a room that was left before. A frame lasts from one call of the tracker to the next. What is asserted is the median
over the frames after the first few, for networks take several frames at a time. What runs once a run is in no frame.
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable
from inspect import CO_GENERATOR
from itertools import groupby, pairwise
from pathlib import Path
from types import FrameType

import numpy as np
import pytest

import tsuiseki.tracking
from tsuiseki.tracking.people.api import follow_people, track_people

HOUSE = f"{Path(tsuiseki.tracking.__path__[0])}/"
# Frames at the beginning that are not looked at.
RUN_UP = 4
# Special methods that stand for a call in the code.
NAMED = ("__init__", "__call__", "__iter__", "__next__", "__enter__")
MOST_ROOMS = 10
MOST_RETURNS = 8
# Folders that no run of a room visits.
APPLICATIONS = {"review", "counts", "hiding", "linking", "floor", "batch", "cli"}


def calls_in(run: Callable[[], object]) -> list[tuple[str, str]]:
    """Room and function of each call in a run, in the order in which they begin."""
    calls, begun = list[tuple[str, str]](), set[FrameType]()

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event != "call" or not code.co_filename.startswith(HOUSE) or _by_python(frame):
            return
        if code.co_flags & CO_GENERATOR:
            if frame in begun:
                return
            begun.add(frame)
        place = code.co_filename.removeprefix(HOUSE).split("/")[0].removesuffix(".py")
        calls.append((place, code.co_qualname))

    sys.setprofile(note)
    try:
        run()
    finally:
        sys.setprofile(None)
    return calls


def _by_python(frame: FrameType | None) -> bool:
    """Whether it is a comprehension, or a special method that no code names, or is called from one."""
    if frame is not None and frame.f_code.co_name.startswith("<"):
        return True
    while frame is not None:
        if frame.f_code.co_name.startswith("__") and frame.f_code.co_name not in NAMED:
            return True
        frame = frame.f_back
    return False


def walk_of_a_frame(calls: list[tuple[str, str]], update: str) -> tuple[float, float]:
    """Rooms and returns of a frame, which begins with the call of ``update``."""
    begins = [number for number, (_, name) in enumerate(calls) if name == update]
    rooms, returns = [], []
    for begin, end in list(pairwise(begins))[RUN_UP:]:
        stays = [room for room, _ in groupby(room for room, _ in calls[begin:end])]
        rooms.append(len(set(stays)))
        returns.append(len(stays) - len(set(stays)))
    return statistics.median(rooms), statistics.median(returns)


def two_people(count: int) -> list[list[list[float]]]:
    return [[[10 + t, 10, 50 + t, 90, 0.9], [100 + t, 10, 150 + t, 90, 0.9]] for t in range(count)]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["flow", "sort"])
@pytest.mark.parametrize("detected", [True, False])
def test_a_frame_visits_few_rooms_and_rarely_comes_back(street: Path, method: str, detected: bool) -> None:
    def run() -> object:
        source = street if detected else [np.zeros((120, 200, 3), np.uint8)] * 16
        detections = None if detected else two_people(16)
        more = {"threads": 1, "detections": detections, "frame_rate": 10.0}
        if method == "flow":
            return track_people(source, **more)
        return list(follow_people(source, "sort", **more))

    calls = calls_in(run)
    assert not {room for room, _ in calls} & APPLICATIONS
    rooms, returns = walk_of_a_frame(calls, "FlowTracker.update" if method == "flow" else "Sort.update")
    assert rooms <= MOST_ROOMS
    assert returns <= MOST_RETURNS
