"""Boxes that straddle people: what lies on the boxes of surer tracks is no further person, or one who is hidden."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.geometry import shared_with_all
from tsuiseki.tracking.types import BoolArray, Track

# Share of a box that others cover together, from which on they explain it.
EXPLAINED = 0.8


def explained_boxes(tracks: Sequence[Track], people: Sequence[bool]) -> list[BoolArray]:
    """``(len(track),)`` for each track: which of its boxes those of surer tracks cover together.

    Between two people who walk side by side a detector also finds a third, half on either. A track of such boxes is
    seldom detected, so the surer track is the one whose detections have the larger sum of scores.

    Args:
        tracks: of one video.
        people: which of them may explain others.
    """
    sureness = np.array([float(track.scores[track.observed].sum()) for track in tracks])
    explained = [np.zeros(len(track), dtype=np.bool_) for track in tracks]
    rows = np.concatenate([np.empty(0, np.int64), *(np.full(len(t), n) for n, t in enumerate(tracks))])
    frames = np.concatenate([np.empty(0, np.int64), *(t.frames for t in tracks)])
    boxes = np.concatenate([np.empty((0, 4)), *(t.boxes for t in tracks)])
    counted = np.asarray(people, dtype=np.bool_)
    for frame in np.unique(frames).tolist():
        here = np.flatnonzero(frames == frame)
        who = rows[here]
        surer = counted[who][None] & (sureness[who][None] > sureness[who][:, None])
        shares = shared_with_all(boxes[here], boxes[here], surer)
        for n, share in zip(who.tolist(), shares.tolist(), strict=True):
            explained[n][int(np.searchsorted(tracks[n].frames, frame))] = share >= EXPLAINED
    return explained
