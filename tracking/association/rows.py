"""Detections of several frames in one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray


@dataclass(frozen=True)
class DetectionRows:
    """Detections of several frames.

    Attributes:
        numbers: ``(N,)`` increasing, counted over the whole video.
        frames: ``(N,)``.
        boxes: ``(N, 4)`` pixels.
        scores: ``(N,)``, NaN where no detector gave one.
        features: ``(N, D)`` of unit length, NaN where not known; None where nothing was described.
        actions: ``(N, A)`` probabilities of actions; None where nothing recognised them.
    """

    numbers: IntArray
    frames: IntArray
    boxes: FloatArray
    scores: FloatArray
    features: FloatArray | None
    actions: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.numbers)

    def select(self, which: BoolArray | IntArray) -> DetectionRows:
        """The rows at a mask or at indices."""
        features = None if self.features is None else self.features[which]
        actions = None if self.actions is None else self.actions[which]
        return DetectionRows(
            self.numbers[which], self.frames[which], self.boxes[which], self.scores[which], features, actions
        )


def rows_of(detections: Sequence[Detections], first_frame: int, first_number: int) -> DetectionRows:
    """The detections of consecutive frames, at least one.

    Raises:
        ValueError: features are of different lengths, or there are actions for some frames only.
    """
    lengths = [len(found) for found in detections]
    boxes = np.concatenate([found.boxes for found in detections])
    return DetectionRows(
        first_number + np.arange(len(boxes)),
        first_frame + np.repeat(np.arange(len(detections)), lengths),
        boxes,
        np.concatenate([found.scores for found in detections]),
        _stacked([found.features for found in detections], lengths),
        _actions(detections),
    )


def _actions(detections: Sequence[Detections]) -> FloatArray | None:
    """Actions one below the other."""
    given = [found.actions for found in detections if found.actions is not None]
    if given and any(found.actions is None and len(found) for found in detections):
        raise ValueError("expected action features for all frames or for none")
    return np.concatenate(given) if given else None


def _stacked(features: Sequence[FloatArray | None], lengths: Sequence[int]) -> FloatArray | None:
    """Features one below the other, NaN for those that are not known."""
    known = {part.shape[1] for part in features if part is not None and len(part)}
    if not known:
        return None
    if len(known) > 1:
        raise ValueError(f"expected features of one length, got lengths {sorted(known)}")
    width = known.pop()
    return np.concatenate(
        [
            np.full((length, width), np.nan) if part is None else part.reshape(length, width)
            for part, length in zip(features, lengths, strict=True)
        ]
    )
