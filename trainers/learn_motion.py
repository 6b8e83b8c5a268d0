"""Learning how a body moves from tracks of it, section 4.1 of the goldfish paper (`tsuiseki train motion`).

A track gives increments ``y = (a''_std, b''_std, theta', shape'…)`` (10)-(14), one for each frame from its third on;
their principal components are the proposal (18). The paper learns the *rotated acceleration* (14), yet (16)-(17) add a
*difference of body-fixed velocities*; in a turn the two differ by the turn of the velocity. Both are learnt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import numpy as np

from tsuiseki.tracking.bodies.body import Body, parse_body
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.fields import FrameRate
from tsuiseki.tracking.filters.body_motion import HEADING, conditions, turned
from tsuiseki.tracking.filters.learnt_motion import LearntMotion, PrincipalComponents, write_motion
from tsuiseki.tracking.formats.body_states import read_states
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.output import RUN_FILE
from tsuiseki.tracking.runs.options import OutputFile
from tsuiseki.tracking.types import Columns, FloatArray

# Steps to learn from, at least.
FEWEST_STEPS = 10
# Below this share of the variance of a column, what varies is the rounding of a file and not motion.
SINGULAR = 1e-6
# A column that varies by less than this share of the one that varies most never changes.
STILL = 1e-9
# Weight of a prior that the conditions say nothing, against as many steps.
RIDGE = 1.0


@dataclass(frozen=True)
class MotionSteps(Columns):
    """Increments of tracks, pooled; row ``t`` of each array belongs to the same step.

    Attributes:
        walk: ``(S, D)`` of ``(a', b', theta', shape'…)`` (10)-(12).
        velocity: ``(S, 2)`` body-fixed, the one that (17) adds.
        image: ``(S, D)`` of ``(a'', b'', theta', shape'…)`` (13).
        increments: ``(S, D)`` of what (16) adds.
        printed: ``(S, D)`` of (14).
        changes: ``(S, D)`` of the rates: body-fixed velocity, ``theta'``, ``shape'…``.
        conditions: ``(S, C)`` before the step, see `conditions`.
    """

    walk: FloatArray
    velocity: FloatArray
    image: FloatArray
    increments: FloatArray
    printed: FloatArray
    changes: FloatArray
    conditions: FloatArray


def track_steps(states: FloatArray, circular: Sequence[int]) -> MotionSteps:
    """The steps of one track, Eqs. (10)-(14): ``(T, D)`` states of consecutive frames give ``T - 2``.

    Args:
        states: position, heading, shape.
        circular: columns that are angles; their differences are taken the short way round.
    """
    difference = np.diff(states, axis=0)
    for column in circular:
        difference[:, column] = np.angle(np.exp(1j * difference[:, column]))
    heading = states[1:, HEADING]
    rates = difference.copy()
    rates[:, :2] = turned(difference[:, :2], -heading)
    acceleration = np.diff(difference[:, :2], axis=0)
    angles = difference[1:, HEADING:]
    return MotionSteps(
        walk=difference[1:],
        velocity=rates[1:, :2],
        image=np.concatenate([acceleration, angles], axis=1),
        increments=np.concatenate([np.diff(rates[:, :2], axis=0), angles], axis=1),
        printed=np.concatenate([turned(acceleration, -heading[1:]), angles], axis=1),
        changes=np.diff(rates, axis=0),
        conditions=conditions(states[1:-1], rates[:-1]),
    )


def pooled_steps(tracks: Sequence[FloatArray], circular: Sequence[int]) -> MotionSteps:
    """The steps of all tracks ``(T_i, D)``; those of fewer than three frames hold none.

    Raises:
        RequestError: there are fewer than 10.
    """
    parts = [track_steps(track, circular) for track in tracks if len(track) > 2]
    count = sum(map(len, parts))
    if count < FEWEST_STEPS:
        raise RequestError(
            f"expected at least {FEWEST_STEPS} steps to learn from, got {count}; "
            "a track of T consecutive frames in the status tracking has T - 2"
        )
    return reduce(MotionSteps.and_then, parts)


def learn_motion(
    tracks: Sequence[FloatArray], body: str, columns: Sequence[str], circular: Sequence[int], frame_rate: float
) -> LearntMotion:
    """The motion of a body from tracks ``(T_i, D)`` of consecutive frames.

    Args:
        tracks: states; those of fewer than three frames hold no step.
        body: its name.
        columns: names of the columns.
        circular: columns that are angles.
        frame_rate: frames per second of the tracks.

    Raises:
        RequestError: there are fewer than 10 steps, or a covariance is singular.
    """
    steps = pooled_steps(tracks, circular)
    gain, residual = regression(steps.conditions, steps.changes)
    return LearntMotion(
        body=body,
        columns=tuple(columns),
        frame_rate=frame_rate,
        steps=len(steps),
        walk=principal_components(steps.walk, columns),
        velocity=components_of(steps.velocity),
        image=principal_components(steps.image, columns),
        increments=principal_components(steps.increments, columns),
        printed=principal_components(steps.printed, columns),
        gain=gain,
        residual=components_of(residual),
    )


def principal_components(rows: FloatArray, columns: Sequence[str]) -> PrincipalComponents:
    """Mean and principal components, Eq. (15), of rows ``(S, D)``.

    Raises:
        RequestError: a column never changes, or one follows from the others.
    """
    mean = rows.mean(axis=0)
    deviation = rows.std(axis=0)
    still = np.flatnonzero(~(deviation > STILL * deviation.max()))
    if len(still):
        raise RequestError(f"expected motion in every column, but {columns[still[0]]} never changes")
    # Scaled first: pixels and radians must not decide what is singular.
    if np.linalg.svd((rows - mean) / deviation, compute_uv=False)[-1] ** 2 < SINGULAR * len(rows):
        raise RequestError(
            f"expected increments that vary in all {rows.shape[1]} directions, but one column follows from the others "
            "(singular covariance); learn from more, or more varied, tracks"
        )
    return components_of(rows)


def components_of(rows: FloatArray) -> PrincipalComponents:
    """Mean and principal components of rows ``(S, D)``, some of which may not vary."""
    mean = rows.mean(axis=0)
    _, lengths, vectors = np.linalg.svd(rows - mean, full_matrices=False)
    return PrincipalComponents(mean, vectors.T, lengths**2 / (len(rows) - 1))


def regression(conditions: FloatArray, changes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gain ``(D, C)`` and the rows it leaves ``(S, D)``, which keep the constant part."""
    centre, deviation = conditions.mean(axis=0), conditions.std(axis=0)
    # A condition that never changes says nothing, and must not be divided by zero.
    deviation = np.where(deviation > STILL * deviation.max(), deviation, np.inf)
    scaled = (conditions - centre) / deviation
    target = changes - changes.mean(axis=0)
    gain = np.linalg.solve(scaled.T @ scaled + RIDGE * np.eye(conditions.shape[1]), scaled.T @ target).T / deviation
    return gain, changes - conditions @ gain.T


def read_segments(tracks: Sequence[Path], body: Body) -> list[FloatArray]:
    """``(T, D)`` states of consecutive frames with the status tracking, of all tracks in some files.

    Args:
        tracks: states.csv files, or folders that hold one.
        body: the one that was tracked.

    Raises:
        RequestError: a file is missing or broken, or of another body.
    """
    tracks_read = [track for path in tracks for track in read_states(_states_file(path), body.fields)]
    return [segment for track in tracks_read for segment in track.segments()]


def common_frame_rate(tracks: Sequence[Path], frame_rate: float | None = None) -> float:
    """Frames per second of the tracks in some files: ``frame_rate``, or what lies beside them says.

    Raises:
        RequestError: nothing says it, they differ, or it is no number above 0.
    """
    rates = {frame_rate} if frame_rate is not None else {_frame_rate_beside(_states_file(path)) for path in tracks}
    if len(rates) != 1:
        several = " and ".join(f"{rate:g}" for rate in sorted(rates))
        raise RequestError(f"expected tracks of one frame rate, got {several}; learn from one at a time")
    rate = float(rates.pop())
    if not 0 < rate < float("inf"):
        raise RequestError(f"`frame_rate`: expected a number above 0, got {rate:g}")
    return rate


def _states_file(path: Path) -> Path:
    return path / "states.csv" if path.is_dir() else path


def _frame_rate_beside(path: Path) -> float:
    """What the run or the sequence that a file of states belongs to says of its frame rate."""
    try:
        run = read_json(path.parent / RUN_FILE, "the record of a run")
        return float(run["facts"]["frame_rate"])
    except (ValueError, KeyError, TypeError):
        pass
    if (path.parent / "seqinfo.ini").is_file():
        return read_sequence(path.parent).frame_rate
    raise RequestError(f"{path}: no run.json or seqinfo.ini beside it says the frame rate; give `frame_rate`")


def train_motion(
    tracks: list[Path], *, output: OutputFile, body: str = "goldfish", frame_rate: FrameRate | None = None
) -> None:
    """Learn how a body moves from tracks of it: the principal components of its changes of shape and motion.

    Good tracks come from a slow, wide run (tsuiseki track deformable --deformable.particles 3000) or from labels. Only
    frames with the status tracking count.

    Args:
        tracks: states.csv files, or folders that hold one.
        output.out: file to write, JSON; tsuiseki track deformable --motion takes it.
        body: the one that was tracked: goldfish, ball, or a file of tsuiseki train body.
        frame_rate: frames per second of the tracks; by default what run.json or seqinfo.ini beside them says.
    """
    shape = parse_body(body)
    segments, rate = read_segments(tracks, shape), common_frame_rate(tracks, frame_rate)
    learnt = learn_motion(segments, shape.name, shape.fields, shape.angles, rate)
    output.write(output.out, lambda path: write_motion(path, learnt))
    print(f"learnt from {learnt.steps} steps at {rate:g} frames/s: {output.out}")
