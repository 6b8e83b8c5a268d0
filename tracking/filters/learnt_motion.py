"""How a body moves, as `tsuiseki train motion` saves it and the tracker of deformable bodies loads it.

All numbers are per frame at the frame rate they were learnt at; `LearntMotion.at` converts them to another.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.body_motion import (
    HEADING,
    BodyFixedVelocity,
    ConstantVelocity,
    Noise,
    RandomWalk,
    conditions,
)
from tsuiseki.tracking.formats.rows import read_learnt
from tsuiseki.tracking.types import FloatArray

FORMAT = "tsuiseki-motion-1"
# The parts of a motion that `LearntMotion.widened` widens: all Gaussians but the velocity at the start.
WIDENED = ("walk", "image", "increments", "printed", "residual")


@dataclass(frozen=True)
class PrincipalComponents:
    """A Gaussian by its principal components, (15).

    Attributes:
        mean: ``(D,)``.
        components: ``(D, D)``, a unit vector a column.
        variances: ``(D,)`` along them, falling.
    """

    mean: FloatArray
    components: FloatArray
    variances: FloatArray

    def noise(self) -> Noise:
        """Draws of it, (18), about its mean."""
        return Noise(self.mean, self.components * np.sqrt(self.variances))

    def scaled(self, units: FloatArray) -> PrincipalComponents:
        """The same Gaussian with each column multiplied by ``units`` ``(D,)``."""
        factor = units[:, None] * self.noise().factor
        vectors, lengths, _ = np.linalg.svd(factor)
        return PrincipalComponents(self.mean * units, vectors, lengths**2)


@dataclass(frozen=True)
class LearntMotion:
    """Motion of one body.

    Attributes:
        body: its name.
        columns: names of the columns of its state.
        frame_rate: frames per second it was learnt at; all numbers are per frame.
        steps: increments it was learnt from.
        walk: of ``(a', b', theta', shape'…)`` (10)-(12), for the random walk.
        velocity: of the body-fixed velocity, two columns.
        image: of ``(a'', b'', theta', shape'…)`` in image axes (13), for constant velocity.
        increments: of what (16) adds: the difference of body-fixed velocities, and ``theta', shape'…``.
        printed: of (14) as printed: the rotated acceleration, and ``theta', shape'…``.
        gain: ``(D, C)`` expected change of the rates for each of `conditions`.
        residual: of the changes of the rates that ``gain`` leaves.
    """

    body: str
    columns: tuple[str, ...]
    frame_rate: float
    steps: int
    walk: PrincipalComponents
    velocity: PrincipalComponents
    image: PrincipalComponents
    increments: PrincipalComponents
    printed: PrincipalComponents
    gain: FloatArray
    residual: PrincipalComponents

    @property
    def dimension(self) -> int:
        """Number of columns of the body's state."""
        return len(self.columns)

    def random_walk(self) -> RandomWalk:
        """(8) with the learnt means and deviations of ``(a', b', theta', shape')``."""
        return RandomWalk(self.walk.noise().without_correlation())

    def constant_velocity(self) -> ConstantVelocity:
        """(9) with the learnt means and deviations of ``(a'', b'', theta', shape')``."""
        return ConstantVelocity(self.image.noise().without_correlation(), self.velocity.noise())

    def independent(self) -> BodyFixedVelocity:
        """(16)-(17) with independent noise of the learnt variances."""
        return BodyFixedVelocity(self.increments.noise().without_correlation(), self.velocity.noise())

    def proposal(self) -> BodyFixedVelocity:
        """(16)-(18) with the principal components of what (16) adds."""
        return BodyFixedVelocity(self.increments.noise(), self.velocity.noise())

    def printed_proposal(self) -> BodyFixedVelocity:
        """(16)-(18) as printed: the principal components of (14), and no mean in (15)."""
        noise = self.printed.noise()
        return BodyFixedVelocity(replace(noise, mean=np.zeros_like(noise.mean)), self.velocity.noise())

    def conditional(self) -> BodyFixedVelocity:
        """(16)-(17) whose increments depend on velocity, shape and the last increments."""
        gain = self.gain.copy()
        # The rates of heading and shape go on; what was learnt is how they change.
        rates = self.dimension - HEADING
        gain[HEADING:, -rates:] += np.eye(rates)
        return BodyFixedVelocity(self.residual.noise(), self.velocity.noise(), gain)

    def widened(self, times: float) -> LearntMotion:
        """The motion with all deviations of its noise so many times as large."""
        parts: dict[str, Any] = {name: getattr(self, name) for name in WIDENED}
        return replace(self, **{n: replace(part, variances=part.variances * times**2) for n, part in parts.items()})

    def at(self, frame_rate: float) -> LearntMotion:
        """The motion per frame at another frame rate.

        Velocities and changes of angles grow with the time between frames, accelerations with its square: bodies move
        smoothly between frames.
        """
        ratio = self.frame_rate / frame_rate
        if ratio == 1.0:
            return self
        first = np.full(self.dimension, ratio)
        second = np.where(np.arange(self.dimension) < HEADING, ratio**2, ratio)
        # Conditions in the order of `conditions`: velocity and its products, shape, rates of heading and shape.
        bends = self.dimension - HEADING - 1
        units = np.concatenate([np.full(2 + bends, ratio), np.ones(bends), np.full(bends + 1, ratio)])
        return replace(
            self,
            frame_rate=frame_rate,
            walk=self.walk.scaled(first),
            velocity=self.velocity.scaled(first[:2]),
            image=self.image.scaled(second),
            increments=self.increments.scaled(second),
            printed=self.printed.scaled(second),
            gain=self.gain * ratio**2 / units,
            residual=self.residual.scaled(np.full(self.dimension, ratio**2)),
        )


def write_motion(path: Path, motion: LearntMotion) -> None:
    """Write the file that `read_motion` reads."""
    path.write_text(motion_text(motion), encoding="utf-8")


def motion_text(motion: LearntMotion) -> str:
    """The motion as JSON."""
    values = {"format": FORMAT, **asdict(motion)}
    return json.dumps(values, indent=1, default=lambda array: array.tolist()) + "\n"


def read_motion(path: Path, body: str, dimension: int) -> LearntMotion:
    """The motion in a file of `tsuiseki train motion`.

    Raises:
        RequestError: it is no such file, is broken, or was learnt from another body or dimension.
    """
    values = read_learnt(path, "train motion", FORMAT)
    if values.get("body") != body:
        raise RequestError(f"{path}: expected motion of the body {body}, got that of {values.get('body')}")
    columns = values.get("columns")
    if not isinstance(columns, list) or len(columns) != dimension:
        got = len(columns) if isinstance(columns, list) else columns
        raise RequestError(f"{path}: expected motion of {dimension} columns, as {body} has, got {got}")
    try:
        return _from_values(values)
    except (KeyError, TypeError, ValueError) as error:
        raise RequestError(f"{path}: broken motion file ({error}); make it again with tsuiseki train motion") from error


def _from_values(values: Mapping[str, Any]) -> LearntMotion:
    columns = tuple(str(name) for name in values["columns"])
    size = len(columns)
    frame_rate, steps = float(values["frame_rate"]), int(values["steps"])
    if not (np.isfinite(frame_rate) and frame_rate > 0):
        raise ValueError(f"expected a frame rate above 0, got {frame_rate}")
    width = conditions(np.zeros((1, size)), np.zeros((1, size))).shape[1]
    parts = {name: _components(values[name], size) for name in WIDENED}
    velocity, gain = _components(values["velocity"], 2), _numbers(values["gain"], (size, width))
    return LearntMotion(str(values["body"]), columns, frame_rate, steps, velocity=velocity, gain=gain, **parts)


def _components(values: Mapping[str, Any], size: int) -> PrincipalComponents:
    variances = _numbers(values["variances"], (size,))
    if np.any(variances < 0) or not variances.max() > 0:
        raise ValueError("expected variances from 0, and one above it")
    return PrincipalComponents(
        _numbers(values["mean"], (size,)), _numbers(values["components"], (size, size)), variances
    )


def _numbers(values: Any, shape: tuple[int, ...]) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"expected finite numbers of shape {shape}, got shape {array.shape}")
    return array
