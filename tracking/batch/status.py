"""`tsuiseki batch status DIR`: how far a batch is, by its journal, whether it runs or not."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from tsuiseki.tracking.batch.jobs import STATE
from tsuiseki.tracking.batch.schedule import JOURNAL
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.output import held

# Seconds of the past that tell the speed.
LATELY = 600.0


def status(folder: Path, /) -> None:
    """Say how far a batch is: videos done, running and failed, frames a second, time left.

    Args:
        folder: that the batch writes into.
    """
    path = folder / STATE / JOURNAL
    if not path.is_file():
        raise RequestError(f"{folder}: expected the folder of a batch, found no {STATE}/{JOURNAL} in it")
    events = list(_events(path))
    begin = max((n for n, event in enumerate(events) if event["event"] == "batch"), default=None)
    if begin is None:
        raise RequestError(f"{path}: expected the beginning of a batch, found none; is it still starting?")
    for line in lines_of(events[begin:], _runs(folder)):
        print(line)


def lines_of(events: list[dict[str, Any]], runs: bool) -> Iterator[str]:
    """What there is to say.

    Args:
        events: of one batch, the first of which says what is to be done.
        runs: whether it does at this moment.
    """
    sizes: Mapping[str, float] = events[0]["sizes"]
    ends = {event["name"]: event for event in events if event["event"] == "end"}
    begun = {event["name"] for event in events if event["event"] == "begin"}
    failed = [event for event in ends.values() if event["status"] == "failed"]
    under_way = [name for name in begun if name not in ends]
    done = len(ends) - len(failed)
    state = "running" if runs else "not running"
    waiting = len(sizes) - len(ends) - len(under_way)
    others = f"{len(under_way)} begun, {waiting} waiting, {len(failed)} failed"
    yield f"{state}: {done} of {len(sizes)} videos done, {others}"
    now = time.time() if runs else events[-1]["time"]
    looked = [event for event in events if event["event"] == "done" and event["kind"] in ("look", "whole")]
    lately = [event for event in looked if event["time"] > now - LATELY]
    seconds = max(now - max(events[0]["time"], now - LATELY), 1e-3)
    if lately:
        yield f"{sum(event['frames'] for event in lately) / seconds:.1f} frames a second"
    worked = sum(sizes[name] for name, end in ends.items() if end["status"] != "kept" and name in sizes)
    left = sum(size for name, size in sizes.items() if name not in ends)
    if runs and worked and left:
        yield f"about {_clock((now - events[0]['time']) * left / worked)} left"
    for event in failed:
        yield f"{event['name']}: {event['line']}"


def _events(path: Path) -> Iterator[dict[str, Any]]:
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            event = json.loads(line)
        except ValueError:
            continue  # torn where the disk was full or the process killed
        if isinstance(event, dict) and {"event", "time"} <= event.keys():
            yield event


def _runs(folder: Path) -> bool:
    """Whether somebody holds the lock on a batch."""
    with ExitStack() as stack:
        return not held(folder / STATE, stack)


def _clock(seconds: float) -> str:
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min" if minutes else "a minute"
