"""Which frames a result is of, as the ``run.json`` beside it says."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

from tsuiseki.tracking.errors import InputWarning
from tsuiseki.tracking.output import RUN_FILE, is_partial
from tsuiseki.tracking.types.frame_range import FrameRange


def tracked_frames(result: Path) -> FrameRange | None:
    """The frames that were tracked for the file ``result``; None where nothing says so."""
    try:
        values = json.loads((result.parent / RUN_FILE).read_text(encoding="utf-8"))
        if result.name not in values["files"]:
            return None
        numbers = values["frames"]["frame"]
        return FrameRange(int(numbers[0]) - 1, int(numbers[-1]) - 1)
    except (OSError, ValueError, KeyError, IndexError, TypeError):
        return None


def warn_of_other_frames(result: Path, first: int, last: int) -> None:
    """Say that frames are scored that were not tracked.

    Args:
        result: a file.
        first: 0-based, of the labels that are scored.
        last: 0-based.
    """
    tracked = tracked_frames(result)
    if tracked is not None and (tracked.first > first or tracked.last is None or tracked.last < last):
        kind = "a partial result, of" if is_partial(result.parent) else "of"
        warnings.warn(
            f"{result} is {kind} frames {tracked} alone, but {first + 1}-{last + 1} are scored; for its own use "
            f"`frames` {tracked}",
            InputWarning,
            stacklevel=3,
        )
    elif tracked is None and is_partial(result.parent):
        warnings.warn(f"{result} is a partial result; score those it has with `frames`", InputWarning, stacklevel=3)
