"""A tracker of a person whom an appearance network recognises; it leads the particles of the combined tracker.

A filter that has slid onto something else is as sure as ever: nothing of its own says that the target is lost. The
network, which learns nothing from the video, says that the box no longer shows the person (`recognition`): where it is
sure the status is ``lost``, whatever the tracker says. Of the combined tracker, particles are drawn at the maxima of
all filters all around as soon as the box looks strange, moved and weighed as in a search, and the network looks at the
heaviest places. The one most like the first frame's box is the target, if it is like enough, and more so than the box.
Otherwise the filter goes on as if nothing had been said. The network knows people alone: where the first box is not as
upright as a person it is not asked, and the tracker is as without it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tsuiseki.tracking.single.combined import Combined
from tsuiseki.tracking.single.interface import SingleTracker, TargetState
from tsuiseki.tracking.single.recognition import Describe, RecognitionSettings, Witness
from tsuiseki.tracking.types import FloatArray, ImageArray


class Recognised:
    """A tracker whose status also says lost where the box no longer looks like the first one.

    Args:
        tracker: that follows; only a `Combined` is led to another place.
        describe: appearance features of boxes.
        settings: when the network looks, and what it takes for the target.

    Attributes:
        asked: whether the first box is upright enough for a person.
        found_again: how often the network has led to another place.
    """

    def __init__(self, tracker: SingleTracker, describe: Describe, settings: RecognitionSettings | None = None) -> None:
        self.settings = settings or RecognitionSettings()
        self._tracker, self._describe = tracker, describe

    def start(self, image: ImageArray, box: FloatArray) -> None:
        """See `SingleTracker.start`."""
        self._tracker.start(image, box)
        width, height = (np.asarray(box)[2:] - np.asarray(box)[:2]).tolist()
        self.asked = height >= self.settings.upright * width
        if self.asked:
            self._witness = Witness(self._describe, self.settings, image, box)
        self._frame = self.found_again = 0

    def follow(self, image: ImageArray) -> TargetState:
        """See `SingleTracker.follow`."""
        found = self._tracker.follow(image)
        if not self.asked:
            return found
        self._frame += 1
        if self._frame % self.settings.every == 0:
            likeness = self._witness.look(image, found.box)
            if self._witness.strange and isinstance(self._tracker, Combined):
                self._find_again(self._tracker, image, likeness)
                found = self._tracker.state()
        return replace(found, status="lost") if self._witness.lost else found

    def _find_again(self, tracker: Combined, image: ImageArray, likeness: float) -> None:
        """Go to the place that looks most like the first box, if that is alike enough."""
        places = tracker.heaviest_places(image, self.settings.candidates)
        boxes = np.array([tracker.box(there) for there in places])
        likenesses = self._witness.likenesses(image, boxes)
        best = int(np.argmax(likenesses))
        alike = max(likeness + self.settings.better, self.settings.alike * self._witness.usual)
        if likenesses[best] >= alike:
            tracker.go_on_at(places[best])
            self.found_again += 1
            self._witness.forget_doubt()
