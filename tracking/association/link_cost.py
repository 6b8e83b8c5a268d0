"""What it costs to link detections, or ends of chains, that can be the same person.

A link from i to j compares what the past of i's chain predicts at j with what the future of j's chain says there. With
e = (difference of place, of velocity) in one coordinate, its covariance Σ = [[a, b], [b, c]] and D = |Σ|, it is

    Σ_coordinates [ ½ log(D / 4 r² v²) + (ν + 2)/2 · log(1 + (c e₁² − 2 b e₁ e₂ + a e₂²) / (D ν)) ]
    + miss · (τ − one frame) · (1 − covering · hidden)

the negative logarithm of Student's t density over its value between two chains of one detection each that agree, plus
the cost of a person who was not detected in between: less where a nearer box hides the place, or the image ends.

The values of one detection are laid out by columns once, so that pairs only look them up; the logarithms of the
coordinates are one of a product.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field, replace
from typing import TypeAlias

import numpy as np
from pydantic import NonNegativeFloat, PositiveFloat
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.association.chain_motion import GROUPS, Beliefs, MotionNoise
from tsuiseki.tracking.association.costs import ActionCost
from tsuiseki.tracking.association.detection_tables import Measurements
from tsuiseki.tracking.bounds import SETTINGS, Share
from tsuiseki.tracking.types import FloatArray, IntArray

# However well two chains fit, a link is worth no more: a track's end may always be bought.
MOST_WORTH = 15.0
# Degrees of freedom ν; the fewer, the less a large difference counts.
TAILS = 2.5
# Share of the cost of a miss that is not paid where the person is hidden.
COVERING = 0.7
# The appearance of two single detections speaks for a link by no more than this. Otherwise detections of one person
# with and without features would rather make two tracks.
MOST_ALIKE = 3.0
# Learnt costs count for no more than this, either way.
MOST_LEARNT = 5.0
# Deviation of the camera's motion, in heights, above which it makes links no dearer: where it is unknown how far the
# camera jumped, all links over the jump are equally far.
LOST = 0.5
# Standard deviations of the camera's motion by which links reach further.
DOUBT = 2.0
# Cost of a sudden change of motion; see `LinkCost.mismatch_along`.
TURN = 3.0


# How ill P pairs of detections, or of the chains that they belong to, go together. Takes ``(P,)`` indices of the
# earlier and of the later detections, the seconds between the two, and the variance that the camera's motion adds in
# between, squared heights; gives ``(P,)`` costs.
Mismatch: TypeAlias = Callable[[IntArray, IntArray, FloatArray, FloatArray], FloatArray]


def _student_cost(fit: FloatArray, volume: FloatArray) -> FloatArray:
    """``(P,)`` costs from the products of 1 + eᵀ Σ⁻¹ e / ν and of D / 4 r² v²."""
    return np.asarray((TAILS + 2) / 2 * np.log(fit) + 0.5 * np.log(volume))


def _free_variance(wander: FloatArray) -> FloatArray:
    """``(P,)`` the part of the camera's variance that makes nothing dearer."""
    return np.maximum(wander - LOST**2, 0)


def _mismatch_of_singles(motion: MotionNoise, measured: Measurements, less: float) -> Mismatch:
    """`LinkCost.mismatch_alone` with ``less`` taken off."""
    places, deviations = measured.places.T.copy(), np.square(measured.noise)
    side = np.maximum(*places[2:])

    def cost(i: IntArray, j: IntArray, seconds: FloatArray, wander: FloatArray) -> FloatArray:
        noise, squared = deviations[i] + deviations[j], seconds * seconds
        # Places count in geometric means of the two longer sides.
        per_side = np.exp(-(side[i] + side[j]))
        fit, volume = np.ones(len(i)), np.ones(len(i))
        settings = zip(motion.measurement, motion.acceleration, motion.velocity, strict=True)
        for group, (r, q, v) in enumerate(settings):
            a = r**2 * noise + squared * (v**2 + seconds * (q**2 / 3))
            b, c = seconds * (v**2 + seconds * (q**2 / 2)), 2 * v**2 + q**2 * seconds
            if group == 0:
                a += wander
            determinant = a * c - b * b
            scale = c / determinant * (1 / TAILS)
            if group == 0:
                scale *= per_side
                determinant -= _free_variance(wander) * c
            determinant *= 1 / (4 * r**2 * v**2)
            for k in np.flatnonzero(group == GROUPS):
                apart = places[k][i] - places[k][j]
                fit *= 1 + scale * (apart * apart)
                volume *= determinant
        return np.maximum(_student_cost(fit, volume) - less, -MOST_WORTH)

    return cost


class _Columns:
    """Beliefs at N detections, a column at a time; ``a``, ``b``, ``c`` are ``(3, N)``, the others ``(4, N)``."""

    def __init__(self, beliefs: Beliefs) -> None:
        self.place, self.velocity = beliefs.place.T.copy(), beliefs.velocity.T.copy()
        self.a, self.b, self.c = (beliefs.covariance[:, :, k].T.copy() for k in range(3))
        # The longer side, so that a car is as large as it is long; of people it is the height.
        self.side = np.maximum(*self.place[2:])


@dataclass(frozen=True, config=SETTINGS)
class LinkCost:
    """What links cost.

    Attributes:
        motion: noise of detections and of motion.
        miss: cost of a second without a detection.
        appearance: weight of the cosine distance of two appearance features, and of two averaged along tracks.
        neutral: cosine distance that speaks neither for nor against, taken also where it is not known; likewise two.
        action: cost of the action features of two detections or tracks; None leaves them out.
        reach: differences of centres in x and in y that are considered, longer sides of the earlier box.
        speed: what is added to them every second.
        size: largest difference of log heights that is considered.
        velocity_confidence: weight in [0, 1] of the estimated velocity when links are first scored; see
            `mismatch_alone`.
    """

    motion: MotionNoise = field(default_factory=MotionNoise)
    miss: NonNegativeFloat = 1.5
    appearance: tuple[float, float] = (14.0, 18.0)
    neutral: tuple[float, float] = (0.27, 0.24)
    action: ActionCost | None = None
    reach: tuple[PositiveFloat, PositiveFloat] = (0.3, 0.3)
    speed: tuple[NonNegativeFloat, NonNegativeFloat] = (2.1, 1.2)
    size: PositiveFloat = 0.5
    velocity_confidence: Share = 0.3

    def at_speed(self, speed: float) -> LinkCost:
        """The same where targets move at ``speed``, longer sides a second, as `VideoEvidence.speed` tells it.

        Velocities differ by as much. Their changes, and how far links reach, are no smaller than at the speed of these
        costs, since who stands may walk on.
        """
        times = speed / self.motion.velocity[0]
        growth = max(times, 1.0)
        (vx, vw, vh), (qx, qw, qh), root = self.motion.velocity, self.motion.acceleration, float(np.sqrt(growth))
        motion = replace(
            self.motion,
            velocity=(vx * times, vw * times, vh * times),
            acceleration=(qx * root, qw * root, qh * root),
        )
        return replace(self, motion=motion, speed=(self.speed[0] * growth, self.speed[1] * growth))

    def limits(self, sides: FloatArray, seconds: float | FloatArray) -> FloatArray:
        """``(N, 2)`` largest differences of centres, pixels, for boxes of ``(N,)`` longer sides, over a gap in seconds,
        one for all or ``(N,)``.
        """
        return np.asarray(sides[:, None] * (np.array(self.reach) + np.multiply.outer(seconds, self.speed)))

    def waiting(self, seconds: FloatArray, one_frame: float, hidden: FloatArray) -> FloatArray:
        """``(P,)`` what the time between two detections costs in which the person was not detected."""
        return np.asarray(self.miss * (seconds - one_frame) * (1 - COVERING * hidden))

    def appearance_cost(self, distance: FloatArray, *, averaged: bool) -> FloatArray:
        """``(P,)`` what cosine distances of single, or of averaged features say; NaN where one is not known."""
        weight, neutral = self.appearance[averaged], self.neutral[averaged]
        cost = np.asarray(weight * np.nan_to_num(distance - neutral))
        return cost if averaged else np.maximum(cost, -MOST_ALIKE)

    def learnt(self, cost: FloatArray) -> FloatArray:
        """``(P,)`` what learnt costs -log P say: -logit P, within bounds, since no single pair is beyond doubt."""
        probability = np.exp(-cost)
        return np.clip(np.log1p(-probability + 1e-9) + cost, -MOST_LEARNT, MOST_LEARNT)

    def mismatch(self, past: Beliefs, future: Beliefs) -> Mismatch:
        """How ill the past of one's chain and the future of the other's go together: the sum over the coordinates."""
        earlier, later = _Columns(past), _Columns(future)
        noise = self.motion.measurement, self.motion.acceleration, self.motion.velocity
        r2, q2, v2 = (np.square(values) for values in noise)

        def cost(i: IntArray, j: IntArray, seconds: FloatArray, wander: FloatArray) -> FloatArray:
            per_side = np.exp(-(earlier.side[i] + later.side[j]))
            fit, volume = np.ones(len(i)), np.ones(len(i))
            for group, q in enumerate(q2):
                b, c = earlier.b[group][i], earlier.c[group][i]
                a = earlier.a[group][i] + later.a[group][j] + seconds * (2 * b + seconds * (c + seconds * (q / 3)))
                b += later.b[group][j] + seconds * (c + seconds * (q / 2))
                c += later.c[group][j] + q * seconds
                if group == 0:
                    a += wander
                determinant = a * c - b * b
                scale = 1 / (determinant * TAILS)
                if group == 0:
                    scale *= per_side
                    determinant -= _free_variance(wander) * c
                determinant *= 1 / (4 * r2[group] * v2[group])
                b *= 2
                for k in np.flatnonzero(group == GROUPS):
                    velocity = earlier.velocity[k][i]
                    apart = earlier.place[k][i] - later.place[k][j] + velocity * seconds
                    velocity -= later.velocity[k][j]
                    fit *= 1 + scale * (apart * (c * apart - b * velocity) + a * (velocity * velocity))
                    volume *= determinant
            return np.maximum(_student_cost(fit, volume), -MOST_WORTH)

        return cost

    def mismatch_along(self, measured: Measurements, past: Beliefs, future: Beliefs, one_frame: float) -> Mismatch:
        """`mismatch` of the past of one and the future of the other, or of a sudden change of motion in between.

        Constant velocity with small changes fits those who walk, not those whom the camera suddenly swings past. The
        more a chain is sure of its velocity, the dearer such a change gets, until whole people are left out. So the
        link may also be explained by two strangers to each other's motion, `mismatch_alone`, for `TURN` more: of two
        explanations the likelier one counts.
        """
        along, alone = self.mismatch(past, future), self.mismatch_alone(measured, one_frame)

        def cheaper(i: IntArray, j: IntArray, seconds: FloatArray, wander: FloatArray) -> FloatArray:
            cost = along(i, j, seconds, wander)
            dear = np.flatnonzero(cost > TURN)
            cost[dear] = np.minimum(cost[dear], alone(i[dear], j[dear], seconds[dear], wander[dear]) + TURN)
            return cost

        return cheaper

    def mismatch_alone(self, measured: Measurements, one_frame: float) -> Mismatch:
        """`mismatch` of detections of which each is all that is known of its chain: with P = diag(r², v²).

        Of two detections alone the velocity is unknown, and ½ log |Σ| says how much room that leaves. A chain has one
        velocity, so it should pay for this once, but here every link of it does: the faster the targets and the fewer
        the frames, the more. What it costs over ``one_frame`` is therefore taken off in part, ``velocity_confidence``
        of it: with 0 chains of fast targets never form, with 1 whatever lies in reach is linked.
        """
        return _mismatch_of_singles(self.motion, measured, self.velocity_confidence * self.room(one_frame))

    def room(self, seconds: float) -> float:
        """½ log(|Σ| / 4r²v²) of two detections alone, summed over the coordinates: what the unknown velocity costs."""
        r2, q2, v2 = (
            np.square(values)[GROUPS]
            for values in (self.motion.measurement, self.motion.acceleration, self.motion.velocity)
        )
        aa = 2 * r2 + np.square(seconds) * (v2 + seconds * q2 / 3)
        bb, cc = seconds * (v2 + seconds * q2 / 2), 2 * v2 + q2 * seconds
        return float(0.5 * np.log((aa * cc - np.square(bb)) / (4 * r2 * v2)).sum())
