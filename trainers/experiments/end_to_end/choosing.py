"""What is chosen by HOTA itself, on sequences that are not scored: six scalars, and how far learnt changes are taken.

*Direct search* needs no gradient: a pattern search (Hooke and Jeeves 1961) over `Scalars`, which tracks the training
sequences at every step. Its points lie on a lattice, so that the searches of all groups share most of their looks.

*Shares* of the learnt changes are chosen inside the training sequences: one group after the other is left out of
the fit and tracked at each of `SHARES`, and the best share is taken for the fit on all of them. So a change that does
not carry over is not made. Few sequences say little, so a share may also be asked to gain *surely*: by more than the
standard error of its gains on single sequences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tsuiseki.tracking.evaluation.resampling import scores_of
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.association.fitting import Fit, NetworkChanges, fit_network
from tsuiseki.trainers.experiments.association.runs import clip_sums
from tsuiseki.trainers.experiments.association.sequences import Clip
from tsuiseki.trainers.experiments.end_to_end.runs import learnable, tracked
from tsuiseki.trainers.experiments.end_to_end.simple_changes import Scalars, Shrunk

# Each tracks all training sequences; the first 13 go once both ways along each of the six scalars.
LOOKS = 16
STEPS = (0.2, 0.6, 0.6, 0.3, 0.8, 1.5)
# Of the changes of links and joins, and of those of detections, starts and ends.
SHARES = ((0.0, 0.0), (0.5, 0.25), (1.0, 0.0), (1.0, 0.5))


def scalar_sums(clip: Clip, scalars: Scalars) -> FloatArray:
    """Sums of the tracks at the tracker's costs changed by six numbers, see `score_sums`."""
    return clip_sums(clip, tracked(clip, scalars))


def share_sums(train: tuple[Clip, ...], tests: tuple[Clip, ...], fit: Fit) -> list[FloatArray]:
    """For each test ``(len(SHARES), 83)`` sums at shares of the changes that were learnt on ``train``."""
    changes = NetworkChanges(fit_network(learnable(train), replace(fit, trust=1.0)))
    # Of the first share nothing is left but the tracker itself.
    ways = [None, *(Shrunk(changes, *share) for share in SHARES[1:])]
    return [np.stack([clip_sums(clip, tracked(clip, way)) for way in ways]) for clip in tests]


def pattern_search(value: Callable[[Scalars], float], looks: int = LOOKS) -> Scalars:
    """The scalars of the highest value of at most ``looks`` that were tried, from none and coarse steps on."""
    known: dict[Scalars, float] = {}

    def of(scalars: Scalars) -> float:
        if scalars not in known:
            if len(known) >= looks:
                return -np.inf
            known[scalars] = value(scalars)
        return known[scalars]

    best, shrink = Scalars(), 1.0
    of(best)
    while len(known) < looks and shrink > 0.2:
        before = best
        for place, step in enumerate(STEPS):
            best = max((best, best.stepped(place, shrink * step), best.stepped(place, -shrink * step)), key=of)
        if best == before:
            shrink /= 2
    return best


def best_share(sums: Sequence[FloatArray], sure: bool) -> tuple[float, float]:
    """The share of the highest HOTA; none of the learnt changes where there is nothing to choose by.

    Args:
        sums: ``(len(SHARES), 83)`` of each sequence, tracked by what neither it nor the group to be scored had a part
            in; the first share is none.
        sure: only shares count whose mean gain of HOTA is above its standard error.
    """
    if not sums:
        return SHARES[0]
    together = [hota([one[k] for one in sums]) for k in range(len(SHARES))]
    if sure:
        single = np.array([[hota([one[k]]) for k in range(len(SHARES))] for one in sums])
        gains = single - single[:, :1]
        error = gains.std(axis=0, ddof=1) / np.sqrt(len(gains)) if len(gains) > 1 else np.full(len(SHARES), np.inf)
        together = [value if k == 0 or gains[:, k].mean() > error[k] else -np.inf for k, value in enumerate(together)]
    return SHARES[int(np.argmax(together))]


def hota(sums: Sequence[FloatArray]) -> float:
    """HOTA of several sequences together."""
    return float(scores_of(np.sum(sums, axis=0))["hota"])
