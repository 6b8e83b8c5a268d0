"""What a person points at on the page, as a correction: people of the shown tracks in frames, and boxes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.review.corrections import Box, Correction, boxes_of
from tsuiseki.tracking.types import Track

PAIRS, ALONE = ("same", "not_same"), ("real", "not_person", "name")


def correction_of(given: Mapping[str, Any], tracks: Mapping[int, Track]) -> Correction:
    """The correction that the page sends.

    Args:
        given: ``kind`` as in `Correction`; ``at``, pairs of a frame and an id; and by kind ``box`` in ``frame`` (corners;
            it is added to the track ``of``, or the box ``at`` is moved there), ``name``, or ``stretch`` (first and last
            frame). The kind ``target`` is a ``point`` in ``frame`` at which the one target ``of`` is.
        tracks: that are shown, by id.

    Raises:
        RequestError: it is something else, or there is no such box.
    """
    try:
        return _correction(str(given["kind"]), given, tracks)
    except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
        if isinstance(error, RequestError):
            raise
        raise RequestError("expected a correction of boxes that are there; load the page again") from error


def _correction(kind: str, given: Mapping[str, Any], tracks: Mapping[int, Track]) -> Correction:
    at = [(int(frame), tracks[int(number)]) for frame, number in given.get("at", [])]
    boxes = [_box(track, frame) for frame, track in at]
    if kind in PAIRS or kind in ALONE:
        return Correction(kind, tuple(boxes), str(given.get("name", "")))
    if kind == "switch":
        (frame, one), (_, two) = at
        sides = [_beside(track, frame) for track in (one, two)]
        return Correction("switch", (sides[0][0], sides[1][0], sides[0][1], sides[1][1]))
    if kind in ("delete", "right"):
        first, last = given.get("stretch", (0, np.inf))
        track = at[0][1]
        within = (track.frames >= first) & (track.frames <= last)
        return Correction(kind, boxes_of(track.frames[within], track.boxes[within]))
    frame = int(given["frame"])
    if kind == "box":
        (new,) = boxes_of([frame], [given["box"]])
        added = Correction("box", (*boxes, new))
        return added if boxes or "of" not in given else _joined(added, new, tracks[int(given["of"])])
    if kind == "target":
        track, (x, y) = tracks[int(given["of"])], map(float, given["point"])
        near = track.boxes[_nearest(track, frame)]
        half = (near[2:] - near[:2]) / 2
        (new,) = boxes_of([frame], [[*((x, y) - half), *((x, y) + half)]])
        return _joined(Correction("box", (new,)), new, track)
    raise RequestError(f"expected a correction of the page, got {kind!r}")


def _joined(added: Correction, new: Box, track: Track) -> Correction:
    """A box is added, and belongs to a track."""
    (near,) = boxes_of(*(values[[_nearest(track, new.frame)]] for values in (track.frames, track.boxes)))
    if near.frame == new.frame:
        raise RequestError(f"person {track.id} has a box in frame {new.frame + 1} already; move that one")
    return Correction("several", parts=(added, Correction("same", (near, new))))


def _nearest(track: Track, frame: int) -> int:
    return int(np.abs(track.frames - frame).argmin())


def _box(track: Track, frame: int) -> Box:
    k = int(np.searchsorted(track.frames, frame))
    if k == len(track) or track.frames[k] != frame:
        raise RequestError(f"person {track.id} is not in frame {frame + 1}; choose a frame in which they are")
    return boxes_of([frame], track.boxes[k : k + 1])[0]


def _beside(track: Track, frame: int) -> tuple[Box | None, Box | None]:
    """The last box before a frame, and the first from it on."""
    k = int(np.searchsorted(track.frames, frame))
    boxes = boxes_of(track.frames[max(k - 1, 0) : k + 1], track.boxes[max(k - 1, 0) : k + 1])
    return boxes[0] if k else None, boxes[-1] if k < len(track) else None
