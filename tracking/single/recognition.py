"""A second witness of whether a box still holds the target: an appearance network, which has learnt nothing here.

A correlation filter that slides onto the background learns it, and is as sure of it as of the target. A network that
tells people apart and is never taught from the video does not slide along: what it says of the box is compared with
what it said of the first box. Where the likeness falls far below what it was, the status is ``lost``, whatever the
filter says. The network knows people: of other targets it says nothing reliable. Where the likeness has never been
high, it is not heard; of a thing that is not upright in its first box it is not asked (`recognised`).
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
        upright: height over width of the first box from which on the target may be a person, and the network is asked.
        every: frames between two looks.
        heard: running median from which on the network is heard.
        memory: looks of the running median.
        expected: likeness of the target before any look, so that a box that is lost at once is not taken for it.
        trusted: looks that ``expected`` counts for.
        share: of the running median under which a likeness is strange.
        looks: strange likenesses in a row from which on the target is looked for elsewhere.
        lost_share: likewise under which the target counts as lost; lower, since who is half hidden looks strange, too.
        lost_looks: in a row.
        candidates: places that are looked at in a look that says that the box does not show the target; see
            `recognised`.
        better: how much more alike than the box such a place must be.
        alike: share of the running median from which on it may be the target.
    """

    upright: float = 1.8
    every: int = 3
    heard: float = 0.6
    memory: int = 15
    expected: float = 0.9
    trusted: int = 3
    share: float = 0.6
    looks: int = 2
    lost_share: float = 0.4
    lost_looks: int = 2
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
        self._likenesses = [settings.expected] * settings.trusted
        self._strange = self._lost = 0

    def likenesses(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """``(N,)`` cosines of what ``boxes`` ``(N, 4)`` show and of the first box, in [-1, 1]."""
        return np.asarray(self._features(image, boxes) @ self._first)

    def look(self, image: ImageArray, box: FloatArray) -> float:
        """Take what the box ``(4,)`` of a frame shows; its likeness."""
        likeness = float(self.likenesses(image, box[None])[0])
        settings, usual = self.settings, self.usual
        if likeness < settings.share * usual:
            self._strange += 1
        else:
            self._strange = 0
            self._likenesses = [*self._likenesses, likeness][-settings.memory :]
        self._lost = self._lost + 1 if likeness < settings.lost_share * usual else 0
        return likeness

    def forget_doubt(self) -> None:
        """The box is elsewhere now: it counts as the target until it looks otherwise."""
        self._strange = self._lost = 0

    @property
    def usual(self) -> float:
        """The running median of likenesses."""
        return median(self._likenesses)

    @property
    def strange(self) -> bool:
        """Whether the box seems to show something else."""
        return self._strange >= self.settings.looks and self.usual >= self.settings.heard

    @property
    def lost(self) -> bool:
        """Whether it is sure that the box no longer shows the target."""
        return self._lost >= self.settings.lost_looks and self.usual >= self.settings.heard

    def _features(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        found = np.asarray(self._describe(image, boxes), dtype=np.float64)
        return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9))
