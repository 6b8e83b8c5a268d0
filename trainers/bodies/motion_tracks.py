"""Tracks to learn a body's motion from: the states in files, and how many frames a second they are."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from tsuiseki.tracking.bodies.body import Body
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.body_states import read_states
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.output import RUN_FILE
from tsuiseki.tracking.types import FloatArray


def read_stretches(tracks: Sequence[Path], body: Body) -> list[FloatArray]:
    """``(T, D)`` states of consecutive frames with the status tracking, of all tracks in some files.

    Args:
        tracks: states.csv files, or folders that hold one.
        body: the one that was tracked.

    Raises:
        RequestError: a file is missing or broken, or of another body.
    """
    found = [track for path in tracks for track in read_states(_states_file(path), body.fields)]
    return [stretch for track in found for stretch in track.stretches()]


def common_frame_rate(tracks: Sequence[Path], given: float | None = None) -> float:
    """Frames per second of the tracks in some files: ``given``, or what lies beside them says.

    Raises:
        RequestError: nothing says it, they differ, or it is no number above 0.
    """
    rates = {given} if given is not None else {_frame_rate_beside(_states_file(path)) for path in tracks}
    if len(rates) != 1:
        several = " and ".join(f"{rate:g}" for rate in sorted(rates))
        raise RequestError(f"expected tracks of one frame rate, got {several}; learn from one at a time")
    rate = float(rates.pop())
    if not 0 < rate < float("inf"):
        raise RequestError(f"`frame_rate`: expected a number above 0, got {rate:g}")
    return rate


def _states_file(path: Path) -> Path:
    return path / "states.csv" if path.is_dir() else path


def _frame_rate_beside(path: Path) -> float:
    """What the run or the sequence that a file of states belongs to says of its frame rate."""
    try:
        run = json.loads((path.parent / RUN_FILE).read_text(encoding="utf-8"))
        return float(run["facts"]["frame_rate"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    if (path.parent / "seqinfo.ini").is_file():
        return read_sequence(path.parent).frame_rate
    raise RequestError(f"{path}: no run.json or seqinfo.ini beside it says the frame rate; give `frame_rate`")
