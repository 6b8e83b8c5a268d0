"""Label Studio's JSON of video: a list of tasks, with a ``videorectangle`` for each track.

Frames count from 1; x, y, width and height are percent of the picture. A key frame that is ``enabled`` holds on a
straight line to the next one, or to the end; one that is not is the last before a gap. A track has one score. The size
of the picture, which other files do not say, stands in ``data`` under ``size``.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import read_json
from tsuiseki.tracking.formats.tracked_video import Size, TrackedVideo, between_keys, runs_of, tracks_of_rows
from tsuiseki.tracking.geometry import corners_from_xywh, xywh_from_corners
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.frame_range import LAST_FRAME

WHAT = "Label Studio's JSON of video"
SIDES = ("x", "y", "width", "height")


def write_label_studio(path: Path, video: TrackedVideo) -> None:
    """Write the tracks as predictions; in ``data`` stands the video's name, for which its address is to be put."""
    size = np.array(video.pixels)
    regions = [_region(track, video, size) for track in video.tracks]
    task = {
        "data": {"video": video.name, "size": size.tolist(), "frame_rate": video.frame_rate},
        "predictions": [{"model_version": "tsuiseki", "result": regions}],
    }
    path.write_text(json.dumps([task]) + "\n", encoding="utf-8")


def _region(track: Track, video: TrackedVideo, size: Any) -> dict[str, Any]:
    shares = (xywh_from_corners(track.boxes) / np.tile(size, 2) * 100).round(5)
    ends = {int(run[-1]) for run in runs_of(track.frames)}
    sequence = [
        {"frame": frame + 1, "enabled": k not in ends, "rotation": 0, **dict(zip(SIDES, box, strict=True)),
         **({"time": (frame + 1) / video.frame_rate} if video.frame_rate else {})}
        for k, (frame, box) in enumerate(zip(track.frames.tolist(), shares.tolist(), strict=True))
    ]  # fmt: skip
    value = {"framesCount": video.frame_count, "sequence": sequence, "labels": [video.kind[track.id]]}
    if video.frame_rate:
        value["duration"] = video.frame_count / video.frame_rate
    names = {"id": str(track.id), "type": "videorectangle", "from_name": "box", "to_name": "video"}
    return {**names, "origin": "prediction", "score": round(float(track.scores.mean()), 4), "value": value}


def read_label_studio(path: Path) -> TrackedVideo:
    """The tracks of the only task in a file: those that people made, or else predictions.

    Names of tracks are numbers, or they are numbered from 1.

    Raises:
        RequestError: it is something else or broken, or has several tasks.
    """
    content = read_json(path, WHAT)
    if not isinstance(content, list) or len(content) != 1:
        count = len(content) if isinstance(content, list) else 0
        raise RequestError(f"{path}: expected one task of {WHAT}, got {count}; export one at a time")
    try:
        task = content[0]
        made = next((each for name in ("annotations", "predictions") for each in task.get(name) or []), None)
        found = [one for one in (made or {}).get("result", []) if one.get("type") == "videorectangle"]
        if made is None or (made["result"] and not found):
            raise RequestError(f"{path}: expected `videorectangle` in {WHAT}, found none")
        names = [str(one["id"]) for one in found]
        numbered = all(name.isdecimal() and len(name) < 19 for name in names) and len({*names}) == len(names)
        ids = [int(name) if numbered else k + 1 for k, name in enumerate(names)]
        data = task["data"]
        size = (int(data["size"][0]), int(data["size"][1])) if "size" in data else None
        length = max((int(one["value"].get("framesCount") or 0) for one in found), default=0)
        rows = [row for number, one in zip(ids, found, strict=True) for row in _rows(path, number, one, size)]
        labels = (str((one["value"].get("labels") or [""])[0]) for one in found)
        classes = {number: (-1, label) for number, label in zip(ids, labels, strict=True)}
        name = PurePosixPath(str(data.get("video") or path.stem).split("?")[0]).name
        rate = float(data.get("frame_rate") or 0) or _rate(found)
    except RequestError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise RequestError(f"{path}: expected {WHAT}, got a broken one: {error!r}") from error
    return TrackedVideo(tracks_of_rows(path, rows, classes), name, rate, size, length, shares=size is None)


def _rate(found: list[dict[str, Any]]) -> float:
    value = found[0]["value"] if found else {}
    return float(value["framesCount"]) / float(value["duration"]) if value.get("duration") else 0.0


def _rows(path: Path, number: int, one: Any, size: Size) -> Iterator[tuple[int, int, Any, float, bool]]:
    keys = sorted(one["value"]["sequence"], key=lambda key: int(key["frame"]))
    frames = np.array([int(key["frame"]) - 1 for key in keys], dtype=np.int64)
    last = int(one["value"].get("framesCount") or 0) - 1
    if not len(frames) or frames[0] < 0 or max(int(frames[-1]), last) >= LAST_FRAME or (np.diff(frames) == 0).any():
        raise RequestError(f"{path}: expected each frame from 1 to {LAST_FRAME} once in track {one['id']}")
    if any(key.get("rotation") for key in keys):
        raise RequestError(f"{path}: expected upright boxes, got a turned one in track {one['id']}")
    shares = np.array([[float(key[side]) for side in SIDES] for key in keys])
    boxes = corners_from_xywh(shares) * np.tile(size or (1, 1), 2) / 100
    enabled = np.array([bool(key.get("enabled", True)) for key in keys])
    every, values, key = between_keys(path, frames, boxes, last if enabled[-1] else 0)
    listed = frames[key] == every
    score = float(one.get("score") or 1)
    for row in np.flatnonzero(enabled[key] | listed).tolist():
        yield int(every[row]), number, values[row], score, bool(listed[row])
