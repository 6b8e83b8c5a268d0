"""What links cost by what people do: action features of single frames and of several (thesis 5.2 and 5.3).

A network says of every detection how likely each action is. Two detections of one person are alike in this, so the
cosine distance of their probabilities prices a link (eq. 5.2). Along the tracks of the flow before, probabilities are
averaged over a window (eq. 5.3), which makes them surer, and the links are priced again. The printed sum of eq. 5.3
runs over 17 frames and divides by 15; here it runs over the window and divides by the number of frames in which the
person was detected.

A window centred on a link's detections reaches over the link on both sides: where the flow has handed a track from one
person to another, both ends of that link see the same mixture of the two, and the link looks all the better. So windows
are one-sided by default (not in the thesis): the earlier detection is compared by what its track did until then, the
later one by what its track does from there on. A track that belongs to two people is split where these differ, if
better links are found for the parts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tsuiseki.tracking.association.costs import inner_products
from tsuiseki.tracking.association.nearby import gaps
from tsuiseki.tracking.association.tracklets.window_means import window_means
from tsuiseki.tracking.types import FloatArray, IntArray

ActionFeatures = Literal["single", "centred", "one-sided"]


@dataclass(frozen=True)
class ActionCost:
    """Cost of a link by the cosine distance d of the action probabilities at its ends: weight · (d − neutral).

    Attributes:
        features: ``single`` compares detections; ``centred`` means over windows about them along their tracks, as the
            thesis does; ``one-sided`` the half of the window up to the earlier one with that from the later one on.
        window: λ, seconds.
        weight: of the distance of two detections, and of two means.
        neutral: distance that speaks neither for nor against a link, of two detections, and of two means.
        least: seconds of a link from which actions count; over less time place and motion say more.
    """

    features: ActionFeatures = "one-sided"
    window: float = 0.5
    weight: tuple[float, float] = (10.0, 25.0)
    neutral: tuple[float, float] = (0.05, 0.04)
    least: float = 0.0

    def __post_init__(self) -> None:
        if not (0 <= self.window < np.inf and 0 <= min(self.weight) <= max(self.weight) < np.inf):
            raise ValueError(f"expected window and weights from 0, got {self.window} and {self.weight}")

    @property
    def averaged(self) -> bool:
        """Whether features are averaged along tracks."""
        return self.features != "single"

    def means(
        self, frames: IntArray, labels: IntArray, actions: FloatArray, frame_rate: float
    ) -> tuple[FloatArray, FloatArray]:
        """Features ``(N, A)`` of detections as the earlier and as the later one of a link.

        Args:
            frames: ``(N,)``.
            labels: ``(N,)`` track of each, -1 for none, which keeps its own features.
            actions: ``(N, A)`` probabilities of single frames.
            frame_rate: frames a second.
        """
        if not self.averaged:
            return actions, actions
        half = gaps(self.window / 2, frame_rate)
        if self.features == "centred":
            both = window_means(frames, labels, actions, frames, labels, (half, half))
            return both, both
        before, after = (window_means(frames, labels, actions, frames, labels, r) for r in ((half, 0), (0, half)))
        return before, after

    def __call__(
        self,
        earlier: FloatArray,
        later: FloatArray,
        i: IntArray,
        j: IntArray,
        seconds: FloatArray,
        *,
        averaged: bool,
    ) -> FloatArray:
        """``(P,)`` costs of links from ``i`` to ``j`` between features ``(N, A)``.

        Args:
            earlier: of detections as the earlier one.
            later: as the later one.
            i: ``(P,)`` indices of the earlier detections.
            j: ``(P,)`` of the later ones.
            seconds: ``(P,)`` between the two.
            averaged: they are means along tracks.
        """
        distance = action_distances(earlier, later, i, j)
        cost = self.weight[averaged] * (distance - self.neutral[averaged])
        return np.where(seconds >= self.least, cost, 0.0)


def action_distances(earlier: FloatArray, later: FloatArray, i: IntArray, j: IntArray) -> FloatArray:
    """``(P,)`` cosine distances of the rows ``i`` of ``earlier`` and ``j`` of ``later``, in [0, 1]: c_saf of eq. 5.2.

    Args:
        earlier: ``(N, A)`` action probabilities.
        later: ``(N, A)`` likewise, or the same.
        i: ``(P,)`` indices.
        j: ``(P,)`` indices.
    """
    unit = [actions / np.maximum(np.linalg.norm(actions, axis=1, keepdims=True), 1e-9) for actions in (earlier, later)]
    return np.clip(1 - inner_products(unit[0], unit[1], i, j), 0, 1)
