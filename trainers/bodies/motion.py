"""Learning how a body moves from tracks of it, section 4.1 of the goldfish paper (`tsuiseki train motion`).

A track gives increments ``y = (a''_std, b''_std, theta', shape'…)`` (10)-(14), one for each frame from its third on;
their principal components are the proposal (18). The paper learns the *rotated acceleration* (14), yet (16)-(17) add a
*difference of body-fixed velocities*; in a turn the two differ by the turn of the velocity. Both are learnt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.motion.bodies import HEADING, conditions, turned
from tsuiseki.tracking.filters.motion.learnt import LearntMotion, PrincipalComponents
from tsuiseki.tracking.types import FloatArray

FEWEST_STEPS = 10
# Below this share of the variance of a column, what varies is the rounding of a file and not motion.
SINGULAR = 1e-6
STILL = 1e-9
# Weight of a prior that the conditions say nothing, against as many steps.
RIDGE = 1.0


@dataclass(frozen=True)
class Steps:
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

    def __len__(self) -> int:
        return len(self.walk)


def track_steps(states: FloatArray, circular: Sequence[int]) -> Steps:
    """The steps of one track: ``(T, D)`` states of consecutive frames give ``T - 2``.

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
    return Steps(
        walk=difference[1:],
        velocity=rates[1:, :2],
        image=np.concatenate([acceleration, angles], axis=1),
        increments=np.concatenate([np.diff(rates[:, :2], axis=0), angles], axis=1),
        printed=np.concatenate([turned(acceleration, -heading[1:]), angles], axis=1),
        changes=np.diff(rates, axis=0),
        conditions=conditions(states[1:-1], rates[:-1]),
    )


def pooled_steps(tracks: Sequence[FloatArray], circular: Sequence[int]) -> Steps:
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
    return Steps(*(np.concatenate([getattr(part, name) for part in parts]) for name in Steps.__dataclass_fields__))


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
    gain, rest = regression(steps.conditions, steps.changes)
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
        residual=components_of(rest),
    )


def principal_components(rows: FloatArray, columns: Sequence[str]) -> PrincipalComponents:
    """Mean and principal components (15) of rows ``(S, D)``.

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


def regression(given: FloatArray, changes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gain ``(D, C)`` and the rows it leaves ``(S, D)``, which keep the constant part."""
    centre, deviation = given.mean(axis=0), given.std(axis=0)
    # A condition that never changes says nothing, and must not be divided by zero.
    deviation = np.where(deviation > STILL * deviation.max(), deviation, np.inf)
    scaled = (given - centre) / deviation
    target = changes - changes.mean(axis=0)
    gain = np.linalg.solve(scaled.T @ scaled + RIDGE * np.eye(given.shape[1]), scaled.T @ target).T / deviation
    return gain, changes - given @ gain.T
