"""What a run of `tsuiseki adapt` was given, by its contents: a file of the same name may have been written anew."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.drone.observation_cache import file_digest


def digest_of(model: Path) -> str:
    """Of the contents of a model's file; empty where there is none."""
    return file_digest(model) if model.is_file() else ""


def state_of(source: str) -> list[int]:
    """Files, bytes and time of the last change (ns) of a video or folder; of a source elsewhere nothing is known.

    Videos are too large to be read for this.
    """
    path = Path(source)
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    found = [file.stat() for file in files if file.is_file()]
    return [len(found), sum(x.st_size for x in found), max((x.st_mtime_ns for x in found), default=0)]
