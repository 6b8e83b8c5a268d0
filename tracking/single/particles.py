"""Particles of the combined tracker: where they start, how they move, when they agree; thesis 3.2.3, 3.2.4, 3.2.6.

A particle is a row ``x, y, f``: the centre of its box in pixels and the number of its correlation filter. Width and
height of the box are the same for all particles: the thesis gives them no variance (3.3.2).
`Archive` holds the filters of the past that particles may take, 3.2.7.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.filters.correlation.kernelised_correlation import FilterBank
from tsuiseki.tracking.types import FloatArray, IntArray


@dataclass(frozen=True)
class Archive:
    """The last stored filters, each a bank of one, with the response that it had when it was stored.

    Attributes:
        capacity: U, the oldest filter goes when there would be more.
        first: the filter of the first frame, kept beside them for good; None as in the thesis.
        banks: oldest first.
        scores: one a bank.
    """

    capacity: int
    first: FilterBank | None = None
    banks: tuple[FilterBank, ...] = ()
    scores: tuple[float, ...] = ()

    def add(self, bank: FilterBank, score: float) -> Archive:
        """With one more filter."""
        keep = slice(max(0, len(self.banks) + 1 - self.capacity), None)
        return Archive(self.capacity, self.first, (*self.banks, bank)[keep], (*self.scores, score)[keep])

    def candidates(self) -> tuple[FilterBank, ...]:
        """All filters that can be drawn, the first frame's first."""
        return (self.first, *self.banks) if self.first is not None else self.banks

    def weights(self, by_score: bool) -> FloatArray:
        """Relative probabilities P_K of the candidates: alike, or by score; the first frame's counts as the best."""
        scores = [max(self.scores, default=1.0)] if self.first is not None else []
        scores += self.scores
        return np.maximum(np.array(scores), 1e-6) if by_score else np.ones(len(scores))


def step_deviation(target: FloatArray, divisor: float) -> FloatArray:
    """Standard deviations ``(2,)`` of x and y, pixels, for a target ``(2,)`` of first size ``w1, h1``.

    The thesis puts ``w1 / a`` and ``h1 / a`` on the diagonal of the covariance matrix S (3.3.2), although these are
    lengths: the deviation is ``sqrt(w1 / a)``, 2.7 pixels for a target of 25.
    """
    return np.sqrt(np.asarray(target, dtype=np.float64) / divisor)


def draw_particles(
    peaks: FloatArray,
    stored: int,
    past_weights: FloatArray,
    past_share: float,
    count: int,
    deviation: FloatArray,
    rng: np.random.Generator,
    shares: FloatArray | None = None,
) -> FloatArray:
    """Algorithm 1: particles around the highest maxima of the response, some with a filter of the past.

    Filter numbers ``0 ... M-1`` are the M hypotheses "the present filter, with the target at maximum m"; numbers
    ``M ... M+stored-1`` are the filters of the past.

    Args:
        peaks: ``(M, 2)`` places of the maxima, pixels.
        stored: number of filters of the past; with none, no number is replaced.
        past_weights: ``(stored,)`` not negative, proportional to P_K.
        past_share: mu of equation (3.2), in [0, 1].
        count: number of particles N.
        deviation: ``(2,)`` of S in equation (3.1), pixels.
        rng: draws everything.
        shares: ``(M,)`` P_J, the probability of each maximum; by default 1/M.

    Returns:
        ``(N, 3)`` particles.
    """
    number = rng.choice(len(peaks), size=count, p=shares)
    places = peaks[number] + rng.normal(size=(count, 2)) * deviation
    from_past = rng.random(count) < past_share
    if stored and past_weights.sum() > 0:
        past = len(peaks) + rng.choice(stored, size=count, p=past_weights / past_weights.sum())
        number = np.where(from_past, past, number)
    return np.column_stack([places, number])


def dispersion(particles: FloatArray, weights: FloatArray, variances: FloatArray) -> float:
    """Weighted variance V of the particles by the Mahalanobis distance, equations (3.7) and (3.8).

    The matrix C is the covariance S of the motion, a constant: with the particles' own covariance V would be the number
    of dimensions whatever the particles do. The weights are normalised, without which (3.8) would be no mean. A filter
    number is a name and not a quantity, so it enters as the probability that two particles, drawn by weight, have
    different filters (the variance of the one-hot vectors): 0 when all agree, below 1 always.

    Args:
        particles: ``(N, 3)``.
        weights: ``(N,)`` that sum to one.
        variances: ``(2,)`` diagonal of C for x and y, square pixels.
    """
    centre = weights @ particles[:, :2]
    places = float(weights @ (((particles[:, :2] - centre) ** 2) / variances).sum(axis=1))
    shares = np.bincount(particles[:, 2].astype(np.int64), weights)
    return places + 1.0 - float(shares @ shares)


def best_by_filter(particles: FloatArray, weights: FloatArray) -> tuple[IntArray, FloatArray]:
    """Filter numbers in use, ascending, and the heaviest particle's place ``(F, 2)`` for each, from which it learns."""
    numbers = particles[:, 2].astype(np.int64)
    order = np.lexsort((-weights, numbers))
    used, first = np.unique(numbers[order], return_index=True)
    return used, particles[order[first], :2]


def jump_prior(places: FloatArray, before: FloatArray, target: FloatArray) -> FloatArray:
    """``(M,)`` probabilities of maxima by how far they are from where the target was.

    A Cauchy density in widths and heights of the target: most targets move by less than themselves between frames, and
    a camera may be jerked by much more.

    Args:
        places: ``(M, 2)`` pixels.
        before: ``(2,)`` centre in the frame before.
        target: ``(2,)`` width and height.
    """
    distance = (((places - before) / target) ** 2).sum(axis=1)
    density = 1 / (1 + distance)
    return np.asarray(density / density.sum())


def densest(particles: FloatArray, weights: FloatArray, deviation: FloatArray) -> int:
    """Index of the heaviest particle at the place where the posterior density is greatest.

    After resampling the posterior is told by where the particles are, and hardly by their last weights: the heaviest
    one alone would jump between groups from frame to frame. The density is a sum of Gaussians about the particles, as
    wide as one step of the motion, ``deviation`` ``(2,)`` pixels.
    """
    places = particles[:, :2] / deviation
    near = np.exp(-0.5 * ((places[:, None] - places[None]) ** 2).sum(axis=2)) * weights
    return int(np.argmax(near[int(np.argmax(near.sum(axis=1)))]))


def heaviest_apart(particles: FloatArray, log_weights: FloatArray, apart: FloatArray, count: int) -> list[FloatArray]:
    """The heaviest particles that are not all near each other, heaviest first.

    Args:
        particles: ``(N, D)`` x, y and more.
        log_weights: ``(N,)``.
        apart: ``(2,)`` pixels; two of them differ by more than this in x or in y.
        count: how many, at most.
    """
    chosen: list[FloatArray] = []
    for particle in particles[np.argsort(-log_weights, kind="stable")]:
        if all((np.abs(particle[:2] - other[:2]) > apart).any() for other in chosen):
            chosen.append(particle)
        if len(chosen) == count:
            break
    return chosen
