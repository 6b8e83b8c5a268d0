"""Distances between sets of points, and between sets of tracks of points.

Points are ``(N, 2)`` or ``(N, D)`` positions in the unit of the cut-off ``c``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.label_checks import identified
from tsuiseki.tracking.formats.measurement_tables import is_point_file, read_point_tracks
from tsuiseki.tracking.formats.mot import read_ground_truth, read_tracks
from tsuiseki.tracking.formats.tracked_video import boxes_of_tracks
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.types import Columns, FloatArray, IntArray, Track
from tsuiseki.tracking.types.frame_range import FrameRange


@dataclass(frozen=True)
class Ospa:
    """OSPA distance and its two parts, ``distance**p == localisation**p + cardinality**p``; each in [0, c]."""

    distance: float
    localisation: float
    cardinality: float


@dataclass(frozen=True)
class Gospa:
    """GOSPA distance with alpha = 2, and its parts: ``distance**p`` is their sum.

    Attributes:
        distance: the metric.
        localisation: sum of ``d**p`` over the assigned pairs.
        missed: ``c**p / 2`` for each true point without an estimate.
        false: ``c**p / 2`` for each estimate without a true point.
        assigned: number of assigned pairs.
    """

    distance: float
    localisation: float
    missed: float
    false: float
    assigned: int


def ospa(truth: FloatArray, reported: FloatArray, c: float, p: float) -> Ospa:
    """Optimal sub-pattern assignment distance of two sets of points (Schuhmacher, Vo and Vo, 2008).

    Args:
        truth: ``(N, D)`` points.
        reported: ``(M, D)`` points.
        c: cut-off, > 0.
        p: order, >= 1.

    Raises:
        ValueError: a point is not finite, or ``c`` or ``p`` is out of range.
    """
    _check(truth, reported, c, p)
    return ospa_of_distances(_distances(truth, reported), c, p)


def ospa_of_distances(distances: FloatArray, c: float, p: float) -> Ospa:
    """:func:`ospa` of two sets whose distances ``(N, M)`` are given."""
    smaller, larger = sorted(distances.shape)
    if larger == 0:
        return Ospa(0.0, 0.0, 0.0)
    cost = np.minimum(distances, c) ** p
    rows, columns = linear_sum_assignment(cost)
    near, missing = cost[rows, columns].sum() / larger, c**p * (larger - smaller) / larger
    return Ospa((near + missing) ** (1 / p), near ** (1 / p), missing ** (1 / p))


def gospa(truth: FloatArray, reported: FloatArray, c: float, p: float) -> Gospa:
    """Generalised OSPA, alpha = 2 (Rahmathullah, Garcia-Fernandez and Svensson, 2017); arguments as :func:`ospa`."""
    _check(truth, reported, c, p)
    cost = np.minimum(_distances(truth, reported), c) ** p
    rows, columns = linear_sum_assignment(cost)
    # A pair at the cut-off costs what a missed and a false point cost together, and is counted as those.
    near = cost[rows, columns] < c**p
    localisation, assigned = float(cost[rows, columns][near].sum()), int(near.sum())
    missed, false = c**p / 2 * (len(truth) - assigned), c**p / 2 * (len(reported) - assigned)
    return Gospa((localisation + missed + false) ** (1 / p), localisation, missed, false, assigned)


@dataclass(frozen=True)
class PointTracks(Columns):
    """Points through time, one row each.

    Attributes:
        frames: ``(N,)`` 0-based.
        ids: ``(N,)``; at most one row of each id in a frame.
        positions: ``(N, D)``.
    """

    frames: IntArray
    ids: IntArray
    positions: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "frames", np.asarray(self.frames, dtype=np.int64))
        object.__setattr__(self, "ids", np.asarray(self.ids, dtype=np.int64))
        object.__setattr__(self, "positions", np.asarray(self.positions, dtype=np.float64))
        if not len(self.frames) == len(self.ids) == len(self.positions) or self.positions.ndim != 2:
            raise ValueError("expected as many frames and ids as positions (N, D)")
        if not np.isfinite(self.positions).all():
            raise ValueError("expected finite positions")
        if len(np.unique(np.stack([self.frames, self.ids], axis=1), axis=0)) != len(self.frames):
            raise ValueError("expected each id at most once in a frame")

    @classmethod
    def of(cls, tracks: Sequence[Track]) -> PointTracks:
        """The centres of the boxes of tracks."""
        rows = boxes_of_tracks(tracks)
        return cls(rows.frames, rows.ids, centres(rows.boxes))

    def at(self, frame: int) -> FloatArray:
        """Positions ``(n, D)`` in one frame."""
        return np.asarray(self.positions[self.frames == frame])

    def between(self, first: int, last: int) -> PointTracks:
        """The rows of frames ``first`` to ``last``, both included."""
        return self.select((self.frames >= first) & (self.frames <= last))


def track_distances(truth: PointTracks, reported: PointTracks, c: float) -> FloatArray:
    """Mean distance ``(N, M)`` of each true and each reported track over the frames where either is, cut off at ``c``.

    Where only one of the two is there, the distance is ``c``. Rows and columns are in the order of the ids.
    """
    frames = np.unique(np.concatenate([truth.frames, reported.frames]))
    a, b = _on_grid(truth, frames), _on_grid(reported, frames)
    apart = np.linalg.norm(a[:, None] - b[None], axis=-1)
    there_a, there_b = ~np.isnan(a[..., 0]), ~np.isnan(b[..., 0])
    both, either = there_a[:, None] & there_b[None], there_a[:, None] | there_b[None]
    cut = np.where(both, np.minimum(np.nan_to_num(apart, nan=c), c), np.where(either, c, 0.0))
    return np.asarray(cut.sum(axis=-1) / np.maximum(either.sum(axis=-1), 1))


def ospa2(truth: PointTracks, reported: PointTracks, last: int, window: int, c: float, p: float) -> Ospa:
    """OSPA distance of two sets of tracks over the ``window`` frames up to ``last`` (Beard, Vo and Vo, 2017).

    It punishes changed identities and broken tracks, which the distance of one frame cannot see.
    """
    first = last - window + 1
    return ospa_of_distances(track_distances(truth.between(first, last), reported.between(first, last), c), c, p)


def identity_switches(truth: PointTracks, reported: PointTracks, c: float) -> int:
    """How often the id assigned to a true track changes; pairs are assigned frame by frame, nearer than ``c``."""
    held: dict[int, int] = {}
    switches = 0
    for frame in np.unique(truth.frames):
        rows, columns = np.flatnonzero(truth.frames == frame), np.flatnonzero(reported.frames == frame)
        distances = _distances(truth.positions[rows], reported.positions[columns])
        for i, j in zip(*linear_sum_assignment(np.minimum(distances, c)), strict=True):
            if distances[i, j] >= c:
                continue
            true_id, reported_id = int(truth.ids[rows[i]]), int(reported.ids[columns[j]])
            switches += held.get(true_id, reported_id) != reported_id
            held[true_id] = reported_id
    return switches


@dataclass(frozen=True)
class PointScores:
    """Means over the frames of one sequence.

    Attributes:
        ospa1: OSPA of order 1.
        ospa2: OSPA of order 2.
        ospa_tracks: OSPA(2), of order 1, over a sliding window.
        gospa: GOSPA of order 2.
        missed: true points without an estimate, a frame.
        false: estimates without a true point, a frame.
        cardinality_error: mean of |reported - true| points.
        switches: changes of identity in the whole sequence.
        frames: how many were scored.
    """

    ospa1: float
    ospa2: float
    ospa_tracks: float
    gospa: float
    missed: float
    false: float
    cardinality_error: float
    switches: int
    frames: int


def evaluate_points(truth: PointTracks, reported: PointTracks, frames: int, c: float, window: int = 10) -> PointScores:
    """Scores over frames 0 to ``frames - 1``.

    Raises:
        ValueError: there is no true point, or no frame.
    """
    if frames < 1 or len(truth.frames) == 0:
        raise ValueError("expected at least one frame and one true point, got none")
    # Where there is nothing, every distance is zero: a gap of a billion frames costs no time.
    filled = np.unique(np.concatenate([truth.frames, reported.frames]))
    filled = filled[(filled >= 0) & (filled < frames)]
    sets = [(truth.at(k), reported.at(k)) for k in filled]
    parts = [gospa(a, b, c, 2.0) for a, b in sets]
    # The last frames of all windows in which there is something.
    ends = sorted({k for frame in filled.tolist() for k in range(frame, min(frame + window, frames))})

    def mean(values: list[float]) -> float:
        return float(np.sum(values) / frames)

    return PointScores(
        mean([ospa(a, b, c, 1.0).distance for a, b in sets]),
        mean([ospa(a, b, c, 2.0).distance for a, b in sets]),
        mean([ospa2(truth, reported, k, window, c, 1.0).distance for k in ends]),
        mean([g.distance for g in parts]),
        mean([len(a) - g.assigned for (a, _), g in zip(sets, parts, strict=True)]),
        mean([len(b) - g.assigned for (_, b), g in zip(sets, parts, strict=True)]),
        mean([abs(len(b) - len(a)) for a, b in sets]),
        identity_switches(truth, reported, c),
        frames,
    )


def _distances(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(cdist(a, b)) if len(a) and len(b) else np.zeros((len(a), len(b)))


def _on_grid(tracks: PointTracks, frames: IntArray) -> FloatArray:
    """Positions ``(ids, frames, D)``, NaN where a track is absent."""
    ids, row = np.unique(tracks.ids, return_inverse=True)
    grid = np.full((len(ids), len(frames), tracks.positions.shape[1]), np.nan)
    grid[row, np.searchsorted(frames, tracks.frames)] = tracks.positions
    return grid


def _check(truth: FloatArray, reported: FloatArray, c: float, p: float) -> None:
    if not (np.isfinite(c) and c > 0 and np.isfinite(p) and p >= 1):
        raise RequestError(f"expected a cut-off above 0 and an order of at least 1, got c={c}, p={p}")
    if not (np.isfinite(truth).all() and np.isfinite(reported).all()):
        raise ValueError("expected finite points, got NaN or infinity")


def evaluate_between(
    truth: PointTracks, reported: PointTracks, frames: FrameRange, c: float, window: int = 10
) -> PointScores:
    """As `evaluate_points`, in ``frames``, by default up to the last that has a point."""
    end = int(max(truth.frames.max(), reported.frames.max(initial=0)))
    first, last = frames.first, end if frames.last is None else frames.last
    inside = [points.between(first, last) for points in (truth, reported)]
    true, reported = (replace(points, frames=points.frames - first) for points in inside)
    return evaluate_points(true, reported, last - first + 1, c, window)


def read_points(path: Path, labelled: bool = False) -> PointTracks:
    """The points of a CSV file, or the centres of the boxes in MOTChallenge text; where ``labelled`` those that count.

    Raises:
        RequestError: the file is missing or broken.
    """
    if is_point_file(path):
        return PointTracks(*read_point_tracks(path))
    if not labelled:
        return PointTracks.of(read_tracks(path))
    truth = read_ground_truth(path)
    truth = identified(path, truth.select(truth.evaluated))
    return PointTracks(truth.frames, truth.ids, centres(truth.boxes))
