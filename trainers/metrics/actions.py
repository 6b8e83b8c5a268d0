"""How well actions are recognised, over batches and processes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from torch import Tensor, int64

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.actions import average_precisions
from tsuiseki.trainers.metrics.states import EvaluationMetric, numbers


class ActionPrecision(EvaluationMetric):
    """Mean average precision of actions: of each the sum over the rises of recall of the precision there.

    ``compute`` gives ``map``, the mean over the actions that occur, in [0, 1], and with ``class_names`` ``ap_NAME`` of
    each; NaN where none occurs, with a warning. A row is a person in a frame, who may do several things at once. Rows
    of equal probability enter together. The numbers are those of scikit-learn's ``average_precision_score``.

    Args:
        class_names: of the actions; None counts them without names.

    Raises:
        RequestError: ``class_names`` has none, or one twice.

    >>> import torch
    >>> metric = ActionPrecision(class_names=("walk", "sit"))
    >>> metric.update(torch.tensor([[0.9, 0.1], [0.8, 0.7]]), torch.tensor([[1, 0], [0, 1]]))
    >>> metric.update(torch.tensor([[0.7, 0.2]]), torch.tensor([[1, 0]]))
    >>> {name: round(value.item(), 4) for name, value in metric.compute().items()}
    {'map': 0.9167, 'ap_walk': 0.8333, 'ap_sit': 1.0}
    """

    higher_is_better = True
    plot_lower_bound = 0.0
    plot_upper_bound = 1.0

    def __init__(self, class_names: Sequence[str] | None = None, **settings: Any) -> None:
        super().__init__(**settings)
        self.class_names = None if class_names is None else tuple(class_names)
        if self.class_names is not None and len(set(self.class_names)) < max(1, len(self.class_names)):
            raise RequestError(f"`class_names`: expected different ones, got {', '.join(self.class_names) or 'none'}")
        self.add_column("probabilities")
        for name in ("performed", "widths"):
            self.add_column(name, int64)

    def update(self, preds: Any, target: Any) -> None:
        """Add rows.

        Args:
            preds: ``(N, A)`` probabilities in [0, 1]; NaN where nothing is said of a person, which is a miss.
            target: ``(N, A)`` 1 for the actions that are performed, 0 for the others.

        Raises:
            RequestError: shapes do not fit, or values lie elsewhere.
        """
        probabilities, performed = numbers(preds, "preds"), numbers(target, "target")
        names = self.class_names
        if probabilities.ndim != 2 or (names is not None and probabilities.shape[1] != len(names)):
            width = "A" if names is None else len(names)
            raise RequestError(f"`preds`: expected shape (N, {width}), got {probabilities.shape}")
        if performed.shape != probabilities.shape:
            raise RequestError(f"`target`: expected shape {probabilities.shape}, got {performed.shape}")
        if ((probabilities < 0) | (probabilities > 1)).any():
            low, high = np.nanmin(probabilities), np.nanmax(probabilities)
            raise RequestError(f"`preds`: expected probabilities in [0, 1], got {low:.3g} to {high:.3g}")
        if not np.isin(performed, (0, 1)).all():
            raise RequestError("`target`: expected 0 and 1, got other values")
        count, width = probabilities.shape
        self.append({
            "probabilities": probabilities.ravel(),
            "performed": performed.ravel(),
            "widths": np.full(count, width),
        })  # fmt: skip

    def compute(self) -> dict[str, Tensor]:
        """``map``, and ``ap_NAME`` of the actions that occur."""
        widths = np.unique(self.column("widths"))
        if len(widths) > 1:
            raise RequestError(
                f"`preds`: expected as many actions in all updates, got {widths[0]} and {widths[-1]} of them"
            )
        performed = self.column("performed") > 0
        if not performed.any():
            return self.unscored(("map",), "an action that is performed")
        rows = self.column("probabilities").reshape(-1, widths[0]), performed.reshape(-1, widths[0])
        precisions = average_precisions(*rows)
        by_name = zip(self.class_names or (), precisions, strict=False)
        apart = {f"ap_{name}": float(value) for name, value in by_name if not np.isnan(value)}
        return self.scored({"map": float(np.nanmean(precisions)), **apart})
