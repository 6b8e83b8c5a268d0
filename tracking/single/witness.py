"""A witness: a linear classifier of the target's appearance features against its surroundings', learnt from the clip.

A correlation filter that slides onto the background learns it and stays confident. The witness learns only where its
own answer is high, from the target and from boxes around it, so it does not slide along. It is a ridge regression to 1
on the target and -1 around it; both classes weigh alike. Its features are those of an appearance network, which learns
nothing from the clip. Its answers add up to a belief, the forward recursion of a hidden Markov model of two states: the
box is on the target, or off it (Rabiner, "A tutorial on hidden Markov models", 1989, eq. 20). Where being off is far
likelier, the target is lost.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.types import FloatArray, ImageArray

Describe = Callable[[ImageArray, FloatArray], FloatArray]
"""Appearance features ``(N, D)`` of boxes ``(N, 4)`` in an image."""
EVERY, LEARN = 3, 3
"""Frames between two answers, and answers between two that are learnt."""
RIDGE = 0.005
"""Ridge penalty of the regression. Features have length one and the weights of all of them sum to one."""
KNOWN, KEPT = 0.5, 20
"""Answer above which the box is learnt, and how many learnt frames are kept beside the first."""
AROUND = np.array(
    [[-1.1, 0], [1.1, 0], [0, -1.1], [0, 1.1], [-1.1, -0.6], [1.1, 0.6], [2, 0], [-2, 0]], dtype=np.float64
)
"""Where the boxes of the surroundings are, in sides of the target."""
SLOPE, MOST = 3.0, 2.5
"""The log-likelihood ratio of on and off is ``SLOPE * answer``, at most so much to either side."""
LEAVES, RETURNS = 0.02, 0.01
"""Chances between two answers that a box on the target leaves it, and that one off it returns."""
AT_FIRST, BOUND = 4.0, 8.0
"""Log-odds of being on: in the first frame, and at most to either side."""


@dataclass(frozen=True)
class Regression:
    """``features @ weights + offset``."""

    weights: FloatArray
    offset: float

    @classmethod
    def learn(cls, on: FloatArray, around: FloatArray) -> Regression:
        """From rows ``(P, D)`` of the target and ``(N, D)`` of the surroundings."""
        rows = np.concatenate([on, around])
        wanted = np.repeat([1.0, -1.0], [len(on), len(around)])
        shares = np.where(wanted > 0, 0.5 / len(on), 0.5 / len(around))  # the weighted mean of `wanted` is zero
        mean = shares @ rows
        weighted = (rows - mean).T * shares
        weights = np.linalg.solve(weighted @ (rows - mean) + RIDGE * np.eye(rows.shape[1]), weighted @ wanted)
        return cls(weights, -float(mean @ weights))

    def __call__(self, rows: FloatArray) -> FloatArray:
        """``(N,)`` answers."""
        return np.asarray(rows @ self.weights + self.offset)


class Witness:
    """The regression, and the features of the target and of its surroundings that it learns from.

    Args:
        describe: appearance features of boxes.
        image: the first frame ``(H, W, 3)``.
        box: ``(4,)`` the target in it.

    Attributes:
        belief: log-odds that the box is on the target.
    """

    def __init__(self, describe: Describe, image: ImageArray, box: FloatArray) -> None:
        self._describe = describe
        self._targets: deque[FloatArray] = deque(maxlen=KEPT)
        self._around: deque[FloatArray] = deque(maxlen=KEPT)
        self.belief, self._updates = AT_FIRST, 0
        self._first = self._features(image, box[None]), self._features(image, _around(box))
        self._regression = Regression.learn(*self._first)

    @property
    def lost(self) -> bool:
        """Whether the box no longer shows the target."""
        return self.belief < 0

    def answers(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """``(N,)`` about 1 where boxes ``(N, 4)`` show the target, about -1 where they show what was around it."""
        return self._regression(self._features(image, boxes))

    def update(self, image: ImageArray, box: FloatArray, sure: bool) -> None:
        """Judge ``box`` ``(4,)``; learn it where the tracker is ``sure`` and the answer is above `KNOWN`."""
        features = self._features(image, box[None])
        answer = float(self._regression(features)[0])
        on = 1 / (1 + np.exp(-self.belief))
        on = on * (1 - LEAVES) + (1 - on) * RETURNS
        ratio = float(np.clip(SLOPE * answer, -MOST, MOST))
        self.belief = float(np.clip(np.log(on / (1 - on)) + ratio, -BOUND, BOUND))
        self._updates += 1
        if sure and answer > KNOWN and self._updates % LEARN == 0:
            self._targets.append(features)
            self._around.append(self._features(image, _around(box)))
            on_it, around = self._first
            self._regression = Regression.learn(
                np.concatenate([on_it, *self._targets]), np.concatenate([around, *self._around])
            )

    def moved(self) -> None:
        """The box is elsewhere now: it counts as the target until the answers are low again."""
        self.belief = max(self.belief, 0.0)

    def _features(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """``(N, D)`` of length one."""
        found = np.asarray(self._describe(image, boxes), dtype=np.float64)
        return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9))


def _around(box: FloatArray) -> FloatArray:
    """``(8, 4)`` boxes beside ``box`` ``(4,)``."""
    return box + np.tile(AROUND * (box[2:] - box[:2]), 2)
