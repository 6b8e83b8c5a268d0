"""Costs of links fitted to what a person said: whether links as dear, over gaps as long, were right in this video."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.review.corrections import Correction
from tsuiseki.tracking.review.demands import NOTHING, Finder
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# After so many corrections, and every time as many more, costs are fitted anew.
EVERY = 20
# Parts of the answers that are held out in turn, and how strongly the fit holds to the costs as they were.
PARTS, PRIOR = 4, 2.0


def refitted(network: SolvedNetwork, said: Sequence[Correction]) -> SolvedNetwork:
    """The network with costs fitted to corrections, where those that were held out are better explained, too.

    That two detections follow each other has the logit of what ending one track and starting another costs more than
    their link (eq. 2.14). The fit adds a constant, a share of the cost, and a share of the doublings of the gap.

    Args:
        network: as it was solved.
        said: corrections.
    """
    i, j, same = _answers(network, said)
    links = network.graph.tail * len(network) + network.graph.head
    order = np.argsort(links)
    place = np.searchsorted(links, i * len(network) + j, sorter=order).clip(max=max(len(links) - 1, 0))
    known = links[order[place]] == i * len(network) + j if len(links) else np.zeros(0, np.bool_)
    arcs, right = order[place[known]] if len(links) else i[:0], same[known]
    if min(right.sum(), (~right).sum()) < PARTS:
        return network
    evidence, usual = _evidence(network)
    part = np.arange(len(arcs)) % PARTS
    before = after = 0.0
    for held in range(PARTS):
        learnt, out = arcs[part != held], arcs[part == held]
        weights = _fit(evidence[learnt], usual[learnt], right[part != held])
        before += _loss(usual[out], right[part == held])
        after += _loss(usual[out] + evidence[out] @ weights, right[part == held])
    if after >= before:
        return network
    # Nobody was asked of links that are surer than these.
    weights = _fit(evidence[arcs], usual[arcs], right)
    change = np.where(usual <= usual[arcs].max(), evidence @ weights, 0.0)
    return replace(network, graph=replace(network.graph, transition=network.graph.transition - change))


def _answers(network: SolvedNetwork, said: Sequence[Correction]) -> tuple[IntArray, IntArray, BoolArray]:
    """Detections that do or do not follow each other by what was said."""
    find, rows = Finder(network.frames, network.boxes), list[tuple[int, int, bool]]()
    for one in (part for each in said for part in (each.parts or (each,))):
        numbers = [find(box) for box in one.there]
        if NOTHING not in numbers and one.kind in ("next", "right"):
            rows += [(a, b, True) for a, b in itertools.pairwise(numbers)]
        elif NOTHING not in numbers and one.kind == "not_same":
            rows.append((min(numbers), max(numbers), False))
    i, j, same = np.array(rows, dtype=np.int64).reshape(-1, 3).T
    return i, j, same.astype(np.bool_)


def _evidence(network: SolvedNetwork) -> tuple[FloatArray, FloatArray]:
    """``(P, 3)`` what the logit of a link may change by, and ``(P,)`` the logit by its cost."""
    graph, frames = network.graph, network.frames
    gap = np.log2(np.maximum(frames[graph.head] - frames[graph.tail], 1))
    usual = graph.exit[graph.tail] + graph.entry[graph.head] - graph.transition
    return np.column_stack([np.ones(len(gap)), usual / 10, gap / 3]), usual


def _loss(logit: FloatArray, right: BoolArray) -> float:
    return float(np.logaddexp(0, np.where(right, -logit, logit)).sum())


def _fit(evidence: FloatArray, usual: FloatArray, right: BoolArray) -> FloatArray:
    """Weights of the evidence by which answers are most likely, near 0."""
    found = scipy.optimize.minimize(
        lambda w: _loss(usual + evidence @ w, right) + PRIOR * (w**2).sum() / 2, np.zeros(evidence.shape[1])
    )
    return np.asarray(found.x)
