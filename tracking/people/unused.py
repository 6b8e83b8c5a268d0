"""Why detections became no track, in one line: a result without anybody is never silent."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import Detections, FloatArray

# Detections that are kept to tell.
KEPT = 2000
# Pixels below which a box shows nobody; and overlap with the next look below which online methods link nothing.
TINY, LEAST_OVERLAP = 2.0, 0.2


@dataclass
class FirstDetections:
    """The first detections of a run, and how many there were.

    Attributes:
        count: of all looks.
        looks: those of the first looks.
    """

    count: int = 0
    looks: list[Detections] = field(default_factory=list)
    _kept: int = 0

    def add(self, found: Detections) -> None:
        """Take the detections of the next look."""
        self.count += len(found)
        if self._kept < KEPT:
            self._kept += len(found)
            self.looks.append(Detections(found.boxes, found.scores))

    def line(self, used: int, tracks: int, settings: Any = None) -> str | None:
        """One line where most belong to no track; None where enough do.

        Args:
            used: detections that belong to tracks.
            tracks: how many there are.
            settings: of the tracker, which say from which score on a track starts.
        """
        if not self.count or (tracks and 2 * used >= self.count):
            return None
        return f"{self.count - used} of {self.count} detections belong to no track: {self.reason(settings)}"

    def reason(self, settings: Any = None) -> str:
        """What most of the kept detections have in common."""
        scores = np.concatenate([found.scores for found in self.looks])
        sides = np.concatenate([found.boxes[:, 2:] - found.boxes[:, :2] for found in self.looks])
        least = getattr(getattr(settings, "lifecycle", None), "start_score", -np.inf)
        if np.mean(scores < least) > 0.5:
            low, high = np.nanmin(scores), np.nanmax(scores)
            return f"scores are from {low:.3g} to {high:.3g}, and a track starts from {least:g} on, its start_score"
        width, height = np.median(sides, axis=0)
        if min(width, height) < TINY:
            return f"boxes are {width:.2g} x {height:.2g} pixels; expected pixels, not shares or metres"
        if len([found for found in self.looks if len(found)]) < 3:
            return "they are in fewer than three frames"
        if least > -np.inf and np.median(self._overlaps()) < LEAST_OVERLAP:
            return "boxes hardly overlap those of the next frame; look at more frames, or take the method flow"
        return "too rarely found again"

    def _overlaps(self) -> FloatArray:
        """``(N,)`` of each box the largest overlap in the next look."""
        pairs = [iou_matrix(one.boxes, other.boxes) for one, other in pairwise(self.looks) if len(one)]
        return np.concatenate([np.zeros(1), *(overlap.max(axis=1, initial=0.0) for overlap in pairs)])
