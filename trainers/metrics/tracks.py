"""Tracking metrics of several people or objects: HOTA, CLEAR MOT, and IDF1, as TrackEval defines them."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from tsuiseki.tracking.evaluation import identity_metrics
from tsuiseki.tracking.evaluation.identity_metrics import ALPHAS, LabelledSequence
from tsuiseki.tracking.evaluation.multi import MATCH_OVERLAP
from tsuiseki.trainers.metrics.sequences import compared
from tsuiseki.trainers.metrics.states import EvaluationMetric

# What a score of several sequences needs.
BOXES = "labelled boxes in one of the sequences"


class SequenceMetric(EvaluationMetric):
    """A metric of tracked sequences: an update is one sequence, whose sums are added."""

    def update(self, preds: Any, target: Any) -> None:
        """Add a sequence.

        Args:
            preds: a `Result`, tracks, or a list with an entry a frame: a dictionary or an object with ``boxes``
                ``(N, 4)`` x1, y1, x2, y2 in pixels and ``ids`` ``(N,)`` whole numbers, tensors or arrays. `Targets`, as
                trackers answer them, are such objects.
            target: the labels, likewise, or `GroundTruth`. A frame may have ``ignored`` ``(N,)`` boxes, on which a
                result is neither right nor wrong. All frames of a list are scored; of tracks and labels those that
                `evaluate_people` scores.

        Raises:
            RequestError: one is none of that, they have other frames, a box has no area, or an id is twice in a frame.
        """
        self.add(vars(self.evaluate(compared(preds, target))))

    def evaluate(self, sequence: LabelledSequence) -> identity_metrics.Sums:
        """The sums of a sequence, whose names are those of the states."""
        raise NotImplementedError


class HOTA(SequenceMetric):
    """Higher order tracking accuracy, averaged over the overlaps 0.05, 0.10, … 0.95.

    ``compute`` gives ``hota``, ``det_a`` and ``ass_a``, each in [0, 1], of all sequences together. They are NaN where
    no box was labelled, with a warning. An `update` is one sequence.

    Luiten et al., "HOTA: a higher order metric for evaluating multi-object tracking", IJCV 2021. The numbers are those
    of TrackEval.

    >>> still = [{"boxes": torch.tensor([[0.0, 0.0, 10.0, 20.0]]), "ids": torch.tensor([1])}] * 4
    >>> halves = still[:2] + [{**frame, "ids": torch.tensor([2])} for frame in still[2:]]
    >>> metric = HOTA()
    >>> metric.update(halves, still)
    >>> {name: round(value.item(), 3) for name, value in metric.compute().items()}
    {'hota': 0.707, 'det_a': 1.0, 'ass_a': 0.5}
    """

    higher_is_better = True
    plot_lower_bound = 0.0
    plot_upper_bound = 1.0

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for name in ("hits", "misses", "false", "associations"):
            self.add_sum(name, (len(ALPHAS),), torch.float64)

    def evaluate(self, sequence: LabelledSequence) -> identity_metrics.Hota:
        return identity_metrics.hota(sequence)

    def compute(self) -> dict[str, Tensor]:
        """``hota``, ``det_a`` and ``ass_a``."""
        sums = identity_metrics.Hota(*map(self.sums, ("hits", "misses", "false", "associations")))
        if not (sums.hits + sums.misses).any():
            return self.unscored(("hota", "det_a", "ass_a"), BOXES)
        means = {name: float(getattr(sums, name).mean()) for name in ("hota", "det_a", "ass_a")}
        return self.scored(means)


class CLEAR(SequenceMetric):
    """The CLEAR MOT metrics: MOTA, MOTP and the counts below them; boxes match from an overlap of 0.5 on.

    ``compute`` gives ``mota`` (at most 1, may be negative), ``motp``, ``recall`` and ``precision`` (in [0, 1]), and the
    counts ``id_switches``, ``false_positives``, ``false_negatives``, of all sequences together. They are NaN where no
    box was labelled, with a warning. An `update` is one sequence.

    Bernardin and Stiefelhagen, "Evaluating multiple object tracking performance: the CLEAR MOT metrics", 2008. The
    numbers are those of TrackEval.

    >>> still = [{"boxes": torch.tensor([[0.0, 0.0, 10.0, 20.0]]), "ids": torch.tensor([1])}] * 4
    >>> halves = still[:2] + [{**frame, "ids": torch.tensor([2])} for frame in still[2:]]
    >>> metric = CLEAR()
    >>> metric.update(halves, still)
    >>> scores = metric.compute()
    >>> scores["mota"].item(), scores["id_switches"].item()
    (0.75, 1.0)
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for name in ("hits", "misses", "false", "switches"):
            self.add_sum(name)
        self.add_sum("overlap", dtype=torch.float64)

    def evaluate(self, sequence: LabelledSequence) -> identity_metrics.Clear:
        return identity_metrics.clear(sequence, MATCH_OVERLAP)

    def compute(self) -> dict[str, Tensor]:
        """The scores by name."""
        counts = identity_metrics.Clear(*map(self.sums, ("hits", "misses", "false", "switches", "overlap")))
        scores = {
            "mota": counts.mota,
            "motp": counts.motp,
            "recall": counts.recall,
            "precision": counts.precision,
            "id_switches": counts.switches,
            "false_positives": counts.false,
            "false_negatives": counts.misses,
        }
        return self.scored(scores) if counts.hits + counts.misses else self.unscored(tuple(scores), BOXES)


class IDF1(SequenceMetric):
    """Identity F1: the share of boxes that bear the right identity throughout, at an overlap of 0.5.

    ``compute`` gives ``idf1``, ``id_precision`` and ``id_recall``, each in [0, 1], of all sequences together. They are
    NaN where no box was labelled, with a warning. An `update` is one sequence.

    Ristani et al., "Performance measures and a data set for multi-target, multi-camera tracking", 2016. The numbers are
    those of TrackEval.

    >>> still = [{"boxes": torch.tensor([[0.0, 0.0, 10.0, 20.0]]), "ids": torch.tensor([1])}] * 4
    >>> halves = still[:2] + [{**frame, "ids": torch.tensor([2])} for frame in still[2:]]
    >>> metric = IDF1()
    >>> metric.update(halves, still)
    >>> metric.compute()["idf1"]
    tensor(0.5000, dtype=torch.float64)
    """

    higher_is_better = True
    plot_lower_bound = 0.0
    plot_upper_bound = 1.0

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for name in ("hits", "misses", "false"):
            self.add_sum(name)

    def evaluate(self, sequence: LabelledSequence) -> identity_metrics.Identity:
        return identity_metrics.identity(sequence, MATCH_OVERLAP)

    def compute(self) -> dict[str, Tensor]:
        """``idf1``, ``id_precision`` and ``id_recall``."""
        counts = identity_metrics.Identity(*map(self.sums, ("hits", "misses", "false")))
        if not counts.hits + counts.misses:
            return self.unscored(("idf1", "id_precision", "id_recall"), BOXES)
        precision = counts.hits / max(1, counts.hits + counts.false)
        recall = counts.hits / (counts.hits + counts.misses)
        return self.scored({"idf1": counts.idf1, "id_precision": precision, "id_recall": recall})
