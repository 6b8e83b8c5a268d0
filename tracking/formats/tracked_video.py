"""Tracked video, as it goes into the files of other programs and comes out of them."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.label_checks import NothingLabelledError, compare_with_picture, wanted_numbers
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Track
from tsuiseki.tracking.types.class_choice import PERSON_NAMES
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.types.tracks import PointTable

Size: TypeAlias = tuple[int, int] | None
PERSON = "person"


LONGEST = 1_000_000
"""Frames of a track that is filled in between keys: 11 hours."""
# The frames or ids of nothing.
NONE = np.empty(0, np.int64)
# Gives the columns of a table of no tracks their types.
EMPTY_TRACK = Track(1, NONE, np.empty((0, 4)), np.empty(0), np.empty(0, np.bool_))


class TrackedBoxes(NamedTuple):
    """The boxes of all tracks, by frame, then by id: ``(N,)`` each, ``(N, 4)`` the boxes."""

    frames: IntArray
    ids: IntArray
    boxes: FloatArray
    scores: FloatArray
    observed: BoolArray
    detection: IntArray

    def listed(self, **others: Any) -> Iterator[tuple[Any, ...]]:
        """The rows as plain values, with ``others`` in the place of columns."""
        return zip(*(column.tolist() for column in self._replace(**others)), strict=True)


def boxes_of_tracks(tracks: Iterable[Track]) -> TrackedBoxes:
    """All boxes of the tracks in one table, by frame and then by id."""
    listed = [EMPTY_TRACK, *tracks]
    ids = np.repeat([track.id for track in listed], [len(track) for track in listed])
    names = ("frames", "boxes", "scores", "observed", "detection")
    frames, *columns = (np.concatenate([getattr(track, name) for track in listed]) for name in names)
    order = np.lexsort([ids, frames])
    return TrackedBoxes(frames[order], ids[order], *(column[order] for column in columns))


@dataclass(frozen=True)
class TrackedVideo:
    """Tracks of boxes or of points, and what files say of the video.

    Attributes:
        tracks: of boxes; none where there are other tracks.
        name: of the video's file or folder.
        frame_rate: frames a second; 0 where not known.
        size: width and height of a frame, pixels; None where not known.
        length: number of frames; 0 where not known.
        images: names of the images by frame, empty for a frame that the file does not list; none for a video file.
        image_sizes: width and height of the images by name, as far as the file says them.
        listed: ``(N,)`` frames that the file speaks of, in order; None for all.
        points: of animals, where they have any.
        shares: boxes are shares of a picture whose size the file does not say.
        anonymous: ids that say nothing, of boxes that the file has no id of, as in pictures labelled one by one.
        crowds: those among them of regions on which a detection is neither right nor wrong.
        table: all tracks, of whatever kind, see `formats.track_tables`.
        about: what a table keeps beside the tracks.
    """

    tracks: Sequence[Track]
    name: str = "video"
    frame_rate: float = 0.0
    size: Size = None
    length: int = 0
    images: tuple[str, ...] = ()
    image_sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    listed: IntArray | None = None
    points: PointTable | None = None
    shares: bool = False
    anonymous: Collection[int] = ()
    crowds: Collection[int] = ()
    table: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def boxes(self) -> TrackedBoxes:
        return boxes_of_tracks(self.tracks)

    @property
    def identified(self) -> bool:
        """Whether there are tracks, or nothing at all; and not only boxes without ids."""
        return not self.tracks or any(track.id not in self.anonymous for track in self.tracks)

    def tracked(self, where: object) -> TrackedVideo:
        """Its tracks alone, without boxes that have no id, which were read from ``where``; says how many there are."""
        tracks = [track for track in self.tracks if track.id not in self.anonymous]
        boxes, total = (sum(map(len, part)) for part in (tracks, self.tracks))
        if boxes < total:
            line = f"{total - boxes} of {total} boxes have no id of a track, or are crowds, and are left out"
            warnings.warn(f"{where}: {line}", InputWarning, stacklevel=3)
        return replace(self, tracks=tracks, anonymous=(), crowds=())

    @property
    def pixels(self) -> tuple[int, int]:
        """`size`, where a format needs it; raises RequestError where it is not known."""
        if self.size is None:
            raise RequestError("expected the size of the frames, which this result does not tell; give its `video`")
        return self.size

    @property
    def frame_count(self) -> int:
        """`length`, or where that is not known, the frames up to the last that has something."""
        frames = [part.frames for part in (self.boxes, self.points) if part is not None]
        frames.append(np.asarray(self.table.get("frame", NONE)))
        return max(self.length, *(int(numbers.max(initial=-1)) + 1 for numbers in frames))

    @property
    def stem(self) -> str:
        """`name` without what the ending says."""
        return PurePosixPath(self.name).stem or "video"

    @cached_property
    def nodes(self) -> PointTable:
        """`points`; of bodies their ends and middles; or else the centres of boxes.

        The centre of the first pixel is 0, 0.

        Raises:
            RequestError: there is nothing of this.
        """
        if self.points is not None:
            return self.points
        table, ends = self.table, np.zeros(1)
        names: tuple[str, ...] = ("centre",)
        if "x1" in table or not table:
            frames, ids, _, scores, *_ = self.boxes
            middle = along = centres(self.boxes.boxes)
        elif {"a", "b"} <= table.keys():
            frames, ids, scores = (table[name] for name in ("frame", "id", "score"))
            middle = along = np.column_stack([table["a"], table["b"]])
            if {"theta", "length"} <= table.keys():
                names, ends = ("head", "centre", "tail"), np.array([0.5, 0.0, -0.5])
                along = np.column_stack([np.cos(table["theta"]), np.sin(table["theta"])]) * table["length"][:, None]
        else:
            raise RequestError(f"expected animals or boxes, got tracks of {', '.join(list(table)[:8])}")
        individuals = tuple(f"track_{number}" for number in ids.tolist())
        places = middle[:, None] + along[:, None] * ends[:, None] - 0.5
        return PointTable(names, frames, individuals, places, np.repeat(scores[:, None], len(names), axis=1))

    @cached_property
    def kind(self) -> Mapping[int, str]:
        """By id the name of its class; who has none is a person."""
        named = ((track, f"class {track.class_id}" if track.class_id >= 0 else PERSON) for track in self.tracks)
        return {track.id: track.class_name or usual for track, usual in named}

    @cached_property
    def kinds(self) -> Mapping[str, int]:
        """The number of each class by its name, from 0 where not all are known; in their order."""
        numbers = {self.kind[track.id]: track.class_id for track in self.tracks} or {PERSON: 0}
        if min(numbers.values()) < 0 or len({*numbers.values()}) < len(numbers):
            numbers = {kind: number for number, kind in enumerate(sorted(numbers))}
        return dict(sorted(numbers.items(), key=lambda item: item[1]))

    def image(self, frame: int) -> str:
        """The name of a frame's image; those of a video file are counted from 1, as FFmpeg does."""
        return (self.images[frame] if frame < len(self.images) else "") or f"{frame + 1:06d}.jpg"

    def in_pixels(self, where: object, size: Size = None) -> TrackedVideo:
        """The same with boxes in pixels; ``size`` counts where they are `shares`.

        Raises:
            RequestError: they are, and there is none.
        """
        if not self.shares:
            return self
        if size is None:
            raise RequestError(f"{where}: its boxes are shares of the picture; expected the `size` of it, got none")
        tracks = [replace(track, boxes=track.boxes * np.tile(size, 2)) for track in self.tracks]
        return replace(self, tracks=tracks, size=size, shares=False)

    def labels(self, path: Path, kind: int | str | None = None) -> GroundTruth:
        """The boxes as labels, which were read from ``path``.

        The class ``kind`` counts, by number or name; by default people, or all where no class is called so.

        Raises:
            RequestError: there is no box, or no such class, or boxes cannot be pixels of the picture.
        """
        rows, names = self.boxes, {number: name for name, number in self.kinds.items()}
        if not len(rows.frames):
            raise NothingLabelledError(f"{path}: expected labelled boxes, found none")
        compare_with_picture(path, rows.boxes, self.size)
        people = [number for number, name in names.items() if name.lower() in PERSON_NAMES] or list(names)
        counted = {names[number] for number in wanted_numbers(kind, names, people, path)}
        of_class = [track.id for track in self.tracks if self.kind[track.id] in counted]
        ids = np.where(np.isin(rows.ids, [*self.anonymous]), -1, rows.ids)
        truth = GroundTruth.of_boxes(rows.frames, ids, rows.boxes)
        ignored = np.isin(rows.ids, [*self.crowds])
        return replace(truth, evaluated=np.isin(rows.ids, of_class) & ~ignored, ignored=ignored)


def runs_of(frames: IntArray) -> list[IntArray]:
    """The rows of each segment of frames without a gap.

    >>> [run.tolist() for run in runs_of(np.array([4, 5, 9]))]
    [[0, 1], [2]]
    """
    return np.split(np.arange(len(frames)), np.flatnonzero(np.diff(frames) != 1) + 1)


def between_keys(
    path: Path, frames: IntArray, boxes: FloatArray, last: int = 0
) -> tuple[IntArray, FloatArray, IntArray]:
    """Every frame from the first key to the last one, or to ``last``: on straight lines between keys, then still.

    Args:
        path: of the file, for messages.
        frames: ``(K,)`` of the keys, increasing.
        boxes: ``(K, 4)`` there.
        last: 0-based.

    Returns:
        ``(T,)`` the frames, ``(T, 4)`` the boxes, and ``(T,)`` the number of the key at or before each.

    Raises:
        RequestError: there are too many frames.
    """
    end = max(int(frames[-1]), last)
    if end - frames[0] >= LONGEST:
        raise RequestError(f"{path}: expected a track of at most {LONGEST} frames, got one of {end + 1 - frames[0]}")
    track_frames = np.arange(frames[0], end + 1)
    values = np.column_stack([np.interp(track_frames, frames, column) for column in boxes.T])
    return track_frames, values, np.searchsorted(frames, track_frames, side="right") - 1


def inside(name: object) -> str | None:
    """The name of a file below a folder, without an address; None where it would lead out of the folder."""
    path = PurePosixPath(str(name).split("?")[0].replace("\\", "/"))
    return None if path.is_absolute() or ".." in path.parts or not path.name else str(path)
