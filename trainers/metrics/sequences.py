"""A sequence as users have it, tracks or a list of its frames, turned into what is compared."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.calls import ground_truth_of
from tsuiseki.tracking.evaluation.identity_metrics import LabelledSequence
from tsuiseki.tracking.evaluation.multi import counted_boxes, labelled_sequence
from tsuiseki.tracking.formats.tracked_video import TrackedBoxes, boxes_of_tracks
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.types.tracks import boxes_about
from tsuiseki.trainers.metrics.states import boxes_in, whole_numbers

EXPECTED = (
    "expected a sequence as tracks, or as a list of its frames, each with `boxes` (N, 4) in pixels and `ids` (N,)"
)


class FrameBoxes(NamedTuple):
    """The boxes of all frames of a sequence, by frame.

    Attributes:
        frames: ``(N,)`` from 0.
        ids: ``(N,)``.
        boxes: ``(N, 4)`` pixels.
        ignored: ``(N,)`` boxes on which a result is neither right nor wrong.
        length: number of frames.
    """

    frames: IntArray
    ids: IntArray
    boxes: FloatArray
    ignored: BoolArray
    length: int


def compared(preds: Any, target: Any) -> LabelledSequence:
    """The boxes of a sequence that count, from both sides.

    Args:
        preds: a `Result` or tracks; or a list of frames, each a dictionary or an object with ``boxes`` ``(N, 4)`` and
            ``ids`` ``(N,)``.
        target: tracks or labels, of which frames are scored as `evaluate_people` does; or a list of frames, which are
            scored all. Boxes that are ``ignored`` ``(N,)`` make no result wrong.

    Raises:
        RequestError: one is none of that, both have not the same frames, or an id is twice in a frame.
    """
    length: int | None
    if _are_tracks(preds):
        result, length = boxes_of_tracks(_boxed(preds, "preds")), None
    else:
        rows = frame_boxes(preds, "preds")
        length = rows.length
        result = _table(rows)
    if isinstance(target, GroundTruth):
        return labelled_sequence("target", target, result, length)
    if _are_tracks(target) and len(target):
        return labelled_sequence("target", ground_truth_of(_boxed(target, "target")), result, length)
    truth = frame_boxes(target, "target")
    if length not in (None, truth.length):
        raise RequestError(f"expected as many frames in `preds` and `target`, got {length} and {truth.length}")
    if len(result.frames) and result.frames[-1] >= truth.length:
        raise RequestError(
            f"`preds`: expected tracks in the {truth.length} frames of `target`, got one in frame {result.frames[-1]}"
        )
    visible = np.ones(len(truth.frames))
    labels = GroundTruth(truth.frames, truth.ids, truth.boxes, ~truth.ignored, truth.ignored, visible)
    return counted_boxes(labels, result)


def _boxed(tracks: Collection[Any], name: str) -> list[Track]:
    boxed = boxes_about(tracks)
    if len({track.id for track in boxed}) < len(boxed):
        raise RequestError(f"`{name}`: expected tracks of different ids, got an id twice")
    return boxed


def _table(rows: FrameBoxes) -> TrackedBoxes:
    count = len(rows.frames)
    return TrackedBoxes(rows.frames, rows.ids, rows.boxes, np.ones(count), np.ones(count, np.bool_), np.full(count, -1))


def _are_tracks(side: object) -> bool:
    """Whether a side is a collection of tracks; an empty one is."""
    return (
        isinstance(side, Collection)
        and not isinstance(side, Mapping | str)
        and all(hasattr(getattr(entry, "track", entry), "frames") for entry in side)
    )


def frame_boxes(frames: Any, name: str) -> FrameBoxes:
    """The boxes of a list of frames.

    Raises:
        RequestError: it is none, or an id is twice in a frame.
    """
    if not isinstance(frames, Sequence) or isinstance(frames, str):
        raise RequestError(f"`{name}`: {EXPECTED}; got {type(frames).__name__}")
    columns = [_frame(frame, f"{name}[{number}]") for number, frame in enumerate(frames)]
    empty = np.empty(0, np.int64)
    ids = np.concatenate([empty, *(ids for _, ids, _ in columns)])
    return FrameBoxes(
        np.repeat(np.arange(len(columns)), [len(ids) for _, ids, _ in columns]),
        ids,
        np.concatenate([np.empty((0, 4)), *(boxes for boxes, _, _ in columns)]),
        np.concatenate([empty, *(ignored for _, _, ignored in columns)]).astype(np.bool_),
        len(columns),
    )


def _frame(frame: Any, name: str) -> tuple[FloatArray, IntArray, IntArray]:
    """Boxes ``(N, 4)``, ids ``(N,)`` and ignored ``(N,)`` of a frame."""
    boxes, ids, ignored = (
        frame.get(key) if isinstance(frame, Mapping) else getattr(frame, key, None)
        for key in ("boxes", "ids", "ignored")
    )
    if boxes is None or ids is None:
        has = ", ".join(map(str, frame)) if isinstance(frame, Mapping) else type(frame).__name__
        raise RequestError(f"`{name}`: {EXPECTED}; got {has or 'nothing'}")
    rows = boxes_in(boxes, f"{name}.boxes")
    who = whole_numbers(ids, f"{name}.ids", len(rows))
    if len(np.unique(who)) < len(who):
        raise RequestError(f"`{name}.ids`: expected each id once in a frame, got one twice")
    none = np.zeros(len(rows), np.int64)
    return rows, who, none if ignored is None else whole_numbers(ignored, f"{name}.ignored", len(rows))
