"""What a run wrote into its folder, read again: the tracks, and what ``run.json`` says of them.

The tracks are in ``tracks.csv``, ``states.csv`` or ``track3d.csv`` (tables, see `formats.track_tables`), in
``tracks.json`` (people and actions), ``tracks.txt`` (MOTChallenge text) or ``boxes.txt`` (one target). ``run.json`` has
under ``results``, for the folder (``.``) and each folder in it, where the video is, its rate and size, and by id the
frames, from 1, in which a box was filled in.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.acting_tracks import read_acting_tracks
from tsuiseki.tracking.formats.body_points import POINTS_FILE, read_poses_file
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.formats.rows import column_names, read_named_rows
from tsuiseki.tracking.formats.single import read_boxes
from tsuiseki.tracking.formats.track_tables import names_in, read_table, tracks_of
from tsuiseki.tracking.formats.tracked_video import runs_of
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.output import RUN_FILE, columns_shifted
from tsuiseki.tracking.types import FloatArray, IntArray, Track
from tsuiseki.tracking.types.frame_range import LAST_FRAME
from tsuiseki.tracking.types.recording import Recording
from tsuiseki.tracking.types.tracks import FloorTrack

ACTIONS_FILE = "tracks.json"
STATES_FILE = "states.csv"
# What the tracker left, beside tracks that were corrected.
SOLVED_FILE = "tracks.solved.txt"
SOLVED_ACTIONS = "tracks.solved.json"
SOLVED_STATES = "states.solved.csv"
TABLES = ("tracks.csv", "states.csv", "track3d.csv")
PLACES = ("x", "y", "rx", "ry", "rw", "rh", "degrees")


def filled_frames(tracks: Sequence[Any]) -> dict[str, str]:
    """By id the frames, from 1, in which no detection supports the box, such as ``"12-15,20"``."""
    boxes = [getattr(track, "track", track) for track in tracks]
    filled = [(track.id, track.frames[~track.observed]) for track in boxes if isinstance(track, Track)]
    return {str(number): _spans(frames) for number, frames in filled if len(frames)}


def _spans(frames: IntArray) -> str:
    runs = [frames[run] + 1 for run in runs_of(frames)]
    return ",".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)


def _numbers(spans: str) -> list[int]:
    """The 0-based frames of `_spans`."""
    ends = [[int(end) for end in span.split("-")] for span in spans.split(",")]
    if any(span[-1] > LAST_FRAME for span in ends):
        raise ValueError(f"a filled frame beyond {LAST_FRAME}")
    return [number - 1 for span in ends for number in range(span[0], span[-1] + 1)]


def read_folder(folder: Path) -> tuple[list[Any], dict[str, Any]]:
    """The tracks of a run, and what is known of them: attributes of `Result`.

    Raises:
        RequestError: there is no result in the folder, or several, or ``run.json`` is broken.
    """
    record, name = _record(folder)
    results = record.get("results", {})
    if name == "." and name not in results and results:
        raise RequestError(f"{folder} holds several results; load one of {', '.join(str(folder / n) for n in results)}")
    about = results.get(name, {})
    attributes: dict[str, Any] = {key: record[key] for key in ("settings", "facts", "seconds") if key in record}
    attributes["frames"] = columns_shifted(record.get("frames", {}), -1)
    readers: dict[str, Reader] = dict.fromkeys(TABLES, _of_table)
    readers["tracks.json"] = lambda place, _: read_acting_tracks(place / "tracks.json", needed=False)
    readers["world.csv"] = _of_floor
    readers["tracks.txt"] = lambda place, _: (list(read_tracks(place / "tracks.txt")), ())
    readers["boxes.txt"] = _of_one
    read = next((read for name, read in readers.items() if (folder / name).is_file()), None)
    if read is None:
        raise RequestError(f"{folder}: expected a result, such as tracks.txt, found none")
    tracks, names = read(folder, attributes["frames"])
    if record.get("partial"):
        warnings.warn(f"{folder} is a partial result: {record.get('reason', 'stopped')}", InputWarning, stacklevel=4)
    if (folder / POINTS_FILE).is_file():
        attributes["points"] = read_poses_file(folder / POINTS_FILE)
    return [_with_filled(track, about.get("filled", {})) for track in tracks], {**attributes, **about, "names": names}


def recorded(folder: Path) -> Recording:
    """What ``run.json`` says of the video of the tracks in a folder; nothing where there is none.

    Raises:
        RequestError: it says something else.
    """
    record, name = _record(folder)
    return Recording.parse(record.get("results", {}).get(name, {}), folder / RUN_FILE)


def _record(folder: Path) -> tuple[dict[str, Any], str]:
    """``run.json`` of a folder or of the one around it, and the name that the folder has there."""
    for place, name in ((folder, "."), (folder.parent, folder.name)):
        if not (place / RUN_FILE).exists():
            continue
        content = read_json(place / RUN_FILE, "JSON of a run")
        if not isinstance(content, dict):
            raise RequestError(f"{place / RUN_FILE}: expected what a run writes, got other JSON")
        if name == "." or name in content.get("results", {}):
            return content, name
    return {}, "."


Reader = Callable[[Path, Mapping[str, Any]], tuple[list[Any], tuple[str, ...]]]


def _of_table(folder: Path, _: Mapping[str, Any]) -> tuple[list[Any], tuple[str, ...]]:
    table = read_table(next(folder / name for name in TABLES if (folder / name).is_file()))[0]
    return tracks_of(table), names_in(table)


def _of_floor(folder: Path, _: Mapping[str, Any]) -> tuple[list[Any], tuple[str, ...]]:
    """People on a floor: their boxes in ``tracks.txt``, and where they are in the rows of ``world.csv``."""
    path = folder / "world.csv"
    if "cameras" in column_names(path, "places on a floor"):
        return tracks_of(read_table(path)[0]), ()
    table = read_named_rows(path, "places on a floor", ("id", *PLACES))
    ids, values = table.numbers(["id"])[:, 0], table.numbers(PLACES)
    values[:, -1] = np.radians(values[:, -1])
    floor_tracks = []
    for track in read_tracks(folder / "tracks.txt"):
        rows: FloatArray = values[ids == track.id]
        if len(rows) != len(track):
            raise RequestError(f"{path}: expected {len(track)} rows of id {track.id} as in tracks.txt, got {len(rows)}")
        floor_tracks.append(FloorTrack(track, rows[:, 2:], rows[:, :2]))
    return floor_tracks, ()


def _of_one(folder: Path, columns: Mapping[str, Any]) -> tuple[list[Any], tuple[str, ...]]:
    """One target, whose scores and statuses are in ``run.json``."""
    boxes = read_boxes(folder / "boxes.txt")
    count = len(boxes)
    frames, scores = np.asarray(columns.get("frame", range(count))), columns.get("score", np.ones(count))
    tracking = np.array([status == "tracking" for status in columns.get("status", ["tracking"] * count)])
    if not len(frames) == len(scores) == len(tracking) == count:
        raise RequestError(f"{folder}: expected as many boxes as frames in {RUN_FILE}, got {count} and {len(frames)}")
    here = np.isfinite(boxes).all(axis=1)
    return [Track(1, frames[here], boxes[here], np.asarray(scores)[here], tracking[here])], ()


def _with_filled(track: Any, filled: Mapping[str, str]) -> Any:
    if isinstance(track, FloorTrack):
        return replace(track, track=_with_filled(track.track, filled))
    spans = filled.get(str(getattr(track, "id", "")))
    if spans is None or not isinstance(track, Track):
        return track
    return replace(track, observed=~np.isin(track.frames, _numbers(spans)))
