"""The combined tracker, ours: a strong filter goes on, and particles challenge it where it is in doubt.

In thesis chapter 3 particles take over as soon as the filter's response is low. On videos that did not choose its
settings this loses more targets than it saves: the response is mostly low for a short time only, and the filter
recovers by itself. So here

* the filter is `regularised`, which knows the target's colours and size;
* the target is in doubt when two measures, the response and the colours, are both low against their own running
  medians; doubt ends at higher values than it begins (hysteresis);
* the filter's learning rate falls with its response, and in doubt it is low; the filter goes on all the same and stays
  one of the hypotheses;
* the particles of 3.2.3 to 3.2.5, each a place and the number of a filter (the present, the first, or a stored one),
  look for the target all around. Where the best one's response is higher elsewhere for several frames in a row, the
  target is taken to be there, with that filter. All particles have the target's present size;
* where the box shows what stood there before the target came, the status is lost (`seen_before`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from statistics import median

import numpy as np

from tsuiseki.tracking.filters.base import bootstrap
from tsuiseki.tracking.filters.kernelised_correlation import ComplexArray
from tsuiseki.tracking.filters.motion.points import PlaneWalk
from tsuiseki.tracking.filters.particle_filter import ParticleFilter, ParticleState
from tsuiseki.tracking.filters.resampling import normalise
from tsuiseki.tracking.single import regularised
from tsuiseki.tracking.single.constants import DOUBTFUL_RATE, CombinedSettings
from tsuiseki.tracking.single.particles import heaviest_apart
from tsuiseki.tracking.single.regularised import Model, RegularisedTarget
from tsuiseki.tracking.single.response import ResponseMaps, maxima_of_each, peak
from tsuiseki.tracking.single.seen_before import SeenBefore
from tsuiseki.tracking.single.tracker import TargetState, box_centre
from tsuiseki.tracking.types import FloatArray, ImageArray, Status


@dataclass(frozen=True)
class Evidence:
    """Responses and colour scores of frames without doubt, newest last, at most ``memory`` of them."""

    peaks: tuple[float, ...] = ()
    colours: tuple[float, ...] = ()

    def add(self, target: RegularisedTarget, memory: int) -> Evidence:
        """With one more frame."""
        return Evidence((*self.peaks, target.peak)[-memory:], (*self.colours, target.colour_score)[-memory:])

    def shares(self, target: RegularisedTarget) -> tuple[float, float]:
        """Response and colour score of ``target`` over their medians; 1 until five frames are known."""
        if len(self.peaks) < 5:
            return 1.0, 1.0
        peak, colour = self._usual
        return target.peak / peak, target.colour_score / colour

    @cached_property
    def _usual(self) -> tuple[float, float]:
        return max(median(self.peaks), 1e-6), max(median(self.colours), 1e-6)


@dataclass(frozen=True)
class Challenge:
    """The particles of a doubt, and for how many frames in a row their place has been better."""

    state: ParticleState
    wins: int = 0


class Combined:
    """The combined tracker of one target; the score is the response at the target.

    Attributes:
        settings: constants.
        target: where the target is, and the filter that tracks alone.
        doubted: for how many frames in a row the filter has been in doubt.
        searched_frames: in how many frames particles ran.
    """

    def __init__(self, settings: CombinedSettings | None = None, seed: int = 0) -> None:
        self.settings = settings or CombinedSettings()
        self._rng = np.random.default_rng(seed)

    def start(self, image: ImageArray, box: FloatArray) -> None:
        """See `SingleTracker.start`."""
        width, height = (box[2:] - box[:2]).tolist()
        self._model = Model.of(self.settings.filter, width, height)
        self.target = regularised.start(self._model, image, box_centre(np.asarray(box)))
        self._first = self.target.filters
        self._stored: list[ComplexArray] = []
        self._evidence = Evidence()
        self._challenge: Challenge | None = None
        self._frame = self.doubted = self.searched_frames = 0
        self._seen_before = SeenBefore(self.settings.seen_before)
        self._seen_before.look(image, np.asarray(box, dtype=np.float64))
        self._on_background = False

    def follow(self, image: ImageArray) -> TargetState:
        """See `SingleTracker.follow`."""
        self._frame += 1
        found = regularised.locate(self._model, self.target, image)
        if self._doubts(found):
            self._go_on_in_doubt(image, found)
        else:
            self._go_on(image, found)
        if self._frame % self.settings.seen_before.every == 0:
            self._on_background = self._seen_before.look(image, self.box(self.target))
        return self.state()

    def state(self) -> TargetState:
        """The target as it is now."""
        return TargetState(self.box(self.target), self.target.peak, self._status())

    def box(self, target: RegularisedTarget) -> FloatArray:
        """``(4,)`` of the target, or of one of `heaviest_places`."""
        return self._model.box(target.centre, target.size)

    def heaviest_places(self, image: ImageArray, count: int) -> list[RegularisedTarget]:
        """The target at the maxima about the heaviest particles that are half a target and more from each other.

        One frame of a search of its own: a search that goes on is left as it is.

        Args:
            image: the frame that `follow` was given last.
            count: of places, at most.
        """
        self.searched_frames += 1
        bank = self._bank()
        maps = self._maps(image, bank)
        particle_filter = self._particle_filter()
        state, _ = particle_filter.step(particle_filter.init(self._draw(maps)), maps, self._rng)
        apart = self._model.target * self.target.size / 2
        chosen = heaviest_apart(state.particles, state.log_weights, apart, count)
        return [self._climbed(image, self._at(particle, bank)) for particle in chosen]

    def go_on_at(self, there: RegularisedTarget) -> None:
        """Take the target to be where one of `heaviest_places` is; the doubt ends."""
        self.target = there
        self.doubted, self._challenge, self._on_background = 0, None, False
        self._seen_before.forget()

    def _doubts(self, found: RegularisedTarget) -> bool:
        response, colours = self._evidence.shares(found)
        if self.doubted:
            return response < self.settings.sure
        return response < self.settings.doubt and colours < self.settings.colour_doubt

    def _go_on(self, image: ImageArray, found: RegularisedTarget) -> None:
        self.target = self._learn(found, image, self._certainty(found, self.settings.certain))
        self._evidence = self._evidence.add(found, self.settings.memory)
        self.doubted, self._challenge = 0, None
        if self._frame % self.settings.store_interval == 0:
            self._store()

    def _go_on_in_doubt(self, image: ImageArray, found: RegularisedTarget) -> None:
        if not self.doubted:
            self._store()  # the last filter from before the doubt
        self.doubted += 1
        self.searched_frames += 1
        rate = DOUBTFUL_RATE * self._certainty(found, self.settings.doubt)
        self.target = self._learn(found, image, rate)
        self._search(image)

    def _certainty(self, found: RegularisedTarget, full: float) -> float:
        """In [0, 1]: 1 where the response is from ``full`` of its running median, 0 where it says `hidden`."""
        share, hidden = self._evidence.shares(found)[0], self.settings.hidden
        return float(np.clip((share - hidden) / max(full - hidden, 1e-6), 0, 1))

    def _learn(self, found: RegularisedTarget, image: ImageArray, rate: float) -> RegularisedTarget:
        return regularised.update(self._model, found, image, rate) if rate > 0 else found

    def _store(self) -> None:
        self._stored = [*self._stored, self.target.filters][-self.settings.stored :]

    def _search(self, image: ImageArray) -> None:
        """One frame of the particles; where they have won often enough, the target is theirs."""
        settings, target = self.settings, self.target
        bank = self._bank()
        maps = self._maps(image, bank)
        particle_filter = self._particle_filter()
        before = self._challenge or Challenge(particle_filter.init(self._draw(maps)))
        state, _ = particle_filter.step(self._renewed(before.state, maps), maps, self._rng)
        heaviest = state.particles[int(np.argmax(state.log_weights))]
        there = self._climbed(image, self._at(heaviest, bank))
        moved = bool((np.abs(there.centre - target.centre) > 0.5 * self._model.target * target.size).any())
        elsewhere = moved or int(heaviest[2]) > 0
        plausible = self._evidence.shares(there)[0] >= settings.hidden
        won = elsewhere and plausible and there.peak > target.peak + settings.margin
        self._challenge = Challenge(state, before.wins + 1 if won else 0)
        if self._challenge.wins >= settings.wins:
            self.go_on_at(there)

    def _renewed(self, state: ParticleState, maps: ResponseMaps) -> ParticleState:
        """``state`` with a share of its particles at the present maxima: a target may come back where none are left."""
        count = round(self.settings.renewed * len(state))
        if not count:
            return state
        chosen = self._rng.choice(len(state), count, replace=False)
        particles, log_weights = state.particles.copy(), state.log_weights.copy()
        particles[chosen] = self._draw(maps)[:count]
        log_weights[chosen] = -np.log(len(state))
        return ParticleState(particles, normalise(log_weights))

    def _bank(self) -> ComplexArray:
        """``(K, D, rows, columns // 2 + 1)`` the present filter, the first one, and those stored."""
        return np.stack([self.target.filters, self._first, *self._stored])

    def _particle_filter(self) -> ParticleFilter[ResponseMaps]:
        deviation = self._model.target * self.target.size * self.settings.spread
        return ParticleFilter(bootstrap(PlaneWalk(deviation)), self._log_likelihood, threshold=1.0)

    def _at(self, particle: FloatArray, bank: ComplexArray) -> RegularisedTarget:
        """The target at a particle, with its filter."""
        return replace(self.target, centre=particle[:2], filters=bank[int(particle[2])])

    def _climbed(self, image: ImageArray, there: RegularisedTarget) -> RegularisedTarget:
        """``there`` at the maximum about it, in a window of its own as the filter alone has one."""
        response, _ = regularised.responses(self._model, there, image)
        shift, value = peak(response)
        extent = np.array([image.shape[1], image.shape[0]], dtype=np.float64)
        place = np.clip(there.centre + shift * self._model.cell_pixels(there.size), 0, extent)
        return replace(there, centre=place, peak=value)

    def _maps(self, image: ImageArray, bank: ComplexArray) -> ResponseMaps:
        """Responses of all filters in the windows about the target that lie in the image."""
        model, target = self._model, self.target
        step = np.array(model.shape[::-1]) * model.cell_pixels(target.size) / 2
        offsets = np.arange(-self.settings.reach, self.settings.reach + 1)
        grid = np.array([(x, y) for y in offsets for x in offsets])
        centres = target.centre + grid[np.argsort((grid**2).sum(axis=1), kind="stable")] * step
        inside = np.all((centres >= 0) & (centres <= [image.shape[1], image.shape[0]]), axis=1)
        centres = centres[inside | (np.arange(len(centres)) == 0)]
        maps = regularised.responses_at(model, target, image, centres, bank)
        return ResponseMaps(maps, centres, model.cell_pixels(target.size))

    def _draw(self, maps: ResponseMaps) -> FloatArray:
        """``(N, 3)`` particles x, y and filter number, at the highest maxima of all filters by their likelihood."""
        count, settings = self.settings.particles, self.settings
        filters = maps.maps.shape[1]
        which, shifts, height = maxima_of_each(maps.maps.reshape(-1, *maps.maps.shape[2:]), 3)
        if not len(which):  # a flat response has no maximum
            return np.tile([*self.target.centre, 0.0], (count, 1))
        everywhere = np.column_stack([maps.centres[which // filters] + shifts * maps.cell, which % filters])
        weights = np.exp(settings.sharpness * (height - height.max()))
        return np.asarray(everywhere[self._rng.choice(len(everywhere), count, p=weights / weights.sum())])

    def _log_likelihood(self, particles: FloatArray, maps: ResponseMaps) -> FloatArray:
        """Equation (3.4), its response joined with the colours and in the exponent."""
        numbers = np.minimum(particles[:, 2].astype(np.int64), maps.maps.shape[1] - 1)
        return self.settings.sharpness * maps.at(particles[:, :2], numbers)

    def _status(self) -> Status:
        if self._on_background:
            return "lost"
        if self.doubted == 0:
            return "tracking"
        return "searching" if self.doubted <= self.settings.lost_after else "lost"
