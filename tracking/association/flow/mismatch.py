"""How ill two chains of detections go together: the logarithm of Student's t density, over all coordinates.

With e = (difference of place, difference of velocity) in one coordinate, Σ = [[a, b], [b, c]] its covariance, D = |Σ|,

    ½ log(D / 4 r² v²) + (ν + 2)/2 · log(1 + (c e₁² − 2 b e₁ e₂ + a e₂²) / (D ν)).

What belongs to one detection is laid out by columns once, so that pairs only look it up; the logarithms of the
coordinates are one of a product.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tsuiseki.tracking.association.tracklets.chain_motion import GROUPS, Beliefs, Measurements, MotionNoise
from tsuiseki.tracking.types import FloatArray, IntArray

# Pairs that are compared together: as many as the processor holds close by.
PAIRS_AT_ONCE = 8192


class Mismatch(Protocol):
    """Anything that says how ill P pairs of detections, or of the chains that they belong to, go together."""

    def __call__(self, i: IntArray, j: IntArray, seconds: FloatArray, wander: FloatArray) -> FloatArray:
        """``(P,)`` costs.

        Args:
            i: ``(P,)`` indices of the earlier detections.
            j: ``(P,)`` of the later ones.
            seconds: ``(P,)`` between the two.
            wander: ``(P,)`` variance that the camera's motion adds in between, squared heights.
        """
        ...


@dataclass(frozen=True)
class StudentT:
    """The distribution.

    Attributes:
        motion: r and v, of which D is counted from, and q.
        tails: ν.
        lost: deviation of the camera's motion, heights, above which it makes nothing dearer.
        most_worth: no pair costs less than this below 0.
    """

    motion: MotionNoise
    tails: float
    lost: float
    most_worth: float

    def cost(self, fit: FloatArray, volume: FloatArray) -> FloatArray:
        """``(P,)`` from the products of 1 + eᵀ Σ⁻¹ e / ν and of D / 4 r² v²."""
        return np.asarray((self.tails + 2) / 2 * np.log(fit) + 0.5 * np.log(volume))

    def doubt(self, wander: FloatArray) -> FloatArray:
        """``(P,)`` the part of the camera's variance that makes nothing dearer."""
        return np.maximum(wander - self.lost**2, 0)


class Alone:
    """`Mismatch` of detections of which each is all that is known of its chain: P = diag(r², v²), and no velocity.

    Args:
        law: the distribution.
        seen: the detections.
        less: what is taken off.
    """

    def __init__(self, law: StudentT, seen: Measurements, less: float) -> None:
        self._law, self._less = law, less
        self._places, self._noise = seen.places.T.copy(), np.square(seen.noise)
        self._side = np.maximum(*self._places[2:])

    def __call__(self, i: IntArray, j: IntArray, seconds: FloatArray, wander: FloatArray) -> FloatArray:
        """See `Mismatch`."""
        return in_parts(self._cost, i, j, seconds, wander)

    def _cost(self, i: IntArray, j: IntArray, seconds: FloatArray, wander: FloatArray) -> FloatArray:
        law, motion = self._law, self._law.motion
        noise, squared = self._noise[i] + self._noise[j], seconds * seconds
        # Places count in geometric means of the two longer sides.
        per_side = np.exp(-(self._side[i] + self._side[j]))
        fit, volume = np.ones(len(i)), np.ones(len(i))
        settings = zip(motion.measurement, motion.acceleration, motion.velocity, strict=True)
        for group, (r, q, v) in enumerate(settings):
            a = r**2 * noise + squared * (v**2 + seconds * (q**2 / 3))
            b, c = seconds * (v**2 + seconds * (q**2 / 2)), 2 * v**2 + q**2 * seconds
            if group == 0:
                a += wander
            determinant = a * c - b * b
            scale = c / determinant * (1 / law.tails)
            if group == 0:
                scale *= per_side
                determinant -= law.doubt(wander) * c
            determinant *= 1 / (4 * r**2 * v**2)
            for k in np.flatnonzero(group == GROUPS):
                apart = self._places[k][i] - self._places[k][j]
                fit *= 1 + scale * (apart * apart)
                volume *= determinant
        return np.maximum(law.cost(fit, volume) - self._less, -law.most_worth)


class Along:
    """`Mismatch` of what the past of the earlier one's chain says and what the future of the later one's does.

    Args:
        law: the distribution.
        past: what the past of its chain says at each detection.
        future: likewise of the future.
    """

    def __init__(self, law: StudentT, past: Beliefs, future: Beliefs) -> None:
        self._law = law
        self._past, self._future = _Columns(past), _Columns(future)

    def __call__(self, i: IntArray, j: IntArray, seconds: FloatArray, wander: FloatArray) -> FloatArray:
        """See `Mismatch`."""
        return in_parts(self._cost, i, j, seconds, wander)

    def _cost(self, i: IntArray, j: IntArray, seconds: FloatArray, wander: FloatArray) -> FloatArray:
        law, past, future = self._law, self._past, self._future
        r2, q2, v2 = (
            np.square(values) for values in (law.motion.measurement, law.motion.acceleration, law.motion.velocity)
        )
        per_side = np.exp(-(past.side[i] + future.side[j]))
        fit, volume = np.ones(len(i)), np.ones(len(i))
        for group in range(3):
            q = q2[group]
            b, c = past.b[group][i], past.c[group][i]
            a = past.a[group][i] + future.a[group][j] + seconds * (2 * b + seconds * (c + seconds * (q / 3)))
            b += future.b[group][j] + seconds * (c + seconds * (q / 2))
            c += future.c[group][j] + q * seconds
            if group == 0:
                a += wander
            determinant = a * c - b * b
            scale = 1 / (determinant * law.tails)
            if group == 0:
                scale *= per_side
                determinant -= law.doubt(wander) * c
            determinant *= 1 / (4 * r2[group] * v2[group])
            b *= 2
            for k in np.flatnonzero(group == GROUPS):
                velocity = past.velocity[k][i]
                apart = past.place[k][i] - future.place[k][j] + velocity * seconds
                velocity -= future.velocity[k][j]
                fit *= 1 + scale * (apart * (c * apart - b * velocity) + a * (velocity * velocity))
                volume *= determinant
        return np.maximum(law.cost(fit, volume), -law.most_worth)


class OrSuddenChange:
    """`Mismatch` along chains, or of strangers for ``turn`` more, whichever is less; see `LinkCost.mismatch_along`.

    Args:
        along: along chains.
        alone: of strangers, which is asked for only where chains go together worse than for ``turn``.
        turn: see `LinkCost`.
    """

    def __init__(self, along: Along, alone: Alone, turn: float) -> None:
        self._along, self._alone, self._turn = along, alone, turn

    def __call__(self, i: IntArray, j: IntArray, seconds: FloatArray, wander: FloatArray) -> FloatArray:
        """See `Mismatch`."""
        cost = self._along(i, j, seconds, wander)
        dear = np.flatnonzero(cost > self._turn)
        alone = self._alone(i[dear], j[dear], seconds[dear], wander[dear])
        cost[dear] = np.minimum(cost[dear], alone + self._turn)
        return cost


class _Columns:
    """Beliefs at N detections, a column at a time; ``a``, ``b``, ``c`` are ``(3, N)``, the others ``(4, N)``."""

    def __init__(self, beliefs: Beliefs) -> None:
        self.place, self.velocity = beliefs.place.T.copy(), beliefs.velocity.T.copy()
        self.a, self.b, self.c = (beliefs.covariance[:, :, k].T.copy() for k in range(3))
        # The longer side, so that a car is as large as it is long; of people it is the height.
        self.side = np.maximum(*self.place[2:])


def in_parts(cost: Mismatch, i: IntArray, j: IntArray, seconds: FloatArray, wander: FloatArray) -> FloatArray:
    """``(P,)`` costs of pairs, so many at a time that what is computed on the way stays close to the processor."""
    if len(i) <= PAIRS_AT_ONCE:
        return cost(i, j, seconds, wander)
    total = np.empty(len(i))
    for start in range(0, len(i), PAIRS_AT_ONCE):
        part = slice(start, start + PAIRS_AT_ONCE)
        total[part] = cost(i[part], j[part], seconds[part], wander[part])
    return total
