"""What a video says of its own detections, without labels: the worth of scores, speeds, what is missed."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field

import numpy as np

from tsuiseki.tracking.association.recurrence import RateOfRight, Stride, TypicalSpeed, found_again
from tsuiseki.tracking.association.score_calibration import EXPECTED, IN_ADVANCE, DetectionCost, ScoreCalibration
from tsuiseki.tracking.types import FloatArray, IntArray


class VideoEvidence:
    """Looks for detections that are found again, as soon as the later ones have come.

    Args:
        settings: what counts as found again, and how the probability of scores is fitted.
        frame_rate: frames a second.

    Attributes:
        probability: of every score to be found again.
        speed: of the targets.
        rate_of_right: how often right detections are found again.
    """

    def __init__(self, settings: DetectionCost, frame_rate: float) -> None:
        self.probability = ScoreCalibration(settings)
        self.speed = TypicalSpeed(memory=settings.memory)
        self.rate_of_right = RateOfRight(EXPECTED, IN_ADVANCE)
        self._again, self._frame_rate = settings.again, frame_rate
        self._stride = Stride()
        self._recent = _Recent()

    def copy(self) -> VideoEvidence:
        """A copy that goes on by itself."""
        other = copy(self)
        other.probability, other.speed = copy(self.probability), copy(self.speed)
        other.rate_of_right, other._stride = copy(self.rate_of_right), copy(self._stride)
        return other

    def add(self, frames: IntArray, boxes: FloatArray, scores: FloatArray, last: int) -> None:
        """Take the detections of the next frames, and what those before them are told by it.

        Args:
            frames: ``(N,)`` increasing.
            boxes: ``(N, 4)`` pixels, as if the camera stood still.
            scores: ``(N,)``, NaN where there is none.
            last: the newest frame, with detections or without.
        """
        self._stride.add(frames)
        stride = self._stride(self._frame_rate)
        gap = self._again.frames(self._frame_rate, stride)
        recent = self._recent.joined(frames, boxes, scores)
        triples = found_again(recent.frames, recent.boxes, self._frame_rate, self._again, stride)
        told = (recent.frames >= max(self._recent.told, gap)) & (recent.frames <= last - gap)
        self.probability.add(recent.scores[told], triples.found[told])
        self.speed.add(triples.speed[told])
        # What those on a line have before them; of the first of the video nobody knows.
        self.rate_of_right.add(triples.found[triples.before[told & triples.found & (recent.frames >= 2 * gap)]])
        self._recent = recent.since(last - 3 * gap + 1, max(self._recent.told, last - gap + 1))


@dataclass(frozen=True)
class _Recent:
    """The detections of the last frames.

    Attributes:
        frames: ``(N,)``.
        boxes: ``(N, 4)`` as if the camera stood still, pixels.
        scores: ``(N,)``.
        told: the frame from which on it is not said yet what was found again.
    """

    frames: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    boxes: FloatArray = field(default_factory=lambda: np.empty((0, 4)))
    scores: FloatArray = field(default_factory=lambda: np.empty(0))
    told: int = 0

    def joined(self, frames: IntArray, boxes: FloatArray, scores: FloatArray) -> _Recent:
        """With the detections of the next frames."""
        return _Recent(
            np.append(self.frames, frames),
            np.concatenate([self.boxes, boxes]),
            np.append(self.scores, scores),
            self.told,
        )

    def since(self, frame: int, told: int) -> _Recent:
        """Those from a frame on."""
        kept = self.frames >= frame
        return _Recent(self.frames[kept], self.boxes[kept], self.scores[kept], told)
