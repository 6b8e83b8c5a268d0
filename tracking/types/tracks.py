"""Tracks that say more than boxes: what a person does, how a body bends, where something is in space."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray, ShortRepr, Status, Targets, Track


@dataclass(frozen=True, repr=False)
class ActingTrack(ShortRepr):
    """A person and what they do.

    Attributes:
        track: who is where.
        single: ``(T, A)`` probabilities of single frames, of filled frames in proportion to the detections on both
            sides. None without action features.
        multi: ``(T, A)`` means over the window around each frame.
    """

    track: Track
    single: FloatArray | None = None
    multi: FloatArray | None = None

    @property
    def id(self) -> int:
        return self.track.id


@dataclass(frozen=True, repr=False)
class BodyTrack(ShortRepr):
    """The states of one body through a video.

    Attributes:
        id: positive and unique within a file.
        frames: ``(T,)`` strictly increasing 0-based frame numbers.
        states: ``(T, D)``.
        scores: ``(T,)`` how sure the tracker is; 1 where states are exact.
        statuses: ``T`` of them.
    """

    id: int
    frames: IntArray
    states: FloatArray
    scores: FloatArray
    statuses: tuple[Status, ...]

    def __post_init__(self) -> None:
        lengths = {len(self.frames), len(self.states), len(self.scores), len(self.statuses)}
        if self.id < 1 or len(lengths) != 1 or np.any(np.diff(self.frames) <= 0):
            raise ValueError("expected a positive id, increasing frames and arrays of one length")

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def tracking(self) -> BoolArray:
        """``(T,)`` frames whose status is ``tracking``."""
        return np.array([status == "tracking" for status in self.statuses], dtype=np.bool_)

    def segments(self) -> list[FloatArray]:
        """States ``(T_i, D)`` of the segments of consecutive frames whose status is ``tracking``."""
        good = np.flatnonzero(self.tracking)
        breaks = np.flatnonzero(np.diff(self.frames[good]) != 1) + 1
        return [self.states[part] for part in np.split(good, breaks.tolist()) if len(part)]


def exact_track(identity: int, frames: IntArray, states: FloatArray) -> BodyTrack:
    """A track of known states ``(T, D)``."""
    tracking: Status = "tracking"
    return BodyTrack(identity, frames, states, np.ones(len(frames)), (tracking,) * len(frames))


def boxes_about(tracks: Iterable[Any], names: Sequence[str] = ()) -> list[Track]:
    """The boxes of tracks; about animals squares as wide as they are long, whose ``detection`` is the row of the state.

    Tracks without a frame are left out; ``names`` are of the numbers of a state.

    Raises:
        RequestError: they are of something else.
    """
    boxed, rows = list[Track](), 0
    for entry in tracks:
        track = getattr(entry, "track", entry)
        if isinstance(track, BodyTrack) and {"a", "b", "length"} <= set(names):
            a, b, length = (track.states[:, names.index(name)] for name in ("a", "b", "length"))
            half = np.maximum(length, 1.0) / 2
            boxes = np.column_stack([a - half, b - half, a + half, b + half])
            origin = np.column_stack([rows + np.arange(len(track)), np.full(len(track), -1)])
            rows += len(track)
            track = Track(track.id, track.frames, boxes, track.scores, track.tracking, origin)
        if not isinstance(track, Track):
            raise RequestError(f"expected tracks of boxes, got {type(track).__name__}; track people, animals or blobs")
        boxed.append(track)
    return [track for track in boxed if len(track)]


@dataclass(frozen=True, repr=False)
class Path3D(ShortRepr):
    """A path in space: ``(T,)`` seconds and ``(T, 3)`` metres."""

    times: FloatArray
    points: FloatArray


@dataclass(frozen=True, repr=False)
class FloorTrack(ShortRepr):
    """One person through time, in the image and on the floor.

    Attributes:
        track: id, frames, boxes in the image and scores.
        rotated: ``(T, 5)`` rotated boxes, see `tsuiseki.tracking.cameras.person_model`.
        places: ``(T, 2)`` metres.
    """

    track: Track
    rotated: FloatArray
    places: FloatArray

    @property
    def id(self) -> int:
        return self.track.id


@dataclass(frozen=True, repr=False)
class PointTable(ShortRepr):
    """Points of N animals in frames.

    Attributes:
        nodes: K names.
        frames: ``(N,)`` 0-based.
        tracks: N names of who it is; empty where that is not known.
        points: ``(N, K, 2)`` pixels; NaN where a point is missing.
        scores: ``(N, K)``; NaN where a point has none.
    """

    nodes: tuple[str, ...]
    frames: IntArray
    tracks: tuple[str, ...]
    points: FloatArray
    scores: FloatArray

    def __len__(self) -> int:
        return len(self.frames)

    def node(self, name: str) -> int:
        """Number of a node.

        Raises:
            RequestError: there is none of that name.
        """
        if name not in self.nodes:
            raise RequestError(f"expected a point of {', '.join(self.nodes)}, got {name!r}")
        return self.nodes.index(name)


@dataclass(frozen=True, repr=False)
class FloorDetections(ShortRepr):
    """People detected in one frame, and where they stand.

    Attributes:
        detections: boxes in the image, with features where something described them.
        rotated: ``(N, 5)`` rotated boxes, see `tsuiseki.tracking.cameras.person_model`.
        places: ``(N, 2)`` metres.
    """

    detections: Detections
    rotated: FloatArray
    places: FloatArray

    def __post_init__(self) -> None:
        if self.rotated.shape != (len(self.detections), 5) or self.places.shape != (len(self.detections), 2):
            raise ValueError(
                f"expected {len(self.detections)} rotated boxes and places, got shapes {self.rotated.shape} and "
                f"{self.places.shape}"
            )

    def __len__(self) -> int:
        return len(self.detections)


def frames_up_to(numbers: Iterable[int], tracks: Iterable[Track | BodyTrack]) -> int:
    """How many frames there are up to the last of the ``numbers`` and of the tracks, which count from 0."""
    return max([-1, *numbers, *(int(track.frames[-1]) for track in tracks if len(track.frames))]) + 1


def positive_ids(ids: IntArray) -> IntArray:
    """``(N,)`` the ids of a file, where 0, which no track here has, becomes the smallest that is free.

    >>> positive_ids(np.array([0, 1, 7])).tolist()
    [2, 1, 7]
    """
    free = np.setdiff1d(np.arange(1, len(ids) + 2), ids)[0]
    return np.where(ids == 0, free, ids)


def rows_of_each(labels: IntArray) -> list[IntArray]:
    """Indices of the rows of each label in ``(N,)``, by label; those of one stay in order."""
    order = np.argsort(labels, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(labels[order])) + 1) if len(order) else []


def targets_at(tracks: Iterable[Track], frame: int, number: int | None = None) -> Targets:
    """The targets of the 0-based ``frame``, out of finished tracks; ``number`` is another name of that frame."""
    rows = [(track, int(row)) for track in tracks for row in np.flatnonzero(track.frames == frame)]
    return Targets(
        frame if number is None else number,
        np.array([track.id for track, _ in rows], dtype=np.int64),
        np.array([track.boxes[row] for track, row in rows]).reshape(-1, 4),
        np.array([track.scores[row] if track.observed[row] else 0.0 for track, row in rows], dtype=np.float64),
        np.array(["tracking" if track.observed[row] else "searching" for track, row in rows], dtype="U9"),
        np.array([(track.detection[row], track.class_id) for track, row in rows], dtype=np.int64).reshape(-1, 2),
        {number: name for track, _ in rows for number, name in track.names.items()},
    )


def targets_of_frames(tracks: Sequence[Track], frames: Iterable[int]) -> Iterator[Targets]:
    """The targets of each of the 0-based ``frames``, out of finished tracks."""
    numbers = np.concatenate([np.empty(0, np.int64), *(track.frames for track in tracks)])
    order = np.argsort(numbers, kind="stable")
    whose = np.repeat(np.arange(len(tracks)), [len(track) for track in tracks])[order]
    numbers = numbers[order]
    for frame in frames:
        first, last = np.searchsorted(numbers, [frame, frame + 1])
        yield targets_at([tracks[n] for n in whose[first:last].tolist()], frame)
