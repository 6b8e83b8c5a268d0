"""Why nobody was tracked: detections that all score below what starts a track."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.types.floor import FloorDetections


@dataclass
class BestScore:
    """Watches the scores of what passes through.

    Attributes:
        number: of detections so far.
        best: the highest score so far; infinite where a detection has none, for it may always start a track.
    """

    number: int = 0
    best: float = -np.inf

    def watched(self, people: Iterable[FloorDetections]) -> Iterator[FloorDetections]:
        """The same, frame by frame."""
        for each in people:
            scores = each.detections.scores
            self.number += len(scores)
            self.best = max(self.best, float(np.nan_to_num(scores, nan=np.inf).max(initial=-np.inf)))
            yield each

    def too_low(self, start_score: float) -> str:
        """What to tell where no detection starts a track from ``start_score`` on; empty where one does."""
        if self.number == 0 or self.best >= start_score:
            return ""
        return (
            f"; none of {self.number} detections scores {start_score:g}, from which a track starts: the best has "
            f"{self.best:.2f}; give a lower `hungarian.start_score`, or `method` flow"
        )
