"""How a camera moved between two frames that have little in common: a search over all shifts and many turns.

Where a jerk smears a frame, or moves it by a third of its width, no feature can be followed. What is left are blurred
patches of ground and people. They are compared at a quarter of the size or less, in colour, without brightness that
changes slowly and without detail that the smear takes away (`pattern`).

For every turn the correlation of the overlapping parts is computed for all shifts at once, in the Fourier domain (D.
Padfield, Masked Object Registration in the Fourier Domain, 2012). The best are refined (G. Evangelidis and E. Psarakis,
Parametric Image Alignment Using Enhanced Correlation Coefficient Maximization, 2008). How well a step explains the
second frame is again a correlation, that of the frame with the first one, moved (`agreement`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from tsuiseki.tracking.types import FloatArray, ImageArray

Pattern = NDArray[np.float32]


# Patterns are shrunk to this longest side, pixels.
LONGEST_SIDE = 160
# Standard deviations of the blur that takes detail away, and of the blur whose result counts as slow brightness, pixels
# of the pattern.
DETAIL, BRIGHTNESS = 1.0, 12.0
# The largest turn and the step between turns, degrees; and the best turns that are refined.
LARGEST_TURN, TURN_STEP, REFINED = 30.0, 5.0, 5
# Least share of the image that two frames must have in common.
OVERLAP = 0.25


@dataclass(frozen=True)
class FoundStep:
    """A step that the search proposes.

    Attributes:
        similarity: ``(2, 3)`` from pixels of the first pattern to those of the second.
        agreement: of the two patterns after it, in [-1, 1].
    """

    similarity: FloatArray
    agreement: float


def pattern(image: ImageArray) -> Pattern:
    """``(h, w, 3)`` float32: what is compared of an image ``(H, W, 3)`` uint8."""
    ratio = min(LONGEST_SIDE / max(image.shape[:2]), 1.0)
    size = max(round(image.shape[1] * ratio), 8), max(round(image.shape[0] * ratio), 8)
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    slow = cv2.GaussianBlur(small, (0, 0), BRIGHTNESS)
    result = cv2.GaussianBlur(small, (0, 0), DETAIL) - slow
    # What rounding leaves of a blank image.
    result[np.abs(result) < 0.01] = 0
    return np.asarray(result, dtype=np.float32)


def agreement(first: Pattern, second: Pattern, similarity: FloatArray) -> float:
    """Correlation of ``second`` with ``first`` moved by ``similarity``, in [-1, 1]; -1 where they share too little."""
    moved, inside = _moved(first, similarity)
    shared = inside > 0
    if shared.mean() < OVERLAP:
        return -1.0
    one, other = moved[shared], second[shared]
    one, other = one - one.mean(axis=0), other - other.mean(axis=0)
    energy = float((one * one).sum()) * float((other * other).sum())
    # Two blank images say nothing.
    return float((one * other).sum()) / energy**0.5 if energy > 0 else -1.0


def search(first: Pattern, second: Pattern) -> list[FoundStep]:
    """The steps that explain ``second`` by ``first``, the best first; those that lead to the same place come once."""
    turns = np.arange(-(LARGEST_TURN // TURN_STEP) * TURN_STEP, LARGEST_TURN + TURN_STEP / 2, TURN_STEP)
    coarse = sorted((_best_shift(first, second, turn) for turn in turns.tolist()), key=lambda s: -s[0])
    found = []
    for height, guess in coarse[:REFINED]:
        found.append(FoundStep(guess, height))
        refined = refine(first, second, guess)
        if refined is not None:
            found.append(refined)
    return _distinct(sorted(found, key=lambda step: -step.agreement), first)


def _moved(image: Pattern, similarity: FloatArray) -> tuple[Pattern, Pattern]:
    """``image`` after a similarity, and ``(h, w)`` where it shows something, 0 or 1."""
    size = image.shape[1], image.shape[0]
    inside = cv2.warpAffine(np.ones(image.shape[:2], dtype=np.float32), similarity, size) > 0.99
    return np.asarray(cv2.warpAffine(image, similarity, size), dtype=np.float32), inside.astype(np.float32)


def _best_shift(first: Pattern, second: Pattern, turn: float) -> tuple[float, FloatArray]:
    """The highest correlation over all shifts of ``first`` turned by ``turn`` degrees, and the similarity."""
    height, width = first.shape[:2]
    similarity = np.asarray(cv2.getRotationMatrix2D((width / 2, height / 2), turn, 1.0), dtype=np.float64)
    turned, inside = _moved(first, similarity)
    correlation = _masked_correlation(turned * inside[..., None], inside, second)
    row, column = np.unravel_index(int(np.argmax(correlation)), correlation.shape)
    # Shifts up and to the left are at the end.
    down = int(row) - correlation.shape[0] * (row >= height)
    right = int(column) - correlation.shape[1] * (column >= width)
    similarity[:, 2] += right, down
    return float(correlation[row, column]), similarity


def _masked_correlation(first: Pattern, inside: Pattern, second: Pattern) -> FloatArray:
    """``(2h, 2w)`` correlation coefficient of the parts that overlap, for all shifts; -1 where they are too small."""
    height, width = second.shape[:2]
    shape = scipy.fft.next_fast_len(2 * height, real=True), scipy.fft.next_fast_len(2 * width, real=True)

    def spectra(images: Pattern) -> NDArray[np.complex64]:
        return np.asarray(scipy.fft.rfft2(images, shape, axes=(0, 1)))

    def correlated(one: NDArray[np.complex64], other: NDArray[np.complex64]) -> FloatArray:
        return np.asarray(scipy.fft.irfft2(np.conj(one) * other, shape, axes=(0, 1)))

    seen, whole = spectra(inside[..., None]), spectra(np.ones((height, width, 1), dtype=np.float32))
    one, other = spectra(first), spectra(second)
    count = np.maximum(correlated(seen, whole), 1)
    sum_first, sum_second = correlated(one, whole), correlated(seen, other)
    product = (correlated(one, other) - sum_first * sum_second / count).sum(axis=2)
    energy_first = (correlated(spectra(first * first), whole) - sum_first**2 / count).sum(axis=2)
    energy_second = (correlated(seen, spectra(second * second)) - sum_second**2 / count).sum(axis=2)
    energy = energy_first * energy_second
    # What rounding leaves of an empty overlap is no energy.
    floor = 1e-3 * max(energy_first.max(), 0) * max(energy_second.max(), 0) + np.finfo(np.float32).tiny
    result = product / np.sqrt(np.maximum(energy, floor))
    return np.where(count[..., 0] < OVERLAP * height * width, -1.0, result)


def refine(first: Pattern, second: Pattern, guess: FloatArray) -> FoundStep | None:
    """The step near ``guess``, turned and shifted, of the highest correlation; None where there is none."""
    back = np.asarray(cv2.invertAffineTransform(guess), dtype=np.float32)
    until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-4)
    grey_second, grey_first = (np.ascontiguousarray(image.mean(axis=2)) for image in (second, first))
    try:
        _, back = cv2.findTransformECC(grey_second, grey_first, back, cv2.MOTION_EUCLIDEAN, until, None, 5)  # type: ignore[call-overload]
    except cv2.error:  # It has left the image.
        return None
    similarity = np.asarray(cv2.invertAffineTransform(back.astype(np.float64)), dtype=np.float64)
    return FoundStep(similarity, agreement(first, second, similarity))


def leads_to_the_same(one: FoundStep, other: FoundStep, image: Pattern) -> bool:
    """Whether two steps take the corners of ``image`` to the same places, to an eighth of the width."""
    height, width = image.shape[:2]
    corners = np.array([[x, y, 1.0] for x in (0, width) for y in (0, height)])
    away = corners @ (one.similarity - other.similarity).T
    return bool(np.linalg.norm(away, axis=1).max() <= width / 8)


def _distinct(steps: Sequence[FoundStep], image: Pattern) -> list[FoundStep]:
    """``steps`` without those that lead to the same as a better one."""
    kept: list[FoundStep] = []
    for step in steps:
        if not any(leads_to_the_same(step, better, image) for better in kept):
            kept.append(step)
    return kept
