"""Bodies against their exact states: errors of position and heading, how often they are detected, and whose they are.

A body is detected in a frame where an estimate lies within a distance of its position; bodies and estimates are paired
frame by frame so that the sum of distances is least. Estimates that a tracker itself calls searching or lost do not
count.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from tsuiseki.tracking.association.assignment import assign
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.multi import rows_by_frame
from tsuiseki.tracking.formats.body_states import read_fields, read_states
from tsuiseki.tracking.types import Columns, FloatArray, IntArray
from tsuiseki.tracking.types.frame_range import EVERY_FRAME, FrameRange

# Columns of the position, the first pair that a file has; and those of a line through the body, from back to front.
POSITIONS = (("a", "b"), ("x", "y"))
HEADING = "theta"
LINES = (("abdomen", "head"), ("thorax", "head"), ("tail", "head"))


@dataclass(frozen=True)
class Poses(Columns):
    """Where bodies are and where they head, a row for each in each frame, ordered by frame.

    Attributes:
        frames: ``(N,)`` 0-based.
        ids: ``(N,)``.
        points: ``(N, 2)`` pixels.
        headings: ``(N,)`` radians; NaN where nothing tells.
    """

    frames: IntArray
    ids: IntArray
    points: FloatArray
    headings: FloatArray

    def within(self, frames: FrameRange) -> Poses:
        """The rows of some frames."""
        return self.select(frames.mask(self.frames))


@dataclass(frozen=True)
class StateScores:
    """How well bodies are followed.

    Attributes:
        success: share of bodies in frames that are detected, in [0, 1].
        followed: how many bodies one and the same track finds in all their frames.
        bodies: how many there are.
        position_mean, position_median, position_95: distance of those that are detected, pixels; NaN without any.
        angle_mean, angle_median: difference of their headings without sign, degrees; NaN where nothing tells.
        reversed: share of them that head the other way, by more than 90 degrees.
        switches: how often a body is followed by another track than before.
        idf1: identity F1, as for people but with the distance.
        false: estimates on no body.
        frames: that were scored.
    """

    success: float
    followed: int
    bodies: int
    position_mean: float
    position_median: float
    position_95: float
    angle_mean: float
    angle_median: float
    reversed: float
    switches: int
    idf1: float
    false: int
    frames: int

    @property
    def followed_of(self) -> str:
        """`followed` and `bodies`, for a table."""
        return f"{self.followed} of {self.bodies}"

    def values(self) -> dict[str, Any]:
        """For JSON, null where there is no number."""
        return {
            name: None if isinstance(value, float) and np.isnan(value) else value
            for name, value in asdict(self).items()
        }


def read_poses(path: Path) -> Poses:
    """The poses in a ``states.csv``: its columns a,b or x,y, and theta or the points at both ends of the body.

    Raises:
        RequestError: see `read_states`, or the file has no position.
    """
    fields = read_fields(path)
    position = next((pair for pair in POSITIONS if set(pair) <= set(fields)), None)
    if position is None:
        raise RequestError(f"{path}: expected the columns a,b or x,y of a position, got {','.join(fields)}")
    ends = [tuple(f"{part}_{axis}" for part in line for axis in "xy") for line in LINES]
    line = next((names for names in ends if set(names) <= set(fields)), ())
    heading = (HEADING,) if HEADING in fields else line
    tracks = read_states(path, (*position, *heading))
    counted = [track.tracking for track in tracks]
    states = np.concatenate([track.states[rows] for track, rows in zip(tracks, counted, strict=True)])
    frames = np.concatenate([track.frames[rows] for track, rows in zip(tracks, counted, strict=True)])
    ids = np.repeat([track.id for track in tracks], [int(rows.sum()) for rows in counted])
    order = np.lexsort([ids, frames])
    return Poses(frames[order], ids[order], states[order, :2], _headings(states[order, 2:]))


def _headings(columns: FloatArray) -> FloatArray:
    """From one column of angles, four of the points at the back and the front, or none."""
    if columns.shape[1] == 0:
        return np.full(len(columns), np.nan)
    if columns.shape[1] == 1:
        return columns[:, 0]
    return np.asarray(np.arctan2(columns[:, 3] - columns[:, 1], columns[:, 2] - columns[:, 0]))


def evaluate_states(
    truth: Poses, reported: Poses, distance: float = 20.0, frames: FrameRange = EVERY_FRAME
) -> StateScores:
    """Scores of ``reported`` against the exact ``truth``; within a ``distance``, pixels, a body is detected.

    Raises:
        RequestError: there is no body in those frames.
    """
    truth, reported = truth.within(frames), reported.within(frames)
    if not len(truth.frames):
        raise RequestError(f"expected bodies in frames {frames}, got none")
    rows, columns = _pairs(truth, reported, distance)
    away = np.linalg.norm(truth.points[rows] - reported.points[columns], axis=1)
    turns = truth.headings[rows] - reported.headings[columns]
    turned = np.degrees(np.abs((turns + np.pi) % (2 * np.pi) - np.pi))
    turned = turned[np.isfinite(turned)]
    followers = np.zeros(len(truth.frames), dtype=np.int64)  # the track on each body in each frame, 0 where none is
    followers[rows] = reported.ids[columns]
    by_body = [followers[truth.ids == body] for body in np.unique(truth.ids)]
    return StateScores(
        success=len(rows) / len(truth.frames),
        followed=sum(bool((tracks == tracks[0]).all() and tracks[0] > 0) for tracks in by_body),
        bodies=len(by_body),
        position_mean=float(away.mean()) if len(away) else np.nan,
        position_median=float(np.median(away)) if len(away) else np.nan,
        position_95=float(np.percentile(away, 95)) if len(away) else np.nan,
        angle_mean=float(turned.mean()) if len(turned) else np.nan,
        angle_median=float(np.median(turned)) if len(turned) else np.nan,
        reversed=float((turned > 90).mean()) if len(turned) else np.nan,
        switches=sum(int((np.diff(tracks[tracks > 0]) != 0).sum()) for tracks in by_body),
        idf1=_identity_f1(truth, reported, distance),
        false=len(reported.frames) - len(rows),
        frames=len(np.unique(truth.frames)),
    )


def _in_frames(truth: Poses, reported: Poses) -> list[tuple[slice, slice]]:
    """Rows of the truth and of what was reported in every frame that has some of the truth."""
    numbers = np.unique(truth.frames)
    return list(zip(rows_by_frame(truth.frames, numbers), rows_by_frame(reported.frames, numbers), strict=True))


def _distances(truth: Poses, reported: Poses, a: slice, b: slice) -> FloatArray:
    return np.asarray(np.linalg.norm(truth.points[a][:, None] - reported.points[b][None], axis=2))


def _pairs(truth: Poses, reported: Poses, distance: float) -> tuple[IntArray, IntArray]:
    """Rows of bodies that are detected, and of the estimates that find them."""
    rows, columns = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for a, b in _in_frames(truth, reported):
        i, j = assign(_distances(truth, reported, a, b), distance)
        rows.append(i + a.start)
        columns.append(j + b.start)
    return np.concatenate(rows), np.concatenate(columns)


def _identity_f1(truth: Poses, reported: Poses, distance: float) -> float:
    bodies, tracks = np.unique(truth.ids), np.unique(reported.ids)
    common = np.zeros((len(bodies), len(tracks)))
    for a, b in _in_frames(truth, reported):
        i, j = np.nonzero(_distances(truth, reported, a, b) <= distance)
        np.add.at(common, (np.searchsorted(bodies, truth.ids[a][i]), np.searchsorted(tracks, reported.ids[b][j])), 1)
    rows, columns = linear_sum_assignment(common, maximize=True)
    return float(2 * common[rows, columns].sum() / (len(truth.frames) + len(reported.frames)))
