"""Tracks that are right already, as detections: for naming actions along them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import Detections, IntArray, Track


def as_detections(tracks: Sequence[Track], length: int | None = None) -> tuple[list[Detections], IntArray]:
    """The boxes of ``tracks`` as detections, one entry a frame, and ``(N,)`` which of the tracks each belongs to.

    Args:
        tracks: at least one.
        length: number of frames; None ends with the last box.

    Raises:
        RequestError: there is no track.
    """
    if not tracks:
        raise RequestError("expected at least one given track, got none")
    frames = np.concatenate([track.frames for track in tracks])
    labels = np.repeat(np.arange(len(tracks)), [len(track) for track in tracks])
    order = np.lexsort((labels, frames))
    cuts = np.searchsorted(frames[order], np.arange(1, (int(frames.max()) + 1) if length is None else length))
    boxes = np.split(np.concatenate([track.boxes for track in tracks])[order], cuts)
    scores = np.split(np.concatenate([track.scores for track in tracks])[order], cuts)
    return [Detections(*both) for both in zip(boxes, scores, strict=True)], labels[order]
