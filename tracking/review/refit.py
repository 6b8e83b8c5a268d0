"""Costs of links fitted to answers, kept where they decide answers better that were held out.

That two detections follow each other has the logit of what ending one track and starting another costs more than their
link (eq. 2.14). The fit adds a constant, a share of that, and a share of the doublings of the gap.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.review.correction_log import Correction
from tsuiseki.tracking.review.demands import NOTHING, Finder
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# After so many corrections, and every time as many more, costs are fitted anew.
EVERY = 20
# Parts of the answers that are held out in turn, how strongly the fit holds to the costs as they were, and how likely
# chance alone may decide so many more of the held-out answers better than worse (sign test).
PARTS, PRIOR, CHANCE = 4, 2.0, 0.01


def refitted(network: SolvedNetwork, given: Sequence[Correction]) -> SolvedNetwork:
    """The network with costs fitted to corrections; the same one where held-out corrections do not agree.

    Args:
        network: as it was solved.
        given: corrections.
    """
    arcs, right, answer = _answers(network, given)
    if min(right.sum(), (~right).sum()) < PARTS:
        return network
    graph = network.graph
    gap = np.log2(np.maximum(network.frames[graph.head] - network.frames[graph.tail], 1))
    usual = graph.exit[graph.tail] + graph.entry[graph.head] - graph.transition
    evidence = np.column_stack([np.ones(len(gap)), usual / 10, gap / 3])
    logit, part = usual[arcs], answer % PARTS
    for held in (part == number for number in range(PARTS)):
        logit[held] += evidence[arcs[held]] @ _fit(evidence[arcs[~held]], usual[arcs[~held]], right[~held])
    # An answer about several links is right where all are.
    before, after = (np.bincount(answer, (some > 0) != right) > 0 for some in (usual[arcs], logit))
    better, worse = int((before & ~after).sum()), int((after & ~before).sum())
    if better == 0 or scipy.special.bdtrc(better - 1, better + worse, 0.5) > CHANCE:
        return network
    # No question was asked about links that are surer than these.
    change = np.where(usual <= usual[arcs].max(), evidence @ _fit(evidence[arcs], usual[arcs], right), 0.0)
    return replace(network, graph=replace(graph, transition=graph.transition - change))


def _answers(network: SolvedNetwork, given: Sequence[Correction]) -> tuple[IntArray, BoolArray, IntArray]:
    """Links that corrections decide, whether they are right, and the number of the correction of each."""
    find, rows = Finder(network.frames, network.boxes), list[tuple[int, int, bool, int]]()
    for number, one in ((number, part) for number, each in enumerate(given) for part in each.parts or (each,)):
        nodes = [find(box) for box in one.there]
        if NOTHING not in nodes and one.kind in ("next", "right"):
            rows += [(a, b, True, number) for a, b in itertools.pairwise(nodes)]
        elif NOTHING not in nodes and one.kind == "not_same":
            rows.append((min(nodes), max(nodes), False, number))
    tail, head, right, answer = np.array(rows, dtype=np.int64).reshape(-1, 4).T
    links, count = network.graph.tail * len(network) + network.graph.head, len(network.graph.tail)
    order, wanted = np.argsort(links), tail * len(network) + head
    place = np.append(order, count)[np.searchsorted(links, wanted, sorter=order)]
    known = np.append(links, -1)[place] == wanted
    return place[known], right[known].astype(np.bool_), answer[known]


def _fit(evidence: FloatArray, usual: FloatArray, right: BoolArray) -> FloatArray:
    """Weights of the evidence by which answers are most likely, near 0."""

    def loss(weights: FloatArray) -> float:
        logit = usual + evidence @ weights
        return float(np.logaddexp(0, np.where(right, -logit, logit)).sum() + PRIOR * (weights**2).sum() / 2)

    return np.asarray(scipy.optimize.minimize(loss, np.zeros(evidence.shape[1])).x)
