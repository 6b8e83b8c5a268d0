"""Costs learnt on pairs, with the same features and the same graph as those learnt through the flow.

Whether a link is right, and whether a detection is, are learnt each by itself: by logistic regression or by boosted
trees. Four scalars, how far to trust either, the worth of a detection and the cost of ends, are then tuned on windows
of the training sequences by direct search (Nelder and Mead 1965), for agreement with the labelled flow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.optimize import minimize
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler
from threadpoolctl import threadpool_limits

from tsuiseki.tracking.association.learnt_costs import LARGEST
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.trainers.association.fitting import Fit
from tsuiseki.trainers.association.flow_loss import Problem, cheapest
from tsuiseki.trainers.association.graphs import Graph, Graphs
from tsuiseki.trainers.association.labelled_flow import FlowCounts
from tsuiseki.trainers.association.windows import RandomWindows

PairLearner = Literal["logistic", "trees"]
# Trust in links and in detections, worth of a detection of even chances, cost of ends beyond the default.
FIRST = (1.0, 0.5, -3.0, 0.0)
# Share of the learnt change of what using a detection costs that is taken outside of training.
TRUST = Fit().trust
LOOKS, WINDOWS, SECONDS, MOST_LINKS = 30, 8, 3.0, 40_000


@dataclass(frozen=True)
class PairChanges:
    """Costs from probabilities of links and detections; a `CostChanges`.

    Attributes:
        link: classifier that says whether links are right.
        detection: classifier that says whether detections are.
        scalars: see `FIRST`.
    """

    link: Any
    detection: Any
    scalars: tuple[float, ...] = FIRST

    def links(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of links."""
        return _links(self.scalars, self.link.decision_function(rows), rows) if len(rows) else np.zeros(0)

    def detections(self, rows: FloatArray) -> FloatArray:
        """``(N, 3)`` changes of the costs of detections, of a track's start and of its end there."""
        if not len(rows):
            return np.zeros((0, 3))
        # As much of it as of what is learnt through the flow: what a score is worth differs from video to video.
        use = TRUST * _use(self.scalars, self.detection.decision_function(rows), rows)
        return np.stack([use, *[np.full(len(rows), self.scalars[3])] * 2], axis=1)

    def joins(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` zeros: joins stay as they are."""
        return np.zeros(len(rows))


def _links(scalars: Sequence[float], logits: FloatArray, rows: FloatArray) -> FloatArray:
    """The change to -log p of a link's probability (Zhang et al. 2008, eq. 11)."""
    return np.asarray(np.clip(scalars[0] * np.logaddexp(0.0, -logits) - rows[:, 0], -LARGEST, LARGEST))


def _use(scalars: Sequence[float], logits: FloatArray, rows: FloatArray) -> FloatArray:
    return np.asarray(np.clip(scalars[2] - scalars[1] * logits - rows[:, 0], -LARGEST, LARGEST))


@threadpool_limits.wrap(limits=1)  # type: ignore[untyped-decorator]
def fit_pairs(graphs: Sequence[Graphs], learner: PairLearner, seed: int = 0) -> PairChanges:
    """The classifiers of links and detections, and their scalars.

    Args:
        graphs: of the training sequences.
        learner: ``logistic`` or ``trees``.
        seed: of samples, windows and trees.
    """
    every = [one.detections for one in graphs]
    used = np.concatenate([one.detections for one in every])
    somebody = np.concatenate([one.owners >= 0 for one in every])
    links = np.concatenate([one.links for one in every])
    right = np.concatenate([one.labelled[3 * len(one) :] > 0 for one in every])
    sample = np.sort(np.random.default_rng(seed).permutation(len(links))[:MOST_LINKS])
    # A sample of the links would miss right ones, of which there are few; all are taken, and the logit is corrected.
    share = len(sample) / max(len(links), 1)
    chosen = np.union1d(sample, np.flatnonzero(right))
    link = _learnt(learner, links[chosen], right[chosen], np.where(right[chosen], 1.0, 1 / share), seed)
    detections = _learnt(learner, used, somebody, np.ones(len(somebody)), seed)
    first = PairChanges(link, detections)
    windows = RandomWindows(graphs, SECONDS, WINDOWS, lambda: (seed, 0))
    known = [windows[k].detections for k in range(WINDOWS)]
    return _tuned(first, [graph for graph in known if len(graph) and len(graph.tail)])


def _learnt(learner: PairLearner, rows: FloatArray, right: BoolArray, weight: FloatArray, seed: int) -> Any:
    if learner == "trees":
        made = HistGradientBoostingClassifier(
            max_iter=80, max_leaf_nodes=12, min_samples_leaf=60, l2_regularization=5.0, random_state=seed
        )
        return made.fit(rows, right, weight)
    # What was never seen in training is no reason for more than what was, as in `CostChange`.
    bounded = FunctionTransformer(np.clip, kw_args={"a_min": -5.0, "a_max": 5.0})
    steps = make_pipeline(StandardScaler(), bounded, LogisticRegression(max_iter=200))
    return steps.fit(rows, right, logisticregression__sample_weight=weight)


def _tuned(first: PairChanges, windows: Sequence[Graph]) -> PairChanges:
    """The same with the scalars of the best agreement of `LOOKS` tries."""
    # What the classifiers say of a window stays, so that only the scalars are computed anew.
    logits = [(first.link.decision_function(one.links), first.detection.decision_function(one.detections))
              for one in windows]  # fmt: skip

    def disagreement(scalars: FloatArray) -> float:
        counts, ends = FlowCounts(), np.clip(scalars[3], -LARGEST, LARGEST)
        for graph, (link, detection) in zip(windows, logits, strict=True):
            use = _use(scalars.tolist(), detection, graph.detections)
            changes = np.concatenate([use, np.full(2 * len(graph), ends)])
            changes[graph.fixed] = 0
            costs = graph.costs + np.concatenate([changes, _links(scalars.tolist(), link, graph.links)])
            counts.add(graph, cheapest(Problem(costs, graph.tail, graph.head)))
        return -counts.agreement

    corners = np.array(FIRST) + np.concatenate([np.zeros((1, 4)), np.diag([0.4, 0.3, 1.0, -1.5])])
    options = {"maxfev": LOOKS, "initial_simplex": corners}
    found = minimize(disagreement, np.array(FIRST), method="Nelder-Mead", options=options)
    return replace(first, scalars=tuple(found.x.tolist()))
