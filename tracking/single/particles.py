"""The search of `kcf_particle`: its particles, their weights in a frame, and when it begins; thesis 3.2.2-3.2.7.

A particle is a row ``x, y, f``: the centre of its box in pixels and the number of its correlation filter. Width and
height of the box are the same for all particles: the thesis gives them no variance (3.3.2).

In (3.5) the displacement is measured from the tracker's box in the frame before, for all particles. So one window
serves all filters, and one batched transform gives all responses. Outside the window the response is zero.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from pydantic import Field, NonNegativeFloat
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.bounds import SETTINGS, Age, Particles, Share
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.colours import ForegroundColour
from tsuiseki.tracking.single.search_windows import ResponseMaps, maxima_of_each
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray

# Share of a new frame in the colours, in [0, 1].
COLOUR_RATE = 0.04
# Of the additions: power of the likelihood.
SHARPNESS = 2.0
# Of the additions: weight of the colours in the likelihood.
COLOUR_WEIGHT = 6.0
# Added to every likelihood, so that a place without any response is unlikely and not impossible.
SMALLEST_LIKELIHOOD = 1e-6
# The thesis's a, of the covariance S of the motion.
DIVISOR = 10 / 3
# Of the additions: share of the response's running mean under which the filter is doubted.
RELATIVE_SWITCH = 0.65
# Of the additions: share of the colour score's running mean under which the filter is doubted.
DRIFT_SWITCH = 0.7


@pydantic_dataclass(frozen=True, config=SETTINGS)
class KcfParticleSettings:
    """Constants; the defaults are Table 3.2 and the choices of 3.3.3, as they are printed.

    Attributes:
        kcf: settings of the correlation filters.
        switch: epsilon_1, the search starts when the greatest response is at most this.
        plain_frames: H, frames after a search in which none starts.
        stored: U, number of stored filters of the past.
        particles: N, number of particles.
        past_share: mu, probability of a filter of the past.
        convergence: epsilon_2, the search ends when V / (w1 h1) is below.
        response_share: alpha of equation (3.4); 1 leaves objectness out.
        hypotheses: M, number of maxima of the response.
        past_by_score: filters of the past are drawn by the response that each had when it was stored, not all alike.
        additions: those of `kcf_particle.ROBUST`, which are not the thesis's.
    """

    kcf: kcf.KcfSettings = field(default_factory=lambda: kcf.THESIS)
    switch: float = 0.2
    plain_frames: Age = 50
    stored: Annotated[int, Field(ge=0, le=1000)] = 20
    particles: Particles = 200
    past_share: Share = 0.5
    convergence: NonNegativeFloat = 0.03
    response_share: Share = 0.3
    hypotheses: Annotated[int, Field(ge=1, le=1000)] = 20
    past_by_score: bool = False
    additions: bool = False


@dataclass(frozen=True)
class RunningMean:
    """A running mean, plain over the first values, and how a new value compares to it."""

    rate: float = 0.05
    mean: float | None = None
    count: int = 0

    def add(self, value: float) -> RunningMean:
        """The mean with one more value: of all until the rate is reached, then weighted towards the recent."""
        share = max(self.rate, 1 / (self.count + 1))
        mean = value if self.mean is None else self.mean + share * (value - self.mean)
        return RunningMean(self.rate, mean, self.count + 1)

    def falls_below(self, share: float, value: float) -> bool:
        """Whether ``value`` is less than ``share`` of the mean so far."""
        return self.mean is not None and value < share * self.mean


@dataclass(frozen=True)
class Confidence:
    """Responses and colours of the target in frames without doubt, and when the filter is doubted, 3.2.2.

    Attributes:
        settings: hold the threshold of the response.
        peaks: responses, a frame each.
        colours: colour scores, one for each frame with a score.
        colour: the colours themselves; None where they are not used or where a box covers the whole image.
    """

    settings: KcfParticleSettings
    peaks: RunningMean = RunningMean()
    colours: RunningMean = RunningMean(rate=0.1)
    colour: ForegroundColour | None = None

    @classmethod
    def start(cls, settings: KcfParticleSettings, image: ImageArray, box: FloatArray) -> Confidence:
        """From the first frame."""
        return cls(settings, colour=ForegroundColour.learn(image, box) if settings.additions else None)

    def doubts(self, peak: float, colour: float | None) -> bool:
        """Whether the particle filter takes over, or goes on.

        Args:
            peak: response of the filter at the target.
            colour: colour score there; None where none was computed.
        """
        if peak <= self.settings.switch:
            return True
        return self.settings.additions and (
            self.peaks.falls_below(RELATIVE_SWITCH, peak)
            or (colour is not None and self.colours.falls_below(DRIFT_SWITCH, colour))
        )

    def learn(self, image: ImageArray, box: FloatArray, peak: float, colour: float | None) -> Confidence:
        """With one more frame without doubt; ``peak`` and ``colour`` as `doubts` had them."""
        learnt = replace(self, peaks=self.peaks.add(peak))
        if colour is None or self.colour is None:
            return learnt
        new = ForegroundColour.learn(image, box)
        blended = self.colour if new is None else self.colour.blend(new, COLOUR_RATE)
        return replace(learnt, colours=self.colours.add(colour), colour=blended)

    def colour_score(self, image: ImageArray, box: FloatArray) -> float:
        """Colour score of one box ``(4,)``; 1 where colours are not used."""
        return 1.0 if self.colour is None else float(self.colour.score(image, box[None])[0])


@dataclass(frozen=True)
class SearchView:
    """What the particles see of one frame.

    Attributes:
        maps: responses of the filters.
        image: ``(H, W, 3)``.
        proposals: ``(K, 4)`` boxes near the windows that look like an object; None where objectness has no share.
    """

    maps: ResponseMaps
    image: ImageArray
    proposals: FloatArray | None

    def log_likelihood(self, particles: FloatArray, size: FloatArray, confidence: Confidence) -> FloatArray:
        """``(N,)`` Eqs. (3.4) and (3.6), v being the greatest overlap with a box that looks like an object.

        With the additions it is sharpened and joined with the colours.

        Args:
            particles: ``(N, 3)`` x, y and number of a filter.
            size: ``(2,)`` width and height of the target, pixels.
            confidence: the target's colours, and how much like them it usually is.
        """
        boxes = np.concatenate([particles[:, :2] - size / 2, particles[:, :2] + size / 2], axis=1)
        response = self.maps.at(particles[:, :2], particles[:, 2].astype(np.int64))
        overlap = 0.0 if self.proposals is None else iou_matrix(boxes, self.proposals).max(axis=1, initial=0)
        share = confidence.settings.response_share
        result = np.log(share * np.maximum(response, 0.0) + (1 - share) * overlap + SMALLEST_LIKELIHOOD)
        if not confidence.settings.additions:
            return np.asarray(result)
        if confidence.colour is not None:
            score = confidence.colour.score(self.image, boxes)
            usual = confidence.colours.mean if confidence.colours.mean is not None else float(score.max())
            result += COLOUR_WEIGHT * np.minimum(score - usual, 0)
        return np.asarray(SHARPNESS * result)


def highest_maxima(maps: ResponseMaps, count: int) -> FloatArray:
    """``(M, 2)`` places of the first filter's highest maxima, the highest first; none where it is flat."""
    which, shifts, heights = maxima_of_each(maps.maps[:, 0], count)
    places = maps.centres[which] + shifts * maps.cell
    # Windows overlap: a maximum counts in the window whose centre is nearest.
    nearest = np.argmin(((places[:, None] - maps.centres[None]) ** 2).sum(axis=2), axis=1) == which
    return np.asarray(places[nearest][np.argsort(-heights[nearest], kind="stable")[:count]])


def step_deviation(target: FloatArray) -> FloatArray:
    """Standard deviations ``(2,)`` of x and y in Eq. (3.3), pixels, for a target ``(2,)`` of first size ``w1, h1``.

    The thesis puts ``w1 / a`` and ``h1 / a`` on the diagonal of the covariance matrix S (3.3.2), although these are
    lengths: the deviation is ``sqrt(w1 / a)``, 2.7 pixels for a target of 25.
    """
    return np.sqrt(np.asarray(target, dtype=np.float64) / DIVISOR)


def draw_particles(
    peaks: FloatArray,
    past_weights: FloatArray,
    past_share: float,
    count: int,
    deviation: FloatArray,
    rng: np.random.Generator,
    shares: FloatArray | None = None,
) -> FloatArray:
    """Algorithm 1: particles around the highest maxima of the response, some with a filter of the past.

    Filter numbers ``0 ... M-1`` are the M hypotheses "the present filter, with the target at maximum m"; numbers
    ``M ... M+S-1`` are the S filters of the past.

    Args:
        peaks: ``(M, 2)`` places of the maxima, pixels.
        past_weights: ``(S,)`` > 0, proportional to P_K; without filters of the past no number is replaced.
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
    if len(past_weights):
        past = len(peaks) + rng.choice(len(past_weights), size=count, p=past_weights / past_weights.sum())
        number = np.where(from_past, past, number)
    return np.column_stack([places, number])


def dispersion(particles: FloatArray, weights: FloatArray, variances: FloatArray) -> float:
    """Weighted variance V of the particles by the Mahalanobis distance, Eqs. (3.7)-(3.8).

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


def jump_prior(places: FloatArray, previous: FloatArray, target: FloatArray) -> FloatArray:
    """``(M,)`` probabilities of maxima by how far they are from where the target was.

    A Cauchy density in widths and heights of the target: most targets move by less than themselves between frames, and
    a camera may be jerked by much more.

    Args:
        places: ``(M, 2)`` pixels.
        previous: ``(2,)`` centre in the frame before.
        target: ``(2,)`` width and height.
    """
    distance = (((places - previous) / target) ** 2).sum(axis=1)
    density = 1 / (1 + distance)
    return np.asarray(density / density.sum())


def densest(particles: FloatArray, weights: FloatArray, deviation: FloatArray) -> int:
    """Index of the heaviest particle at the place where the posterior density is greatest.

    After resampling the posterior lies in the places of the particles, and hardly in their last weights: the heaviest
    one alone would jump between groups from frame to frame. The density is a sum of Gaussians about the particles, as
    wide as one step of the motion, ``deviation`` ``(2,)`` pixels.
    """
    places = particles[:, :2] / deviation
    near = np.exp(-0.5 * ((places[:, None] - places[None]) ** 2).sum(axis=2)) * weights
    return int(np.argmax(near[int(np.argmax(near.sum(axis=1)))]))
