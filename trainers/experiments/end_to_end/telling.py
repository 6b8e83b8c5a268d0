"""What the features can tell: whether right links and right detections look better than wrong ones.

A right link is *contested* where a link between two people, or to nobody, has the same tail or the same head; it is
*told* where it is the cheapest of them all. Boosted trees that were taught by the other half of the same video know
its camera, its detector and its people: what they do not tell, the features do not say. What they tell and what was
taught by other videos does not, is lost on the way from video to video. All are asked of the same links and
detections: of those that the other half says anything of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from sklearn.metrics import roc_auc_score
from threadpoolctl import threadpool_limits

from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray
from tsuiseki.trainers.association.fitting import Fit
from tsuiseki.trainers.association.graphs import Graph
from tsuiseki.trainers.experiments.association.sequences import Clip
from tsuiseki.trainers.experiments.end_to_end.pairwise import Classifier, detection_classifier, link_classifier
from tsuiseki.trainers.experiments.end_to_end.runs import graphs_of_clip, learnable, learnt_changes

SAYS = ("default", "through the flow, others taught", "trees, others taught", "trees, its other half taught")
# Upper ends of the bins of gaps, seconds; the first bin is that of one frame to the next.
GAPS = (0.4, np.inf)
BINS = ("one frame", "up to 0.4 s", "longer")
# Halves alternate in blocks of so many seconds; what teaches has to have so many right links and wrong detections.
BLOCK, FEWEST = 5.0, 30


@dataclass(frozen=True)
class Told:
    """What is told of a sequence.

    Attributes:
        links: ``(len(SAYS), len(BINS), 2)`` contested right links, and those that are told.
        detections: ``(len(SAYS),)`` area under the ROC curve of detections on somebody against those on nobody; NaN
            where there are none of either.
        count: detections.
    """

    links: FloatArray
    detections: FloatArray
    count: int


def told(train: tuple[Clip, ...], tests: tuple[Clip, ...], fit: Fit) -> list[Told]:
    """What is told of each test by the tracker's costs, and by what ``train`` and its own halves teach."""
    graphs = learnable(train)
    changes = learnt_changes(train, fit)
    link, detection = _trees([one.detections for one in graphs])
    found = []
    for clip in tests:
        graph = graphs_of_clip(clip).detections
        own_links, own_detections = by_its_other_half(graph)
        use, links = graph.costs[: len(graph)], graph.costs[3 * len(graph) :]
        of_links = (
            links,
            links + changes.links(graph.links),
            -link.decision_function(graph.links),
            own_links,
        )
        of_detections = (
            use,
            use + changes.detections(graph.detections)[:, 0],
            -detection.decision_function(graph.detections),
            own_detections,
        )
        known, seen = ~np.isnan(own_links), ~np.isnan(own_detections)
        counts = np.stack([contests(graph, costs, known) for costs in of_links])
        areas = np.array([area(graph.owners[seen] >= 0, costs[seen]) for costs in of_detections])
        found.append(Told(counts, areas, int(seen.sum())))
    return found


def contests(graph: Graph, costs: FloatArray, known: BoolArray) -> FloatArray:
    """``(len(BINS), 2)`` contested right links, and those that are told by ``(P,)`` costs, among links that are known.

    Links of one person that pass over a detection of theirs are neither right nor rivals.
    """
    tail, head, count = graph.tail, graph.head, len(graph)
    right = np.flatnonzero((graph.labelled[3 * count :] > 0) & known)
    wrong = ((graph.owners[tail] != graph.owners[head]) | (graph.owners[tail] < 0)) & known
    from_tail, to_head = np.full(count, np.inf), np.full(count, np.inf)
    np.minimum.at(from_tail, tail[wrong], costs[wrong])
    np.minimum.at(to_head, head[wrong], costs[wrong])
    rival = np.minimum(from_tail[tail[right]], to_head[head[right]])
    right, rival = right[np.isfinite(rival)], rival[np.isfinite(rival)]
    gap = graph.frames[head[right]] - graph.frames[tail[right]]
    bins = np.where(gap == 1, 0, 1 + np.searchsorted(GAPS, gap / graph.frame_rate))
    is_told = costs[right] < rival
    count_in = partial(np.bincount, bins, minlength=len(BINS))
    return np.stack([count_in(), count_in(weights=is_told)], axis=1)


def area(right: BoolArray, costs: FloatArray) -> float:
    """Area under the ROC curve of detections that are right against others, by ``(N,)`` costs; NaN without either."""
    if right.all() or not right.any():
        return float("nan")
    return float(roc_auc_score(right, -costs))


@threadpool_limits.wrap(limits=1)  # type: ignore[untyped-decorator]
def by_its_other_half(graph: Graph) -> tuple[FloatArray, FloatArray]:
    """``(P,)`` costs of links and ``(N,)`` of detections by trees of the other half; NaN where that taught too little.

    Links from half to half are left out.
    """
    half: IntArray = (graph.frames / (BLOCK * graph.frame_rate)).astype(np.int64) % 2
    links, detections = np.full(len(graph.tail), np.nan), np.full(len(graph), np.nan)
    right, somebody = graph.labelled[3 * len(graph) :] > 0, graph.owners >= 0
    inside = half[graph.tail] == half[graph.head]
    for tested in (0, 1):
        asked, teach = inside & (half[graph.tail] == tested), inside & (half[graph.tail] != tested)
        if _enough(right[teach]) and asked.any():
            trees = link_classifier(graph.links[teach], right[teach], "trees")
            links[asked] = -trees.decision_function(graph.links[asked])
        asked, teach = half == tested, half != tested
        if _enough(somebody[teach]) and asked.any():
            trees = detection_classifier(graph.detections[teach], somebody[teach], "trees")
            detections[asked] = -trees.decision_function(graph.detections[asked])
    return links, detections


@threadpool_limits.wrap(limits=1)  # type: ignore[untyped-decorator]
def _trees(graphs: Sequence[Graph]) -> tuple[Classifier, Classifier]:
    """Of links and of detections."""
    right = np.concatenate([one.labelled[3 * len(one) :] > 0 for one in graphs])
    somebody = np.concatenate([one.owners >= 0 for one in graphs])
    return (
        link_classifier(np.concatenate([one.links for one in graphs]), right, "trees"),
        detection_classifier(np.concatenate([one.detections for one in graphs]), somebody, "trees"),
    )


def _enough(right: BoolArray) -> bool:
    return int(right.sum()) >= FEWEST and int((~right).sum()) >= FEWEST
