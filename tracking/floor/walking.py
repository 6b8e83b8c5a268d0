"""How people walk on a floor: Kalman filters along tracks from either side, and the cost of a link between two nodes.

The state is (x, y) and its velocity, which changes at random (white acceleration of strength q):

    P ← F P Fᵀ + q² [[|τ|³/3, τ|τ|/2], [τ|τ|/2, |τ|]] on each axis,    F = [[1, τ], [0, 1]].

From behind, τ is negative. A link's likelihood is that of the future's state given the past's, over that of the
velocity alone, so that two lone nodes are compared by their places.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.filters.kalman import Gaussians
from tsuiseki.tracking.floor.grouping import inverted, log_normal
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# ``(2, 4)`` takes the place of a state.
PLACE = np.eye(2, 4)
# Squared Mahalanobis distance from which a measured place begins a track anew: four deviations.
SURPRISE = 16.0
# Standard deviation of a velocity along each axis, m/s.
SPEED = 0.9
# Strength q of the change of a velocity, m/s over the root of a second.
RESTLESS = 0.4
# Share of the links with a sudden turn or a measurement that is far off.
TURNS = 0.03
# Standard deviation of their mean velocity along each axis, m/s.
TURNING = 2.0
# New people per square metre and second.
BIRTHS = 0.004
# Mean time for which a person is there, seconds.
LIVES = 20.0


def start(places: FloatArray, covariances: FloatArray) -> Gaussians:
    """States ``(G, 4)`` at ``(G, 2)`` measured places, of unknown velocity."""
    mean = np.zeros((len(places), 4))
    mean[:, :2] = places
    covariance = np.zeros((len(places), 4, 4))
    covariance[:, :2, :2] = covariances
    covariance[:, 2:, 2:] = SPEED**2 * np.eye(2)
    return Gaussians(mean, covariance)


def moved(states: Gaussians, seconds: FloatArray) -> Gaussians:
    """The states ``seconds`` ``(N,)`` later, or earlier where they are negative."""
    mean, covariance, tau = states.mean.copy(), states.covariance.copy(), seconds[:, None, None]
    mean[:, :2] += seconds[:, None] * mean[:, 2:]
    across, velocity = states.covariance[:, :2, 2:], states.covariance[:, 2:, 2:]
    length, noise = np.abs(tau), RESTLESS**2 * np.eye(2)
    covariance[:, :2, :2] += tau * (across + across.swapaxes(1, 2)) + tau**2 * velocity + length**3 / 3 * noise
    covariance[:, :2, 2:] += tau * velocity + tau * length / 2 * noise
    covariance[:, 2:, :2] = covariance[:, :2, 2:].swapaxes(1, 2)
    covariance[:, 2:, 2:] += length * noise
    return Gaussians(mean, covariance)


@dataclass(frozen=True)
class Expectations:
    """Where tracks are expected, by track and moment; from both sides where both are known.

    Attributes:
        track: ``(E,)``.
        moment: ``(E,)`` in order.
        states: E of them, without the node of that moment.
    """

    track: IntArray
    moment: IntArray
    states: Gaussians

    def chosen(self, rows: BoolArray) -> Expectations:
        """Those of ``rows`` ``(E,)``."""
        states = Gaussians(self.states.mean[rows], self.states.covariance[rows])
        return Expectations(self.track[rows], self.moment[rows], states)


def filtered(
    steps: FloatArray, table: IntArray, places: FloatArray, covariances: FloatArray, beyond: int
) -> tuple[Gaussians, Expectations]:
    """One pass along all tracks.

    Args:
        steps: ``(K, T)`` seconds of each moment since the one before it in the pass; negative from behind.
        table: ``(K, T)`` node of each track at each moment, -1 for none.
        places: ``(G, 2)`` of the nodes.
        covariances: ``(G, 2, 2)``.
        beyond: moments for which a track is expected after its last node.

    Returns:
        The state of each node's track there, nodes of no track as if alone; and where tracks are expected.
    """
    states = start(places, covariances)
    filled = table >= 0
    count = table.shape[1]
    first, last = filled.argmax(axis=1), count - 1 - filled[:, ::-1].argmax(axis=1)
    live = np.full((len(table), 4), np.nan)
    spread = np.full((len(table), 4, 4), np.nan)
    none, blank = np.empty(0, dtype=np.int64), (np.empty((0, 4)), np.empty((0, 4, 4)))
    expectations: list[tuple[IntArray, IntArray, FloatArray, FloatArray]] = [(none, none, *blank)]
    for moment in range(count):
        going = np.flatnonzero((first < moment) & (moment <= last + beyond))
        if len(going):
            ahead = moved(Gaussians(live[going], spread[going]), steps[going, moment])
            live[going], spread[going] = ahead.mean, ahead.covariance
            expectations.append((going, np.full(len(going), moment), ahead.mean, ahead.covariance))
            node = table[going, moment]
            here = node >= 0
            met, node = going[here], node[here]
            if len(met):
                posterior, square = _updated(live[met], spread[met], places[node], covariances[node])
                # Who turned at once begins anew: the state stays that of the node alone.
                calm = square <= SURPRISE
                states.mean[node[calm]], states.covariance[node[calm]] = (
                    posterior.mean[calm],
                    posterior.covariance[calm],
                )
                live[met], spread[met] = states.mean[node], states.covariance[node]
        new = np.flatnonzero(first == moment)
        new = new[filled[new, moment]]
        live[new], spread[new] = states.mean[table[new, moment]], states.covariance[table[new, moment]]
    track, at, mean, covariance = (np.concatenate(column) for column in zip(*expectations, strict=True))
    return states, Expectations(track, at, Gaussians(mean, covariance))


def _updated(
    mean: FloatArray, covariance: FloatArray, places: FloatArray, noise: FloatArray
) -> tuple[Gaussians, FloatArray]:
    """The states ``(N, 4)`` after a measured place each, and ``(N,)`` the squared Mahalanobis distance to it."""
    residual = places - mean[:, :2]
    inverse, _ = inverted(covariance[:, :2, :2] + noise)
    solved = np.matmul(inverse, residual[..., None])
    gain = np.matmul(covariance[:, :, :2], inverse)
    posterior = mean + np.matmul(covariance[:, :, :2], solved)[..., 0]
    return Gaussians(posterior, covariance - np.matmul(gain, covariance[:, :2])), (residual * solved[..., 0]).sum(
        axis=1
    )


def from_both_sides(ahead: Expectations, behind: Expectations, moments: int) -> Expectations:
    """Two passes as one: the product of both states, over the prior of the velocity that both of them hold."""
    codes_by_pass = [expected.track * moments + expected.moment for expected in (ahead, behind)]
    codes = np.unique(np.concatenate(codes_by_pass))
    information, vector = np.zeros((len(codes), 4, 4)), np.zeros((len(codes), 4))
    times = np.zeros(len(codes), dtype=np.int64)
    for pass_codes, expected in zip(codes_by_pass, (ahead, behind), strict=True):
        at = np.searchsorted(codes, pass_codes)
        inverse = np.linalg.inv(expected.states.covariance)
        information[at] += inverse
        vector[at] += np.einsum("nij,nj->ni", inverse, expected.states.mean)
        times[at] += 1
    twice = times == 2
    for axis in (2, 3):
        information[twice, axis, axis] -= SPEED**-2
    covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
    mean = np.einsum("nij,nj->ni", covariance, vector)
    order = np.lexsort([codes // moments, codes % moments])
    codes = codes[order]
    return Expectations(codes // moments, codes % moments, Gaussians(mean[order], covariance[order]))


def link_likelihood(past: Gaussians, future: Gaussians, seconds: FloatArray) -> FloatArray:
    """``(P,)`` log density of going on from each state of the past to each of the future, a square metre."""
    ahead = moved(past, seconds)
    apart, spread = future.mean - ahead.mean, future.covariance + ahead.covariance
    # The density of the place, times that of the velocity given the place.
    inverse, _ = inverted(spread[:, :2, :2])
    gain = np.matmul(spread[:, 2:, :2], inverse)
    place, _ = log_normal(apart[:, :2], spread[:, :2, :2])
    velocity_gap = apart[:, 2:] - np.matmul(gain, apart[:, :2, None])[..., 0]
    velocity, _ = log_normal(velocity_gap, spread[:, 2:, 2:] - np.matmul(gain, spread[:, :2, 2:]))
    free, _ = log_normal(ahead.mean[:, 2:], ahead.covariance[:, 2:, 2:] + SPEED**2 * np.eye(2))
    wide = (TURNING * seconds) ** 2
    anyhow = past.covariance[:, :2, :2] + future.covariance[:, :2, :2] + wide[:, None, None] * np.eye(2)
    turned, _ = log_normal(future.mean[:, :2] - past.mean[:, :2], anyhow)
    going = np.log1p(-TURNS) + place + velocity - free
    return np.asarray(np.logaddexp(going, np.log(TURNS) + turned))
