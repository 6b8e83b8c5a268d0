"""Which new targets are believed: those at which a patch of the colour is seen in several frames.

The ratio of a likelihood to its value on background may be so great that one frame makes a target certain. Where
patches flash, every flash begins a false target, which then rests on the next spot of the colour. So a new target has
to show again: M of N, as radar trackers begin tracks (Bar-Shalom and Li, "Multitarget-multisensor tracking", 1995).
"""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.geometry import areas, intersections
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

SHARED = 0.5
"""Of the smaller of a target's box and a patch's, above which the patch is at the target."""


class Confirmation:
    """The targets that are believed, and what was seen of the others.

    Args:
        hits: a target is believed once it was supported in so many frames,
        frames: of its first so many, at least ``hits``.
    """

    def __init__(self, hits: int, frames: int) -> None:
        self.hits, self.frames = hits, frames
        self._believed: set[int] = set()
        self._seen: dict[int, tuple[int, int]] = {}  # frames and hits of each target not believed yet

    def update(self, labels: IntArray, supported: BoolArray) -> IntArray:
        """Take the targets of the next frame; the labels of those that cannot be confirmed any more.

        Args:
            labels: ``(T,)`` of all targets that are followed. A label that is missing is never used again.
            supported: ``(T,)`` whether a patch is at each.
        """
        names = labels.tolist()
        self._believed.intersection_update(names)
        self._seen = {name: self._seen.get(name, (0, 0)) for name in names if name not in self._believed}
        failed = []
        for name, hit in zip(names, supported.tolist(), strict=True):
            if name in self._believed:
                continue
            age, hits = self._seen[name]
            self._seen[name] = age, hits = age + 1, hits + hit
            if hits >= self.hits:
                self._believed.add(name)
            elif age - hits > self.frames - self.hits:
                failed.append(name)
        return np.array(failed, dtype=np.int64)

    def believes(self, labels: IntArray) -> BoolArray:
        """Which of the targets ``(N,)`` are believed."""
        return np.array([name in self._believed for name in labels.tolist()], dtype=np.bool_)


def at_patches(boxes: FloatArray, patches: FloatArray) -> BoolArray:
    """Which of the boxes ``(T, 4)`` have one of the patches ``(G, 4)`` at them, pixels."""
    if len(boxes) == 0 or len(patches) == 0:
        return np.zeros(len(boxes), dtype=np.bool_)
    smaller = np.minimum(areas(boxes)[:, None], areas(patches)[None])
    return np.asarray((intersections(boxes[:, None], patches[None]) > SHARED * smaller).any(axis=1))
