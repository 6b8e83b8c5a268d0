"""Correlation filters selected by a particle filter, thesis chapter 3.

While the correlation filter is confident it tracks alone (`kcf`). When its greatest response is low, a search by
particles begins. Each particle has a place and the number of a correlation filter. The filters are copies of the
present one at several hypotheses of the target's place, and filters stored in the past. When the particles agree, the
filter of the best particle goes on alone.

The text leaves points open. That of (3.5) is settled in `particles`; of the rest:

* (3.3): S holds variances, see `particles.step_deviation`.
* Algorithm 1: hypothesis ``m`` is a copy of the present filter with the target at maximum ``m``. The copies become
  different because each learns at its own place. Particles of the first frame are weighed where they were drawn.
* 3.2.7: in every frame a filter learns at the place of its heaviest particle, with the learning rate of
  KCF. Of a stored filter a copy learns, and the store keeps it unchanged. The filter with the greatest response is
  stored. A filter without particles is dropped.
* (3.7): see `particles.dispersion` for the matrix C and the filter numbers.
* In every frame of the search the particles are resampled systematically.

The preset `ROBUST` adds to this; each addition answers a failure seen on videos. They stand second in
`KcfParticleSettings`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.features.objectness import ObjectnessModel, shipped_objectness
from tsuiseki.tracking.filters.base import bootstrap
from tsuiseki.tracking.filters.kernelised_correlation import FilterBank, join
from tsuiseki.tracking.filters.motion.points import PlaneWalk
from tsuiseki.tracking.filters.particle_filter import ParticleFilter, ParticleState
from tsuiseki.tracking.filters.resampling import probabilities
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.constants import DRIFT_INTERVAL, ROBUST, KcfParticleSettings
from tsuiseki.tracking.single.particles import (
    Archive,
    Confidence,
    ObservationModel,
    SearchView,
    best_by_filter,
    densest,
    dispersion,
    draw_particles,
    highest_maxima,
    jump_prior,
    step_deviation,
)
from tsuiseki.tracking.single.tracker import TargetState, box_centre
from tsuiseki.tracking.types import FloatArray, ImageArray, Status


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
        self._deviation = step_deviation(self.model.target, settings.divisor) * settings.spread
        self._archive = Archive(settings.stored, self.target.bank if settings.keeps_first else None)
        self._confidence = Confidence.start(settings, image, box)
        self._frame = self._plain_left = self._doubted = self.searched_frames = 0
        self.search = None
        self._observation = ObservationModel(settings, self.model, self._objects(float(size[0]), float(size[1])))

    def _objects(self, width: float, height: float) -> ObjectnessModel | None:
        """What objects of about the target's sides look like; None where objectness has no share."""
        if self.settings.response_share == 1:
            return None
        return (self._objectness or shipped_objectness()).near(width, height)

    def follow(self, image: ImageArray) -> TargetState:
        """The target in the next frame."""
        self._frame += 1
        self._doubted += self._doubted > 0
        if self.search is None:
            found = kcf.locate(self.model, self.target, image)
            box, checked = self.model.box(found.centre, found.size), self._frame % DRIFT_INTERVAL == 0
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
        windows = self._observation.windows(image, target, settings.reach)
        maps = self._observation.maps(windows, target.bank, target.size)
        peaks = highest_maxima(maps, settings.hypotheses)
        if not len(peaks):  # a flat response, as on a constant image: the target is where it was
            peaks = target.centre[None]
        weights = self._archive.weights(settings.past == "score")
        near = jump_prior(peaks, target.centre, self.model.target * target.size) if settings.prefers_near else None
        particles = draw_particles(
            peaks, len(past), weights, settings.past_share, settings.particles, self._deviation, self._rng, near
        )
        banks = [target.bank] * len(peaks) + list(past)
        if not settings.learns_while_searching:  # the hypotheses stay one filter, which then responds only once
            particles[:, 2] = np.maximum(particles[:, 2] - (len(peaks) - 1), 0)
            banks = banks[len(peaks) - 1 :]
        used, numbers = np.unique(particles[:, 2].astype(np.int64), return_inverse=True)
        particles[:, 2] = numbers
        bank = join([banks[number] for number in used])
        state = self._filter(move=False).init(particles)
        self._weigh(self._observation.view(image, windows, bank, target.size), Search(state, bank, 0), move=False)

    def _continue_search(self, image: ImageArray, search: Search) -> None:
        windows = self._observation.windows(image, self.target, self.settings.reach)
        view = self._observation.view(image, windows, search.bank, self.target.size)
        self._weigh(view, search, move=True)

    def _log_likelihood(self, particles: FloatArray, observation: SearchView) -> FloatArray:
        return self._observation.log_likelihood(particles, observation, self.target.size, self._confidence)

    def _filter(self, move: bool) -> ParticleFilter[SearchView]:
        """Resampling in every frame; the particles of the first one stay where they were drawn."""
        motion = PlaneWalk(self._deviation) if move else _stay
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
        spread = dispersion(particles, weights, self._deviation**2) / float(np.prod(self.model.target))
        if spread >= settings.convergence:
            return
        colour = self._confidence.colour_score(view.image, self._box())
        sure = not settings.ends_when_sure or not self._confidence.doubts(settings, response, colour)
        if sure or search.frames + 1 >= settings.longest_search:
            self._doubted = 0 if sure else self._doubted
            self._end_search(bank.select(slice(int(numbers[chosen]), int(numbers[chosen]) + 1)))

    def _end_search(self, bank: FilterBank) -> None:
        """3.2.6: the best particle's filter goes on alone."""
        self.target = replace(self.target, bank=bank)
        self.search, self._plain_left = None, self.settings.plain_frames

    def _box(self) -> FloatArray:
        return self.model.box(self.target.centre, self.target.size)

    def _status(self) -> Status:
        if self._doubted == 0:
            return "tracking"
        return "searching" if self._doubted <= self.settings.lost_after else "lost"


def _stay(particles: FloatArray, frames: float, rng: np.random.Generator) -> FloatArray:
    del frames, rng
    return particles
