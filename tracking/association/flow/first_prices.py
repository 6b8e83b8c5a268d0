"""Prices before any track is known, where they are too high.

Where targets move fast, frames are few or boxes inexact, what the velocity of two detections alone is worth exceeds
what they are. Then first prices make no track, no track tells the velocity, and no round mends it. That is so where
most detections are right and most of those are left out all the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.association.flow.link_cost import MOST_WORTH, LinkCost
from tsuiseki.tracking.association.flow.links import Links
from tsuiseki.tracking.types import BoolArray, FloatArray

# A detection counts as right from this probability on; most are if these many and this share of all are; they are left
# out if no more than that share of them is in tracks.
RIGHT, FEWEST, MOST, USED = 0.7, 10, 2 / 3, 0.6


@dataclass(frozen=True)
class Believed:
    """U detections as the video would have them if those that it does not bear out were missed by chance.

    Attributes:
        probability: ``(U,)`` of being right.
        change: ``(U,)`` of the cost of using them, then.
    """

    probability: FloatArray
    change: FloatArray

    def left_out(self, used: BoolArray) -> bool:
        """Whether most are right, and most of those are left out, of which ``(U,)`` are in tracks."""
        right = self.probability >= RIGHT
        return bool(right.sum() >= FEWEST and right.mean() >= MOST and used[right].mean() <= USED)


def with_known_velocity(links: Links, cost: LinkCost, frame_rate: float) -> Links:
    """Links, of which those without a price along tracks are priced as with `LinkCost.settled` = 1."""
    less = (1 - cost.settled) * cost.room(1 / frame_rate)
    known = np.maximum(links.cost - less, -MOST_WORTH)
    return replace(links, cost=np.where(np.isnan(links.price), known, links.cost))
