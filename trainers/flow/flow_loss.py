"""Losses of whole flows, with their gradients by the costs, from the exact solver.

A flow x of a window with N detections and P links is a vector of 2 N + N + P arcs: for each detection whether it is
used, whether a track starts and whether one ends there, and for each link whether it is taken. With c the costs of the
arcs, x̂(c) = argmin c·x over all flows, and x* the labelled flow:

* Fenchel-Young, perturbed (Berthet et al. 2020): L(c) = c·x* − E_Z[min_x (c + εZ)·x], Z standard normal. It is convex
  in c, at least 0 in expectation, and its gradient is x* − E[x̂(c + εZ)].
* Structured hinge (Wang and Fowlkes 2016): L(c) = c·x* − min_x [c·x − Δ(x, x*)], Δ a weighted Hamming distance. It is
  convex and at least 0, and 0 where x* is cheaper than every other flow by its Δ. A subgradient is x* − x̂ of that
  minimum.
* Both: the mean of the two. Noise tells what may go wrong anywhere near the costs, the margin what goes most wrong.

In each the solver is asked for minima only, so it may be any; nothing is differentiated through it.

The perturbed minima are also a smoothed flow E[x̂(c + εZ)]. Its derivative by c is E[x̂(c + εZ) Zᵀ] / ε; antithetic pairs
estimate it by the mean of (x̂(c + εZ) − x̂(c − εZ)) Zᵀ / (2 ε), which is 0 where the noise changes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import torch
from torch import Tensor

from tsuiseki.tracking.association.network_flow import FlowGraph, solve
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

FlowLossName = Literal["fenchel_young", "hinge", "both"]


@dataclass(frozen=True)
class Arcs:
    """Which arcs a window has, and which of them are the labelled flow's.

    Attributes:
        tail: ``(P,)`` index of the earlier detection of each link.
        head: ``(P,)`` of the later one.
        labelled: ``(3 N + P,)`` the labelled flow x*: used, starts, ends, links.
        weight: ``(3 N + P,)`` what Δ counts for an arc that differs from x*.
    """

    tail: IntArray
    head: IntArray
    labelled: FloatArray
    weight: FloatArray

    @property
    def count(self) -> int:
        """N, the number of detections."""
        return (len(self.labelled) - len(self.tail)) // 3


def cheapest(costs: FloatArray, tail: IntArray, head: IntArray) -> FloatArray:
    """``(3 N + P,)`` the cheapest flow, 0 or 1 an arc, at as many costs; its links go from ``tail`` to ``head``."""
    count = (len(costs) - len(tail)) // 3
    observation, start, end, link = np.split(costs, [count, 2 * count, 3 * count])
    # A link that costs as much as an end and a start is never needed.
    worth = np.flatnonzero(link < end[tail] + start[head])
    solution = solve(FlowGraph(observation, start, end, tail[worth], head[worth], link[worth]))
    starts = solution.used.copy()
    starts[solution.follower[solution.follower >= 0]] = False
    flow = np.zeros(len(link))
    flow[worth] = solution.follower[tail[worth]] == head[worth]
    return np.concatenate([solution.used, starts, solution.used & (solution.follower < 0), flow]).astype(np.float64)


def differing(arcs: Arcs) -> tuple[float, FloatArray]:
    """Δ(x, x*) = constant + slope · x for flows x, which are 0 or 1 on every arc: the constant and the slope."""
    return float((arcs.weight * arcs.labelled).sum()), arcs.weight * (1 - 2 * arcs.labelled)


@dataclass(frozen=True)
class Minima:
    """What the minima at costs c say of the flow there.

    Attributes:
        loss: L(c).
        gradient: ``(3 N + P,)`` of the loss.
        draws: ``(K, 3 N + P)`` the perturbations εZ; none for ``hinge``.
        flows: ``(2 K, 3 N + P)`` x̂(c + εZ) and x̂(c − εZ) in turn.
    """

    loss: float
    gradient: FloatArray
    draws: FloatArray
    flows: FloatArray


@dataclass(frozen=True)
class FlowLoss:
    """The loss of whole flows.

    Attributes:
        name: ``fenchel_young``, ``hinge``, or ``both`` for their mean.
        epsilon: ε, deviation of the perturbation of every cost; of ``fenchel_young`` and ``both``.
        pairs: K, antithetic pairs Z, −Z of perturbations that estimate the expectation in a step.
    """

    name: FlowLossName = "both"
    epsilon: float = 1.0
    pairs: int = 1

    def __post_init__(self) -> None:
        whole = isinstance(self.pairs, int) and self.pairs >= 1
        if self.name not in get_args(FlowLossName) or not 0 < self.epsilon < np.inf or not whole:
            names = ", ".join(get_args(FlowLossName))
            raise RequestError(f"expected the loss {names}, epsilon above 0 and a number of pairs from 1, got {self}")

    def minima(self, costs: FloatArray, arcs: Arcs, rng: np.random.Generator) -> Minima:
        """The loss at ``(3 N + P,)`` costs, its gradient and the smoothed flow there, from minima at other costs.

        These are perturbed for ``fenchel_young``, and less the difference from x* for ``hinge``.
        """
        perturbed, constant, draws = list[FloatArray](), 0.0, np.empty((0, len(costs)))
        if self.name != "hinge":
            draws = self.epsilon * rng.standard_normal((self.pairs, len(costs)))
            perturbed += [costs + sign * draw for draw in draws for sign in (1, -1)]
        if self.name != "fenchel_young":
            constant, slope = differing(arcs)
            perturbed.append(costs - slope)
        flows = np.array([cheapest(draw_costs, arcs.tail, arcs.head) for draw_costs in perturbed])
        least = np.array([draw_costs @ flow for draw_costs, flow in zip(perturbed, flows, strict=True)])
        least[-1] -= constant
        share = np.full(len(perturbed), 1 / len(perturbed))
        if self.name == "both":
            share[:] = 0.25 / self.pairs
            share[-1] = 0.5
        loss, gradient = float(costs @ arcs.labelled - share @ least), arcs.labelled - share @ flows
        return Minima(loss, gradient, draws, flows[: 2 * len(draws)])


def labelled_flow(
    frames: IntArray, owners: IntArray, tail: IntArray, head: IntArray, all_used: bool = False
) -> FloatArray:
    """``(3 N + P,)`` x*: detections of a person that follow each other in time are linked where there is a link.

    Args:
        frames: ``(N,)`` of the detections.
        owners: ``(N,)`` whose each detection is, below 0 for a false positive.
        tail: ``(P,)``.
        head: ``(P,)``.
        all_used: false positives are used, too, each by itself.
    """
    followed = next_of_owner(frames, owners)[tail] == head
    used = np.ones(len(frames), np.bool_) if all_used else owners >= 0
    starts, ends = used.copy(), used.copy()
    starts[head[followed]] = False
    ends[tail[followed]] = False
    return np.concatenate([used, starts, ends, followed]).astype(np.float64)


def next_of_owner(frames: IntArray, owners: IntArray) -> IntArray:
    """``(N,)`` the next detection of the same person in time, -1 where there is none."""
    order = np.lexsort([frames, owners])
    same = (owners[order[:-1]] == owners[order[1:]]) & (owners[order[:-1]] >= 0)
    follower = np.full(len(frames), -1, dtype=np.int64)
    follower[order[:-1][same]] = order[1:][same]
    return follower


# What Δ counts for a detection that is used and false, or right and not used.
MISSED = 1.0
# What Δ counts for a start or an end where the labelled flow has none.
BROKEN = 0.5
# What Δ counts for a link between detections that are not of one person.
WRONG = 2.0


def difference_weights(owners: IntArray, tail: IntArray, head: IntArray, labelled: FloatArray) -> FloatArray:
    """``(3 N + P,)`` what Δ counts for arcs that differ from the labelled flow.

    A link to the next but one detection of the same person counts nothing, since the missed detection does; nor does an
    arc that is not taken, since what is taken in its stead does. So a missed detection within a track costs 1, one at
    its end 1.5, one over which there is no link 2; a broken track costs 1; two people who are swapped cost two wrong
    links, 4: a switch costs more than a missed box.

    Args:
        owners: ``(N,)`` whose each detection is, below 0 for a false positive.
        tail: ``(P,)``.
        head: ``(P,)``.
        labelled: ``(3 N + P,)`` x*.
    """
    count = len(owners)
    same: BoolArray = (owners[tail] == owners[head]) & (owners[tail] >= 0)
    ends = np.where(labelled[count : 3 * count] > 0, 0.0, BROKEN)
    return np.concatenate([np.full(count, MISSED), ends, np.where(same, 0.0, WRONG)])


def finite(values: Tensor, name: str, what: str = "loss") -> Tensor:
    """The loss, or the costs, of the window ``name``.

    Raises:
        RunError: one of them is no number.
    """
    wrong = values.detach()[~torch.isfinite(values.detach())]
    if len(wrong):
        raise RunError(
            f"the {what} is {wrong[0].item()} on {name}; lower --model.optimisation.learning_rate and start again"
        )
    return values
