"""A second witness of whether a box still holds the target: an appearance network, which has learnt nothing here.

A correlation filter that slides onto the background learns it, and is as sure of it as of the target. A network that
tells people apart and is never taught from the video does not slide along: what it says of the box is compared with
what it said of the first box. Where the likeness falls far below what it was, the status is ``lost``, whatever the
filter says. The network knows people: of other targets it says nothing reliable. Where the likeness has never been
high, it is not heard.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from tsuiseki.tracking.trackers.single.interface import SingleTracker, TargetState
from tsuiseki.tracking.types import FloatArray, ImageArray

Describe = Callable[[ImageArray, FloatArray], FloatArray]
"""Appearance features ``(N, D)`` of boxes ``(N, 4)`` in an image."""


@dataclass(frozen=True)
class RecognitionSettings:
    """Constants.

    Attributes:
        every: frames between two looks.
        share: of its running median under which a likeness is low.
        heard: running median from which on the network is heard.
        looks: low likenesses in a row from which on the target counts as lost.
        memory: looks of the running median.
        trusted: looks at the beginning that count as the target.
    """

    every: int = 3
    share: float = 0.6
    heard: float = 0.6
    looks: int = 2
    memory: int = 15
    trusted: int = 3


class Recognised:
    """A tracker whose status also says lost where the box no longer looks like the first one.

    Args:
        tracker: that follows.
        describe: appearance features of boxes.
        settings: see there.
    """

    def __init__(self, tracker: SingleTracker, describe: Describe, settings: RecognitionSettings | None = None) -> None:
        self.settings = settings or RecognitionSettings()
        self._tracker, self._describe = tracker, describe

    def start(self, image: ImageArray, box: FloatArray) -> None:
        """See `SingleTracker.start`."""
        self._tracker.start(image, box)
        self._first = self._look(image, np.asarray(box))
        self._likenesses: list[float] = []
        self._frame = self._low = 0

    def follow(self, image: ImageArray) -> TargetState:
        """See `SingleTracker.follow`."""
        found = self._tracker.follow(image)
        self._frame += 1
        if self._frame % self.settings.every == 0:
            self._compare(float(self._first @ self._look(image, found.box)))
        return replace(found, status="lost") if self._strange() else found

    def _look(self, image: ImageArray, box: FloatArray) -> FloatArray:
        features = np.asarray(self._describe(image, box[None])[0], dtype=np.float64)
        return np.asarray(features / max(float(np.linalg.norm(features)), 1e-9))

    def _compare(self, likeness: float) -> None:
        settings, seen = self.settings, self._likenesses
        if len(seen) >= settings.trusted and likeness < settings.share * median(seen):
            self._low += 1
            return
        self._low = 0
        self._likenesses = [*seen, likeness][-settings.memory :]

    def _strange(self) -> bool:
        return self._low >= self.settings.looks and median(self._likenesses) >= self.settings.heard
