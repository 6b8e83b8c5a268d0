"""How far positions in space lie from the truth."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.tracks import Path3D


def distance_to_position(track: Path3D, truth: Path3D) -> FloatArray:
    """``(T,)`` distances to the true position at the same time, interpolated; NaN outside the truth's times."""
    expected = np.stack([np.interp(track.times, truth.times, axis) for axis in truth.points.T], axis=1)
    slack = 1e-6
    inside = (track.times >= truth.times[0] - slack) & (track.times <= truth.times[-1] + slack)
    distances = np.sqrt(np.square(track.points - expected).sum(axis=1))
    return np.where(inside, distances, np.nan)


def distance_to_path(points: FloatArray, path: FloatArray) -> FloatArray:
    """``(T,)`` least distances of ``points`` ``(T, 3)`` to the line through ``path`` ``(K, 3)``.

    The error of section 3 of the sphere paper: it forgives being early or late along the path.
    """
    if len(path) == 1:
        return np.asarray(np.sqrt(np.square(points - path[0]).sum(axis=1)))
    start, along = path[:-1], np.diff(path, axis=0)
    length = np.maximum(np.einsum("kj,kj->k", along, along), 1e-18)
    away = points[:, None] - start
    share = np.clip(np.einsum("tkj,kj->tk", away, along) / length, 0.0, 1.0)
    gap = away - share[:, :, None] * along
    return np.asarray(np.sqrt(np.einsum("tkj,tkj->tk", gap, gap).min(axis=1)))
