"""A second witness of whether a box still holds the target: an appearance network, which has learnt nothing here.

A correlation filter that slides onto the background learns it, and is as sure of it as of the target. A network that
tells people apart and is never taught from the video does not slide along: what it says of the box is compared with
what it said of the first box. Where the likeness falls far below what it was, the status is ``lost``, whatever the
filter says. The network knows people: of other targets it says nothing reliable. Where the likeness has never been
high, it is not heard.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

import numpy as np

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
        candidates: places that are looked at in a look that says that the box does not show the target; see
            `recognised`.
        better: how much more alike than the box such a place must be.
        alike: share of the running median from which on it may be the target.
    """

    every: int = 3
    share: float = 0.6
    heard: float = 0.6
    looks: int = 2
    memory: int = 15
    trusted: int = 3
    candidates: int = 4
    better: float = 0.1
    alike: float = 0.85


class Witness:
    """What the network says of boxes, against the first one.

    Args:
        describe: appearance features of boxes.
        settings: see there.
        image: the first frame ``(H, W, 3)``.
        box: ``(4,)`` of the target in it.
    """

    def __init__(self, describe: Describe, settings: RecognitionSettings, image: ImageArray, box: FloatArray) -> None:
        self.settings = settings
        self._describe = describe
        self._first = self._features(image, np.asarray(box)[None])[0]
        self._likenesses: list[float] = []
        self._low = 0

    def likenesses(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """``(N,)`` cosines of what ``boxes`` ``(N, 4)`` show and of the first box, in [-1, 1]."""
        return np.asarray(self._features(image, boxes) @ self._first)

    def look(self, image: ImageArray, box: FloatArray) -> float:
        """Take what the box ``(4,)`` of a frame shows; its likeness."""
        likeness = float(self.likenesses(image, box[None])[0])
        settings, seen = self.settings, self._likenesses
        if len(seen) >= settings.trusted and likeness < settings.share * median(seen):
            self._low += 1
        else:
            self._low = 0
            self._likenesses = [*seen, likeness][-settings.memory :]
        return likeness

    def forget_doubt(self) -> None:
        """The box is elsewhere now: it counts as the target until it looks otherwise."""
        self._low = 0

    @property
    def usual(self) -> float:
        """The running median of likenesses."""
        return median(self._likenesses)

    @property
    def strange(self) -> bool:
        """Whether the box no longer shows the target."""
        return self._low >= self.settings.looks and self.usual >= self.settings.heard

    def _features(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        found = np.asarray(self._describe(image, boxes), dtype=np.float64)
        return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9))
