"""The nouns of the toolkit: small frozen dataclasses, validated where they are made.

Boxes are ``(N, 4)`` float64 arrays ``x1, y1, x2, y2`` in pixels, 0-based and continuous: a box that covers
exactly the first pixel of an image is ``0, 0, 1, 1``. Frame numbers are 0-based. Files convert at the border.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tsuiseki.tracking.errors import RequestError

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
ImageArray: TypeAlias = NDArray[np.uint8]

Status = Literal["tracking", "searching", "lost"]
StatusArray: TypeAlias = NDArray[np.str_]
STATUSES: tuple[Status, ...] = ("tracking", "searching", "lost")


class ShortRepr:
    """A dataclass whose ``repr`` is a line: arrays by their shape, short ones by their numbers."""

    def __repr__(self) -> str:
        parts = [f"{name}={_short(value)}" for name, value in vars(self).items()]
        return f"{type(self).__name__}({', '.join(parts)})"


def _short(value: object) -> str:
    if isinstance(value, np.ndarray):
        numbers = value.dtype.kind == "f" and value.ndim == 1 and value.size <= 4
        return f"[{', '.join(f'{v:g}' for v in value)}]" if numbers else f"<{'x'.join(map(str, value.shape))}>"
    return f"<{len(value)}>" if isinstance(value, Sequence | Mapping) and len(repr(value)) > 40 else repr(value)


class ComparedByValue(ShortRepr):
    """Two of a class are equal where all their fields are, arrays among them; NaN equals NaN."""

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        mine, others = vars(self), vars(other)
        return mine.keys() == others.keys() and all(_same(mine[name], others[name]) for name in mine)

    __hash__ = None  # type: ignore[assignment]


def _same(value: object, counterpart: object) -> bool:
    if isinstance(value, np.ndarray) or isinstance(counterpart, np.ndarray):
        first, second = np.asarray(value), np.asarray(counterpart)
        return np.array_equal(first, second, equal_nan=first.dtype.kind == second.dtype.kind == "f")
    return bool(value == counterpart)


class Columns:
    """A frozen dataclass whose arrays have a row an entry, as tables among its fields do; None stands for not known."""

    def __len__(self) -> int:
        return next(len(value) for value in vars(self).values() if isinstance(value, np.ndarray))

    def _rows(self, which: BoolArray | IntArray | slice) -> dict[str, Any]:
        """The columns by name at a mask, at indices or in a range."""
        columns = {column.name: getattr(self, column.name) for column in fields(self)}  # type: ignore[arg-type]
        rows = {name: value[which] for name, value in columns.items() if isinstance(value, np.ndarray)}
        return rows | {name: value.select(which) for name, value in columns.items() if isinstance(value, Columns)}

    def select(self, which: BoolArray | IntArray | slice) -> Self:
        """The rows at a mask, at indices or in a range."""
        return replace(self, **self._rows(which))  # type: ignore[type-var]

    def and_then(self, *following: Self) -> Self:
        """These rows, and after them those of other tables; NaN where only some of them know a column."""
        joined: dict[str, Any] = {}
        tables = (self, *following)
        for name in [column.name for column in fields(self)]:  # type: ignore[arg-type]
            parts = [getattr(table, name) for table in tables]
            values = next((part for part in parts if part is not None), None)
            if isinstance(values, Columns):
                joined[name] = parts[0].and_then(*parts[1:])
            elif isinstance(values, np.ndarray):
                known = (
                    np.full((len(table), *values.shape[1:]), np.nan) if part is None else part
                    for table, part in zip(tables, parts, strict=True)
                )
                joined[name] = np.concatenate([*known])
        return replace(self, **joined)  # type: ignore[type-var]


class FromDetections:
    """What tells where its boxes come from, in ``(N, 2)`` `detection` and `classes`."""

    origin: IntArray

    @property
    def detection(self) -> IntArray:
        """``(N,)`` row of the detection of each, in what was given for the frame; -1 where none supports the box."""
        return self.origin[:, 0]

    @property
    def classes(self) -> IntArray:
        """``(N,)`` class of that detection, of targets that of most of theirs so far; -1 where none is known."""
        return self.origin[:, 1]


@dataclass(frozen=True, eq=False, repr=False)
class Frame(ComparedByValue):
    """One image of a video.

    Attributes:
        index: 0-based position in the video.
        time: seconds since the first frame.
        image: ``(H, W, 3)`` uint8 RGB.
        camera: number of the source, from 0, where several are followed.
    """

    index: int
    time: float
    image: ImageArray
    camera: int = 0

    def __post_init__(self) -> None:
        if self.image.ndim != 3 or self.image.shape[2] != 3 or self.image.dtype != np.uint8:
            raise ValueError(
                f"expected an image of shape (H, W, 3) and dtype uint8, got {self.image.shape} {self.image.dtype}"
            )


@dataclass(frozen=True, eq=False, repr=False)
class Detections(Columns, ComparedByValue):
    """What a detector reports in one frame.

    Attributes:
        boxes: ``(N, 4)`` pixels, x1 < x2 and y1 < y2.
        scores: ``(N,)``, any finite number; a network's scores lie in [0, 1]. NaN where no detector gave one.
        features: ``(N, D)`` unit-length appearance features, or None when nothing described them.
        actions: ``(N, A)`` probabilities of what each person does, or None when nothing recognised it.
        angles: ``(N,)`` radians by which each box is turned clockwise about its centre; None where all stand upright.
        classes: ``(N,)`` numbers of their classes, -1 where it has none; None where nothing tells classes apart.
        sources: ``(N,)`` rows in what the detector or the user gave for the frame; None where nothing was left out.
        names: of the classes, by number, where they are known.
    """

    boxes: FloatArray
    scores: FloatArray
    features: FloatArray | None = None
    actions: FloatArray | None = None
    angles: FloatArray | None = None
    classes: IntArray | None = None
    sources: IntArray | None = None
    names: Mapping[int, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "boxes", check_boxes(self.boxes))
        object.__setattr__(self, "scores", np.asarray(self.scores, dtype=np.float64))
        if self.scores.shape != (len(self.boxes),) or np.isinf(self.scores).any():
            raise ValueError(f"expected {len(self.boxes)} finite scores, got shape {self.scores.shape}")
        if not isinstance(self.names, Mapping):
            raise RequestError(f"expected names of classes by number, got {type(self.names).__name__}")
        for name in ("features", "actions"):
            if (column := getattr(self, name)) is not None:
                rows = np.asarray(column, dtype=np.float64)
                if rows.ndim != 2 or len(rows) != len(self.boxes):
                    raise ValueError(f"expected {name} of shape ({len(self.boxes)}, D), got {rows.shape}")
                object.__setattr__(self, name, rows)
        if self.angles is not None:
            object.__setattr__(self, "angles", np.asarray(self.angles, dtype=np.float64))
            if self.angles.shape != (len(self.boxes),) or not np.isfinite(self.angles).all():
                raise ValueError(f"expected {len(self.boxes)} finite angles, got shape {self.angles.shape}")
        for name in ("classes", "sources"):
            if (column := getattr(self, name)) is not None:
                object.__setattr__(self, name, np.asarray(column, dtype=np.int64))
                if np.shape(column) != (len(self.boxes),):
                    raise ValueError(f"expected {len(self.boxes)} {name}, got shape {np.shape(column)}")

    def __repr__(self) -> str:
        columns = [name for name in ("features", "actions", "angles", "classes") if getattr(self, name) is not None]
        return f"<Detections: {len(self)}{' with ' * bool(columns)}{', '.join(columns)}>"

    @classmethod
    def empty(cls) -> Detections:
        return cls(np.empty((0, 4)), np.empty(0))

    def select(self, which: BoolArray | IntArray | slice) -> Self:
        """The detections at a mask, at indices or in a range."""
        return replace(self, **self._rows(which) | {"sources": self.origin[which, 0]})

    def scoring(self, least: float | None) -> Self:
        """The detections of at least a score, and those without one; None keeps all."""
        return self if least is None else self.select(~(self.scores < least))

    @property
    def origin(self) -> IntArray:
        """``(N, 2)`` the row of each in what was given for the frame, and its class, -1 where none is known."""
        count = len(self.boxes)
        rows = np.arange(count) if self.sources is None else self.sources
        return np.column_stack([rows, np.full(count, -1) if self.classes is None else self.classes])

    def with_features(self, features: FloatArray) -> Detections:
        """The same detections, described by ``features`` ``(N, D)``."""
        return replace(self, features=features)


@dataclass(frozen=True)
class Recognition:
    """Who somebody most probably is, of the people in a gallery.

    Attributes:
        name: of the person; empty where nobody of the gallery is more probable.
        probability: that this is right, in [0, 1].
    """

    name: str
    probability: float


@dataclass(frozen=True, eq=False, repr=False)
class Target(ComparedByValue):
    """One target in one frame, as a tracker of many answers it.

    Attributes:
        id: positive; stays while the target is followed.
        box: ``(4,)`` pixels.
        score: how sure the tracker is of the box; 0 where nothing in the frame supports it.
        status: ``tracking``, ``searching`` or ``lost``.
        detection: row of the detection, in what was given for the frame, that supports it; -1 where none does.
        class_id: number of the class that most of its detections so far have; -1 where none is known.
        class_name: of that class; empty where none is known.
        identity: who it is of a gallery; None where none is asked.
    """

    id: int
    box: FloatArray
    score: float
    status: Status
    detection: int = -1
    class_id: int = -1
    class_name: str = ""
    identity: Recognition | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Targets(FromDetections, Columns, ComparedByValue):
    """The targets of one frame; going through them gives one `Target` after the other.

    Attributes:
        frame: 0-based number.
        ids: ``(N,)`` positive, each once.
        boxes: ``(N, 4)`` pixels.
        scores: ``(N,)`` how sure the tracker is of each box; 0 where nothing in the frame supports it.
        status: ``(N,)`` of ``tracking``, ``searching`` and ``lost``.
        origin: ``(N, 2)`` `detection` and `classes`; by default -1.
        names: of the classes, by number, where they are known.
        identities: who they are of a gallery, by id, where one is asked.
    """

    frame: int
    ids: IntArray
    boxes: FloatArray
    scores: FloatArray
    status: StatusArray
    origin: IntArray = field(default_factory=lambda: np.empty((0, 2), dtype=np.int64))
    names: Mapping[int, str] = field(default_factory=dict)
    identities: Mapping[int, Recognition] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "origin", _origin(self.origin, len(self.ids)))
        lengths = (len(self.ids), len(self.boxes), len(self.scores), len(self.status), len(self.origin))
        if lengths.count(lengths[0]) != 5:
            raise ValueError(f"expected ids, boxes, scores, status and origin of one length, got {lengths}")

    def __iter__(self) -> Iterator[Target]:
        columns = self.ids.tolist(), self.boxes, self.scores.tolist(), self.status.tolist(), self.origin.tolist()
        for number, box, score, status, (row, kind) in zip(*columns, strict=True):
            identity = self.identities.get(number)
            yield Target(number, box, score, status, row, kind, self.names.get(kind, ""), identity)

    def __repr__(self) -> str:
        return f"<Targets: {len(self)} in frame {self.frame}>"

    @classmethod
    def empty(cls, frame: int) -> Targets:
        return cls(frame, np.empty(0, np.int64), np.empty((0, 4)), np.empty(0), np.empty(0, dtype="U9"))


@dataclass(frozen=True, eq=False, repr=False)
class Track(FromDetections, ComparedByValue):
    """One person or object through time.

    Attributes:
        id: positive and unique within a result.
        frames: ``(T,)`` strictly increasing 0-based frame numbers; gaps are allowed.
        boxes: ``(T, 4)`` pixels.
        scores: ``(T,)`` how sure the tracker is of each box.
        observed: ``(T,)`` False where the box was filled in and no detection supports it.
        origin: ``(T, 2)`` `detection` and `classes`; by default -1.
        names: of the classes, by number, where they are known.
    """

    id: int
    frames: IntArray
    boxes: FloatArray
    scores: FloatArray
    observed: BoolArray = field(default_factory=lambda: np.empty(0, dtype=np.bool_))
    origin: IntArray = field(default_factory=lambda: np.empty((0, 2), dtype=np.int64))
    names: Mapping[int, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "frames", np.asarray(self.frames, dtype=np.int64))
        object.__setattr__(self, "origin", _origin(self.origin, len(self.frames)))
        object.__setattr__(self, "boxes", check_boxes(self.boxes))
        object.__setattr__(self, "scores", np.asarray(self.scores, dtype=np.float64))
        if self.observed.size == 0:
            object.__setattr__(self, "observed", np.ones(len(self.frames), dtype=np.bool_))
        if self.id < 1:
            raise ValueError(f"expected a positive track id, got {self.id}")
        if np.any(np.diff(self.frames) <= 0):
            raise ValueError(f"expected strictly increasing frames in track {self.id}")
        lengths = {len(self.frames), len(self.boxes), len(self.scores), len(self.observed), len(self.origin)}
        if len(lengths) != 1:
            raise ValueError(f"expected arrays of one length in track {self.id}, got {sorted(lengths)}")

    def __len__(self) -> int:
        return len(self.frames)

    def __repr__(self) -> str:
        where = f", frames {self.frames[0]} to {self.frames[-1]}" if len(self) else ""
        return f"<Track {self.id}: {len(self)} boxes{where}{', ' * bool(self.class_name)}{self.class_name[:40]}>"

    @property
    def class_id(self) -> int:
        """Number of the class that most of its detections have, the smaller one of two; -1 where none is known."""
        numbers, counts = np.unique(self.classes[self.classes >= 0], return_counts=True)
        return int(numbers[counts.argmax()]) if len(numbers) else -1

    @property
    def class_name(self) -> str:
        """Name of `class_id`; empty where none is known."""
        return self.names.get(self.class_id, "")


def _origin(origin: IntArray, count: int) -> IntArray:
    return origin if len(origin) or not count else np.full((count, 2), -1)


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(ComparedByValue):
    """Where one target is in one frame, and its status.

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


def as_numbers(value: ArrayLike, name: str) -> FloatArray:
    """``value`` as an array; raises RequestError where the argument ``name`` is none of numbers."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise RequestError(f"`{name}`: expected numbers, got {type(value).__name__}") from error


def check_boxes(boxes: FloatArray) -> FloatArray:
    """``boxes`` as a ``(N, 4)`` float64 array.

    Raises:
        RequestError: the shape is another, a value is not finite, or a box has no area.
    """
    boxes = np.asarray(boxes, dtype=np.float64)
    if boxes.ndim != 2 or boxes.shape[1] != 4:
        raise RequestError(f"expected boxes of shape (N, 4), got {boxes.shape}")
    bad = ~np.isfinite(boxes).all(axis=1) | (boxes[:, 2] <= boxes[:, 0]) | (boxes[:, 3] <= boxes[:, 1])
    if bad.any():
        raise RequestError(f"expected finite boxes with x1 < x2 and y1 < y2, got {boxes[bad][0].tolist()}")
    return boxes


@dataclass(frozen=True, repr=False)
class Position(ShortRepr):
    """Where one target is in space at one time, and its status.

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
