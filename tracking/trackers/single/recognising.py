"""The combined tracker of a person, with an appearance network that leads its particles.

A filter that has slid onto something else is as sure as ever: nothing of its own starts a search. The network, which
learns nothing from the video, says that the box no longer shows the person (`recognition`). Then particles are drawn at
the maxima of all filters all around, moved and weighed as in a search of `combined`, and the network looks at the
heaviest places. The one most like the first frame's box is the target, if it is like enough, and more so than the box.
Otherwise the filter goes on as if nothing had been said.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tsuiseki.tracking.filters.base import bootstrap
from tsuiseki.tracking.filters.particles.particle_filter import ParticleFilter
from tsuiseki.tracking.trackers.single.combined import Combined, CombinedSettings
from tsuiseki.tracking.trackers.single.interface import TargetState
from tsuiseki.tracking.trackers.single.particles import random_walk
from tsuiseki.tracking.trackers.single.recognition import Describe, RecognitionSettings, Witness
from tsuiseki.tracking.trackers.single.regularised import RegularisedTarget
from tsuiseki.tracking.types import FloatArray, ImageArray


class Recognising(Combined):
    """`Combined` of a person whom a network recognises; the status says lost where it does not.

    Args:
        describe: appearance features of boxes.
        settings: of the tracker.
        seed: of its random numbers.
        recognition: when the network looks, and what it takes for the target.

    Attributes:
        found_again: how often the network has led to another place.
    """

    def __init__(
        self,
        describe: Describe,
        settings: CombinedSettings | None = None,
        seed: int = 0,
        recognition: RecognitionSettings | None = None,
    ) -> None:
        super().__init__(settings, seed)
        self.recognition = recognition or RecognitionSettings()
        self._describe = describe

    def start(self, image: ImageArray, box: FloatArray) -> None:
        """See `SingleTracker.start`."""
        super().start(image, box)
        self._witness = Witness(self._describe, self.recognition, image, box)
        self.found_again = 0

    def follow(self, image: ImageArray) -> TargetState:
        """See `SingleTracker.follow`."""
        found = super().follow(image)
        if self._frame % self.recognition.every == 0:
            likeness = self._witness.look(image, found.box)
            if self._witness.strange:
                self._find_again(image, likeness)
                box = self._model.box(self.target.centre, self.target.size)
                found = TargetState(box, self.target.peak, self._status())
        return replace(found, status="lost") if self._witness.strange else found

    def _find_again(self, image: ImageArray, likeness: float) -> None:
        """Go to the place that looks most like the first box, if that is alike enough."""
        self.searched_frames += 1
        places = self._heaviest_places(image)
        boxes = np.array([self._model.box(there.centre, there.size) for there in places])
        likenesses = self._witness.likenesses(image, boxes)
        best = int(np.argmax(likenesses))
        alike = max(likeness + self.recognition.better, self.recognition.alike * self._witness.usual)
        if likenesses[best] >= alike:
            self.target = places[best]
            self.doubted, self._challenge = 0, None
            self.found_again += 1
            self._witness.forget_doubt()

    def _heaviest_places(self, image: ImageArray) -> list[RegularisedTarget]:
        """The target at the maxima about the heaviest particles that are half a target and more from each other."""
        settings, target = self.settings, self.target
        bank = np.stack([target.filters, self._first, *self._stored])
        maps = self._sized_maps(image, bank)
        sides = self._model.target * target.size
        motion = random_walk(sides * settings.spread, settings.size_spread)
        particle_filter = ParticleFilter(bootstrap(motion), self._log_likelihood, threshold=1.0)
        state, _ = particle_filter.step(particle_filter.init(self._draw(maps.middle)), maps, self._rng)
        chosen: list[FloatArray] = []
        for particle in state.particles[np.argsort(-state.log_weights, kind="stable")]:
            if all((np.abs(particle[:2] - other[:2]) > sides / 2).any() for other in chosen):
                chosen.append(particle)
            if len(chosen) == self.recognition.candidates:
                break
        extent = np.array([image.shape[1], image.shape[0]], dtype=np.float64)
        found = []
        for particle in chosen:
            there = replace(target, centre=particle[:2], filters=bank[int(particle[2])], size=self._size(particle))
            place, response = self._look(image, there)
            found.append(replace(there, centre=np.clip(place, 0, extent), peak=response))
        return found
