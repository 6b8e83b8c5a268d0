"""Correlation filters selected by a particle filter, thesis chapter 3.

While the correlation filter is confident it tracks alone (`kcf`). When its greatest response is low, a search by
particles begins. Each particle has a place and the number of a correlation filter. The filters are copies of the
present one at several hypotheses of the target's place, and filters stored in the past. When the particles agree, the
filter of the best particle goes on alone.

The text leaves these points open; here:

* (3.4) adds r and v with the shares alpha and 1 - alpha. A search begins where every response is at most epsilon_1 =
  0.2, and v is about 0.5 nearly everywhere. So r as it comes out of the filter adds 0.06 of 0.41 at most, and v alone
  decides. `THESIS` therefore divides r by the greatest response of the frame; `PRINTED` does not.
* (3.3): S holds deviations in `THESIS` and variances in `PRINTED`, see `particles.step_deviation`.
* (3.5): the displacement is measured from the tracker's box in the frame before, for all particles. So one window
  serves all filters, and one batched transform gives all responses. Outside the window the response is zero.
* Algorithm 1: hypothesis ``m`` is a copy of the present filter with the target at maximum ``m``. The copies become
  different because each learns at its own place. Particles of the first frame are weighed where they were drawn.
* 3.2.7: in every frame a filter learns at the place of its heaviest particle, with the learning rate of KCF. Of a
  stored filter a copy learns, and the store keeps it unchanged. The filter with the greatest response is stored. A
  filter without particles is dropped.
* (3.7): see `particles.dispersion` for the matrix C and the filter numbers.
* In every frame of the search the particles are resampled systematically.

The preset `ROBUST` adds to this; each addition answers a failure seen on videos. They stand second in
`KcfParticleSettings`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.features.objectness import ObjectnessModel, propose, shipped_objectness
from tsuiseki.tracking.filters.base import bootstrap
from tsuiseki.tracking.filters.correlation.kernelised_correlation import FilterBank, Samples, join, respond
from tsuiseki.tracking.filters.particles.particle_filter import ParticleFilter, ParticleState
from tsuiseki.tracking.filters.particles.weights import probabilities
from tsuiseki.tracking.likelihoods.peaks import local_maxima, peak
from tsuiseki.tracking.likelihoods.response import ResponseMaps, log_likelihood, object_overlap
from tsuiseki.tracking.trackers.single import kcf
from tsuiseki.tracking.trackers.single.archive import Archive
from tsuiseki.tracking.trackers.single.confidence import Confidence
from tsuiseki.tracking.trackers.single.interface import TargetState, box_centre
from tsuiseki.tracking.trackers.single.kcf_particle_settings import ROBUST, KcfParticleSettings
from tsuiseki.tracking.trackers.single.particles import (
    best_by_filter,
    densest,
    dispersion,
    draw_particles,
    jump_prior,
    random_walk,
    step_deviation,
)
from tsuiseki.tracking.types import FloatArray, ImageArray, Status

PROPOSALS = 100
LEAST_RESPONSE = 1e-6
Windows = tuple[Samples, FloatArray]


@dataclass(frozen=True)
class Search:
    """The particle filter at work.

    Attributes:
        state: particles ``x, y, filter`` and their log-weights.
        bank: the filters in use, by number.
        frames: how long it has lasted, this frame included.
    """

    state: ParticleState
    bank: FilterBank
    frames: int


@dataclass(frozen=True)
class SearchView:
    """What the particles see of one frame."""

    maps: ResponseMaps
    image: ImageArray
    proposals: FloatArray


class KcfParticle:
    """The combined tracker of one target; see the module.

    Attributes:
        settings: constants.
        model: what is fixed for the target.
        target: where the target is, and the filter that tracks alone.
        search: the particle filter, None while the filter tracks alone.
        searched_frames: in how many frames the particle filter ran.
    """

    def __init__(
        self, settings: KcfParticleSettings = ROBUST, seed: int = 0, objectness: ObjectnessModel | None = None
    ) -> None:
        self.settings = settings
        self._rng = np.random.default_rng(seed)
        self._objectness = objectness
        self.search: Search | None = None
        self.searched_frames = 0

    def start(self, image: ImageArray, box: FloatArray) -> None:
        """Take ``box`` ``(4,)`` of the first frame as the target."""
        size = box[2:] - box[:2]
        settings = self.settings
        self.model = kcf.Kcf.of(settings.kcf, float(size[0]), float(size[1]))
        self.target = kcf.start(self.model, image, box_centre(box))
        step = step_deviation(self.model.target, settings.divisor, settings.covariance)
        self._deviation = step * settings.spread
        self._archive = Archive(settings.stored, self.target.bank if settings.keeps_first else None)
        self._confidence = Confidence.start(settings, image, box)
        self._frame = self._plain_left = self._doubted = self.searched_frames = 0
        self.search = None
        if settings.response_share < 1 and self._objectness is None:
            self._objectness = shipped_objectness()
        if self._objectness is not None:
            self._near_sizes = self._objectness.near(float(size[0]), float(size[1]))

    def follow(self, image: ImageArray) -> TargetState:
        """The target in the next frame."""
        self._frame += 1
        self._doubted += self._doubted > 0
        if self.search is None:
            found = kcf.locate(self.model, self.target, image)
            box, checked = self.model.box(found.centre, found.size), self._frame % self.settings.drift_interval == 0
            colour = self._confidence.colour_score(image, box) if checked else None
            doubtful = self._confidence.doubts(self.settings, found.peak, colour)
            self._doubted = 0 if not doubtful and (checked or not self.settings.drift_switch) else self._doubted
            if self._plain_left > 0 or not doubtful:
                self._go_on(image, found, colour)
                return TargetState(self._box(), found.peak, self._status())
            self._doubted = max(self._doubted, 1)
            self._begin_search(image)
        else:
            self._continue_search(image, self.search)
        return TargetState(self._box(), self.target.peak, self._status())

    def _go_on(self, image: ImageArray, found: kcf.KcfState, colour: float | None) -> None:
        """Learn from the frame, as KCF does, and keep the filter, 3.2.7."""
        self._plain_left = max(self._plain_left - 1, 0)
        bank = self.model.update(found.bank, image, found.centre[None], np.array([found.size]))
        self.target = replace(found, bank=bank)
        self._confidence = self._confidence.learn(image, self._box(), found.peak, colour)
        if self._frame % self.settings.store_interval == 0:
            self._archive = self._archive.add(bank, found.peak)

    def _begin_search(self, image: ImageArray) -> None:
        """Algorithm 1: particles about the highest maxima of the present filter's response."""
        settings, target = self.settings, self.target
        past = self._archive.candidates()
        windows = self._windows(image)
        peaks = self._highest_maxima(self._maps(windows, target.bank))
        weights = self._archive.weights(settings.past == "score")
        shares = jump_prior(peaks, target.centre, self.model.target * target.size) if settings.prefers_near else None
        particles = draw_particles(
            peaks, len(past), weights, settings.past_share, settings.particles, self._deviation, self._rng, shares
        )
        banks = [target.bank] * len(peaks) + list(past)
        if not settings.learns_while_searching:  # the hypotheses stay one filter, which then responds only once
            particles[:, 2] = np.maximum(particles[:, 2] - (len(peaks) - 1), 0)
            banks = banks[len(peaks) - 1 :]
        used, numbers = np.unique(particles[:, 2].astype(np.int64), return_inverse=True)
        particles[:, 2] = numbers
        bank = join([banks[number] for number in used])
        state = self._filter(move=False).init(particles)
        self._weigh(self._view(image, windows, bank), Search(state, bank, 0), move=False)

    def _continue_search(self, image: ImageArray, search: Search) -> None:
        view = self._view(image, self._windows(image), search.bank)
        if not (self.settings.decides_always and self._confident(view, search)):
            self._weigh(view, search, move=True)

    def _confident(self, view: SearchView, search: Search) -> bool:
        """3.2.2 in a frame of search: whether a filter's response is above epsilon_1; if so, it goes on alone."""
        maps, size = view.maps.maps, np.array([self.target.size])
        if maps.max() <= self.settings.switch:
            return False
        window, number = divmod(int(np.argmax(maps.max(axis=(2, 3)))), maps.shape[1])
        shift, value = peak(maps[window, number])
        place = view.maps.centres[window] + shift * view.maps.cell
        self.searched_frames += 1
        self.target = replace(self.target, centre=place, peak=value)
        self._doubted = 0
        self._end_search(
            self.model.update(search.bank.select(slice(number, number + 1)), view.image, place[None], size)
        )
        return True

    def _windows(self, image: ImageArray) -> Windows:
        """The windows of a frame of search and their centres."""
        settings, target = self.settings, self.target
        lost = self.search is not None and self._status() == "lost"
        reach = settings.redetect_reach if lost and settings.redetect_reach else settings.reach
        if reach == 0:
            return self.model.window.describe(image, target.centre[None], np.array([target.size])), target.centre[None]
        return self.model.window.describe_around(image, target.centre, target.size, reach)

    def _maps(self, windows: Windows, bank: FilterBank) -> ResponseMaps:
        """Responses of all filters in all windows."""
        samples, centres = windows
        kernel = self.settings.kcf.kernel
        maps = np.stack([respond(bank, samples.select(slice(k, k + 1)), kernel) for k in range(len(centres))])
        return ResponseMaps(maps, centres, self.model.window.cell_pixels(self.target.size))

    def _view(self, image: ImageArray, windows: Windows, bank: FilterBank) -> SearchView:
        """Responses of the filters, and what looks like an object near the windows."""
        proposals, centres = np.empty((0, 4)), windows[1]
        if self.settings.response_share < 1:
            half = self.model.target * self.target.size * self.settings.kcf.padding / 2
            region = np.concatenate([centres.min(axis=0) - half, centres.max(axis=0) + half])
            proposals, _ = propose(image, self._near_sizes, PROPOSALS, region)
        return SearchView(self._maps(windows, bank), image, proposals)

    def _boxes(self, particles: FloatArray) -> FloatArray:
        half = self.model.target * self.target.size / 2
        return np.concatenate([particles[:, :2] - half, particles[:, :2] + half], axis=1)

    def _log_likelihood(self, particles: FloatArray, observation: SearchView) -> FloatArray:
        """Equation (3.4), sharpened and joined with the colours where the settings say so."""
        settings, view = self.settings, observation
        boxes = self._boxes(particles)
        response = view.maps.at(particles[:, :2], particles[:, 2].astype(np.int64))
        if settings.response_scale == "greatest":
            response = response / max(float(view.maps.maps.max()), LEAST_RESPONSE)
        overlap = object_overlap(boxes, view.proposals) if settings.response_share < 1 else np.zeros(len(boxes))
        result = log_likelihood(response, overlap, settings.response_share)
        confidence = self._confidence
        if settings.colour and confidence.colour is not None:
            score = confidence.colour.score(view.image, boxes)
            usual = confidence.colours.mean if confidence.colours.mean is not None else float(score.max())
            result += settings.colour * np.minimum(score - usual, 0)
        return settings.sharpness * result

    def _filter(self, move: bool) -> ParticleFilter[SearchView]:
        """Resampling in every frame; the particles of the first one stay where they were drawn."""
        motion = random_walk(self._deviation) if move else _stay
        return ParticleFilter(bootstrap(motion), self._log_likelihood, threshold=1.0)

    def _weigh(self, view: SearchView, search: Search, move: bool) -> None:
        """One frame of search: move, weigh, take the best particle, learn, and see whether they agree."""
        settings = self.settings
        state, _ = self._filter(move).step(search.state, view, self._rng)
        weights = probabilities(state.log_weights)
        chosen = densest(state.particles, weights, self._deviation) if settings.densest else int(np.argmax(weights))
        best = state.particles[chosen]
        self.searched_frames += 1
        place = view.maps.climb(best[:2], int(best[2])) if settings.climbs else best[:2].copy()
        response = float(view.maps.at(place[None], best[None, 2].astype(np.int64))[0])
        self.target = replace(self.target, centre=place, peak=response)
        used, places = best_by_filter(state.particles, weights)
        bank = search.bank.select(used)
        if settings.learns_while_searching:
            bank = self.model.update(bank, view.image, places, np.full(len(places), self.target.size))
            strongest = int(np.argmax(view.maps.maps[:, used].max(axis=(0, 2, 3))))
            value = float(view.maps.maps[:, used[strongest]].max())
            self._archive = self._archive.add(bank.select(slice(strongest, strongest + 1)), value)
        numbers = np.searchsorted(used, state.particles[:, 2])
        particles = np.column_stack([state.particles[:, :2], numbers])
        self.search = Search(ParticleState(particles, state.log_weights), bank, search.frames + 1)
        spread = dispersion(particles, weights, self._agreement()) / float(np.prod(self.model.target))
        if spread >= settings.convergence:
            return
        colour = self._confidence.colour_score(view.image, self._box())
        sure = not settings.ends_when_sure or not self._confidence.doubts(settings, response, colour)
        if sure or search.frames + 1 >= settings.longest_search:
            self._doubted = 0 if sure else self._doubted
            self._end_search(bank.select(slice(int(numbers[chosen]), int(numbers[chosen]) + 1)))

    def _agreement(self) -> FloatArray:
        """``(2,)`` diagonal of C in (3.7), square pixels."""
        chosen = {
            "covariance": self._deviation**2,
            "lengths": self.model.target / self.settings.divisor,
            "pixels": np.ones(2),
        }
        return chosen[self.settings.agreement]

    def _end_search(self, bank: FilterBank) -> None:
        """3.2.6: the best particle's filter goes on alone."""
        self.target = replace(self.target, bank=bank)
        self.search, self._plain_left = None, self.settings.plain_frames

    def _highest_maxima(self, present: ResponseMaps) -> FloatArray:
        """Places ``(M, 2)`` of the highest maxima of the present filter's responses, highest first."""
        places, values = [], []
        for k, centre in enumerate(present.centres):
            shifts, heights = local_maxima(present.maps[k, 0], self.settings.hypotheses)
            found = centre + shifts * present.cell
            # Windows overlap: a maximum counts in the window whose centre is nearest.
            nearest = np.argmin(((found[:, None] - present.centres[None]) ** 2).sum(axis=2), axis=1)
            places.append(found[nearest == k])
            values.append(heights[nearest == k])
        order = np.argsort(-np.concatenate(values), kind="stable")[: self.settings.hypotheses]
        # A flat response, as on a constant image, has no maximum: the target is where it was.
        return np.concatenate(places)[order] if len(order) else self.target.centre[None]

    def _box(self) -> FloatArray:
        return self.model.box(self.target.centre, self.target.size)

    def _status(self) -> Status:
        if self._doubted == 0:
            return "tracking"
        return "searching" if self._doubted <= self.settings.lost_after else "lost"


def _stay(particles: FloatArray, frames: float, rng: np.random.Generator) -> FloatArray:
    del frames, rng
    return particles
