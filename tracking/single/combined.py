"""The combined tracker, ours: a strong filter goes on, and particles challenge it where it is in doubt.

In thesis chapter 3 particles take over as soon as the filter's response is low. On videos that did not choose its
settings this loses more targets than it saves: the response is mostly low for a short time only, and the filter
recovers by itself. So here

* the filter is `regularised`, with the target's colours and size;
* the target is in doubt when two measures, the response and the colours, are both low against their own running
  medians; doubt ends at higher values than it begins (hysteresis);
* in doubt the filter goes on learning all the same and stays one of the hypotheses;
* the particles of 3.2.3 to 3.2.5, each a place and the number of a filter (the present, the first, or a stored one),
  search the target all around. Where the best one's response is higher elsewhere, and would end the doubt, for several
  frames in a row, it takes over, with that filter, if the witness agrees. Ten frames later it may undo this. All
  particles have the present size;
* where the witness does not know the box, the status is lost (`witness`). It looks at the heaviest particles' places
  with the filter, size and colours from when it was certain. Where it sees the target in two looks, that place takes
  over.
"""

from __future__ import annotations

from collections import deque
from dataclasses import field, replace
from statistics import median

import numpy as np
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.bounds import SETTINGS, Share
from tsuiseki.tracking.features.exported import Appearance
from tsuiseki.tracking.filters.base import bootstrap
from tsuiseki.tracking.filters.correlation_filters import ComplexArray
from tsuiseki.tracking.filters.particle_filter import ParticleFilter, ParticleState
from tsuiseki.tracking.filters.point_motion import PlaneWalk
from tsuiseki.tracking.filters.resampling import normalise
from tsuiseki.tracking.single import regularised, witness
from tsuiseki.tracking.single.regularised import Model, RegularisedSettings, RegularisedTarget
from tsuiseki.tracking.single.search_windows import ResponseMaps, maxima_of_each, peak, window_grid
from tsuiseki.tracking.single.tracker import TargetState, box_centre
from tsuiseki.tracking.single.witness import Describe, Witness
from tsuiseki.tracking.types import FloatArray, ImageArray, Status
from tsuiseki.tracking.weights import shipped

# Share of the colours' running median below which they, too, are low, and doubt begins.
COLOUR_DOUBT = 0.95
# Share of the response's running median from which doubt ends.
SURE = 0.75
# Frames of the running medians.
MEMORY = 50
# Frames of doubt after which the target counts as lost.
LOST_AFTER = 5
# Filters kept from frames without doubt, beside the first frame's.
STORED = 3
# Frames between two filters that are kept.
STORE_INTERVAL = 25
# Of the search, the thesis's N.
PARTICLES = 200
# Share of the particles drawn anew in every frame, at the maxima of all filters.
RENEWED = 0.25
# Standard deviation of a particle's step, as a share of the target's sides.
SPREAD = 0.25
# Factor on the response in the log-likelihood.
SHARPNESS = 20.0
# Windows searched to each side of the one about the target.
REACH = 1
# How much more than the filter's a challenger's response must be.
MARGIN = 0.1
# For how many frames in a row a challenger must be better.
WINS = 3
# Frames after which what was won can be given back.
PROBATION = 10
# Belief of the witness, log-odds, above which the target's state is kept, to look for it once it is lost.
CERTAIN = 2.0
# Places that the witness looks at for a lost target.
PLACES = 8
# Evidence from which the witness sees the target there.
CLEAR = 1.1
# In how many looks in a row it must see the target.
AGREED = 2
# Sides of the first box from which it can see one, pixels.
LEAST_SIDE = 8.0


@pydantic_dataclass(frozen=True, config=SETTINGS)
class CombinedSettings:
    """Constants.

    Attributes:
        filter: settings of the correlation filter.
        doubt: share of its running median under which a response is low, in [0, 1].
    """

    filter: RegularisedSettings = field(default_factory=RegularisedSettings)
    doubt: Share = 0.6


class Evidence:
    """Responses and colour scores of the last frames without doubt."""

    def __init__(self) -> None:
        self.peaks: deque[float] = deque(maxlen=MEMORY)
        self.colours: deque[float] = deque(maxlen=MEMORY)
        self._usual = 1.0, 1.0

    def add(self, target: RegularisedTarget) -> None:
        """One more frame."""
        self.peaks.append(target.peak)
        self.colours.append(target.colour_score)
        self._usual = max(median(self.peaks), 1e-6), max(median(self.colours), 1e-6)

    def shares(self, target: RegularisedTarget) -> tuple[float, float]:
        """Response and colour score of ``target`` over their medians; 1 until five frames are known."""
        if len(self.peaks) < 5:
            return 1.0, 1.0
        return target.peak / self._usual[0], target.colour_score / self._usual[1]


class Combined:
    """The combined tracker of one target; the score is the response at the target.

    Attributes:
        settings: constants.
        target: where the target is, and the filter that tracks alone.
        doubted: for how many frames in a row the filter has been in doubt.
        searched_frames: in how many frames particles ran.
    """

    def __init__(
        self, settings: CombinedSettings | None = None, seed: int = 0, describe: Describe | None = None
    ) -> None:
        self.settings = settings or CombinedSettings()
        self._describe = describe or Appearance(shipped("appearance_people"), threads=1).describe
        self._rng = np.random.default_rng(seed)

    def start(self, image: ImageArray, box: FloatArray) -> None:
        width, height = (box[2:] - box[:2]).tolist()
        self._model = Model.of(self.settings.filter, width, height)
        self.target = regularised.start(self._model, image, box_centre(np.asarray(box)))
        self._first, self._certain = self.target.filters, self.target
        self._stored: deque[ComplexArray] = deque(maxlen=STORED)
        self._evidence = Evidence()
        self._particles: ParticleState | None = None
        self._former: RegularisedTarget | None = None
        self._wins = self._agreed = self._frame = self.doubted = self.searched_frames = 0
        self._witness = Witness(self._describe, image, np.asarray(box, dtype=np.float64))

    def follow(self, image: ImageArray) -> TargetState:
        self._frame += 1
        located = regularised.locate(self._model, self.target, image)
        if self._doubts(located):
            self._go_on_in_doubt(image, located)
        else:
            self._go_on(image, located)
        if self._former is not None:
            self._reconsider(image, self._former)
        if self._frame % witness.LOOK_INTERVAL == 0:
            self._witness.update(image, self.box(self.target))
            if self._witness.belief > CERTAIN:
                self._certain = self.target
            if self._witness.lost and self._model.target.min() >= LEAST_SIDE:
                self._find_again(image)
        return TargetState(self.box(self.target), self.target.peak, self._status())

    def box(self, target: RegularisedTarget) -> FloatArray:
        """``(4,)`` of the target, or of one of `heaviest_places`."""
        return self._model.box(target.centre, target.size)

    def heaviest_places(self, image: ImageArray, count: int, target: RegularisedTarget) -> list[RegularisedTarget]:
        """The target at the maxima about the heaviest particles that are half a target and more from each other.

        One frame of a search of its own: a search that goes on is left as it is.

        Args:
            image: the frame that `follow` was given last.
            count: of places, at most.
            target: whose size, colours and filters are looked for about its centre.
        """
        self.searched_frames += 1
        bank = self._bank(target)
        maps = self._maps(image, target, bank)
        state = self._weighed(target, self._drawn(maps), maps)
        apart = self._model.target * target.size / 2
        chosen: list[FloatArray] = []
        for particle in state.particles[np.argsort(-state.log_weights, kind="stable")]:
            if all((np.abs(particle[:2] - heavier[:2]) > apart).any() for heavier in chosen[:count]):
                chosen.append(particle)
        return [self._climbed(image, _at(target, particle, bank)) for particle in chosen[:count]]

    def go_on_at(self, there: RegularisedTarget) -> None:
        """Take the target to be where one of `heaviest_places` is; the doubt ends."""
        self.target = there
        self.doubted, self._particles, self._agreed = 0, None, 0
        self._witness.moved()

    def take_over(self, there: RegularisedTarget) -> None:
        """`go_on_at` for a probation, after which the target's present place may be taken again."""
        self._former, self._until = self.target, self._frame + PROBATION
        self.go_on_at(there)

    def _doubts(self, target: RegularisedTarget) -> bool:
        response, colours = self._evidence.shares(target)
        if self.doubted:
            return response < SURE
        return response < self.settings.doubt and colours < COLOUR_DOUBT

    def _go_on(self, image: ImageArray, located: RegularisedTarget) -> None:
        self.target = regularised.update(self._model, located, image)
        self._evidence.add(located)
        self.doubted, self._particles = 0, None
        if self._frame % STORE_INTERVAL == 0:
            self._stored.append(self.target.filters)

    def _go_on_in_doubt(self, image: ImageArray, located: RegularisedTarget) -> None:
        if not self.doubted:
            self._stored.append(self.target.filters)  # the last filter from before the doubt
        self.doubted += 1
        self.target = regularised.update(self._model, located, image)
        self._search(image)

    def _search(self, image: ImageArray) -> None:
        """One frame of the particles; where they have won often enough, the target is theirs."""
        self.searched_frames += 1
        target, bank = self.target, self._bank(self.target)
        maps = self._maps(image, target, bank)
        if self._particles is None:
            self._particles, self._wins = self._drawn(maps), 0
        state = self._particles = self._weighed(target, self._renewed(self._particles, maps), maps)
        heaviest = state.particles[int(np.argmax(state.log_weights))]
        there = self._climbed(image, _at(target, heaviest, bank))
        moved = bool((np.abs(there.centre - target.centre) > 0.5 * self._model.target * target.size).any())
        elsewhere = moved or int(heaviest[2]) > 0
        better = there.peak > target.peak + MARGIN
        accepted = not self._doubts(there)
        won = elsewhere and better and accepted and self._likelier(image, there, target)
        self._wins = self._wins + 1 if won else 0
        if self._wins >= WINS:
            self.take_over(there)

    def _likelier(self, image: ImageArray, there: RegularisedTarget, target: RegularisedTarget) -> bool:
        """Whether the witness takes ``there`` for the target, and rather than ``target``."""
        evidence = self._witness.evidence(image, np.stack([self.box(there), self.box(target)]))
        return bool(evidence[0] > max(evidence[1], 0))

    def _reconsider(self, image: ImageArray, former: RegularisedTarget) -> None:
        """Follow on from where the filter was before a challenge won, and go back if the target is lost after it."""
        self._former = regularised.locate(self._model, former, image)
        if self._frame < self._until:
            return
        former, self._former = self._former, None
        if self._witness.lost and self._likelier(image, former, self.target):
            self.go_on_at(former)

    def _find_again(self, image: ImageArray) -> None:
        """Of a target that is lost: where the witness sees it often enough, as it was when that was certain, it is."""
        places = self.heaviest_places(image, PLACES, replace(self._certain, centre=self.target.centre))
        evidence = self._witness.evidence(image, np.stack([self.box(there) for there in places]))
        best = int(np.argmax(evidence))
        self._agreed = self._agreed + 1 if evidence[best] > CLEAR else 0
        if self._agreed >= AGREED:
            self.take_over(places[best])

    def _renewed(self, state: ParticleState, maps: ResponseMaps) -> ParticleState:
        """``state`` with a share of its particles at the present maxima: a target may come back where none are left."""
        count = round(RENEWED * len(state))
        chosen = self._rng.choice(len(state), count, replace=False)
        particles, log_weights = state.particles.copy(), state.log_weights.copy()
        particles[chosen] = self._drawn(maps).particles[:count]
        log_weights[chosen] = -np.log(len(state))
        return ParticleState(particles, normalise(log_weights))

    def _bank(self, target: RegularisedTarget) -> ComplexArray:
        """``(K, D, rows, columns // 2 + 1)`` the target's filter, the first one, and those stored."""
        return np.stack([target.filters, self._first, *self._stored])

    def _weighed(self, target: RegularisedTarget, state: ParticleState, maps: ResponseMaps) -> ParticleState:
        """One step of the particle filter."""
        motion = PlaneWalk(self._model.target * target.size * SPREAD)
        return ParticleFilter(bootstrap(motion), _log_likelihood, threshold=1.0).step(state, maps, self._rng)[0]

    def _climbed(self, image: ImageArray, there: RegularisedTarget) -> RegularisedTarget:
        """``there`` at the maximum about it, in a window of its own as the filter alone has one."""
        response, _ = regularised.responses(self._model, there, image)
        shift, value = peak(response)
        extent = np.array([image.shape[1], image.shape[0]], dtype=np.float64)
        place = np.clip(there.centre + shift * self._model.cell_pixels(there.size), 0, extent)
        return replace(there, centre=place, peak=value)

    def _maps(self, image: ImageArray, target: RegularisedTarget, bank: ComplexArray) -> ResponseMaps:
        """Responses of all filters in the windows about the target that lie in the image."""
        model = self._model
        step = np.array(model.shape[::-1]) * model.cell_pixels(target.size) / 2
        centres = target.centre + window_grid(REACH) * step
        inside = np.all((centres >= 0) & (centres <= [image.shape[1], image.shape[0]]), axis=1)
        centres = centres[inside | (np.arange(len(centres)) == 0)]
        maps = regularised.responses_at(model, target, image, centres, bank)
        return ResponseMaps(maps, centres, model.cell_pixels(target.size))

    def _drawn(self, maps: ResponseMaps) -> ParticleState:
        """Particles x, y and filter number, at the highest maxima of all filters by their likelihood."""
        filters = maps.maps.shape[1]
        which, shifts, height = maxima_of_each(maps.maps.reshape(-1, *maps.maps.shape[2:]), 3)
        if not len(which):  # a flat response has no maximum
            which, shifts, height = np.zeros(1, dtype=np.int64), np.zeros((1, 2)), np.zeros(1)
        everywhere = np.column_stack([maps.centres[which // filters] + shifts * maps.cell, which % filters])
        weights = np.exp(SHARPNESS * (height - height.max()))
        drawn = everywhere[self._rng.choice(len(everywhere), PARTICLES, p=weights / weights.sum())]
        return ParticleState(drawn, np.full(PARTICLES, -np.log(PARTICLES)))

    def _status(self) -> Status:
        if self._witness.lost:
            return "lost"
        if self.doubted == 0:
            return "tracking"
        return "searching" if self.doubted <= LOST_AFTER else "lost"


def _at(target: RegularisedTarget, particle: FloatArray, bank: ComplexArray) -> RegularisedTarget:
    """The target at a particle, with its filter."""
    return replace(target, centre=particle[:2], filters=bank[int(particle[2])])


def _log_likelihood(particles: FloatArray, maps: ResponseMaps) -> FloatArray:
    """Equation (3.4), its response joined with the colours and in the exponent."""
    numbers = np.minimum(particles[:, 2].astype(np.int64), maps.maps.shape[1] - 1)
    return SHARPNESS * maps.at(particles[:, :2], numbers)
