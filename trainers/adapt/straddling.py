"""Boxes that straddle people: what lies on the boxes of surer tracks is no further person, or one who is hidden."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.types import BoolArray, FloatArray, Track

# Share of a box that others cover together, from which on they explain it.
EXPLAINED = 0.8
# Points across and down at which it is measured.
_GRID = (10, 20)


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


def shared_with_all(boxes: FloatArray, others: FloatArray, which: BoolArray | None = None) -> FloatArray:
    """``(N,)`` share of each of ``(N, 4)`` boxes that lies on any of ``(M, 4)`` others.

    Args:
        boxes: pixels.
        others: likewise.
        which: ``(N, M)`` whether the other counts for the box; None takes all.
    """
    if not len(boxes) or not len(others):
        return np.zeros(len(boxes))
    across, down = ((np.arange(count) + 0.5) / count for count in _GRID)
    x = boxes[:, 0, None] + (boxes[:, 2] - boxes[:, 0])[:, None] * across
    y = boxes[:, 1, None] + (boxes[:, 3] - boxes[:, 1])[:, None] * down
    wide = (x[:, None] >= others[None, :, 0, None]) & (x[:, None] < others[None, :, 2, None])
    high = (y[:, None] >= others[None, :, 1, None]) & (y[:, None] < others[None, :, 3, None])
    if which is not None:
        wide &= which[..., None]
    inside = (wide[:, :, None, :] & high[:, :, :, None]).any(axis=1)
    return np.asarray(inside.mean(axis=(1, 2)))
