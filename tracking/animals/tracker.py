"""Several animals before a fixed camera, frame by frame: the regions that stand out become poses.

Where animals touch, their last poses tell the pixels apart. Who is who is decided in the end, by `link_animals`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from tsuiseki.tracking.animals.linking import Animal, link_animals
from tsuiseki.tracking.animals.pose import AnimalPose, Expected
from tsuiseki.tracking.animals.regions import find_animals
from tsuiseki.tracking.animals.settings import AnimalSettings
from tsuiseki.tracking.features.background_difference import Background
from tsuiseki.tracking.types import FloatArray, Frame

# Of the sizes of an animal, how much a frame in which nothing touches it changes what is remembered.
REMEMBERED = 0.1
# Frames that an animal is expected where it was last seen.
PATIENCE = 5


@dataclass
class _Seen:
    """An animal as the frames before showed it, and how it moved in the last."""

    expected: Expected
    step: FloatArray = field(default_factory=lambda: np.zeros(2))
    unseen: int = 0


class AnimalTracker:
    """Follows animals through frames; the answer comes in the end.

    Args:
        background: what they stand out from.
        settings: see `AnimalSettings`.
        frame_rate: frames a second.
    """

    def __init__(
        self, background: Background, settings: AnimalSettings | None = None, frame_rate: float = 25.0
    ) -> None:
        self.background, self.settings, self.frame_rate = background, settings or AnimalSettings(), frame_rate
        self.frames: list[int] = []
        self.poses: list[list[AnimalPose]] = []
        self._seen: list[_Seen] = []
        self._area = self.settings.area or background.area

    def update(self, frame: Frame) -> list[AnimalPose]:
        """Take the next frame; returns the animals in it, in no particular order."""
        expected = [replace(one.expected, core=one.expected.core + one.step) for one in self._seen]
        found: list[AnimalPose] = []
        if self._area > 0:
            difference = self.background.difference(frame.image)
            found = find_animals(difference, self.background, self._area, self.settings.smallest, expected)
        self._seen = _remembered(self._seen, expected, found)
        self.frames.append(frame.index)
        self.poses.append(found)
        return found

    def animals(self) -> list[Animal]:
        """The animals of all frames so far, by id."""
        height, width = self.background.image.shape[:2]
        return link_animals(self.poses, self.frames, self.settings, self.frame_rate, (width, height))


def _remembered(seen: list[_Seen], expected: list[Expected], found: list[AnimalPose]) -> list[_Seen]:
    """Who is expected in the next frame: animals found, paired with the nearest of those before, and those missed."""
    pairs = []
    if seen and found:
        away = np.array([[np.linalg.norm(one.core - pose.core) for pose in found] for one in expected])
        pairs = [(i, j) for i, j in zip(*linear_sum_assignment(away), strict=True) if away[i, j] < found[j].length]
    before = {j: i for i, j in pairs}
    after = []
    for j, pose in enumerate(found):
        if j not in before:
            axis, shift = pose.pointing(pose.axis)
            after.append(_Seen(Expected(pose.core, axis, pose.spread, shift, pose.length)))
            continue
        old = seen[before[j]]
        axis, shift = pose.pointing(old.expected.axis)
        # What was told apart by a fit to what is remembered teaches nothing.
        share = 0.0 if pose.contact else REMEMBERED
        kept = old.expected
        known = Expected(
            pose.core,
            axis,
            (1 - share) * kept.spread + share * pose.spread,
            (1 - share) * kept.shift + share * shift,
            (1 - share) * kept.length + share * pose.length,
        )
        after.append(_Seen(known, 0.5 * old.step + 0.5 * (pose.core - kept.core)))
    used = set(before.values())
    for i, old in enumerate(seen):
        if i not in used and old.unseen < PATIENCE:
            after.append(replace(old, step=np.zeros(2), unseen=old.unseen + 1))
    return after
