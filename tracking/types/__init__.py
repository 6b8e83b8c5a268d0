"""The nouns of the toolkit: small frozen dataclasses, validated where they are made.

Boxes are ``(N, 4)`` float64 arrays ``x1, y1, x2, y2`` in pixels, 0-based and continuous: a box that covers
exactly the first pixel of an image is ``0, 0, 1, 1``. Frame numbers are 0-based. Files convert at the border.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
ImageArray: TypeAlias = NDArray[np.uint8]

Status = Literal["tracking", "searching", "lost"]
StatusArray: TypeAlias = NDArray[np.str_]
STATUSES: tuple[Status, ...] = ("tracking", "searching", "lost")


class ComparedByValue:
    """Two of a class are equal where all their fields are, arrays among them; NaN equals NaN."""

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        mine, others = vars(self), vars(other)
        return mine.keys() == others.keys() and all(_same(mine[name], others[name]) for name in mine)

    __hash__ = None  # type: ignore[assignment]


def _same(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        first, second = np.asarray(one), np.asarray(other)
        return np.array_equal(first, second, equal_nan=first.dtype.kind == second.dtype.kind == "f")
    return bool(one == other)


@dataclass(frozen=True, eq=False)
class Frame(ComparedByValue):
    """One image of a video.

    Attributes:
        index: 0-based position in the video.
        time: seconds since the first frame.
        image: ``(H, W, 3)`` uint8 RGB.
    """

    index: int
    time: float
    image: ImageArray

    def __post_init__(self) -> None:
        if self.image.ndim != 3 or self.image.shape[2] != 3 or self.image.dtype != np.uint8:
            raise ValueError(
                f"expected an image of shape (H, W, 3) and dtype uint8, got {self.image.shape} {self.image.dtype}"
            )


@dataclass(frozen=True, eq=False)
class Detections(ComparedByValue):
    """What a detector found in one frame.

    Attributes:
        boxes: ``(N, 4)`` pixels, x1 < x2 and y1 < y2.
        scores: ``(N,)``, any finite number; a network's scores lie in [0, 1]. NaN where no detector gave one.
        features: ``(N, D)`` unit-length appearance features, or None when nothing described them.
        actions: ``(N, A)`` probabilities of what each person does, or None when nothing recognised it.
        angles: ``(N,)`` radians by which each box is turned clockwise about its centre; None where all stand upright.
    """

    boxes: FloatArray
    scores: FloatArray
    features: FloatArray | None = None
    actions: FloatArray | None = None
    angles: FloatArray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "boxes", check_boxes(self.boxes))
        object.__setattr__(self, "scores", np.asarray(self.scores, dtype=np.float64))
        if self.scores.shape != (len(self.boxes),) or np.isinf(self.scores).any():
            raise ValueError(f"expected {len(self.boxes)} finite scores, got shape {self.scores.shape}")
        for name in ("features", "actions"):
            self._check_rows(name)
        if self.angles is not None:
            object.__setattr__(self, "angles", np.asarray(self.angles, dtype=np.float64))
            if self.angles.shape != (len(self.boxes),) or not np.isfinite(self.angles).all():
                raise ValueError(f"expected {len(self.boxes)} finite angles, got shape {self.angles.shape}")

    def _check_rows(self, name: str) -> None:
        given = getattr(self, name)
        if given is None:
            return
        rows = np.asarray(given, dtype=np.float64)
        if rows.ndim != 2 or len(rows) != len(self.boxes):
            raise ValueError(f"expected {name} of shape ({len(self.boxes)}, D), got {rows.shape}")
        object.__setattr__(self, name, rows)

    def __len__(self) -> int:
        return len(self.boxes)

    @classmethod
    def empty(cls) -> Detections:
        """No detection at all."""
        return cls(np.empty((0, 4)), np.empty(0))

    def select(self, which: BoolArray | IntArray) -> Detections:
        """The detections at a mask or at indices."""
        features = None if self.features is None else self.features[which]
        actions = None if self.actions is None else self.actions[which]
        angles = None if self.angles is None else self.angles[which]
        return Detections(self.boxes[which], self.scores[which], features, actions, angles)

    def with_features(self, features: FloatArray) -> Detections:
        """The same detections, described by ``features`` ``(N, D)``."""
        return replace(self, features=features)


@dataclass(frozen=True, eq=False)
class Target(ComparedByValue):
    """One target in one frame, as a tracker of many answers it.

    Attributes:
        id: positive; stays while the target is followed.
        box: ``(4,)`` pixels.
        score: how sure the tracker is of the box; 0 where nothing in the frame supports it.
        status: ``tracking``, ``searching`` or ``lost``.
    """

    id: int
    box: FloatArray
    score: float
    status: Status


@dataclass(frozen=True, eq=False)
class Targets(ComparedByValue):
    """The targets of one frame; going through them gives one `Target` after the other.

    Attributes:
        frame: 0-based number.
        ids: ``(N,)`` positive, each once.
        boxes: ``(N, 4)`` pixels.
        scores: ``(N,)`` how sure the tracker is of each box; 0 where nothing in the frame supports it.
        status: ``(N,)`` of ``tracking``, ``searching`` and ``lost``.
    """

    frame: int
    ids: IntArray
    boxes: FloatArray
    scores: FloatArray
    status: StatusArray

    def __post_init__(self) -> None:
        lengths = (len(self.ids), len(self.boxes), len(self.scores), len(self.status))
        if lengths.count(lengths[0]) != 4:
            raise ValueError(f"expected ids, boxes, scores and status of one length, got {lengths}")

    def __len__(self) -> int:
        return len(self.ids)

    def __iter__(self) -> Iterator[Target]:
        for row in zip(self.ids.tolist(), self.boxes, self.scores.tolist(), self.status.tolist(), strict=True):
            yield Target(*row)

    @classmethod
    def empty(cls, frame: int) -> Targets:
        """Nobody in ``frame``."""
        return cls(frame, np.empty(0, np.int64), np.empty((0, 4)), np.empty(0), np.empty(0, dtype="U9"))

    def select(self, which: BoolArray | IntArray) -> Targets:
        """The targets at a mask or at indices."""
        return Targets(self.frame, self.ids[which], self.boxes[which], self.scores[which], self.status[which])


@dataclass(frozen=True, eq=False)
class Track(ComparedByValue):
    """One person or object through time.

    Attributes:
        id: positive and unique within a result.
        frames: ``(T,)`` strictly increasing 0-based frame numbers; gaps are allowed.
        boxes: ``(T, 4)`` pixels.
        scores: ``(T,)`` how sure the tracker is of each box.
        observed: ``(T,)`` False where the box was filled in and no detection supports it.
    """

    id: int
    frames: IntArray
    boxes: FloatArray
    scores: FloatArray
    observed: BoolArray = field(default_factory=lambda: np.empty(0, dtype=np.bool_))

    def __post_init__(self) -> None:
        object.__setattr__(self, "frames", np.asarray(self.frames, dtype=np.int64))
        object.__setattr__(self, "boxes", check_boxes(self.boxes))
        object.__setattr__(self, "scores", np.asarray(self.scores, dtype=np.float64))
        if self.observed.size == 0:
            object.__setattr__(self, "observed", np.ones(len(self.frames), dtype=np.bool_))
        if self.id < 1:
            raise ValueError(f"expected a positive track id, got {self.id}")
        if np.any(np.diff(self.frames) <= 0):
            raise ValueError(f"expected strictly increasing frames in track {self.id}")
        lengths = {len(self.frames), len(self.boxes), len(self.scores), len(self.observed)}
        if len(lengths) != 1:
            raise ValueError(f"expected arrays of one length in track {self.id}, got {sorted(lengths)}")

    def __len__(self) -> int:
        return len(self.frames)


@dataclass(frozen=True, eq=False)
class Estimate(ComparedByValue):
    """Where one target is in one frame, and whether to believe it.

    Attributes:
        frame: 0-based frame number.
        box: ``(4,)`` pixels.
        score: how sure the tracker is; higher is surer.
        status: ``tracking``, ``searching`` or ``lost``.
    """

    frame: int
    box: FloatArray
    score: float
    status: Status

    def __post_init__(self) -> None:
        object.__setattr__(self, "box", check_boxes(np.asarray(self.box)[None])[0])
        if self.status not in STATUSES:
            raise ValueError(f"expected a status of {STATUSES}, got {self.status!r}")


def check_boxes(boxes: FloatArray) -> FloatArray:
    """``boxes`` as a ``(N, 4)`` float64 array.

    Raises:
        ValueError: the shape is another, a value is not finite, or a box has no area.
    """
    boxes = np.asarray(boxes, dtype=np.float64)
    if boxes.ndim != 2 or boxes.shape[1] != 4:
        raise ValueError(f"expected boxes of shape (N, 4), got {boxes.shape}")
    bad = ~np.isfinite(boxes).all(axis=1) | (boxes[:, 2] <= boxes[:, 0]) | (boxes[:, 3] <= boxes[:, 1])
    if bad.any():
        raise ValueError(f"expected finite boxes with x1 < x2 and y1 < y2, got {boxes[bad][0].tolist()}")
    return boxes


@dataclass(frozen=True)
class Position:
    """Where one target is in space at one time, and whether to believe it.

    Attributes:
        time: seconds.
        point: ``(3,)`` metres.
        covariance: ``(3, 3)`` square metres.
        score: how sure the tracker is, [0, 1].
        status: ``tracking``, ``searching`` or ``lost``.
        velocity: ``(3,)`` m/s.
        open: ``(C,)`` probability that each camera sees the target.
    """

    time: float
    point: FloatArray
    covariance: FloatArray
    score: float
    status: Status
    velocity: FloatArray = field(default_factory=lambda: np.zeros(3))
    open: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        for name, shape in (("point", (3,)), ("covariance", (3, 3)), ("velocity", (3,))):
            value = np.asarray(getattr(self, name), dtype=np.float64)
            if value.shape != shape or not np.isfinite(value).all():
                raise ValueError(f"expected a finite {name} of shape {shape}, got {value.tolist()}")
            object.__setattr__(self, name, value)
        if self.status not in STATUSES:
            raise ValueError(f"expected a status of {STATUSES}, got {self.status!r}")
