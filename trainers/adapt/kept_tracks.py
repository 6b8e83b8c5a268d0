"""The tracks of a round on disk, with what of them was filled in."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tsuiseki.tracking.types import Track

_COLUMNS = ("frames", "boxes", "scores", "observed")


def write_everyone(path: Path, tracks: Sequence[Track]) -> None:
    """Keep ``tracks`` with what of them was filled in."""
    np.savez(
        path,
        ids=np.array([t.id for t in tracks], dtype=np.int64),
        lengths=np.array([len(t) for t in tracks], dtype=np.int64),
        frames=np.concatenate([np.empty(0, np.int64), *(t.frames for t in tracks)]),
        boxes=np.concatenate([np.empty((0, 4)), *(t.boxes for t in tracks)]),
        scores=np.concatenate([np.empty(0), *(t.scores for t in tracks)]),
        observed=np.concatenate([np.empty(0, np.bool_), *(t.observed for t in tracks)]),
    )


def read_everyone(path: Path) -> list[Track]:
    """What `write_everyone` wrote."""
    with np.load(path, allow_pickle=False) as file:
        ends = np.cumsum(file["lengths"])
        columns = [np.split(file[name], ends[:-1]) for name in _COLUMNS]
        ids = file["ids"].tolist()
    return [Track(int(i), *parts) for i, *parts in zip(ids, *columns, strict=True)] if ids else []
