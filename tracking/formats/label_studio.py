"""Tracks in Label Studio's JSON of video: a list of tasks, with a ``videorectangle`` for each track.

Frames count from 1; x, y, width and height are percent of the picture, and ``rotation`` turns a box about its upper
left corner, in degrees clockwise. A key frame that is ``enabled`` holds on a straight line to the next one, or to the
end; one that is not is the last before a gap. A track has one score. The size of the picture, which other files do not
say, stands in ``data`` under ``size``.

What several people labelled differs, so one of them has to be chosen: the one that is marked as ``ground_truth``, or
the only one that was not cancelled.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.label_checks import Sieve, UnusableError
from tsuiseki.tracking.formats.labelled_boxes import (
    TURNED,
    LabelledBox,
    about_turned,
    finite,
    labelled_video,
    with_area,
)
from tsuiseki.tracking.formats.rows import whole
from tsuiseki.tracking.formats.tracked_video import Size, TrackedVideo, between_keys, runs_of
from tsuiseki.tracking.geometry import xywh_from_corners
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.openers.text import refusing
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.frame_range import LAST_FRAME

LABEL_STUDIO = "Label Studio's JSON of video"
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
    """The tracks of the only task in a file: those that somebody made, or else predictions.

    Names of tracks are numbers, or they are numbered from 1.

    Raises:
        RequestError: it is something else or broken, has several tasks or annotators, or most cannot be used.
    """
    content = read_json(path, LABEL_STUDIO)
    if not isinstance(content, list) or len(content) != 1:
        count = len(content) if isinstance(content, list) else 0
        raise RequestError(f"{path}: expected one task of {LABEL_STUDIO}, got {count}; export one at a time")
    with refusing(f"{path}: expected {LABEL_STUDIO}, got something else"):
        task = content[0]
        annotation = _annotation(path, task)
        results = (annotation or {}).get("result", [])
        regions = [region for region in results if region.get("type") == "videorectangle"]
        if annotation is None or (results and not regions):
            raise RequestError(f"{path}: expected `videorectangle` in {LABEL_STUDIO}, found none")
        _tell_of_others(path, results)
        names = [str(region["id"]) for region in regions]
        numbered = all(name.isdecimal() and len(name) < 19 for name in names) and len({*names}) == len(names)
        ids = [int(name) if numbered else k + 1 for k, name in enumerate(names)]
        data = task["data"]
        size = (int(data["size"][0]), int(data["size"][1])) if "size" in data else None
        length = max((int(region["value"].get("framesCount") or 0) for region in regions), default=0)
        sieve = Sieve(path, "key frames")
        numbered_regions = zip(ids, regions, strict=True)
        boxes = [box for number, region in numbered_regions for box in _boxes(path, sieve, number, region, size)]
        name = PurePosixPath(str(data.get("video") or path.stem).split("?")[0]).name
        value = regions[0]["value"] if regions else {}
        measured = float(value["framesCount"]) / float(value["duration"]) if value.get("duration") else 0.0
        rate = float(data.get("frame_rate") or 0) or measured
    tracks = labelled_video(path, boxes, sieve).tracks
    return TrackedVideo(tracks, name, rate, size, length, shares=size is None)


def _annotation(path: Path, task: Mapping[str, Any]) -> Any:
    """What is read of a task: the annotation, or else the prediction; None where there is neither.

    Raises:
        RequestError: there are several to choose from.
    """
    listed = task.get("annotations") or []
    annotations = [entry for entry in listed if not entry.get("was_cancelled")]
    if len(annotations) < len(listed):
        cancelled = f"{len(listed) - len(annotations)} of {len(listed)} annotations were cancelled and are left out"
        warnings.warn(f"{path}: {cancelled}", InputWarning, stacklevel=4)
    marked = [entry for entry in annotations if entry.get("ground_truth")]
    if len(marked) == 1 < len(annotations):
        line = f"of {len(annotations)} annotations the one that is marked as ground truth is read"
        warnings.warn(f"{path}: {line}", InputWarning, stacklevel=4)
        return marked[0]
    entries, what = (annotations, "annotation") if annotations else (task.get("predictions") or [], "prediction")
    if len(entries) > 1:
        makers = ", ".join(_maker(entry) for entry in entries[:4])
        raise RequestError(
            f"{path}: expected one {what} of the task, got {len(entries)} (by {makers}), which may differ; mark one as "
            "ground truth, or export one"
        )
    return entries[0] if entries else None


def _maker(entry: Mapping[str, Any]) -> str:
    """Who or what made an annotation or a prediction, as far as it says."""
    maker = entry.get("completed_by") or entry.get("model_version") or f"number {entry.get('id')}"
    return str(maker.get("email") or maker.get("id") if isinstance(maker, dict) else maker)


def _tell_of_others(path: Path, results: list[Mapping[str, Any]]) -> None:
    """Warn of results that are no tracks of boxes."""
    others = [str(result.get("type")) for result in results if result.get("type") != "videorectangle"]
    if others:
        kinds = ", ".join(sorted({*others}))
        line = f"{len(others)} of {len(results)} results are no videorectangle ({kinds}) and are left out"
        warnings.warn(f"{path}: {line}", InputWarning, stacklevel=4)


def _key(sieve: Sieve, name: str, key: Mapping[str, Any], size: Size) -> tuple[int, bool, list[float]]:
    """Frame, whether it goes on, and the corners of a key frame; raises UnusableError, see `Sieve`."""
    frame = whole(str(key.get("frame")))
    if frame is None or not 1 <= frame <= LAST_FRAME:
        raise UnusableError(f"without a frame from 1 to {LAST_FRAME}")
    x, y, width, height = (finite(key.get(side), side) for side in SIDES)
    scale = np.tile(size or (1, 1), 2)
    corners = np.array(with_area((x, y, x + width, y + height))) * scale / 100
    degrees = finite(key.get("rotation"), "rotation", 0.0) % 360
    if degrees:
        if size is None:
            raise UnusableError("turned, in a picture whose size is not known")
        sieve.mend(name, TURNED)
        # About the upper left corner, which moves the middle.
        half, angle = (corners[2:] - corners[:2]) / 2, np.radians(degrees)
        turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ half
        corners = about_turned((corners + np.tile(turned - half, 2))[None], np.array([degrees]))[0]
    return frame - 1, bool(key.get("enabled", True)), corners.tolist()


def _boxes(path: Path, sieve: Sieve, number: int, region: Mapping[str, Any], size: Size) -> Iterator[LabelledBox]:
    """The boxes of a track in all its frames."""
    sequence = region["value"].get("sequence") or [{}]
    named = ((f"frame {key.get('frame')} of track {region['id']}", key) for key in sequence)
    keys = sorted(sieve.read(named, lambda name, key: _key(sieve, name, key, size)), key=lambda key: key[0])
    if not keys:
        return
    frames = np.array([frame for frame, _, _ in keys], dtype=np.int64)
    last = int(region["value"].get("framesCount") or 0) - 1
    if last >= LAST_FRAME or (np.diff(frames) == 0).any():
        raise RequestError(f"{path}: expected each frame from 1 to {LAST_FRAME} once in track {region['id']}")
    enabled = np.array([goes_on for _, goes_on, _ in keys])
    boxes = np.array([corners for _, _, corners in keys])
    track_frames, values, key = between_keys(path, frames, boxes, last if enabled[-1] else 0)
    listed = frames[key] == track_frames
    kind = -1, str((region["value"].get("labels") or [""])[0])
    score = float(region.get("score") or 1)
    for row in np.flatnonzero(enabled[key] | listed).tolist():
        yield LabelledBox(
            int(track_frames[row]), number, kind, values[row].tolist(), score=score, observed=bool(listed[row])
        )
