"""The links between detections of a window as one table."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Links:
    """Links between detections of a window.

    Attributes:
        tail: ``(P,)`` numbers of the earlier detections.
        head: ``(P,)`` of the later ones.
        cost: ``(P,)``.
        price: ``(P,)`` what they cost along the tracks last found, which the cost nears; NaN for links that have been
            priced as pairs only.
        hidden: ``(P,)`` share of the person hidden in the middle of the gap, which no round changes.
    """

    tail: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    head: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    cost: FloatArray = field(default_factory=lambda: np.empty(0))
    price: FloatArray = field(default_factory=lambda: np.empty(0))
    hidden: FloatArray = field(default_factory=lambda: np.empty(0))

    def select(self, which: BoolArray | IntArray) -> Links:
        """The links at a mask or at indices."""
        return Links(self.tail[which], self.head[which], self.cost[which], self.price[which], self.hidden[which])


def joined_links(one: Links, other: Links) -> Links:
    """The links of two tables, one after the other."""
    if len(one.tail) == 0 or len(other.tail) == 0:
        return one if len(other.tail) == 0 else other
    return Links(
        np.append(one.tail, other.tail),
        np.append(one.head, other.head),
        np.append(one.cost, other.cost),
        np.append(one.price, other.price),
        np.append(one.hidden, other.hidden),
    )
