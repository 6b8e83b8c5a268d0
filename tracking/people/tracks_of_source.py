"""The people in a source, whatever it is: a result, a file of tracks, or a video, which is tracked first."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError, a_path
from tsuiseki.tracking.formats.exports import format_at
from tsuiseki.tracking.formats.result_folder import TABLES
from tsuiseki.tracking.output import RUN_FILE
from tsuiseki.tracking.people.api import track_people
from tsuiseki.tracking.result import FILES, Result
from tsuiseki.tracking.types import FloatArray, Track
from tsuiseki.tracking.video.source import open_source

RESULTS = (RUN_FILE, *TABLES, "tracks.json", "tracks.txt")


def tracked(source: str | Path | Result[Track]) -> Result[Track]:
    """The tracks of people.

    Args:
        source: a result, its folder, a file of tracks in any format that `Result.load` reads; or a video, a folder of
            images or a sequence folder, which is tracked with default settings.

    Raises:
        RequestError: there is nothing of this, the source does not end, or no person has a box.
    """
    result = source if isinstance(source, Result) else _read(a_path(source, "source"))
    if not result.tracks or not all(isinstance(track, Track) for track in boxes_of(result)):
        raise RequestError(f"{name_of(source)}: expected tracks of people with boxes, got none")
    return result


def _read(path: Path) -> Result[Track]:
    # `tsuiseki simulate` leaves a run.json in the sequences that it draws.
    folder = any((path / name).is_file() for name in RESULTS) and not (path / "seqinfo.ini").is_file()
    if folder or path.suffix.lower() in FILES or (path.exists() and format_at(path)):
        return Result.load(path)
    if open_source(str(path)).endless:
        raise RequestError(f"{path}: expected a source that ends, got a live one; record it first")
    return track_people(str(path))


def name_of(source: str | Path | Result[Track]) -> str:
    """What a source is called."""
    return (source.name or "result") if isinstance(source, Result) else Path(source).stem or str(source)


def boxes_of(result: Result[Track]) -> list[Track]:
    """The tracks of a result, without what else is known of each."""
    return [getattr(track, "track", track) for track in result]


def rates_of(frame_rates: Sequence[float] | None, count: int) -> list[float | None]:
    """Frames a second of each of so many sources, of one number or one a source; None where they say so themselves.

    Raises:
        RequestError: it is another number of them, or one is not above 0.
    """
    if frame_rates is not None and (len(frame_rates) not in (1, count) or not min(frame_rates) > 0):
        came = ",".join(f"{rate:g}" for rate in frame_rates)
        raise RequestError(f"`fps`: expected 1 number or {count}, one a source, above 0, got {came or 'none'}")
    return [None if frame_rates is None else frame_rates[k % len(frame_rates)] for k in range(count)]


def frame_times(result: Result[Track], frame_rate: float) -> FloatArray:
    """``(F,)`` seconds of the frames up to the last with a box."""
    frames = np.arange(max(int(track.frames[-1]) for track in boxes_of(result)) + 1)
    noted = result.frames.get("time")
    return frames / frame_rate if noted is None else np.interp(frames, result.frames["frame"], noted)
