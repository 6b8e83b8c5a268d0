"""Detections of several frames in one table.

The detections of a window as one table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray


@dataclass(frozen=True)
class Measurements:
    """N detections as the filter takes them.

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

    def select(self, which: BoolArray | IntArray) -> Measurements:
        """Those at a mask or at indices."""
        return Measurements(self.times[which], self.places[which], self.noise[which], self.wander[which])


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


@dataclass(frozen=True)
class Seen:
    """The detections of a window, in the order of their frames.

    Attributes:
        numbers: ``(N,)`` increasing, counted over the whole video.
        frames: ``(N,)``.
        image: ``(N, 4)`` boxes where the image shows them, pixels.
        boxes: ``(N, 4)`` boxes as if the camera stood still.
        measured: the same as the filter takes them.
        features: ``(N, D)`` of unit length, NaN where not known; None where nothing was described.
        frame_rate: frames a second.
        size: width and height of the image; None where not known.
        actions: ``(N, A)`` probabilities of actions; None where nothing recognised them.
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

    def __len__(self) -> int:
        return len(self.numbers)

    def rows(self, numbers: IntArray) -> IntArray:
        """``(K,)`` indices of the detections of ``(K,)`` numbers, -1 for those that are not here."""
        return rows_of_numbers(self.numbers, numbers)


def rows_of_numbers(known: IntArray, numbers: IntArray) -> IntArray:
    """``(K,)`` indices of ``(K,)`` numbers in ``(N,)`` increasing ones, -1 for those that are not there."""
    if len(known) == 0:
        return np.full(len(numbers), -1)
    # Numbers of a window are nearly without gaps, and looking up is faster than searching. The last place is nobody's.
    first, last = int(known[0]), int(known[-1])
    table = np.full(last - first + 2, -1)
    table[known - first] = np.arange(len(known))
    return np.asarray(table[np.where((numbers >= first) & (numbers <= last), numbers - first, -1)])


def no_detections(frame_rate: float, size: tuple[int, int] | None) -> Seen:
    """A table of nothing."""
    none, nothing = np.empty(0, dtype=np.int64), np.empty(0)
    measured = Measurements(nothing, np.empty((0, 4)), nothing, nothing)
    return Seen(none, none, np.empty((0, 4)), np.empty((0, 4)), measured, None, frame_rate, size)


def select_detections(seen: Seen, which: BoolArray | IntArray) -> Seen:
    """The detections at a mask or at indices."""
    measured = seen.measured.select(which)
    features = None if seen.features is None else seen.features[which]
    actions = None if seen.actions is None else seen.actions[which]
    return replace(
        seen,
        numbers=seen.numbers[which],
        frames=seen.frames[which],
        image=seen.image[which],
        boxes=seen.boxes[which],
        measured=measured,
        features=features,
        actions=actions,
    )


def joined_detections(one: Seen, other: Seen) -> Seen:
    """The detections of two tables, one after the other."""
    measured = Measurements(
        np.append(one.measured.times, other.measured.times),
        np.concatenate([one.measured.places, other.measured.places]),
        np.append(one.measured.noise, other.measured.noise),
        np.append(one.measured.wander, other.measured.wander),
    )
    return replace(
        one,
        numbers=np.append(one.numbers, other.numbers),
        frames=np.append(one.frames, other.frames),
        image=np.concatenate([one.image, other.image]),
        boxes=np.concatenate([one.boxes, other.boxes]),
        measured=measured,
        features=_stacked(one, one.features, other, other.features),
        actions=_stacked(one, one.actions, other, other.actions),
    )


def _stacked(one: Seen, first: FloatArray | None, other: Seen, second: FloatArray | None) -> FloatArray | None:
    """Rows of two tables, one after the other, NaN where one has none; None where neither has any."""
    width = next((rows.shape[1] for rows in (first, second) if rows is not None), None)
    if width is None:
        return None
    pairs = ((one, first), (other, second))
    return np.concatenate([np.full((len(seen), width), np.nan) if rows is None else rows for seen, rows in pairs])
