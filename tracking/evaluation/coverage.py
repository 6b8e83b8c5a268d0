"""Which track follows which person when: what a timeline shows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.evaluation.multi import MATCH_OVERLAP
from tsuiseki.tracking.evaluation.owners import NOBODY, matched_labels
from tsuiseki.tracking.types import IntArray, Track
from tsuiseki.tracking.types.labels import GroundTruth


@dataclass(frozen=True)
class Coverage:
    """One person of the ground truth and the tracks that follow them.

    Attributes:
        id: of the person.
        frames: ``(N,)`` 0-based frames in which they are labelled and count.
        track_ids: ``(N,)`` id of the track on them in each, 0 where none is.
    """

    id: int
    frames: IntArray
    track_ids: IntArray


@dataclass(frozen=True)
class Span:
    """Frames ``first`` to ``last``, both included, in which a value stays the same."""

    first: int
    last: int
    value: int


def coverage(truth: GroundTruth, tracks: Iterable[Track], overlap: float = MATCH_OVERLAP) -> list[Coverage]:
    """The tracks on every person, matched frame by frame from an ``overlap`` on, in the order of appearance."""
    rows = truth.select(truth.evaluated)
    tracks = list(tracks)
    frames = np.concatenate([t.frames for t in tracks]) if tracks else np.empty(0, np.int64)
    ids = np.concatenate([np.full(len(t), t.id) for t in tracks]) if tracks else frames
    boxes = np.concatenate([t.boxes for t in tracks]) if tracks else np.empty((0, 4))
    label = matched_labels(frames, boxes, rows, overlap)
    found = np.zeros(len(rows), dtype=np.int64)
    found[label[label != NOBODY]] = ids[label != NOBODY]
    people, first = np.unique(rows.ids, return_index=True)
    return [
        Coverage(int(person), rows.frames[rows.ids == person], found[rows.ids == person])
        for person in people[np.argsort(first, kind="stable")]
    ]


def spans(frames: IntArray, values: IntArray) -> list[Span]:
    """Runs of equal ``values`` over consecutive ``frames``.

    >>> spans(np.array([0, 1, 2, 5]), np.array([7, 7, 0, 0]))
    [Span(first=0, last=1, value=7), Span(first=2, last=2, value=0), Span(first=5, last=5, value=0)]
    """
    breaks = np.flatnonzero((np.diff(frames) != 1) | (np.diff(values) != 0)) + 1
    pieces = np.split(np.arange(len(frames)), breaks) if len(frames) else []
    return [Span(int(frames[p[0]]), int(frames[p[-1]]), int(values[p[0]])) for p in pieces]
