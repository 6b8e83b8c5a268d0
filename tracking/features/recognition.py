"""Who of a gallery each person in view is, or nobody of them: probabilities by appearance.

Features are those of a view without their mean, since light and camera are common to all in it. With s the cosine of
person i in view and person k of K in the gallery, the odds that they are one against two people are

    w_ik = π / K / (1 − π) · N(min(s_ik, μ); μ, σ) / N(s_ik; m, d)                                    (1)

A cosine above the usual one of the same person speaks no less for it, hence the minimum. m and d are learnt from the
people who are in view together, who are different ones. μ and σ, and π, the share of people in view who are of the
gallery, are those that agree with the probabilities, by expectation and maximisation from the usual ones.
Person i is one person at most, and person k is in one place at a time, so that odds compete. How probable each answer
is under both is found by belief propagation (Williams and Lau, *Approximate evaluation of marginal association
probabilities*, 2014), with sums over j that are in view together with i:

    ν_ik = 1 / (1 + Σ_{l≠k} w_il μ_il),   μ_ik = 1 / (1 + Σ_{j≠i} w_jk ν_jk)
    P(i is k) = w_ik μ_ik / (1 + Σ_l w_il μ_il)                                                      (2)

The rest, 1 − Σ_k P(i is k), is nobody's of the gallery.
"""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import BoolArray, FloatArray, Recognition

# Mean and deviation of the cosine of one person on two days, before they are learnt. These and what follows were chosen
# on generated people before one camera and before two.
SAME = (0.7, 0.2)
# Pairs that it counts for.
SAME_WEIGHT = 2.0
# Mean and deviation of the cosine of two people, before they are learnt.
DIFFERENT = (-0.04, 0.31)
# Pairs that it counts for.
DIFFERENT_WEIGHT = 20.0
# Share of people in view who are of the gallery, before it is learnt.
SHARE = 0.5
# People that it counts for.
SHARE_WEIGHT = 5.0
# Rounds of expectation and maximisation: the share has settled.
ROUNDS = 20
# Rounds of belief propagation in each: its messages change by under a thousandth in the last.
MESSAGES = 30
# People in a view from which on its mean is taken off.
FEW = 5


def centred(features: FloatArray, centre: FloatArray | None = None) -> FloatArray:
    """``(N, D)`` rows of unit length, without the mean of their view; rows of zeros, of which nothing is known, stay.

    Args:
        features: ``(N, D)`` of people in one view.
        centre: ``(D,)`` of another view, which is taken off where there are too `FEW` people in this one.
    """
    return without(features, centre_of(features, centre))


def centre_of(features: FloatArray, usual: FloatArray | None = None) -> FloatArray | None:
    """``(D,)`` mean of people in one view; the ``usual`` one where they are too `FEW`."""
    unit = unit_rows(features)
    described = unit.any(axis=1)
    return np.asarray(unit[described].mean(axis=0)) if described.sum() >= FEW else usual


def without(features: FloatArray, centre: FloatArray | None) -> FloatArray:
    """``(N, D)`` rows of unit length, without a centre ``(D,)``; rows of zeros stay."""
    unit = unit_rows(features)
    return unit if centre is None else unit_rows(np.where(unit.any(axis=1, keepdims=True), unit - centre, 0.0))


def unit_rows(rows: FloatArray) -> FloatArray:
    """``(N, D)`` rows of unit length; rows of zeros stay."""
    return np.asarray(rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9))


def recognise(features: FloatArray, gallery: FloatArray, together: BoolArray) -> FloatArray:
    """``(N, K)`` probability (2) that each person in view is each of the gallery.

    Args:
        features: ``(N, D)`` of the people in view, as of `centred`; zeros where nothing is known.
        gallery: ``(K, D)`` likewise.
        together: ``(N, N)`` which people are in view at one time, and so are different ones.
    """
    cosines = features @ gallery.T
    if not cosines.size:
        return cosines
    described = (features != 0).any(axis=1, keepdims=True)
    rivals = (together & ~np.eye(len(features), dtype=bool)).astype(float)
    different, same, share = _different(features, together), SAME, SHARE
    for _ in range(ROUNDS):
        likelier = np.exp(_normal(np.minimum(cosines, same[0]), *same) - _normal(cosines, *different))
        odds = np.where(described, likelier, 1.0) * (share / len(gallery) / (1 - share))
        probabilities = _compete(odds, rivals)
        share = float((probabilities.sum() + SHARE_WEIGHT * SHARE) / (len(features) + SHARE_WEIGHT))
        mean, deviation = _blended(cosines, probabilities * described, SAME, SAME_WEIGHT)
        same = max(mean, sum(different)), deviation
    return np.asarray(probabilities)


def _compete(odds: FloatArray, rivals: FloatArray) -> FloatArray:
    """``(N, K)`` probabilities (2) of odds (1), with ``(N, N)`` 1 for two who are in view together."""
    room = np.ones_like(odds)
    for _ in range(MESSAGES):
        weighted = odds * room
        free = 1 / (1 + weighted.sum(axis=1, keepdims=True) - weighted)
        room = 1 / (1 + rivals @ (odds * free))
    weighted = odds * room
    return np.asarray(weighted / (1 + weighted.sum(axis=1, keepdims=True)))


def identity_of(probabilities: FloatArray, names: list[str]) -> Recognition:
    """The best of ``(K,)`` probabilities, or nobody of the gallery, where that is more probable than each."""
    nobody = 1 - float(probabilities.sum())
    best = int(probabilities.argmax()) if len(probabilities) else -1
    if best < 0 or nobody >= probabilities[best]:
        return Recognition("", nobody)
    return Recognition(names[best], float(probabilities[best]))


def _different(features: FloatArray, together: BoolArray) -> tuple[float, float]:
    """Mean and deviation of the cosine of two people in view."""
    described = (features != 0).any(axis=1)
    pairs = np.triu(together & described & described[:, None], 1)
    return _blended(features @ features.T, pairs.astype(float), DIFFERENT, DIFFERENT_WEIGHT)


def _blended(values: FloatArray, weights: FloatArray, usual: tuple[float, float], count: float) -> tuple[float, float]:
    """Weighted mean and deviation of values, as if the usual ones had been seen ``count`` times besides."""
    total = weights.sum() + count
    mean = ((weights * values).sum() + count * usual[0]) / total
    square = (weights * np.square(values - mean)).sum() + count * (usual[1] ** 2 + (usual[0] - mean) ** 2)
    return float(mean), float(np.sqrt(square / total))


def _normal(values: FloatArray, mean: float, deviation: float) -> FloatArray:
    """Logarithm of the normal density, without the constant."""
    return np.asarray(-0.5 * np.square((values - mean) / deviation) - np.log(deviation))
