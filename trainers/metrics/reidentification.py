"""How well an appearance network finds people again, over batches and processes."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.reidentification import APART, evaluate_retrieval
from tsuiseki.trainers.metrics.states import EvaluationMetric, numbers, whole_numbers

# Largest difference of a feature's length to 1; bfloat16 rounds by 0.004.
SLACK = 0.02


class ReIdentification(EvaluationMetric):
    """Re-identification by appearance: the CMC curve at ranks 1, 5 and 10, and mean average precision.

    ``compute`` gives ``rank1``, ``rank5``, ``rank10`` and ``map``, each in [0, 1], of all queries that have an answer
    in the gallery; NaN where none has, with a warning. Features are compared by their inner product. Equal distances
    count against the query.

    A gallery view of the query's own person is left out where it is of the same camera, or less than ``apart`` frames
    away. So is a view with the id -1.

    Zheng et al., "Scalable person re-identification: a benchmark", ICCV 2015, which made Market-1501.

    Args:
        apart: frames from which two views of a person say something.

    >>> metric = ReIdentification()
    >>> metric.update(torch.tensor([[1.0, 0.0], [0.0, 1.0]]), ids=torch.tensor([1, 2]), query=True)
    >>> metric.update(torch.tensor([[0.8, 0.6], [1.0, 0.0]]), ids=torch.tensor([1, 2]), query=False)
    >>> {name: round(value.item(), 2) for name, value in metric.compute().items()}
    {'rank1': 0.0, 'rank5': 1.0, 'rank10': 1.0, 'map': 0.5}
    """

    higher_is_better = True
    plot_lower_bound = 0.0
    plot_upper_bound = 1.0

    def __init__(self, apart: int = APART, **settings: Any) -> None:
        super().__init__(**settings)
        self.apart = apart
        self.add_column("features")
        for name in ("lengths", "ids", "query", "cameras"):
            self.add_column(name, torch.int64)
        self.add_column("frames")

    def update(self, features: Any, ids: Any, query: Any, cameras: Any = None, frames: Any = None) -> None:
        """Add views.

        Args:
            features: ``(N, D)`` of unit length.
            ids: ``(N,)`` person in each view.
            query: ``(N,)`` views that are searched for among the others; or one bool for all.
            cameras: ``(N,)`` numbers from 0, -1 where not known; by default not known.
            frames: ``(N,)`` numbers of frames; by default not known.

        Raises:
            RequestError: shapes do not fit, or a feature is not of unit length.
        """
        rows = numbers(features, "features")
        if rows.ndim != 2:
            raise RequestError(f"`features`: expected shape (N, D), got {rows.shape}")
        lengths = np.sqrt(np.square(rows).sum(axis=1))
        # What has no direction stays zero when it is normalised.
        if not np.all((np.abs(lengths - 1) < SLACK) | (lengths == 0)):
            raise RequestError(
                f"`features`: expected unit length, got {lengths.min():.3g} to {lengths.max():.3g}; "
                "`torch.nn.functional.normalize` gives it"
            )
        count = len(rows)
        columns = {
            "features": rows.ravel(),
            "lengths": np.full(count, rows.shape[1]),
            "ids": whole_numbers(ids, "ids", count),
            "query": whole_numbers(np.full(count, query) if isinstance(query, bool) else query, "query", count),
            "cameras": np.full(count, -1) if cameras is None else whole_numbers(cameras, "cameras", count),
            "frames": np.full(count, np.nan) if frames is None else whole_numbers(frames, "frames", count),
        }
        self.append(columns)

    def compute(self) -> dict[str, Tensor]:
        """``rank1``, ``rank5``, ``rank10`` and ``map``."""
        ids, cameras, frames = (self.column(name) for name in ("ids", "cameras", "frames"))
        query = self.column("query") > 0
        lengths = np.unique(self.column("lengths"))
        if len(lengths) > 1:
            raise RequestError(f"`features`: expected one length in all updates, got {lengths[0]} and {lengths[-1]}")
        features = self.column("features").reshape(len(ids), -1) if len(ids) else np.empty((0, 0))
        same = ids[query][:, None] == ids[~query][None]
        same_camera = (cameras[query][:, None] == cameras[~query][None]) & (cameras[query] >= 0)[:, None]
        # Views a moment apart look the same to anything.
        near = np.abs(frames[query][:, None] - frames[~query][None]) < self.apart
        junk = (same & (same_camera | near)) | (ids[~query] == -1)
        if not (same & ~junk).any():
            return self.unscored(
                ("rank1", "rank5", "rank10", "map"), "a person who is in a query and again in the gallery"
            )
        distances = 1 - features[query] @ features[~query].T
        scores = evaluate_retrieval(distances, ids[query], ids[~query], junk)
        return self.scored(
            {
                "rank1": scores.rank1,
                "rank5": scores.rank5,
                "rank10": scores.rank10,
                "map": scores.mean_average_precision,
            }
        )
