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

The preset `ROBUST` adds to this; each addition answers a failure on videos:

* the colours weigh particles too, and the windows about the target's are searched (`particles`);
* the search also starts when response or colours fall below their usual (`particles.Confidence`), and goes on while
  there is such a reason, up to `LONGEST_SEARCH` frames: the target may look different for good. What follows counts as
  tracked only once there is no doubt;
* particles move further, since 2.7 pixels for a target of 25 is less than people move, and maxima near the last place
  are drawn more often (`particles.jump_prior`) instead of P_J = 1/M;
* no filter learns before it is known who is right, and the filter of the first frame, the only one that is surely
  right, stays in the store;
* the output is the maximum uphill from where particles are dense (`particles.densest`), not the heaviest particle.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.features.objectness import ObjectnessModel, propose, shipped_objectness
from tsuiseki.tracking.filters.base import Motion, bootstrap
from tsuiseki.tracking.filters.correlation_filters import FilterBank, Samples, join, respond
from tsuiseki.tracking.filters.particle_filter import ParticleFilter, ParticleState
from tsuiseki.tracking.filters.point_motion import PlaneWalk
from tsuiseki.tracking.filters.resampling import probabilities
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.particles import (
    Confidence,
    KcfParticleSettings,
    SearchView,
    best_by_filter,
    densest,
    dispersion,
    draw_particles,
    highest_maxima,
    jump_prior,
    step_deviation,
)
from tsuiseki.tracking.single.search_windows import ResponseMaps
from tsuiseki.tracking.single.tracker import TargetState, box_centre
from tsuiseki.tracking.types import FloatArray, ImageArray, Status

# To the letter of the thesis.
PRINTED = KcfParticleSettings()
# With the additions; see the module.
ROBUST = KcfParticleSettings(kcf=kcf.KcfSettings(), plain_frames=3, stored=8, past_by_score=True, additions=True)
# Boxes near the windows that look like an object.
PROPOSALS = 100
# Of the additions: windows searched to each side of the target's.
REACH = 1
# Frames of doubt after which the target counts as lost.
LOST_AFTER = 30
# Of the additions: factor on the motion's deviation.
SPREAD = 3.0
# Of the additions: frames between two stored filters.
STORE_INTERVAL = 3
# Of the additions: frames of a search at most.
LONGEST_SEARCH = 10
# Of the additions: frames between two checks of the colours.
DRIFT_INTERVAL = 5
Windows = tuple[Samples, FloatArray]
"""What is in the windows of a frame, and their centres ``(W, 2)`` in pixels."""


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
    """The thesis's tracker of one target; see the module.

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
        width, height = (box[2:] - box[:2]).tolist()
        settings = self.settings
        self.model = kcf.Kcf.of(settings.kcf, width, height)
        self.target = kcf.start(self.model, image, box_centre(box))
        self._deviation = step_deviation(self.model.target) * (SPREAD if settings.additions else 1)
        self._first = [self.target.bank] if settings.additions else []
        self._stored: deque[tuple[FilterBank, float]] = deque(maxlen=settings.stored)
        self._confidence = Confidence.start(settings, image, box)
        self._frame = self._plain_left = self._doubted = self.searched_frames = 0
        self.search = None
        uses_objectness = settings.response_share < 1
        self._objects = (self._objectness or shipped_objectness()).near(width, height) if uses_objectness else None

    def follow(self, image: ImageArray) -> TargetState:
        """The target in the next frame."""
        self._frame += 1
        self._doubted += self._doubted > 0
        if self.search is None:
            located = kcf.locate(self.model, self.target, image)
            checked = self._frame % DRIFT_INTERVAL == 0
            box = self.model.box(located.centre, located.size)
            colour = self._confidence.colour_score(image, box) if checked else None
            doubtful = self._confidence.doubts(located.peak, colour)
            if not doubtful and (checked or not self.settings.additions):
                self._doubted = 0
            if self._plain_left > 0 or not doubtful:
                self._go_on(image, located, colour)
            else:
                self._doubted = max(self._doubted, 1)
                self._begin_search(image)
        else:
            view = self._view(image, self._windows(image), self.search.bank)
            self._weigh(view, self.search, PlaneWalk(self._deviation))
        return TargetState(self._box(), self.target.peak, self._status())

    def _go_on(self, image: ImageArray, located: kcf.KcfState, colour: float | None) -> None:
        """Learn from the frame, as KCF does, and keep the filter, 3.2.7."""
        self._plain_left = max(self._plain_left - 1, 0)
        bank = self.model.update(located.bank, image, located.centre[None], np.array([located.size]))
        self.target = replace(located, bank=bank)
        self._confidence = self._confidence.learn(image, self._box(), located.peak, colour)
        if not self.settings.additions or self._frame % STORE_INTERVAL == 0:
            self._stored.append((bank, located.peak))

    def _past(self) -> tuple[list[FilterBank], FloatArray]:
        """Filters of the past and their relative probabilities P_K; the first frame's counts as the best."""
        scores = [score for _, score in self._stored]
        scores = [max(scores, default=1.0)] * len(self._first) + scores
        weights = np.maximum(np.array(scores), 1e-6) if self.settings.past_by_score else np.ones(len(scores))
        return [*self._first, *(bank for bank, _ in self._stored)], weights

    def _begin_search(self, image: ImageArray) -> None:
        """Algorithm 1: particles about the highest maxima of the present filter's response."""
        settings, target = self.settings, self.target
        past, weights = self._past()
        windows = self._windows(image)
        peaks = highest_maxima(self._maps(windows, target.bank), settings.hypotheses)
        if not len(peaks):  # a flat response, as on a constant image: the target is where it was
            peaks = target.centre[None]
        near = jump_prior(peaks, target.centre, self.model.target * target.size) if settings.additions else None
        particles = draw_particles(
            peaks, weights, settings.past_share, settings.particles, self._deviation, self._rng, near
        )
        banks = [target.bank] * len(peaks) + past
        if settings.additions:  # nothing learns: the hypotheses stay one filter, which then responds only once
            particles[:, 2] = np.maximum(particles[:, 2] - (len(peaks) - 1), 0)
            banks = banks[len(peaks) - 1 :]
        used, numbers = np.unique(particles[:, 2].astype(np.int64), return_inverse=True)
        particles[:, 2] = numbers
        bank = join([banks[number] for number in used])
        state = ParticleState(particles, np.full(len(particles), -np.log(len(particles))))
        self._weigh(self._view(image, windows, bank), Search(state, bank, 0), _stay)

    def _windows(self, image: ImageArray) -> Windows:
        """The window about the target; with the additions also `REACH` more to each side of it."""
        target = self.target
        if self.settings.additions:
            return self.model.describe_around(image, target.centre, target.size, REACH)
        return self.model.describe(image, target.centre[None], np.array([target.size])), target.centre[None]

    def _maps(self, windows: Windows, bank: FilterBank) -> ResponseMaps:
        """Responses of all filters in all windows."""
        samples, centres = windows
        kernel = self.settings.kcf.kernel
        maps = np.stack([respond(bank, samples.select(slice(k, k + 1)), kernel) for k in range(len(centres))])
        return ResponseMaps(maps, centres, self.model.cell_pixels(self.target.size))

    def _view(self, image: ImageArray, windows: Windows, bank: FilterBank) -> SearchView:
        """Responses of the filters, and what looks like an object near the windows."""
        proposals, centres = None, windows[1]
        if self._objects is not None:
            half = self.model.target * self.target.size * self.settings.kcf.padding / 2
            region = np.concatenate([centres.min(axis=0) - half, centres.max(axis=0) + half])
            proposals, _ = propose(image, self._objects, PROPOSALS, region)
        return SearchView(self._maps(windows, bank), image, proposals)

    def _log_likelihood(self, particles: FloatArray, view: SearchView) -> FloatArray:
        return view.log_likelihood(particles, self.model.target * self.target.size, self._confidence)

    def _weigh(self, view: SearchView, search: Search, motion: Motion) -> None:
        """One frame of search: move, weigh, take the best particle, learn, and see whether they agree.

        Particles are resampled in every frame; those of the first frame stay where they were drawn.
        """
        settings = self.settings
        particle_filter = ParticleFilter[SearchView](bootstrap(motion), self._log_likelihood, threshold=1.0)
        state, _ = particle_filter.step(search.state, view, self._rng)
        weights = probabilities(state.log_weights)
        chosen = densest(state.particles, weights, self._deviation) if settings.additions else int(np.argmax(weights))
        best = state.particles[chosen]
        self.searched_frames += 1
        place = view.maps.climb(best[:2], int(best[2])) if settings.additions else best[:2].copy()
        response = float(view.maps.at(place[None], best[None, 2].astype(np.int64))[0])
        self.target = replace(self.target, centre=place, peak=response)
        used, places = best_by_filter(state.particles, weights)
        bank = search.bank.select(used)
        if not settings.additions:
            bank = self.model.update(bank, view.image, places, np.full(len(places), self.target.size))
            peaks = view.maps.maps[:, used].max(axis=(0, 2, 3))
            strongest = int(np.argmax(peaks))
            self._stored.append((bank.select(slice(strongest, strongest + 1)), float(peaks[strongest])))
        numbers = np.searchsorted(used, state.particles[:, 2])
        particles = np.column_stack([state.particles[:, :2], numbers])
        self.search = Search(ParticleState(particles, state.log_weights), bank, search.frames + 1)
        spread = dispersion(particles, weights, self._deviation**2) / float(np.prod(self.model.target))
        if spread >= settings.convergence:
            return
        colour = self._confidence.colour_score(view.image, self._box())
        sure = not settings.additions or not self._confidence.doubts(response, colour)
        if sure or self.search.frames >= LONGEST_SEARCH:
            self._doubted = 0 if sure else self._doubted
            # 3.2.6: the best particle's filter goes on alone.
            self.target = replace(self.target, bank=bank.select(slice(int(numbers[chosen]), int(numbers[chosen]) + 1)))
            self.search, self._plain_left = None, settings.plain_frames

    def _box(self) -> FloatArray:
        return self.model.box(self.target.centre, self.target.size)

    def _status(self) -> Status:
        if self._doubted == 0:
            return "tracking"
        return "searching" if self._doubted <= LOST_AFTER else "lost"


def _stay(particles: FloatArray, frames: float, rng: np.random.Generator) -> FloatArray:
    """A `Motion` of the first frame of a search."""
    del frames, rng
    return particles
