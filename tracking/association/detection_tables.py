"""Detections of several frames as tables: as they are given, and as the flow compares them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from tsuiseki.tracking.types import Columns, Detections, FloatArray, IntArray


@dataclass(frozen=True)
class DetectionRows(Columns):
    """Detections of several frames, as they are given.

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


def rows_of(detections: Sequence[Detections], first_frame: int, first_number: int) -> DetectionRows:
    """The detections of consecutive frames, at least one.

    Raises:
        ValueError: features are of different lengths, or there are actions for some frames only.
    """
    frames, boxes, scores = boxes_of_frames(detections)
    parts = [frame.actions for frame in detections if frame.actions is not None]
    if parts and any(frame.actions is None and len(frame) for frame in detections):
        raise ValueError("expected action features for all frames or for none")
    actions = np.concatenate(parts) if parts else None
    numbers = first_number + np.arange(len(boxes))
    return DetectionRows(numbers, first_frame + frames, boxes, scores, _features_of(detections), actions)


def boxes_of_frames(detections: Sequence[Detections]) -> tuple[IntArray, FloatArray, FloatArray]:
    """``(N,)`` frames from 0, ``(N, 4)`` boxes and ``(N,)`` scores of the detections of consecutive frames."""
    frames = np.repeat(np.arange(len(detections)), [len(frame) for frame in detections])
    boxes = np.concatenate([np.empty((0, 4)), *(frame.boxes for frame in detections)])
    return frames, boxes, np.concatenate([np.empty(0), *(frame.scores for frame in detections)])


def _features_of(detections: Sequence[Detections]) -> FloatArray | None:
    """Features one below the other, NaN for those that are not known."""
    lengths = {frame.features.shape[1] for frame in detections if frame.features is not None and len(frame.features)}
    if not lengths:
        return None
    if len(lengths) > 1:
        raise ValueError(f"expected features of one length, got lengths {sorted(lengths)}")
    parts = []
    for frame in detections:
        shape = (len(frame), *lengths)
        parts.append(np.full(shape, np.nan) if frame.features is None else frame.features.reshape(shape))
    return np.concatenate(parts)


@dataclass(frozen=True)
class Measurements(Columns):
    """N detections as the filter along chains takes them.

    Attributes:
        times: ``(N,)`` seconds.
        places: ``(N, 4)`` x, y in pixels, log width, log height.
        noise: ``(N,)`` by how much the measurement deviates more than r.
        wander: ``(N,)`` variance of a place that the camera's motion has added up to, squared heights.
    """

    times: FloatArray
    places: FloatArray
    noise: FloatArray
    wander: FloatArray


@dataclass(frozen=True)
class DetectionTable(Columns):
    """The detections of a window of the flow, in the order of their frames.

    Attributes:
        numbers: ``(N,)`` increasing, counted over the whole video.
        frames: ``(N,)``.
        image: ``(N, 4)`` boxes where the image shows them, pixels.
        boxes: ``(N, 4)`` boxes as if the camera stood still, pixels.
        measured: the same as the filter takes them.
        features: ``(N, D)`` of unit length, NaN where not known; None where nothing was described.
        frame_rate: frames a second.
        size: width and height of the image; None where not known.
        actions: ``(N, A)`` probabilities of actions; None where nothing recognised them.
        even: whether frames follow each other at one interval, or ``measured.times`` says when.
    """

    numbers: IntArray
    frames: IntArray
    image: FloatArray
    boxes: FloatArray
    measured: Measurements
    features: FloatArray | None
    frame_rate: float
    size: tuple[int, int] | None
    actions: FloatArray | None = None
    even: bool = True

    @classmethod
    def empty(cls, frame_rate: float, size: tuple[int, int] | None) -> DetectionTable:
        none, nothing = np.empty(0, dtype=np.int64), np.empty(0)
        measured = Measurements(nothing, np.empty((0, 4)), nothing, nothing)
        return cls(none, none, np.empty((0, 4)), np.empty((0, 4)), measured, None, frame_rate, size)

    def rows(self, numbers: IntArray) -> IntArray:
        """``(K,)`` indices of the detections of ``(K,)`` numbers, -1 for those that are not here."""
        return rows_of_numbers(self.numbers, numbers)

    def seconds(self, i: IntArray, j: IntArray) -> FloatArray:
        """``(P,)`` from the detections at ``(P,)`` indices to those at others."""
        if self.even:
            return np.asarray((self.frames[j] - self.frames[i]) * (1 / self.frame_rate), dtype=np.float64)
        return np.asarray(self.measured.times[j] - self.measured.times[i])

    def and_then(self, *later: Self) -> Self:
        """These detections, and after them those of other tables."""
        return replace(super().and_then(*later), even=all(table.even for table in (self, *later)))


def rows_of_numbers(increasing: IntArray, numbers: IntArray) -> IntArray:
    """``(K,)`` indices of ``(K,)`` numbers in ``(N,)`` increasing ones, -1 for those that are not there."""
    if len(increasing) == 0:
        return np.full(len(numbers), -1)
    # Numbers of a window are nearly without gaps, and looking up is faster than searching. The last place stands for
    # numbers that are not there.
    first, last = int(increasing[0]), int(increasing[-1])
    places = np.full(last - first + 2, -1)
    places[increasing - first] = np.arange(len(increasing))
    return np.asarray(places[np.where((numbers >= first) & (numbers <= last), numbers - first, -1)])
