"""Labelled boxes of any file as tracks: of one id each; of none, as in pictures labelled one by one; and of crowds."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.label_checks import Sieve, UnusableError
from tsuiseki.tracking.formats.rows import repeated, whole
from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.geometry import about_rotated
from tsuiseki.tracking.openers.text import refusing
from tsuiseki.tracking.types import FloatArray, Track
from tsuiseki.tracking.types.frame_range import LAST_FRAME
from tsuiseki.tracking.types.tracks import rows_of_each


class LabelledBox(NamedTuple):
    """A box as a file has it.

    Attributes:
        frame: 0-based.
        number: id of the track; None where the file says none.
        kind: number and name of the class; a negative number stands for the place among the names.
        corners: x1, y1, x2, y2.
        crowd: a detection on it is neither right nor wrong.
        score: in [0, 1]; 1 where the file does not say.
        observed: it was not filled in.
        detection: row of the box in what a detector gave for the frame; -1 where that is not known.
    """

    frame: int
    number: int | None
    kind: tuple[int, str]
    corners: Sequence[float]
    crowd: bool = False
    score: float = 1.0
    observed: bool = True
    detection: int = -1


def finite(value: object, what: str, usual: float | None = None) -> float:
    """A number of a label, or what is usual where there is none; raises UnusableError where it is none or infinite."""
    try:
        number = float(value if value is not None or usual is None else usual)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        number = np.nan
    if not np.isfinite(number):
        raise UnusableError(f"without a finite number as {what}")
    return number


def id_of(value: object, what: str) -> int | None:
    """A label's id; None where there is none, or a negative one; raises UnusableError where it is no whole number."""
    if value is None:
        return None
    number = whole(str(value))
    if number is None:
        raise UnusableError(f"with {str(value)[:24]!r} as {what}, which is no whole number")
    return number if number >= 0 else None


def with_area(corners: Sequence[float]) -> Sequence[float]:
    """Corners that span something; raises UnusableError where they do not."""
    if not (corners[2] > corners[0] and corners[3] > corners[1]):
        raise UnusableError("without an area")
    return corners


# What is said of a turned box.
TURNED = "turned, for which the upright boxes about them are taken"


def about_turned(boxes: FloatArray, degrees: FloatArray) -> FloatArray:
    """``(N, 4)`` upright boxes about ``(N, 4)`` corners that are turned about their middles, ``(N,)`` clockwise.

    >>> about_turned(np.array([[0.0, 0, 2, 4], [0, 0, 2, 4]]), np.array([0.0, 90])).round(6).tolist()
    [[0.0, 0.0, 2.0, 4.0], [-1.0, 1.0, 3.0, 3.0]]
    """
    middles, sizes = (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]
    about = about_rotated(np.column_stack([middles, sizes, np.radians(degrees)]))
    return np.where((degrees % 360 == 0)[:, None], boxes, about)


def video_of_boxes(path: Path, boxes: Iterable[LabelledBox]) -> TrackedVideo:
    """The tracks of boxes; an id 0 becomes the smallest that is free.

    A box without an id, or of a crowd, gets as id its place among those of its class in the frame, beyond other ids.

    Raises:
        RequestError: an id stands twice in a frame, or a number is impossible.
    """
    listed = list(boxes)
    if not listed:
        return TrackedVideo([])
    with refusing(f"{path}: expected numbers of frames, ids and boxes: ", str):
        numbers, places = _ids(listed)
        ids = np.array(numbers, dtype=np.int64)
        frames = np.array([box.frame for box in listed], dtype=np.int64)
        corners = np.array([box.corners for box in listed], dtype=np.float64).reshape(-1, 4)
        scores = np.array([box.score for box in listed], dtype=np.float64)
        detection = np.array([box.detection for box in listed], dtype=np.int64)
    observed = np.array([box.observed for box in listed], dtype=np.bool_)
    if frames.min() < 0 or frames.max() >= LAST_FRAME or ids.min() < 0:
        raise RequestError(
            f"{path}: expected frames up to {LAST_FRAME} and ids from 0, got frame {frames[frames.argmax()]} and id "
            f"{ids.min()}"
        )
    if (twice := repeated(frames, ids)) is not None:
        raise RequestError(f"{path}: id {ids[twice]} stands twice in frame {frames[twice]}, counted from 0")
    order = np.argsort(frames, kind="stable")
    names = sorted({box.kind[1] for box in listed})
    tracks = []
    for rows in (order[part] for part in rows_of_each(ids[order])):
        number, name = _class_of(path, [listed[row] for row in rows.tolist()])
        number = names.index(name) if number < 0 and name else number
        origin = np.column_stack([detection[rows], np.full(len(rows), number)])
        columns = frames[rows], corners[rows], scores[rows], observed[rows], origin
        tracks.append(Track(int(ids[rows[0]]), *columns, {number: name} if name else {}))
    crowds = [number for (_, crowd, _), number in places.items() if crowd]
    return TrackedVideo(tracks, anonymous=[*places.values()], crowds=crowds)


# Class, whether it is a crowd, and which of these it is in the frame.
_Place = tuple[tuple[int, str], bool, int]


def _ids(boxes: Sequence[LabelledBox]) -> tuple[list[int], Mapping[_Place, int]]:
    """The id of each box; and by place those that stand for no track."""
    tracked = [box.number for box in boxes if box.number is not None and not box.crowd]
    used = {*tracked}
    free = next(number for number in count(1) if number not in used) if 0 in used else 0
    largest = max([*tracked, free], default=0)
    counts, places, ids = Counter[Any](), dict[_Place, int](), list[int]()
    for box in boxes:
        if box.number is not None and not box.crowd:
            ids.append(box.number or free)
            continue
        counts[box.frame, box.kind, box.crowd] += 1
        place = box.kind, box.crowd, counts[box.frame, box.kind, box.crowd]
        ids.append(places.setdefault(place, largest + len(places) + 1))
    return ids, places


def _class_of(path: Path, boxes: Sequence[LabelledBox]) -> tuple[int, str]:
    """The class of most of the boxes of a track; says where they are of several."""
    counts = Counter(box.kind for box in boxes)
    kind = counts.most_common(1)[0][0]
    if len(counts) > 1:
        listed = ", ".join(f"{count} {name or number}" for (number, name), count in counts.most_common())
        line = f"boxes of id {boxes[0].number} are of several classes ({listed}); all are taken as {kind[1] or kind[0]}"
        warnings.warn(f"{path}: {line}", InputWarning, stacklevel=3)
    return kind


def labelled_video(path: Path, boxes: Iterable[LabelledBox], sieve: Sieve) -> TrackedVideo:
    """The tracks of boxes that go through a sieve, which is told; raises RequestError, see `video_of_boxes`."""
    listed = list(boxes)
    sieve.tell()
    return video_of_boxes(path, listed)
