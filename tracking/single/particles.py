"""The search of `kcf_particle`: its particles, what they see of a frame, and when it begins; thesis 3.2.2-3.2.7.

A particle is a row ``x, y, f``: the centre of its box in pixels and the number of its correlation filter. Width and
height of the box are the same for all particles: the thesis gives them no variance (3.3.2). `Archive` holds the filters
of the past that particles may take, 3.2.7. `Confidence` says when the correlation filter is in doubt, 3.2.2, with two
more reasons to doubt.

In (3.5) the displacement is measured from the tracker's box in the frame before, for all particles. So one window
serves all filters, and one batched transform gives all responses. Outside the window the response is zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.features.objectness import ObjectnessModel, propose
from tsuiseki.tracking.filters.kernelised_correlation import FilterBank, Samples, respond
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.colours import ForegroundColour
from tsuiseki.tracking.single.constants import KcfParticleSettings
from tsuiseki.tracking.single.response import ResponseMaps, local_maxima, log_likelihood, object_overlap
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray

COLOUR_RATE = 0.04  # of learning new colours, a look


@dataclass(frozen=True)
class RunningMean:
    """A running mean, plain over the first values, and how a new value compares to it."""

    rate: float = 0.05
    mean: float | None = None
    count: int = 0

    def add(self, value: float) -> RunningMean:
        """With one more value."""
        share = max(self.rate, 1 / (self.count + 1))
        return RunningMean(
            self.rate, value if self.mean is None else self.mean + share * (value - self.mean), self.count + 1
        )

    def falls_below(self, share: float, value: float) -> bool:
        """Whether ``value`` is less than ``share`` of the mean so far."""
        return self.mean is not None and value < share * self.mean


@dataclass(frozen=True)
class Confidence:
    """What the target looked like while it was tracked without doubt.

    Attributes:
        peaks: responses, a frame each.
        colours: colour scores, a look each.
        colour: the colours themselves; None where they are not used or where a box covers the whole image.
    """

    peaks: RunningMean = RunningMean()
    colours: RunningMean = RunningMean(rate=0.1)
    colour: ForegroundColour | None = None

    @classmethod
    def start(cls, settings: KcfParticleSettings, image: ImageArray, box: FloatArray) -> Confidence:
        """From the first frame."""
        wanted = settings.colour or settings.drift_switch
        return cls(colour=ForegroundColour.learn(image, box) if wanted else None)

    def doubts(self, settings: KcfParticleSettings, peak: float, colour: float | None) -> bool:
        """Whether the particle filter takes over, or goes on.

        Args:
            settings: hold the thresholds.
            peak: response of the filter at the target.
            colour: colour score there; None where nobody looked.
        """
        if peak <= settings.switch or self.peaks.falls_below(settings.relative_switch, peak):
            return True
        return colour is not None and self.colours.falls_below(settings.drift_switch, colour)

    def learn(self, image: ImageArray, box: FloatArray, peak: float, colour: float | None) -> Confidence:
        """With one more frame without doubt; ``peak`` and ``colour`` as `doubts` had them."""
        after = replace(self, peaks=self.peaks.add(peak))
        if self.colour is None or colour is None:
            return after
        new = ForegroundColour.learn(image, box)
        return replace(
            after,
            colours=self.colours.add(colour),
            colour=self.colour if new is None else self.colour.blend(new, COLOUR_RATE),
        )

    def colour_score(self, image: ImageArray, box: FloatArray) -> float:
        """Of one box ``(4,)``; 1 where colours are not used."""
        return 1.0 if self.colour is None else float(self.colour.score(image, box[None])[0])


PROPOSALS = 100
Windows = tuple[Samples, FloatArray]
"""What is in the windows of a frame, and their centres ``(W, 2)`` in pixels."""


@dataclass(frozen=True)
class SearchView:
    """What the particles see of one frame.

    Attributes:
        maps: responses of the filters.
        image: ``(H, W, 3)``.
        proposals: ``(K, 4)`` boxes near the windows that look like an object.
    """

    maps: ResponseMaps
    image: ImageArray
    proposals: FloatArray


@dataclass(frozen=True)
class ObservationModel:
    """How a frame is looked at in a search.

    Attributes:
        settings: constants.
        model: of the correlation filters.
        objects: objectness of sizes near the target's; None where the settings give it no share.
    """

    settings: KcfParticleSettings
    model: kcf.Kcf
    objects: ObjectnessModel | None

    def windows(self, image: ImageArray, target: kcf.KcfState, reach: int) -> Windows:
        """The window about ``target``, and ``reach`` more to each side of it."""
        if reach == 0:
            return self.model.window.describe(image, target.centre[None], np.array([target.size])), target.centre[None]
        return self.model.window.describe_around(image, target.centre, target.size, reach)

    def maps(self, windows: Windows, bank: FilterBank, size: float) -> ResponseMaps:
        """Responses of all filters in all windows, for a target of relative ``size``."""
        samples, centres = windows
        kernel = self.settings.kcf.kernel
        maps = np.stack([respond(bank, samples.select(slice(k, k + 1)), kernel) for k in range(len(centres))])
        return ResponseMaps(maps, centres, self.model.window.cell_pixels(size))

    def view(self, image: ImageArray, windows: Windows, bank: FilterBank, size: float) -> SearchView:
        """Responses of the filters, and what looks like an object near the windows."""
        proposals, centres = np.empty((0, 4)), windows[1]
        if self.objects is not None:
            half = self.model.target * size * self.settings.kcf.padding / 2
            region = np.concatenate([centres.min(axis=0) - half, centres.max(axis=0) + half])
            proposals, _ = propose(image, self.objects, PROPOSALS, region)
        return SearchView(self.maps(windows, bank, size), image, proposals)

    def log_likelihood(self, particles: FloatArray, view: SearchView, size: float, known: Confidence) -> FloatArray:
        """``(N,)`` equation (3.4), sharpened and joined with the colours where the settings say so.

        Args:
            particles: ``(N, 3)`` x, y and number of a filter.
            view: of the frame.
            size: of the target, relative to the first.
            known: the target's colours, and how much like them it usually is.
        """
        settings = self.settings
        half = self.model.target * size / 2
        boxes = np.concatenate([particles[:, :2] - half, particles[:, :2] + half], axis=1)
        response = view.maps.at(particles[:, :2], particles[:, 2].astype(np.int64))
        overlap = object_overlap(boxes, view.proposals) if self.objects is not None else np.zeros(len(boxes))
        result = log_likelihood(response, overlap, settings.response_share)
        if settings.colour and known.colour is not None:
            score = known.colour.score(view.image, boxes)
            usual = known.colours.mean if known.colours.mean is not None else float(score.max())
            result += settings.colour * np.minimum(score - usual, 0)
        return settings.sharpness * result


def highest_maxima(maps: ResponseMaps, count: int) -> FloatArray:
    """``(M, 2)`` places of the first filter's highest maxima, the highest first; none where it is flat."""
    places, values = [], []
    for k, centre in enumerate(maps.centres):
        shifts, heights = local_maxima(maps.maps[k, 0], count)
        found = centre + shifts * maps.cell
        # Windows overlap: a maximum counts in the window whose centre is nearest.
        nearest = np.argmin(((found[:, None] - maps.centres[None]) ** 2).sum(axis=2), axis=1)
        places.append(found[nearest == k])
        values.append(heights[nearest == k])
    order = np.argsort(-np.concatenate(values), kind="stable")[:count]
    return np.asarray(np.concatenate(places)[order])


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
