"""Pairs of detections whose action features change from flow to flow, and what they cost (thesis eq. 2.14 and 5.2).

Which pairs are plausible, and how they differ in place, size and appearance, is computed once. What their actions say
is computed for every flow, and only where it has changed is a pair priced again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.association.costs import PairFeatures, TransitionCost, inner_products, pair_features
from tsuiseki.tracking.association.flow.network_flow import FlowGraph, build_graph
from tsuiseki.tracking.association.gating import GateSettings, candidate_pairs
from tsuiseki.tracking.association.rows import DetectionRows
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# A smaller change of an action distance than this moves no cost that matters; below 0, everything counts as changed.
SAME_DISTANCE = 1e-3
ALL_NEW = -1.0


@dataclass(frozen=True)
class PricedPairs:
    """Detections that may be linked, and what their links cost.

    Attributes:
        i: ``(P,)`` indices of the earlier detections.
        j: ``(P,)`` indices of the later ones.
        pairs: how they differ; ``action`` as it was when each was priced.
        costs: ``(P,)`` c_tran.
        waiting: ``(P,)`` what the frames between them cost.
    """

    i: IntArray
    j: IntArray
    pairs: PairFeatures
    costs: FloatArray
    waiting: FloatArray


def price_pairs(
    rows: DetectionRows, actions: FloatArray | None, transition: TransitionCost, gate: GateSettings, miss: float
) -> PricedPairs:
    """The pairs within the gate at the prices of single-frame features: what is computed once.

    Args:
        rows: the detections.
        actions: ``(N, A)`` probabilities, or None.
        transition: prices the pairs.
        gate: which detections may be linked.
        miss: cost of every frame between two linked detections.
    """
    i, j, gap = candidate_pairs(rows.frames, rows.boxes, gate)
    distances = None if actions is None else action_distances(actions, actions, i, j)
    pairs = replace(pair_features(rows.boxes, rows.features, i, j, gap), action=distances)
    return PricedPairs(i, j, pairs, transition(pairs), miss * np.asarray(gap - 1, dtype=np.float64))


def reprice(priced: PricedPairs, distances: FloatArray, transition: TransitionCost, smallest: float) -> PricedPairs:
    """The pairs at the prices of other action features; only what has changed is priced.

    Args:
        priced: the pairs as they were.
        distances: ``(P,)`` of their action features as they are.
        transition: prices the pairs.
        smallest: a change of distance of no more leaves a pair at its price.
    """
    assert priced.pairs.action is not None
    changed = np.flatnonzero(np.abs(distances - priced.pairs.action) > smallest)
    priced_at, costs = priced.pairs.action.copy(), priced.costs.copy()
    priced_at[changed] = distances[changed]
    pairs = replace(priced.pairs, action=priced_at)
    costs[changed] = transition(pairs.select(changed))
    return replace(priced, pairs=pairs, costs=costs)


def network(
    observation: FloatArray, priced: PricedPairs, entry: float, exit: float, goes_on: BoolArray | None = None
) -> FlowGraph:
    """The flow network of eq. 2.17.

    Args:
        observation: ``(N,)`` c_obsv of the detections.
        priced: pairs of them.
        entry: cost of a track's start.
        exit: cost of a track's end.
        goes_on: ``(N,)`` detections after which the video goes on, where a track may end for nothing.
    """
    links = (priced.i, priced.j, priced.costs + priced.waiting)
    graph = build_graph(observation, [links], entry, exit)
    return graph if goes_on is None else replace(graph, exit=np.where(goes_on, 0.0, graph.exit))


def action_distances(earlier: FloatArray, later: FloatArray, i: IntArray, j: IntArray) -> FloatArray:
    """``(P,)`` cosine distances of the rows ``i`` of ``earlier`` and ``j`` of ``later``, in [0, 1]: c_saf of eq. 5.2.

    Args:
        earlier: ``(N, A)`` action probabilities.
        later: ``(N, A)`` likewise, or the same.
        i: ``(P,)`` indices.
        j: ``(P,)`` indices.
    """
    unit = [actions / np.maximum(np.linalg.norm(actions, axis=1, keepdims=True), 1e-9) for actions in (earlier, later)]
    return np.clip(1 - inner_products(unit[0], unit[1], i, j), 0, 1)
