"""How the people of a result look: a few pictures of each track, described by a network."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.features.exported import Describe
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import FloatArray, Track

# Pictures of a track that are described.
PICTURES = 6


def described_tracks(result: Result[Track], tracks: Sequence[Track], describer: Describe) -> list[FloatArray] | None:
    """``(P, D)`` rows of each track, of up to `PICTURES` of its pictures; None where the video is not there.

    Args:
        result: where the video is from.
        tracks: of the result.
        describer: gives a row a picture.
    """
    source = result.opened_source()
    if source is None or not source.has_images:
        return None
    crops: dict[int, list[tuple[int, FloatArray]]] = {}
    for number, track in enumerate(tracks):
        rows = np.flatnonzero(track.observed)
        for row in rows[np.unique(np.linspace(0, len(rows) - 1, PICTURES + 2).round().astype(int)[1:-1])]:
            crops.setdefault(int(track.frames[row]), []).append((number, track.boxes[row]))
    pictures: list[list[FloatArray]] = [[] for _ in tracks]
    length = 1
    for frame in source.frames():
        boxes = crops.pop(frame.index, None)
        if boxes:
            rows = np.nan_to_num(describer.describe(frame.image, np.array([box for _, box in boxes])))
            length = rows.shape[1]
            for (number, _), row in zip(boxes, rows, strict=True):
                pictures[number].append(row)
        if not crops:
            break
    return [np.array(rows).reshape(-1, length) for rows in pictures]


def mean_looks(pictures: Sequence[FloatArray]) -> FloatArray:
    """``(N, D)`` mean row of each track, zeros where it has no picture; not of unit length."""
    width = max((rows.shape[1] for rows in pictures), default=1)
    return np.array([rows.sum(axis=0) if len(rows) else np.zeros(width) for rows in pictures]).reshape(-1, width)
