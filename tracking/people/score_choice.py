"""From which score on the boxes of a detector of other people are taken: the video says, see `association.clutter`.

A network of another project is first run on the beginning of the video with a low threshold. What moves there tells the
score from which its detections are worth keeping, and the rest of the video is looked at with this threshold. Given
detections are cut likewise where that leaves out most of them, which no detector's own threshold did.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.association.clutter import score_floor
from tsuiseki.tracking.features.exported import Detect
from tsuiseki.tracking.features.foreign_detector import ForeignDetector
from tsuiseki.tracking.features.ground_plane import GroundPlane
from tsuiseki.tracking.features.streaming import stream
from tsuiseki.tracking.features.view_choice import inner_detector
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.video.source import Source

# Score from which a network's boxes are looked at, seconds of the video that tell, and most detections that do.
LOWEST, SECONDS, MOST = 0.05, 20.0, 60_000
# Given detections are cut where no more than this share of them is worth keeping.
MOSTLY = 0.25


def floor_of(found: Sequence[Detections], frame_rate: float) -> float | None:
    """`score_floor` of ``(F,)`` frames' detections; None where they have no scores, or too little moves."""
    counts = np.array([len(each) for each in found])
    kept = int(np.searchsorted(np.cumsum(counts), MOST, side="right"))
    found, counts = found[:kept], counts[:kept]
    if not counts.sum():
        return None
    scores = np.concatenate([each.scores for each in found])
    if np.isnan(scores).any():
        return None
    boxes = np.concatenate([each.boxes for each in found])
    return score_floor(np.repeat(np.arange(len(found)), counts), boxes, scores, frame_rate)


def above_floor(found: Sequence[Detections], frame_rate: float) -> tuple[list[Detections], float | None]:
    """Given detections, an entry a frame, that are worth keeping, and the score from which they are; None for all."""
    floor, every = floor_of(found, frame_rate), [*found]
    if floor is not None:
        kept = [each.select(each.scores >= floor) for each in found]
        if sum(map(len, kept)) <= MOSTLY * sum(map(len, found)):
            return kept, floor
    return every, None


class ScoreChoice:
    """A network of another project whose threshold the beginning of a video tells.

    Args:
        detect: the network, in tiles or not.
        network: the same, which holds the threshold.
        ground: also drops what scores less.

    Attributes:
        floor: the threshold by now; None where the video did not tell, and the usual one is taken.
    """

    def __init__(self, detect: Detect, network: ForeignDetector, ground: GroundPlane | None) -> None:
        self._detect, self._network, self._ground = detect, network, ground
        self.floor: float | None = None

    def look(self, source: Source, batch_size: int, workers: int, times: StageTimes) -> dict[int, Detections]:
        """Detections by frame number at the beginning of the video, at the threshold that is taken from then on."""
        usual, self._network.score_threshold = self._network.score_threshold, LOWEST
        last = source.frames_wanted.first + round(SECONDS * source.frame_rate)
        found: dict[int, Detections] = {}
        frames = source.frames()
        for frame, each in stream(frames, self._detect, None, batch_size, times, workers):
            if frame.index >= last:
                break
            found[frame.index] = each
        self.floor = floor_of([*found.values()], source.frame_rate)
        threshold = usual if self.floor is None else self.floor
        self._network.score_threshold = threshold
        if self._ground is not None:
            self._ground.score_threshold = threshold
        return {number: each.select(each.scores >= threshold) for number, each in found.items()}

    @property
    def threshold(self) -> float:
        """Score from which boxes are kept by now."""
        return self._network.score_threshold

    def __str__(self) -> str:
        if self.floor is None:
            return f"scores: too little moves to tell what they are worth; kept from {self.threshold:g}"
        return f"scores: boxes are kept from {self.floor:.2f} on, by what moves; --score-threshold says another"


def score_choice(detect: object, ground: GroundPlane | None) -> ScoreChoice | None:
    """For a network of another project; None for others, whose scores are known or whose threshold is theirs."""
    network = inner_detector(detect)
    return ScoreChoice(detect, network, ground) if isinstance(network, ForeignDetector) else None  # type: ignore[arg-type]
