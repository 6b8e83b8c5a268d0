"""Boxes that straddle people: what lies on the boxes of surer tracks is no further person, or one who is hidden.

Between two people who walk side by side a detector also finds a third, half on either, often enough for a track. Who is
surer has the larger sum of scores: a straddling track is seldom detected, and most of its boxes are filled in.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.geometry import shared_with_all
from tsuiseki.tracking.types import BoolArray, Track

# Share of a box that others cover together, from which on they explain it.
EXPLAINED = 0.8


def explained_boxes(tracks: Sequence[Track], people: Sequence[bool], share: float = EXPLAINED) -> list[BoolArray]:
    """``(len(track),)`` for each track: which of its boxes those of surer tracks cover together.

    The surer track is the one whose detections have the larger sum of scores.

    Args:
        tracks: of one video.
        people: which of them may explain others.
        share: of a box that must be covered, in (0, 1].
    """
    sureness = np.array([float(track.scores[track.observed].sum()) for track in tracks])
    rows = np.concatenate([np.empty(0, np.int64), *(np.full(len(t), n) for n, t in enumerate(tracks))])
    frames = np.concatenate([np.empty(0, np.int64), *(t.frames for t in tracks)])
    boxes = np.concatenate([np.empty((0, 4)), *(t.boxes for t in tracks)])
    counted = np.asarray(people, dtype=np.bool_)
    explained = np.zeros(len(rows), dtype=np.bool_)
    order = np.argsort(frames, kind="stable")
    for here in np.split(order, np.flatnonzero(np.diff(frames[order])) + 1):
        who = rows[here]
        surer = counted[who][None] & (sureness[who][None] > sureness[who][:, None])
        explained[here] = shared_with_all(boxes[here], boxes[here], surer) >= share
    ends = np.cumsum([0, *map(len, tracks)])
    return [explained[first:end] for first, end in itertools.pairwise(ends)]


def is_straddling(track: Track, explained: BoolArray) -> bool:
    """Whether most detections of a track are ``explained`` ``(len(track),)`` by others."""
    detected = explained[track.observed]
    return len(detected) > 0 and 2 * int(detected.sum()) > len(detected)


def straddling_tracks(tracks: Sequence[Track], share: float = EXPLAINED) -> BoolArray:
    """``(N,)`` which tracks of a video have most of their detections on the boxes of surer ones that stay.

    Args:
        tracks: of one video.
        share: of a box that must be covered, in (0, 1].
    """
    straddles = np.zeros(len(tracks), dtype=np.bool_)
    # Who is dropped explains nobody. Only surer tracks explain others, so this ends after as many rounds at most.
    for _ in tracks:
        explained = explained_boxes(tracks, (~straddles).tolist(), share)
        now = np.array([is_straddling(*each) for each in zip(tracks, explained, strict=True)], dtype=np.bool_)
        if (now == straddles).all():
            break
        straddles = now
    return straddles
