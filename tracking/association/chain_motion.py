"""Place and motion along chains of detections: a Kalman filter from either side, over all chains at once.

The state of a chain is (x, y, log width, log height) and its velocity; each coordinate moves by itself with a velocity
that changes at random (white acceleration). With r the deviation of a measurement, v that of the velocity at the start
and q the strength of the acceleration, a step of τ seconds is

    P ← F P Fᵀ + q² [[τ³/3, τ²/2], [τ²/2, τ]],    F = [[1, τ], [0, 1]],

and a chain begins with P = diag(r², v²). Places are in heights of the box: a gain depends on ratios of variances only,
so the means stay in pixels. x and y have the same noise, so three covariances stand for the four coordinates.

Long chains are cut into blocks that are filtered side by side. Each block starts a little earlier than it counts, by
when the filter has forgotten how it started.

`TrackMotion` holds the estimates along the tracks of a solution, from the past and from the future of each detection.
From one solution to the next most tracks stay as they are. So filters run again only near the changes, and only links
with an end there need another cost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import PositiveFloat
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.association.detection_tables import DetectionTable, Measurements
from tsuiseki.tracking.association.network_flow import predecessors
from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.types import BoolArray, Columns, FloatArray, IntArray

# Which covariance belongs to x, y, log width and log height.
GROUPS = np.array([0, 0, 1, 2])
# Detections of a block, filtered side by side with others.
BLOCK = 64
# Detections that are filtered before a block; after so many the start of the filter no longer changes a cost.
RUN_UP = 48


@pydantic_dataclass(frozen=True, config=SETTINGS)
class MotionNoise:
    """Noise of the filter, for places, log widths and log heights.

    Attributes:
        measurement: r, deviation of a box of high score that nothing hides, heights of the box and logarithms.
        acceleration: q, strength of the acceleration, heights and logarithms a second and the root of a second.
        velocity: v, deviation of the velocity at the start, heights and logarithms a second.
    """

    measurement: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = (0.03, 0.14, 0.05)
    acceleration: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = (0.246, 0.49, 0.099)
    velocity: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = (0.75, 0.15, 0.11)


@dataclass(frozen=True)
class Beliefs(Columns):
    """Estimates of place and velocity at N detections.

    Attributes:
        place: ``(N, 4)`` x, y in pixels, log width, log height.
        velocity: ``(N, 4)`` velocity of the four, pixels and logarithms a second, as time runs.
        covariance: ``(N, 3, 3)``: for places, log widths and log heights the variance of the place, the covariance of
            place and velocity, and the variance of the velocity.
    """

    place: FloatArray
    velocity: FloatArray
    covariance: FloatArray

    def replaced(self, which: IntArray, new: Beliefs) -> Beliefs:
        """These, with others at ``(K,)`` indices."""
        both = Beliefs(self.place.copy(), self.velocity.copy(), self.covariance.copy())
        both.place[which], both.velocity[which], both.covariance[which] = new.place, new.velocity, new.covariance
        return both


def beliefs_alone(measured: Measurements, noise: MotionNoise) -> Beliefs:
    """Estimates from single detections: their place, and P = diag(r², v²)."""
    count = len(measured.times)
    covariance = np.zeros((count, 3, 3))
    covariance[:, :, 0] = np.square(noise.measurement) * np.square(measured.noise)[:, None]
    covariance[:, :, 2] = np.square(noise.velocity)
    return Beliefs(measured.places, np.zeros((count, 4)), covariance)


def beliefs_along(labels: IntArray, measured: Measurements, noise: MotionNoise) -> tuple[Beliefs, Beliefs]:
    """Estimates at each detection, itself included, from the past of its chain, and from its future.

    Args:
        labels: ``(N,)`` number of the chain from 0 on; a detection of -1 is a chain by itself.
        measured: the detections, in the order of time.
        noise: of the filter.
    """
    count = len(labels)
    chain = np.where(labels < 0, labels.max(initial=-1) + 1 + np.arange(count), labels)
    order = np.argsort(chain, kind="stable")
    change = chain[order[1:]] != chain[order[:-1]]
    ends = np.ones(count, dtype=np.bool_)
    ends[:-1] = change
    starts = np.ones(count, dtype=np.bool_)
    starts[1:] = change
    both = np.concatenate([order, order[::-1]])
    filtered = _filtered(np.concatenate([starts, ends[::-1]]), both, measured, noise)
    return (
        _scattered(filtered, slice(0, count), order, 1.0),
        _scattered(filtered, slice(count, None), order[::-1], -1.0),
    )


def _scattered(
    filtered: tuple[FloatArray, FloatArray, FloatArray], half: slice, order: IntArray, direction: float
) -> Beliefs:
    """One half of the beliefs in the order of the detections, with time running forwards."""
    place, velocity, covariance = (part[..., half] for part in filtered)
    count = len(order)
    beliefs = Beliefs(np.empty((count, 4)), np.empty((count, 4)), np.empty((count, 3, 3)))
    beliefs.place[order], beliefs.velocity[order] = place.T, direction * velocity.T
    beliefs.covariance[order] = covariance.transpose(2, 1, 0)
    beliefs.covariance[:, :, 1] *= direction
    return beliefs


def _filtered(
    starts: BoolArray, order: IntArray, measured: Measurements, noise: MotionNoise
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The filter along chains that follow each other in ``order`` and begin where ``starts`` says.

    The second half of ``order`` is filtered against the time. Blocks come last, so that they lie together in memory.

    Returns:
        ``(4, 2N)`` places, ``(4, 2N)`` velocities, ``(3, 3, 2N)`` covariances (a, b, c of each group).
    """
    count = len(order) // 2
    blocks = -(-count // BLOCK)
    at = np.arange(BLOCK + RUN_UP)[:, None] + np.tile(np.arange(blocks) * BLOCK - RUN_UP, 2)
    offset = np.repeat([0, count], blocks)
    inside, now = (at >= 0) & (at < count), at.clip(0, max(count - 1, 0)) + offset
    fresh = starts[now] | (at <= 0)
    fresh[0] = True
    direction = np.repeat([1.0, -1.0], count)
    times, wander = direction * measured.times[order], direction * measured.wander[order]
    tau = np.diff(times[now], axis=0, prepend=0.0)
    camera = np.diff(wander[now], axis=0, prepend=0.0).clip(min=0)
    r2, q2, v2 = (np.square(values)[:, None] for values in (noise.measurement, noise.acceleration, noise.velocity))
    places, spread = np.ascontiguousarray(measured.places[order].T), np.square(measured.noise[order])
    place, velocity, covariance = np.zeros((4, 2 * count)), np.zeros((4, 2 * count)), np.zeros((3, 3, 2 * count))
    x, v = np.zeros((4, 2 * blocks)), np.zeros((4, 2 * blocks))
    a, b, c = np.zeros((3, 2 * blocks)), np.zeros((3, 2 * blocks)), np.zeros((3, 2 * blocks))
    for step in range(BLOCK + RUN_UP):
        rows, t, new = now[step], tau[step], fresh[step]
        # Prediction.
        x = x + v * t
        a = a + 2 * b * t + c * t**2 + q2 * (t * t * t) / 3
        a[0] += camera[step]
        b = b + c * t + q2 * t**2 / 2
        c = c + q2 * t
        # Update by the measurement.
        r, z = r2 * spread[rows], places[:, rows]
        gain_x, gain_v = a / (a + r), b / (a + r)
        off = z - x
        x = np.where(new, z, x + gain_x[GROUPS] * off)
        v = np.where(new, 0, v + gain_v[GROUPS] * off)
        c = np.where(new, v2, c - gain_v * b)
        b = np.where(new, 0, b - gain_x * b)
        a = np.where(new, r, a - gain_x * a)
        if step >= RUN_UP:
            counted = inside[step]
            rows = rows[counted]
            place[:, rows], velocity[:, rows] = x[:, counted], v[:, counted]
            covariance[:, :, rows] = np.stack([a, b, c])[:, :, counted]
    return place, velocity, covariance


@dataclass(frozen=True)
class TrackMotion(Columns):
    """Motion at N detections along the tracks of a solution.

    Attributes:
        follower: ``(N,)`` number of the next detection of the track, -1 for none.
        past: estimates at each detection from the past of its track.
        future: estimates at each detection from the future of its track.
        ending: ``(N,)`` whether links over long gaps that start there were considered.
        beginning: ``(N,)`` whether links over long gaps that end there were considered.
    """

    follower: IntArray
    past: Beliefs
    future: Beliefs
    ending: BoolArray
    beginning: BoolArray

    @classmethod
    def alone(cls, table: DetectionTable, motion: MotionNoise) -> TrackMotion:
        """Of detections of which each is a track by itself."""
        never = np.zeros(len(table), dtype=np.bool_)
        past, future = (beliefs_alone(table.measured, motion) for _ in range(2))
        return cls(np.full(len(table), -1), past, future, never, never)


def followed(
    previous: TrackMotion, table: DetectionTable, labels: IntArray, follower: IntArray, motion: MotionNoise, reach: int
) -> tuple[TrackMotion, tuple[BoolArray, BoolArray]]:
    """The motion along the tracks of a new solution.

    Args:
        previous: motion along the tracks of the solution before.
        table: the detections.
        labels: ``(N,)`` track of each now, -1 for none.
        follower: ``(N,)`` number of the next detection of the track now, -1 for none.
        motion: noise of the filter.
        reach: detections of a track over which a change matters; see `RUN_UP`.

    Returns:
        The motion, and ``(N,)`` whether the past, and whether the future of its track has changed at each detection.
    """
    track = np.where(labels < 0, int(labels.max(initial=-1)) + 1 + np.arange(len(table)), labels)
    order = np.argsort(track, kind="stable")
    # First and last row of the track of each: those of one track follow each other.
    bounds = np.searchsorted(track[order], track[order]), np.searchsorted(track[order], track[order], side="right") - 1
    old_follower, new_follower = table.rows(previous.follower), table.rows(follower)
    past = any_within((predecessors(old_follower) != predecessors(new_follower))[order], bounds, reach, 0)
    future = any_within((old_follower != new_follower)[order], bounds, 0, reach)
    needed = any_within(past, bounds, 0, RUN_UP) | any_within(future, bounds, RUN_UP, 0)
    back, ahead = np.empty(len(table), np.bool_), np.empty(len(table), np.bool_)
    back[order], ahead[order] = past, future
    # A part of a track that lies apart from its other parts is filtered by itself.
    part = np.cumsum(np.diff(bounds[0], prepend=-1).astype(np.bool_) | (needed & ~np.roll(needed, 1)))
    label = np.empty(len(table), dtype=np.int64)
    label[order] = part
    again = np.sort(order[needed])
    pasts, futures = beliefs_along(label[again], table.measured.select(again), motion)
    now = TrackMotion(
        follower.copy(),
        previous.past.replaced(again[back[again]], pasts.select(back[again])),
        previous.future.replaced(again[ahead[again]], futures.select(ahead[again])),
        previous.ending,
        previous.beginning,
    )
    return now, (back, ahead)


def any_within(flags: BoolArray, bounds: tuple[IntArray, IntArray], rows_back: int, rows_ahead: int) -> BoolArray:
    """``(N,)`` whether a flag is set from so many rows before each to so many after it, within bounds ``(N,)``."""
    row, total = np.arange(len(flags)), np.append(0, np.cumsum(flags))
    first, last = np.maximum(row - rows_back, bounds[0]), np.minimum(row + rows_ahead, bounds[1])
    return np.asarray(total[last + 1] > total[first])
