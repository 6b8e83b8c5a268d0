"""Which detections of one moment are one person.

A group holds at most one detection of each sensor. With the floor position x of the person integrated out, a group of
detections i of sensors s weighs against false alarms

    V = log ∫ p(x) Π_i p_D N(z_i; x, Σ_i) / κ(z_i) dx + Σ log(1 - p_D v(x))   (the second over sensors without one),

p(x) being a person's density on the floor, or the prediction of a track. Finding the partition of the greatest sum of
V is a multidimensional assignment, which is NP-hard from three sensors on. It is climbed sensor by sensor: the
detections of one are taken out and assigned anew to all groups, exactly, until no sensor improves it (Poore and
Robertson, "A new Lagrangian relaxation based algorithm for a class of multidimensional assignment problems", 1997,
solve the same pieces).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

LOG_TWO_PI = float(np.log(2 * np.pi))
SWEEPS, GATHERING = 4, 1
GATE = 9.0
BARRED = -1e9


@dataclass(frozen=True)
class MomentPoints:
    """What was measured at one moment, and what is expected there.

    Attributes:
        sensor: ``(N,)`` of each point.
        places: ``(N, 2)``.
        covariances: ``(N, 2, 2)``.
        gain: ``(N,)`` log p_D - log κ.
        missed: ``(N, S)`` log(1 - p_D v) of each sensor there.
        names: ``(N,)`` who it is for certain, or -1.
        alike: ``(N, N)`` log ratio by which appearance makes two of them one person, or None.
    """

    sensor: IntArray
    places: FloatArray
    covariances: FloatArray
    gain: FloatArray
    missed: FloatArray
    names: IntArray
    alike: FloatArray | None = None


@dataclass(frozen=True)
class ExpectedTracks:
    """Tracks that are expected at one moment.

    Attributes:
        places: ``(K, 2)``.
        covariances: ``(K, 2, 2)``.
        missed: ``(K, S)``.
    """

    places: FloatArray
    covariances: FloatArray
    missed: FloatArray


def group(points: MomentPoints, density: float, expected: ExpectedTracks | None = None) -> IntArray:
    """``(N,)`` number of the group of each point.

    Args:
        points: N, of S sensors.
        density: people a square metre where none is expected.
        expected: K tracks; groups 0 to K - 1 go on with them, the others begin.
    """
    tracks = 0 if expected is None else len(expected.places)
    label = tracks + np.arange(len(points.sensor))
    state = _Climb(points, np.log(density), expected)
    for sweep in range(SWEEPS):
        before = label.copy()
        for sensor in np.unique(points.sensor):
            label = state.reassigned(label, points.sensor == sensor, sweep < GATHERING)
        if sweep >= GATHERING and (label == before).all():
            break
    return label


class _Climb:
    """One moment with what never changes about it."""

    def __init__(self, points: MomentPoints, density: float, expected: ExpectedTracks | None) -> None:
        self.points, self.density = points, density
        self.tracks = 0 if expected is None else len(expected.places)
        places, covariances, missed = points.places, points.covariances, points.missed
        if expected is not None:
            places = np.concatenate([expected.places, places])
            covariances = np.concatenate([expected.covariances, covariances])
            missed = np.concatenate([expected.missed, missed])
        self.information, determinant = inverted(covariances)
        self.vector = np.matmul(self.information, places[..., None])[..., 0]
        fit = (self.vector * places).sum(axis=1)
        self.rest = -LOG_TWO_PI - 0.5 * np.log(determinant) - 0.5 * fit
        self.missed, self.sensors = missed, missed.shape[1]
        self.prior = np.full(len(places), density)
        self.prior[: self.tracks] = 0.0
        self.gain = np.concatenate([np.zeros(self.tracks), points.gain])
        self.precise = 1.0 / determinant
        self.named = bool((points.names >= 0).any())

    def reassigned(self, label: IntArray, own: BoolArray, gathering: bool) -> IntArray:
        """The labels after the points of one sensor chose their groups anew.

        While ``gathering``, all count as people: a group of two that three other sensors miss weighs less than nothing,
        and would never become one of five.
        """
        points, tracks = self.points, self.tracks
        mine, others = np.flatnonzero(own), np.flatnonzero(~own)
        who = np.concatenate([np.arange(tracks), tracks + others])
        numbers, first, member = np.unique(
            np.concatenate([np.arange(tracks), label[others]]), return_index=True, return_inverse=True
        )
        # A new group bears the number of one of its members, which must not be among those taken out.
        numbers = who[first]
        sensor = int(points.sensor[mine[0]])
        value, missed, (mean, covariance) = self.values(who, member, len(numbers))
        alone = self.gain[tracks + mine] + self.density + self.missed[tracks + mine].sum(axis=1)
        alone -= self.missed[tracks + mine, sensor]
        apart = points.places[mine][:, None] - mean[None]
        spread = points.covariances[mine][:, None] + covariance[None]
        fit, square = _log_normal(apart, spread)
        joined = value[None] + self.gain[tracks + mine][:, None] - missed[None, :, sensor] + fit
        if points.alike is not None:
            joined = joined + self._alike(mine, who, member, len(numbers))
        if self.named:
            joined[self._barred(mine, who, member, len(numbers))] = BARRED
        # A group or point of negative weight is a false alarm, and weighs nothing.
        least = -np.inf if gathering else 0.0
        profit = np.maximum(joined, least) - np.maximum(value, least)[None] - np.maximum(alone, least)[:, None]
        if gathering:
            profit[square > GATE] = 0.0
        rows, columns = scipy.optimize.linear_sum_assignment(np.maximum(profit, 0.0), maximize=True)
        taken = profit[rows, columns] > 0
        result = label.copy()
        result[others] = numbers[member[tracks:]]
        result[mine] = tracks + mine
        result[mine[rows[taken]]] = numbers[columns[taken]]
        return result

    def values(
        self, who: IntArray, member: IntArray, count: int
    ) -> tuple[FloatArray, FloatArray, tuple[FloatArray, FloatArray]]:
        """Weights V of the groups, their misses ``(G, S)``, means and covariances."""
        held = np.zeros((count, len(who)))
        held[member, np.arange(len(who))] = 1.0
        # Gaussians multiplied by group: information and its vector give the mean, the rest the integral.
        information = (held @ self.information[who].reshape(-1, 4)).reshape(-1, 2, 2)
        vector = held @ self.vector[who]
        covariance, determinant = inverted(information)
        mean = np.matmul(covariance, vector[..., None])[..., 0]
        fit = (mean * vector).sum(axis=1)
        integral = held @ self.rest[who] + LOG_TWO_PI - 0.5 * np.log(determinant) + 0.5 * fit
        missed = self.missed[self.most_precise(who, member, count)].copy()
        real = who >= self.tracks
        missed[member[real], self.points.sensor[who[real] - self.tracks]] = 0.0
        prior = np.full(count, self.density)
        prior[member[~real]] = 0.0
        value = integral + held @ self.gain[who] + prior + missed.sum(axis=1)
        return value, missed, (mean, covariance)

    def most_precise(self, who: IntArray, member: IntArray, count: int) -> IntArray:
        """``(G,)`` the member of each group whose place is surest."""
        first = np.zeros(count, dtype=np.int64)
        order = np.argsort(self.precise[who], kind="stable")
        first[member[order]] = who[order]
        return first

    def _alike(self, mine: IntArray, who: IntArray, member: IntArray, count: int) -> FloatArray:
        """``(n, G)`` what appearance adds, the mean over the members that were seen from a like side."""
        assert self.points.alike is not None
        held = who >= self.tracks
        total = np.zeros((count, len(mine)))
        np.add.at(total, member[held], self.points.alike[who[held] - self.tracks][:, mine])
        sizes = np.bincount(member[held], minlength=count)
        return np.asarray((total / np.maximum(sizes, 1)[:, None]).T)

    def _barred(self, mine: IntArray, who: IntArray, member: IntArray, count: int) -> BoolArray:
        """``(n, G)`` where two certain names contradict each other."""
        named = np.full(count, -1)
        held = who >= self.tracks
        names = self.points.names[who[held] - self.tracks]
        named[member[held][names >= 0]] = names[names >= 0]
        own = self.points.names[mine]
        return np.asarray((own[:, None] >= 0) & (named[None] >= 0) & (own[:, None] != named[None]))


def inverted(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inverses and determinants of symmetric ``(N, 2, 2)`` matrices."""
    a, b, c = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 1]
    determinant = a * c - b * b
    inverse = np.empty_like(matrices)
    inverse[:, 0, 0], inverse[:, 1, 1] = c / determinant, a / determinant
    inverse[:, 0, 1] = inverse[:, 1, 0] = -b / determinant
    return inverse, determinant


def _log_normal(apart: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``log N(apart; 0, covariance)`` of ``(..., 2)`` and ``(..., 2, 2)``, and the squared Mahalanobis distance."""
    a, b, c = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    determinant = a * c - b * b
    x, y = apart[..., 0], apart[..., 1]
    square = (c * x * x - 2 * b * x * y + a * y * y) / determinant
    return np.asarray(-LOG_TWO_PI - 0.5 * np.log(determinant) - 0.5 * square), np.asarray(square)


@dataclass(frozen=True)
class PersonNodes:
    """Groups of all moments: the nodes of the flow.

    Attributes:
        moment: ``(G,)``.
        places: ``(G, 2)``.
        covariances: ``(G, 2, 2)``.
        weight: ``(G,)`` V without a prior.
        missed: ``(G,)`` log probability that no sensor finds somebody there.
        node: ``(N,)`` group of each point.
    """

    moment: IntArray
    places: FloatArray
    covariances: FloatArray
    weight: FloatArray
    missed: FloatArray
    node: IntArray

    def highest(self, names: IntArray) -> IntArray:
        """``(G,)`` certain names of the nodes from those of their points, -1 for none."""
        found = np.full(len(self.moment), -1)
        np.maximum.at(found, self.node, names)
        return found


def weighed(points: MomentPoints, label: IntArray, moment: int) -> PersonNodes:
    """The groups of one moment as nodes, in the order of their labels."""
    climb = _Climb(points, 0.0, None)
    numbers, member = np.unique(label, return_inverse=True)
    value, _, (mean, covariance) = climb.values(np.arange(len(label)), member, len(numbers))
    missed = climb.missed[climb.most_precise(np.arange(len(label)), member, len(numbers))].sum(axis=1)
    return PersonNodes(np.full(len(numbers), moment), mean, covariance, value, missed, member.astype(np.int64))


def joined_nodes(parts: Sequence[PersonNodes]) -> PersonNodes:
    """The nodes of all moments."""
    columns = ("moment", "places", "covariances", "weight", "missed", "node")
    return PersonNodes(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in columns})
