"""Kalman filters over many tracks at once.

Two filters with one contract, ``predict`` to the next frame and ``update`` by a measurement, over all tracks in one
call and without a loop over them:

* ``predict`` and ``update`` are the textbook filter of any linear model (Kalman 1960).
* ``predict_boxes`` and ``update_boxes`` are the same filter for boxes of constant velocity, in closed form. Each of
  the four corner coordinates moves by itself and with the same noise, so one 2x2 covariance a track stands for the
  whole 8x8 one. The noise is a share of the person's height; since a Kalman gain depends on ratios of variances
  only, the covariance is kept in squared heights and the height itself is never needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import NonNegativeFloat, PositiveFloat
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.types import Columns, FloatArray


@dataclass(frozen=True)
class Gaussians:
    """What is known of N states of length D.

    Attributes:
        mean: ``(N, D)``.
        covariance: ``(N, D, D)`` symmetric positive semi-definite.
    """

    mean: FloatArray
    covariance: FloatArray


def predict(state: Gaussians, transition: FloatArray, noise: FloatArray) -> Gaussians:
    """The states one step later.

    Args:
        state: N states of length D.
        transition: ``(D, D)`` or ``(N, D, D)``; this and the next are what a motion's ``linear`` gives.
        noise: covariance of what the transition does not explain, ``(D, D)`` or ``(N, D, D)``.
    """
    mean = (transition @ state.mean[..., None])[..., 0]
    return Gaussians(mean, transition @ state.covariance @ np.swapaxes(transition, -1, -2) + noise)


def update(state: Gaussians, measured: FloatArray, observation: FloatArray, noise: FloatArray) -> Gaussians:
    """The states after one measurement each.

    Args:
        state: N states of length D.
        measured: ``(N, M)``.
        observation: maps a state to its measurement, ``(M, D)`` or ``(N, M, D)``.
        noise: covariance of the measurement, ``(M, M)`` or ``(N, M, M)``, positive definite.
    """
    innovation, cross, spread = _innovation(state, measured, observation, noise)
    gain = np.swapaxes(np.linalg.solve(spread, np.swapaxes(cross, -1, -2)), -1, -2)
    # Joseph's form: symmetric and positive semi-definite whatever the rounding.
    remainder = np.eye(state.mean.shape[-1]) - gain @ observation
    covariance = remainder @ state.covariance @ np.swapaxes(remainder, -1, -2) + gain @ noise @ np.swapaxes(
        gain, -1, -2
    )
    return Gaussians(state.mean + (gain @ innovation[..., None])[..., 0], covariance)


def log_likelihood(state: Gaussians, measured: FloatArray, observation: FloatArray, noise: FloatArray) -> FloatArray:
    """``(N,)`` logarithm of the density of each measurement; arguments are those of `update`."""
    innovation, _, spread = _innovation(state, measured, observation, noise)
    square = (innovation * np.linalg.solve(spread, innovation[..., None])[..., 0]).sum(axis=-1)
    return np.asarray(-0.5 * (square + np.linalg.slogdet(2 * np.pi * spread)[1]))


def _innovation(
    state: Gaussians, measured: FloatArray, observation: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """``(N, M)`` how far the measurements are off, ``(N, D, M)`` covariance with the states, ``(N, M, M)`` its own."""
    cross = state.covariance @ np.swapaxes(observation, -1, -2)
    return measured - (observation @ state.mean[..., None])[..., 0], cross, observation @ cross + noise


@pydantic_dataclass(frozen=True, config=SETTINGS)
class BoxMotion:
    """Noise of boxes that move with constant velocity, in heights of the person.

    Attributes:
        measurement: standard deviation of a detected corner coordinate.
        acceleration: standard deviation of the change of velocity from one frame to the next.
        start_velocity: standard deviation of the velocity of a new track, a frame.
    """

    measurement: PositiveFloat = 0.05
    acceleration: NonNegativeFloat = 0.01
    start_velocity: NonNegativeFloat = 0.1


@dataclass(frozen=True)
class BoxBelief(Columns):
    """What is known of N moving boxes.

    Attributes:
        boxes: ``(N, 4)`` pixels, the mean positions.
        velocities: ``(N, 4)`` pixels a frame.
        variance: ``(N, 3)`` variance of the position, covariance of both, variance of the velocity, of each corner
            coordinate, in squared heights.
    """

    boxes: FloatArray
    velocities: FloatArray
    variance: FloatArray


def start_boxes(boxes: FloatArray, motion: BoxMotion) -> BoxBelief:
    """New tracks at ``(N, 4)`` boxes, of unknown velocity."""
    variance = np.empty((len(boxes), 3))
    variance[:] = motion.measurement**2, 0.0, motion.start_velocity**2
    return BoxBelief(np.array(boxes, dtype=np.float64), np.zeros((len(boxes), 4)), variance)


def predict_boxes(belief: BoxBelief, motion: BoxMotion, passed: float | FloatArray = 1.0) -> BoxBelief:
    """The boxes some time later: the position moves by the velocity, which changes by white noise.

    Args:
        belief: of N boxes.
        motion: its noise.
        passed: frames, one for all or ``(N,)``, 0 or more.
    """
    t = np.asarray(passed, dtype=np.float64)
    position, both, velocity = belief.variance.T
    # Q of a velocity that changes evenly during each frame.
    noise = motion.acceleration**2 * t
    spread = noise * (t**2 / 4 + np.maximum(t**2 - 1, 0) / 12)
    variance = [position + 2 * t * both + t**2 * velocity + spread, both + t * velocity + noise * t / 2]
    moved = belief.boxes + t[..., None] * belief.velocities
    return BoxBelief(moved, belief.velocities, np.stack([*variance, velocity + noise], axis=1))


def per_longer_frame(belief: BoxBelief, longer: float) -> BoxBelief:
    """The same belief where a frame lasts so many times as long."""
    return BoxBelief(belief.boxes, belief.velocities * longer, belief.variance * (1.0, longer, longer**2))


def update_boxes(belief: BoxBelief, boxes: FloatArray, motion: BoxMotion) -> BoxBelief:
    """The boxes after each was detected at ``(N, 4)`` boxes."""
    position, both = belief.variance[:, :1], belief.variance[:, 1:2]
    remainder = motion.measurement**2 / (position + motion.measurement**2)
    velocity_gain = both * (remainder / motion.measurement**2)
    residual = boxes - belief.boxes
    variance = belief.variance * remainder
    # (1 - K H) P leaves the velocity's variance less what its correlation with the position explains.
    variance[:, 2:] = belief.variance[:, 2:] - velocity_gain * both
    return BoxBelief(boxes - remainder * residual, belief.velocities + velocity_gain * residual, variance)
