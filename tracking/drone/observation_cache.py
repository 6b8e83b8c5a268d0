"""Observations stored on disk, so that a second run with other settings of the tracker takes seconds.

An entry holds the observations of `CHUNK` frames and a checksum. Its name is a digest of the video, the models and
their settings. It is written to a temporary file that is then renamed. An entry that cannot be read, or whose checksum
is wrong, is computed again with a warning.
"""

from __future__ import annotations

import hashlib
import io
import json
import sys
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.drone.observations import Observation
from tsuiseki.tracking.features.motion.camera_trajectory import CameraStep
from tsuiseki.tracking.output import whole_file
from tsuiseki.tracking.types import Detections

CHUNK = 100
VERSION = 3
MAGIC = b"tsuiseki observations 1\n"


def cached_observations(
    folder: Path,
    key: Mapping[str, Any],
    first: int,
    last: int,
    compute: Callable[[int, int], Iterator[Observation]],
    superset_key: Mapping[str, Any] | None = None,
) -> Iterator[Observation]:
    """The observations of frames ``first`` to ``last``, both included, read from disk where they are stored.

    Args:
        folder: of the entries.
        key: plain values that say what the observations depend on: video, models, settings.
        first: 0-based.
        last: 0-based.
        compute: gives the observations of a range of frames, both ends included; called for missing entries.
        superset_key: key of observations that include all of these; read where these are not stored.

    Raises:
        RequestError: the folder cannot be written to.
    """
    for start in range(first, last + 1, CHUNK):
        stop = min(start + CHUNK - 1, last)
        stretch = {"first": start, "last": stop, "version": VERSION}
        path = folder / f"{digest({**key, **stretch})}.npz"
        found = _read(path, start, stop)
        if found is None and superset_key is not None:
            found = _read(folder / f"{digest({**superset_key, **stretch})}.npz", start, stop)
        if found is None:
            found = list(compute(start, stop))
            _write(path, found)
        yield from found


def digest(key: Mapping[str, Any]) -> str:
    """A name for plain values: the same for the same values, whatever their order."""
    return hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:32]


def file_digest(path: Path) -> str:
    """A digest of what is in a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:32]


def files_key(paths: Iterator[Path] | tuple[Path, ...]) -> str:
    """A digest of files by name, size and time of change: quick, whatever their number."""
    facts = [(path.name, (status := path.stat()).st_size, status.st_mtime_ns) for path in paths]
    return hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:32]


def _write(path: Path, observations: list[Observation]) -> None:
    arrays: dict[str, np.ndarray[Any, Any]] = {
        "frames": np.array([o.frame for o in observations]),
        "counts": np.array([len(o.detections) for o in observations]),
        "boxes": np.concatenate([np.empty((0, 4)), *(o.detections.boxes for o in observations)]),
        "scores": np.concatenate([np.empty(0), *(o.detections.scores for o in observations)]),
        "has_motion": np.array([o.motion is not None for o in observations]),
        "motion": np.array([np.eye(3)[:2] if o.motion is None else o.motion.similarity for o in observations]),
        "deviation": np.array([0.0 if o.motion is None else o.motion.deviation for o in observations]),
    }
    features = [o.detections.features for o in observations]
    if all(part is not None for part in features):
        arrays["features"] = np.concatenate([part for part in features if part is not None])
    actions = [o.actions for o in observations]
    if all(part is not None for part in actions):
        arrays["actions"] = np.concatenate([part for part in actions if part is not None], axis=1)
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **arrays)
    body = content.getvalue()
    with whole_file(path) as file:
        file.write(MAGIC + zlib.crc32(body).to_bytes(4, "big") + body)


def _read(path: Path, first: int, last: int) -> list[Observation] | None:
    """The entry at ``path``; None where there is none, or none that can be trusted."""
    if not path.exists():
        return None
    try:
        content = path.read_bytes()
        head, body = content[: len(MAGIC) + 4], content[len(MAGIC) + 4 :]
        if head != MAGIC + zlib.crc32(body).to_bytes(4, "big"):
            raise ValueError("its checksum is wrong")
        with np.load(io.BytesIO(body), allow_pickle=False) as arrays:
            found = _observations(dict(arrays))
        if [o.frame for o in found] != list(range(first, last + 1)):
            raise ValueError("it holds other frames")
        return found
    except (OSError, ValueError, KeyError, EOFError) as error:
        print(f"tsuiseki: warning: {path} is no usable cache entry ({error}); made anew", file=sys.stderr)
        return None


def _observations(arrays: Mapping[str, np.ndarray[Any, Any]]) -> list[Observation]:
    cuts = np.cumsum(arrays["counts"])[:-1]
    count = len(arrays["frames"])
    boxes, scores = np.split(arrays["boxes"], cuts), np.split(arrays["scores"], cuts)
    features = np.split(arrays["features"], cuts) if "features" in arrays else [None] * count
    actions = np.split(arrays["actions"], cuts, axis=1) if "actions" in arrays else [None] * count
    return [
        Observation(
            int(arrays["frames"][n]),
            Detections(boxes[n], scores[n], features[n]),
            actions[n],
            CameraStep(arrays["motion"][n], float(arrays["deviation"][n])) if arrays["has_motion"][n] else None,
        )
        for n in range(count)
    ]
