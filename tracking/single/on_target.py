"""The probability that a box is on its target, from what a network and the particles say of it: a logistic regression.

A Siamese network's own score is hardly lower on something else than on the target. Together with the recent template,
the likeness to the looks so far, the scores of distractors, and how well particles agree, it tells more. Signs of a
frame are joined with their running means, for a short flicker says less than a lasting change.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass

import numpy as np

from tsuiseki.tracking.single.siamese import Template
from tsuiseki.tracking.types import FloatArray

# Share of a frame in the running means.
RATE = 0.2
# Score nearest to 0 and to 1 that counts, so that its logit is bounded.
LEAST_SCORE = 1e-4


@dataclass(frozen=True)
class Signs:
    """What speaks for and against a box being on the target.

    Attributes:
        score: logit of the network's score.
        distractor: logit of the best score by more than half the target's sides away.
        spread: mean distance of particles from the box, in sides of the target.
        likeness: greatest cosine with the first look and those of the last certain frames.
        rival: greatest cosine with the looks of what is not the target: its surroundings at first, and distractors.
    """

    score: float
    distractor: float
    spread: float
    likeness: float
    rival: float

    def row(self) -> FloatArray:
        """``(5,)`` in the order of the attributes."""
        return np.array(astuple(self))


# Weights of the logistic regression for `Signs.row` of a frame, fitted with NanoTrack's response to
# generated clips (`python -m benchmarks.single.on_target`). No real picture is in them.
NOW = np.array([0.30, -0.01, 0.19, 5.13, -1.25])
# Weights for the running means of those rows, fitted likewise.
LASTING = np.array([0.25, 0.14, -0.17, 3.94, -1.27])
# Log-odds where all signs are zero. The shift of 0.75 is chosen on real clips, whose targets change more.
OFFSET = -7.69 + 0.75


def logit(score: float) -> float:
    """Log-odds of a score in [0, 1], bounded.

    >>> logit(0.5)
    0.0
    """
    bounded = min(max(score, LEAST_SCORE), 1 - LEAST_SCORE)
    return math.log(bounded / (1 - bounded))


def look(template: Template) -> FloatArray:
    """The template's middle half, which the target covers, as a unit vector without its mean."""
    height, width = template.shape[-2:]
    middle = template[..., height // 4 : height - height // 4, width // 4 : width - width // 4]
    centred = middle.astype(np.float64).ravel() - middle.mean()
    return np.asarray(centred / max(float(np.linalg.norm(centred)), 1e-9))


def probability(now: FloatArray, means: FloatArray) -> float:
    """How likely a box is on its target, in [0, 1].

    Args:
        now: ``(5,)`` of `Signs.row`.
        means: ``(5,)`` their running means.
    """
    return 1 / (1 + math.exp(-float(np.clip(OFFSET + NOW @ now + LASTING @ means, -60, 60))))
