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

# Logarithm of 2π, of the density of a Gaussian in the plane.
LOG_TWO_PI = float(np.log(2 * np.pi))
# Times that all sensors are assigned anew, at most.
SWEEPS = 4
# The first of these sweeps, in which all detections count as people.
GATHERING = 1
# Squared Mahalanobis distance up to which a detection may join a group while gathering: three deviations.
GATE = 9.0
# Weight of a detection in a group of another certain name, nats: below any sum of others.
BARRED = -1e9


@dataclass(frozen=True)
class MomentPoints:
    """What was measured, moment by moment.

    Attributes:
        moment: ``(N,)`` number of each point's, rising.
        sensor: ``(N,)`` of each point.
        places: ``(N, 2)``.
        covariances: ``(N, 2, 2)``.
        gain: ``(N,)`` log p_D - log κ.
        missed: ``(N, S)`` log(1 - p_D v) of each sensor there.
        names: ``(N,)`` who it is for certain, or -1.
        affinities: of each moment ``(n, n)`` log ratios by which appearance makes two points one person; or None.
    """

    moment: IntArray
    sensor: IntArray
    places: FloatArray
    covariances: FloatArray
    gain: FloatArray
    missed: FloatArray
    names: IntArray
    affinities: Sequence[FloatArray] | None = None


@dataclass(frozen=True)
class ExpectedTracks:
    """Tracks that are expected.

    Attributes:
        moment: ``(K,)`` at which each is expected, rising; a track is in as many rows as moments.
        places: ``(K, 2)``.
        covariances: ``(K, 2, 2)``.
        missed: ``(K, S)``.
    """

    moment: IntArray
    places: FloatArray
    covariances: FloatArray
    missed: FloatArray


def group(points: MomentPoints, density: float, expected: ExpectedTracks | None = None) -> IntArray:
    """``(N,)`` number of the group of each point.

    The moments know nothing of each other; all take the same step at once, which is much faster.

    Args:
        points: N, of S sensors.
        density: people a square metre where none is expected.
        expected: K tracks; groups 0 to K - 1 go on with them, the others begin.
    """
    climb = _Climb(points, np.log(density), expected)
    label = climb.tracks + np.arange(len(points.sensor))
    going = np.ones(int(climb.moment.max(initial=-1)) + 1, dtype=np.bool_)
    for sweep in range(SWEEPS):
        previous = label
        for sensor in np.unique(points.sensor).tolist():
            label = climb.reassigned(label, sensor, going, sweep < GATHERING)
        if sweep >= GATHERING:
            going = np.isin(np.arange(len(going)), points.moment[label != previous])
    return label


class _Climb:
    """Points and tracks with what never changes about them."""

    def __init__(self, points: MomentPoints, density: float, expected: ExpectedTracks | None) -> None:
        self.points, self.density = points, density
        self.tracks = 0 if expected is None else len(expected.places)
        self.moment, places, covariances, missed = points.moment, points.places, points.covariances, points.missed
        if expected is not None:
            self.moment = np.concatenate([expected.moment, points.moment])
            places = np.concatenate([expected.places, places])
            covariances = np.concatenate([expected.covariances, covariances])
            missed = np.concatenate([expected.missed, missed])
        information, determinant = inverted(covariances)
        vector = np.matmul(information, places[..., None])[..., 0]
        constant = -LOG_TWO_PI - 0.5 * np.log(determinant) - 0.5 * (vector * places).sum(axis=1)
        gain = np.concatenate([np.zeros(self.tracks), points.gain])
        # What adds up over the members of a group, a row each.
        self.sums = np.stack(
            [
                information[:, 0, 0],
                information[:, 0, 1],
                information[:, 1, 1],
                vector[:, 0],
                vector[:, 1],
                constant,
                gain,
            ]
        )
        self.missed, self.gain, self.precise = missed, gain, 1.0 / determinant
        # The most that joining a group may bring, but for its misses.
        self.trace = _trace(points.covariances)
        self.bound = points.gain - LOG_TWO_PI - 0.5 * np.log(determinant[self.tracks :])
        self.named = bool((points.names >= 0).any())
        if points.affinities is not None:
            first = np.searchsorted(points.moment, points.moment)
            self.within = np.arange(len(first)) - first
            self.blocks = np.cumsum([0, *(block.size for block in points.affinities)])[:-1]
            self.affinities = np.concatenate([np.empty(0), *(block.ravel() for block in points.affinities)])
            self.block = np.unique(points.moment, return_inverse=True)[1]
            self.width = np.array([len(block) for block in points.affinities], dtype=np.int64)
            self.bound = self.bound + self.affinities.max(initial=0.0)

    def reassigned(self, label: IntArray, sensor: int, going: BoolArray, gathering: bool) -> IntArray:
        """The labels after the points of one sensor, in the moments still ``going``, chose their groups anew.

        While ``gathering``, all count as people: a group of two that three other sensors miss weighs less than nothing,
        and would never become one of five.
        """
        points, tracks = self.points, self.tracks
        of_sensor = points.sensor == sensor
        here = going & np.isin(np.arange(len(going)), points.moment[of_sensor])
        mine, others = (np.flatnonzero(of & here[points.moment]) for of in (of_sensor, ~of_sensor))
        expected = np.flatnonzero(here[self.moment[:tracks]])
        who = np.concatenate([expected, tracks + others])
        if not len(mine) or not len(who):
            return label
        _, first, member = np.unique(np.concatenate([expected, label[others]]), return_index=True, return_inverse=True)
        # A new group bears the number of one of its members, which must not be among those taken out.
        numbers = who[first]
        value, missed, mean, covariance = self.values(who, member, len(numbers))
        alone = points.gain[mine] + self.density + points.missed[mine].sum(axis=1) - points.missed[mine, sensor]
        pair_rows, columns, sizes = _within_moments(points.moment[mine], self.moment[numbers])
        # The others are too far apart to be joined, whatever their shapes.
        apart = ((points.places[mine][pair_rows] - mean[columns]) ** 2).sum(axis=1)
        reach = self.trace[mine][pair_rows] + _trace(covariance)[columns]
        limit = GATE if gathering else 2 * (self.bound[mine][pair_rows] - missed[:, sensor][columns])
        near = np.flatnonzero(apart <= limit * reach)
        i, g = pair_rows[near], columns[near]
        fit, square = log_normal(points.places[mine][i] - mean[g], points.covariances[mine][i] + covariance[g])
        joined = value[g] + points.gain[mine][i] - missed[g, sensor] + fit
        if points.affinities is not None:
            joined += self._affinity(mine, i, g, who, member, len(numbers))
        if self.named:
            joined[self._barred(mine, i, g, who, member, len(numbers))] = BARRED
        # A group or point of negative weight is a false alarm, and weighs nothing.
        least = -np.inf if gathering else 0.0
        profit = np.maximum(joined, least) - np.maximum(value, least)[g] - np.maximum(alone, least)[i]
        if gathering:
            profit[square > GATE] = 0.0
        result = label.copy()
        result[others] = numbers[member[len(expected) :]]
        result[mine] = tracks + mine
        profits = np.zeros(len(pair_rows))
        profits[near] = np.maximum(profit, 0.0)
        rows, chosen = _assigned(profits, points.moment[mine], columns, sizes)
        result[mine[rows]] = numbers[chosen]
        return result

    def values(
        self, who: IntArray, member: IntArray, count: int
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Weights V of the groups, their misses ``(G, S)``, means and covariances."""
        # Gaussians multiplied by group: information and its vector give the mean, the rest the integral.
        a, b, c, x, y, constant, gain = (np.bincount(member, weights=row, minlength=count) for row in self.sums[:, who])
        determinant = a * c - b * b
        covariance = np.stack([c, -b, -b, a], axis=1).reshape(-1, 2, 2) / determinant[:, None, None]
        mean = np.stack([c * x - b * y, a * y - b * x], axis=1) / determinant[:, None]
        integral = constant + LOG_TWO_PI - 0.5 * np.log(determinant) + 0.5 * (mean[:, 0] * x + mean[:, 1] * y)
        missed = self.missed[self.most_precise(who, member, count)].copy()
        real = who >= self.tracks
        missed[member[real], self.points.sensor[who[real] - self.tracks]] = 0.0
        prior = np.full(count, self.density)
        prior[member[~real]] = 0.0
        return integral + gain + prior + missed.sum(axis=1), missed, mean, covariance

    def most_precise(self, who: IntArray, member: IntArray, count: int) -> IntArray:
        """``(G,)`` the member of each group whose place is surest."""
        first = np.zeros(count, dtype=np.int64)
        order = np.argsort(self.precise[who], kind="stable")
        first[member[order]] = who[order]
        return first

    def _affinity(
        self, mine: IntArray, i: IntArray, g: IntArray, who: IntArray, member: IntArray, count: int
    ) -> FloatArray:
        """``(P,)`` what appearance adds to pairs, the mean over the members in view from a like side."""
        held = who >= self.tracks
        others, groups = who[held] - self.tracks, member[held]
        # All pairs of a point of the sensor and another point of its moment, added up by group.
        row, of, _ = _within_moments(self.points.moment[mine], self.points.moment[others])
        point, partner = mine[row], others[of]
        block = self.block[point]
        ratio = self.affinities[self.blocks[block] + self.within[point] * self.width[block] + self.within[partner]]
        total = np.bincount(row * count + groups[of], weights=ratio, minlength=len(mine) * count)
        return np.asarray(total[i * count + g] / np.maximum(np.bincount(groups, minlength=count), 1)[g])

    def _barred(
        self, mine: IntArray, i: IntArray, g: IntArray, who: IntArray, member: IntArray, count: int
    ) -> BoolArray:
        """``(P,)`` where two certain names contradict each other."""
        named = np.full(count, -1)
        held = who >= self.tracks
        names = self.points.names[who[held] - self.tracks]
        named[member[held][names >= 0]] = names[names >= 0]
        point_names = self.points.names[mine][i]
        return np.asarray((point_names >= 0) & (named[g] >= 0) & (point_names != named[g]))


def _within_moments(rows: IntArray, columns: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Pairs ``(P,)`` of a row and a column of one moment, row by row, and how many each row has.

    Args:
        rows: ``(n,)`` moments, rising.
        columns: ``(m,)`` moments; those of one moment keep their order.
    """
    order = np.argsort(columns, kind="stable")
    sizes = np.bincount(columns, minlength=int(rows.max(initial=-1)) + 1)
    ends = np.cumsum(sizes)
    partners = sizes[rows]
    i = np.repeat(np.arange(len(rows)), partners)
    return i, order[np.arange(len(i)) + np.repeat(ends[rows] - np.cumsum(partners), partners)], partners


def _assigned(profit: FloatArray, moment: IntArray, columns: IntArray, sizes: IntArray) -> tuple[IntArray, IntArray]:
    """Rows and columns of greatest profit in each moment, those of none left out, for pairs of `_within_moments`."""
    edges = np.append(np.flatnonzero(np.diff(moment, prepend=-1)), len(moment))
    ends = np.append(0, np.cumsum(sizes))
    rows, chosen = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        start, width = ends[first], sizes[first]
        block = profit[start : ends[last]].reshape(last - first, width)
        if width and (block > 0).any():
            row, column = scipy.optimize.linear_sum_assignment(block, maximize=True)
            profitable = block[row, column] > 0
            rows.append(first + row[profitable])
            chosen.append(columns[start + column[profitable]])
    return np.concatenate(rows), np.concatenate(chosen)


def inverted(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inverses and determinants of symmetric ``(N, 2, 2)`` matrices."""
    a, b, c = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 1]
    determinant = a * c - b * b
    inverse = np.empty_like(matrices)
    inverse[:, 0, 0], inverse[:, 1, 1] = c / determinant, a / determinant
    inverse[:, 0, 1] = inverse[:, 1, 0] = -b / determinant
    return inverse, determinant


def _trace(matrices: FloatArray) -> FloatArray:
    return np.asarray(matrices[:, 0, 0] + matrices[:, 1, 1])


def log_normal(apart: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
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
        highest = np.full(len(self.moment), -1)
        np.maximum.at(highest, self.node, names)
        return highest


def weighed(points: MomentPoints, label: IntArray) -> tuple[PersonNodes, IntArray]:
    """The groups as nodes, by moment and then by label, and the label of each."""
    climb, indices = _Climb(points, 0.0, None), np.arange(len(label))
    numbers, first, member = np.unique(label, return_index=True, return_inverse=True)
    order = np.argsort(points.moment[first], kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    member = place[member]
    value, _, mean, covariance = climb.values(indices, member, len(numbers))
    missed = climb.missed[climb.most_precise(indices, member, len(numbers))].sum(axis=1)
    return PersonNodes(points.moment[first[order]], mean, covariance, value, missed, member), numbers[order]


def joined_nodes(parts: Sequence[PersonNodes]) -> PersonNodes:
    """The nodes of all parts of a video."""
    columns = ("moment", "places", "covariances", "weight", "missed", "node")
    return PersonNodes(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in columns})
