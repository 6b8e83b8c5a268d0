"""A tracker of a person with a second witness: an appearance network, which learns nothing from the video.

A correlation filter that slides onto the background learns it, and its response stays high. An appearance network does
not slide along. It compares the features of the box with those of the first box: their cosine is the likeness. Where
the likeness falls far below its running median, the status is ``lost``, whatever the tracker reports.

The network describes people. It counts only where the likeness has been high, and the first box is as upright as a
person.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from tsuiseki.tracking.single.tracker import SingleTracker, TargetState
from tsuiseki.tracking.single.witness import Describe, unit_features
from tsuiseki.tracking.types import FloatArray, ImageArray

MEMORY, HEARD = 15, 0.6
"""Likenesses of the running median, and its value from which on the network counts."""
EXPECTED = 0.9
"""Prior likeness of the target, so that a box that is lost at once is not taken for it."""
USUAL_SHARE, LOST_SHARE = 0.6, 0.4
"""Shares of the running median from which on a likeness counts in it, and under which the target counts as lost. Half
hidden, the target has one between them."""


@dataclass(frozen=True)
class RecognitionSettings:
    """Constants.

    Attributes:
        upright: height over width of the first box from which on the target may be a person, and the network is asked.
        every: frames from one inference of the network to the next.
        trusted: weight of `EXPECTED`, in inferences.
        lost_inferences: likenesses below `LOST_SHARE` in a row from which on the status is ``lost``.
    """

    upright: float = 1.8
    every: int = 3
    trusted: int = 3
    lost_inferences: int = 2


class Recognised:
    """A tracker whose status is also lost where the box is no longer like the first one.

    Args:
        tracker: that follows.
        describe: appearance features of boxes.
        settings: when the network runs, and which likenesses it takes for the target.

    Attributes:
        asked: whether the first box is upright enough for a person.
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
            self._first = self._features(image, np.asarray(box)[None])[0]
        self._likenesses = deque([EXPECTED] * self.settings.trusted, maxlen=MEMORY)
        self._frame = self._lost = 0

    def follow(self, image: ImageArray) -> TargetState:
        """See `SingleTracker.follow`."""
        found = self._tracker.follow(image)
        if not self.asked:
            return found
        self._frame += 1
        if self._frame % self.settings.every == 0:
            self._compare(image, found.box)
        lost = self._lost >= self.settings.lost_inferences and median(self._likenesses) >= HEARD
        return replace(found, status="lost") if lost else found

    def _compare(self, image: ImageArray, box: FloatArray) -> None:
        """Count the likeness of what the box ``(4,)`` of a frame shows as usual or lost."""
        likeness, usual = float(self._features(image, box[None])[0] @ self._first), median(self._likenesses)
        if likeness >= USUAL_SHARE * usual:
            self._likenesses.append(likeness)
        self._lost = self._lost + 1 if likeness < LOST_SHARE * usual else 0

    def _features(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        return unit_features(self._describe, image, boxes)
