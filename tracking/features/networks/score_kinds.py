"""What the class scores of a transformer mean: probabilities, or logits of one function or the other.

Networks that judge each class by itself (RT-DETR, RF-DETR, Deformable DETR) give logits of a sigmoid; those that choose
one class (DETR, YOLOS) logits of a softmax, in which "no object" is the last class. The shapes are the same. It is
decided once, by what a network gives for a picture of noise, where nearly all of its queries see no object.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.features.networks.foreign_options import ScoreKind
from tsuiseki.tracking.types import FloatArray

# Share of the queries that see no object in a picture of noise, at least.
_NEARLY_ALL = 0.9
# From here on a softmax cannot be ruled out.
_HALF = 0.5


def possible_kinds(values: NDArray[Any], names: int | None = None) -> list[ScoreKind]:
    """What ``(N, C)`` class values for a picture of noise can be.

    Args:
        values: of N queries and C classes.
        names: number of classes that have a name, where that is known: "no object" has none.
    """
    if not values.size or (values.min() >= 0 and values.max() <= 1):
        return ["probabilities"]
    count = values.shape[1]
    if count == 1 or names == count:
        return ["sigmoid"]
    if names == count - 1 or background_first(values) or min(_wins(values, count - 1)) >= _NEARLY_ALL:
        return ["softmax"]
    # The only class that was trained, or "no object" with small numbers.
    return ["sigmoid", "softmax"] if _wins(values, count - 1)[0] >= _HALF else ["sigmoid"]


def background_first(values: NDArray[Any]) -> bool:
    """Whether "no object" is the first class of ``(N, C)`` logits for a picture of noise, as in SSD."""
    return values.shape[1] > 1 and min(_wins(values, 0)) >= _NEARLY_ALL


def as_probabilities(values: NDArray[Any], kind: ScoreKind) -> FloatArray:
    """``(N, C)`` in [0, 1] of ``(N, C)`` class values."""
    real = values.astype(np.float64)
    if kind == "probabilities":
        return real
    if kind == "sigmoid":
        return np.asarray(1 / (1 + np.exp(-np.clip(real, -60, 60))))
    powers = np.exp(real - real.max(axis=1, keepdims=True))
    return np.asarray(powers / powers.sum(axis=1, keepdims=True))


def _wins(values: NDArray[Any], column: int) -> tuple[float, float]:
    """Share of the rows in which a class is the largest, and in which a sigmoid would call it likely."""
    return float((values.argmax(axis=1) == column).mean()), float((values[:, column] > 0).mean())
