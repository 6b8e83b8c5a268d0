"""The result that a command left in a folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.output import RUN_FILE
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.video.source import open_source


def read_result(path: Path) -> Result[Track]:
    """The tracks in a folder or file, with what ``run.json`` and the video say of them.

    Raises:
        RequestError: there are no tracks.
    """
    folder = path if path.is_dir() else path.parent
    if path.is_dir() and not (path / "tracks.txt").is_file():
        raise RequestError(f"{path}: expected the folder of a result with tracks.txt, found none; run tsuiseki track")
    tracks = read_tracks(path / "tracks.txt" if path.is_dir() else path)
    try:
        record: dict[str, Any] = json.loads((folder / RUN_FILE).read_text(encoding="utf-8"))
        source = str(record["settings"]["source"])
        frames = [number - 1 for number in record["frames"]["frame"]]
    except (OSError, ValueError, KeyError, TypeError):
        return Result(tracks)
    try:
        video = open_source(source, frame_rate=record["settings"].get("fps"))
    except (RequestError, RunError):  # the video has moved
        return Result(tracks, source, frames={"frame": frames})
    return Result.of(video, tracks, frames={"frame": frames})
