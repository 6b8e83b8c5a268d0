"""Scores of several sequences together from sums over them, and how sure a difference of two trackers is.

HOTA, MOTA and IDF1 of several sequences are ratios of sums over all their boxes. With the sums of each sequence in one
row, the scores of any sample of sequences, drawn with replacement, come from one product of matrices: the paired
bootstrap (Efron and Tibshirani 1993, chapter 13) scores two trackers on the same samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.evaluation.identity_metrics import ALPHAS
from tsuiseki.tracking.evaluation.multi import SequencePair, people_sums
from tsuiseki.tracking.types import FloatArray

# How many overlaps HOTA averages over.
OVERLAPS = len(ALPHAS)
SCORES = ("hota", "det_a", "ass_a", "mota", "idf1")
COUNTS = ("id_switches", "false_positives", "false_negatives", "labelled")


@dataclass(frozen=True)
class Interval:
    """A difference of two scores over all sequences, and the ends of its interval over samples of sequences."""

    difference: float
    low: float
    high: float


def score_sums(pair: SequencePair) -> FloatArray:
    """``(83,)`` the sums of a sequence from which its scores and those of several follow.

    Matched, missed and false boxes and the association accuracies of the matched ones at each of the 19 overlaps of
    HOTA; matched, false and missed boxes and switches of CLEAR; matched, false and missed boxes of the identities.
    """
    sums = people_sums(pair)
    hota, clear, identity = sums.hota, sums.clear, sums.identity
    return np.concatenate(
        [
            hota.hits, hota.misses, hota.false, hota.associations,
            [clear.hits, clear.false, clear.misses, clear.switches],
            [identity.hits, identity.false, identity.misses],
        ]
    ).astype(np.float64)  # fmt: skip


def scores_of(sums: FloatArray) -> dict[str, FloatArray]:
    """Scores from ``(..., 83)`` sums, ``(...)`` each: hota, det_a, ass_a, mota, idf1 and the counts."""
    matched, missed, false, associated = (sums[..., k * OVERLAPS : (k + 1) * OVERLAPS] for k in range(4))
    hits, wrong, lost, switches, id_found, id_wrong, id_lost = np.moveaxis(sums[..., 4 * OVERLAPS :], -1, 0)
    det_a = matched / np.maximum(matched + missed + false, 1)
    ass_a = associated / np.maximum(matched, 1)
    return {
        "hota": np.sqrt(det_a * ass_a).mean(axis=-1),
        "det_a": det_a.mean(axis=-1),
        "ass_a": ass_a.mean(axis=-1),
        "mota": (hits - wrong - switches) / np.maximum(hits + lost, 1),
        "idf1": id_found / np.maximum(id_found + 0.5 * (id_wrong + id_lost), 1),
        "id_switches": switches,
        "false_positives": wrong,
        "false_negatives": lost,
        "labelled": hits + lost,
    }


def paired_bootstrap(
    ours: FloatArray, theirs: FloatArray, samples: int, rng: np.random.Generator
) -> dict[str, Interval]:
    """How far ours is above theirs, with intervals of 95 % over the sequences.

    Args:
        ours: ``(S, 83)`` sums of S sequences.
        theirs: likewise, of the same sequences in the same order.
        samples: how many samples of S sequences are drawn with replacement.
        rng: draws them.

    Returns:
        An interval for each of hota, det_a, ass_a, mota, idf1 and id_switches. With a single sequence it is that of one
        point.

    Raises:
        ValueError: the two are of different shape.
    """
    if ours.shape != theirs.shape:
        raise ValueError(f"expected sums of the same sequences, got {ours.shape} and {theirs.shape}")
    count = len(ours)
    drawn = rng.multinomial(count, np.full(count, 1 / count), samples).astype(np.float64)
    our_scores, their_scores = scores_of(ours.sum(axis=0)), scores_of(theirs.sum(axis=0))
    our_samples, their_samples = scores_of(drawn @ ours), scores_of(drawn @ theirs)
    outside = (1 - 0.95) / 2
    intervals = {}
    for name in (*SCORES, "id_switches"):
        low, high = np.quantile(our_samples[name] - their_samples[name], (outside, 1 - outside))
        intervals[name] = Interval(float(our_scores[name] - their_scores[name]), float(low), float(high))
    return intervals
