"""A witness: whether a box looks like the target, by features of an appearance network, learnt from the clip.

A correlation filter that slides onto the background learns it and stays confident. The witness asks two questions. How
alike is the box to what is known of the target? The likeness is the greatest cosine of their features. Is it rather the
target or what is around it? The answer is a ridge regression to 1 on the target and -1 around it; both classes weigh
alike. Only a box that passes both is learnt, so the witness does not slide along. The network learns nothing from the
clip.

Likeness and answer together are the evidence of a look. The looks add up to a belief, the forward recursion of a hidden
Markov model of two states: the box is on the target, or off it (Rabiner, "A tutorial on hidden Markov models", 1989,
eq. 20). Where being off is likelier, the target is lost.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from statistics import median

import numpy as np

from tsuiseki.tracking.single.tracker import SingleTracker, TargetState
from tsuiseki.tracking.types import FloatArray, ImageArray

Describe = Callable[[ImageArray, FloatArray], FloatArray]
"""Appearance features ``(N, D)`` of boxes ``(N, 4)`` in an image."""
# Frames between two looks, each of which is an inference.
LOOK_INTERVAL = 3
# Looks between two that are learnt.
LEARN_INTERVAL = 3
# Ridge penalty of the regression. Features have length one and the weights of all of them sum to one.
RIDGE = 0.005
# Likeness from which the box is learnt, if its answer is positive, too.
LEARNT_LIKENESS = 0.65
# Learnt frames kept beside the first.
LEARNT_FRAMES = 20
# Where the boxes of the surroundings are, in sides of the target.
AROUND = np.array(
    [[-1.1, 0], [1.1, 0], [0, -1.1], [0, 1.1], [-1.1, -0.6], [1.1, 0.6], [2, 0], [-2, 0]], dtype=np.float64
)
# Likeness and answer together that speak neither for nor against the target.
EVEN = 0.65
# Log-likelihood ratio of on and off the target, for each unit that they are above it.
SLOPE = 5.0
# Largest log-likelihood ratio of a look, to either side.
LARGEST_RATIO = 2.5
# Chance between two looks that a box on the target leaves it, or that one off it returns.
CHANGES = 0.1
# Log-odds of being on in the first frame.
AT_FIRST = 4.0


def regression(on: FloatArray, around: FloatArray) -> tuple[FloatArray, float]:
    """Weights ``(D,)`` and offset of the ridge regression on rows ``(P, D)`` of the target and ``(N, D)`` around it."""
    rows = np.concatenate([on, around])
    labels = np.repeat([1.0, -1.0], [len(on), len(around)])
    shares = np.where(labels > 0, 0.5 / len(on), 0.5 / len(around))  # the weighted mean of `labels` is zero
    mean = shares @ rows
    weighted = (rows - mean).T * shares
    weights = np.linalg.solve(weighted @ (rows - mean) + RIDGE * np.eye(rows.shape[1]), weighted @ labels)
    return weights, -float(mean @ weights)


class Witness:
    """What the target and its surroundings looked like, and the regression that tells them apart.

    Args:
        describe: appearance features of boxes.
        image: the first frame ``(H, W, 3)``.
        box: ``(4,)`` the target in it.

    Attributes:
        belief: log-odds that the box is on the target.
    """

    def __init__(self, describe: Describe, image: ImageArray, box: FloatArray) -> None:
        self._describe = describe
        self._learnt: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=LEARNT_FRAMES)
        self.belief, self._updates = AT_FIRST, 0
        self._first = (
            unit_features(self._describe, image, box[None]),
            unit_features(self._describe, image, _around(box)),
        )
        self._learn()

    @property
    def lost(self) -> bool:
        """Whether the box no longer shows the target."""
        return self.belief < 0

    def evidence(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """``(N,)`` how much boxes ``(N, 4)`` look like the target, in [-2.65, 1.35]; negative: rather like others."""
        likeness, answers = self._compare(unit_features(self._describe, image, boxes))
        return likeness + answers - EVEN

    def update(self, image: ImageArray, box: FloatArray) -> None:
        """Judge ``box`` ``(4,)``, and learn it where it is known and not like the surroundings."""
        features = unit_features(self._describe, image, box[None])
        likeness, answer = (float(values[0]) for values in self._compare(features))
        on = CHANGES + (1 - 2 * CHANGES) / (1 + np.exp(-self.belief))
        ratio = float(np.clip(SLOPE * (likeness + answer - EVEN), -LARGEST_RATIO, LARGEST_RATIO))
        self.belief = float(np.log(on / (1 - on))) + ratio
        self._updates += 1
        if likeness > LEARNT_LIKENESS and answer > 0 and self._updates % LEARN_INTERVAL == 0:
            self._learnt.append((features, unit_features(self._describe, image, _around(box))))
            self._learn()

    def moved(self) -> None:
        """The box is elsewhere now: it counts as the target until the evidence is against it again."""
        self.belief = max(self.belief, 0.0)

    def _learn(self) -> None:
        targets, around = zip(self._first, *self._learnt, strict=True)
        self._target_features = np.concatenate(targets)
        self._weights, self._offset = regression(self._target_features, np.concatenate(around))

    def _compare(self, features: FloatArray) -> tuple[FloatArray, FloatArray]:
        """``(N,)`` greatest cosine to what is known of the target, and the regression's answer, both in [-1, 1]."""
        return (features @ self._target_features.T).max(axis=1), np.clip(features @ self._weights + self._offset, -1, 1)


def unit_features(describe: Describe, image: ImageArray, boxes: FloatArray) -> FloatArray:
    """``(N, D)`` features of ``(N, 4)`` boxes, of length one."""
    features = np.asarray(describe(image, boxes), dtype=np.float64)
    return np.asarray(features / np.maximum(np.linalg.norm(features, axis=1, keepdims=True), 1e-9))


def _around(box: FloatArray) -> FloatArray:
    """``(8, 4)`` boxes beside ``box`` ``(4,)``."""
    return box + np.tile(AROUND * (box[2:] - box[:2]), 2)


# Likenesses of the running median.
MEMORY = 15
# The running median from which the network counts.
TRUSTED_LIKENESS = 0.6
# Prior likeness of the target, so that a box that is lost at once is not taken for it.
EXPECTED = 0.9
# Share of the running median from which a likeness counts in it.
USUAL_SHARE = 0.6
# Share of the running median under which the target counts as lost. Half hidden, the target has one between the two.
LOST_SHARE = 0.4


# Height over width of the first box from which on the target may be a person, and the network is asked.
UPRIGHT = 1.8
# Weight of `EXPECTED`, in inferences.
TRUSTED = 3
# Likenesses below `LOST_SHARE` in a row from which the target is lost.
LOST_INFERENCES = 2


class Recognised:
    """A tracker whose status is also lost where the box is no longer like the first one.

    The likeness is the cosine of the features of an appearance network. The target is lost where it falls far below its
    running median. The network describes people. It counts only where the likeness has been high, and the first box is
    as upright as a person.

    Args:
        tracker: that follows.
        describe: appearance features of boxes.

    Attributes:
        settings: of the tracker; None where it has none.
        asked: whether the first box is upright enough for a person.
    """

    def __init__(self, tracker: SingleTracker, describe: Describe) -> None:
        self._tracker, self._describe = tracker, describe
        self.settings = getattr(tracker, "settings", None)

    def start(self, image: ImageArray, box: FloatArray) -> None:
        self._tracker.start(image, box)
        width, height = (np.asarray(box)[2:] - np.asarray(box)[:2]).tolist()
        self.asked = height >= UPRIGHT * width
        if self.asked:
            self._first = unit_features(self._describe, image, np.asarray(box)[None])[0]
        self._likenesses = deque([EXPECTED] * TRUSTED, maxlen=MEMORY)
        self._frame = self._lost = 0

    def follow(self, image: ImageArray) -> TargetState:
        there = self._tracker.follow(image)
        if not self.asked:
            return there
        self._frame += 1
        if self._frame % LOOK_INTERVAL == 0:
            likeness = float(unit_features(self._describe, image, there.box[None])[0] @ self._first)
            usual = median(self._likenesses)
            if likeness >= USUAL_SHARE * usual:
                self._likenesses.append(likeness)
            self._lost = self._lost + 1 if likeness < LOST_SHARE * usual else 0
        lost = self._lost >= LOST_INFERENCES and median(self._likenesses) >= TRUSTED_LIKENESS
        return replace(there, status="lost") if lost else there
