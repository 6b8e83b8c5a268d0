"""By how many frames a result is counted otherwise than the labels, as of a part of a video that counts anew."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.multi import MATCH_OVERLAP, restrict
from tsuiseki.tracking.formats.tracked_video import boxes_of_tracks
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import FloatArray, IntArray, Track
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.types.labels import GroundTruth

# Boxes of a result that are compared with all labels, spread evenly.
SAMPLE = 200
# Of those that are compared at a time: the memory of their overlaps is bounded.
CHUNK = 16
# Share of boxes on labels from which on frames are taken to be counted alike.
RIGHT = 0.5
# Share of boxes on labels from which on an offset is taken to be right.
FITTING = 0.6
# How much larger that share is where frames are counted otherwise; a slow scene fits frames nearby, too.
BETTER = 1.5
# Fewest boxes in labelled frames that tell an offset.
FEWEST = 20


@dataclass(frozen=True)
class FrameOffset:
    """How a result fits labels.

    Attributes:
        frames: to add to the numbers of the result.
        share: of its boxes in labelled frames that are on labels then, in [0, 1].
        share_as_counted: the same without the offset.
    """

    frames: int
    share: float
    share_as_counted: float

    def hint(self, offset: int) -> str:
        """What to tell users who gave an ``offset``."""
        where = f"{abs(self.frames)} frames {'later' if self.frames > 0 else 'earlier'}"
        return (
            f"{self.share:.0%} of its boxes are on labels {where}, {self.share_as_counted:.0%} as they are counted; "
            f"if it is a part that counts anew, give `offset` {offset + self.frames}"
        )


def frame_offset(labels: GroundTruth, tracks: Sequence[Track]) -> FrameOffset | None:
    """The offset at which the boxes of a result are on labels; None where they are without one, or with none.

    The overlaps of some boxes with all labels vote for the difference of their frames.
    """
    rows = boxes_of_tracks(tracks)
    if not len(rows.frames) or not len(labels.frames):
        return None
    chosen = np.unique(np.linspace(0, len(rows.frames) - 1, SAMPLE).astype(np.int64))
    frames, boxes = rows.frames[chosen], rows.boxes[chosen]
    first, last = int(labels.frames.min()), int(labels.frames.max())
    as_counted = _share_as_counted(labels, frames, boxes)
    if as_counted >= RIGHT:
        return None
    lowest = first - int(frames.max())
    votes, counts = _votes(labels, frames, boxes, lowest)
    best = int(votes.argmax())
    offset = best + lowest
    within = int(FrameRange(first, last).mask(frames + offset).sum())
    share = min(counts[best] / max(within, 1), 1.0)
    if offset == 0 or within < FEWEST or share < max(FITTING, BETTER * as_counted):
        return None
    return FrameOffset(offset, float(share), as_counted)


def _share_as_counted(labels: GroundTruth, frames: IntArray, boxes: FloatArray) -> float:
    """Share of ``(N, 4)`` boxes that are on a label of their frame."""
    right = 0
    for frame in np.unique(frames):
        overlaps = iou_matrix(boxes[frames == frame], labels.boxes[labels.frames == frame])
        right += int((overlaps.max(axis=1, initial=0) >= MATCH_OVERLAP).sum())
    return right / len(frames)


def _votes(labels: GroundTruth, frames: IntArray, boxes: FloatArray, lowest: int) -> tuple[FloatArray, IntArray]:
    """For each offset from the ``lowest`` on the sum of the overlaps that match, and their number."""
    size = int(labels.frames.max()) - int(frames.min()) - lowest + 1
    votes, counts = np.zeros(size), np.zeros(size, dtype=np.int64)
    for rows in np.split(np.arange(len(frames)), range(CHUNK, len(frames), CHUNK)):
        overlaps = iou_matrix(boxes[rows], labels.boxes)
        box, label = np.nonzero(overlaps >= MATCH_OVERLAP)
        offsets = labels.frames[label] - frames[rows][box] - lowest
        votes += np.bincount(offsets, overlaps[box, label], minlength=size)
        counts += np.bincount(offsets, minlength=size)
    return votes, counts


def moved(file: object, tracks: Sequence[Track], offset: int, frames: FrameRange) -> list[Track]:
    """The tracks so many frames later, of which those outside ``frames`` are left out and counted.

    Raises:
        RequestError: nothing is left.
    """
    tracks_within = restrict((replace(track, frames=track.frames + offset) for track in tracks), frames)
    total, inside = sum(map(len, tracks)), sum(map(len, tracks_within))
    if not inside:
        raise RequestError(f"{file}: expected boxes in frames {frames} with `offset` {offset}, got none")
    if inside < total:
        line = f"{total - inside} of {total} boxes lie outside frames {frames} with `offset` {offset}, and are left out"
        warnings.warn(f"{file}: {line}", InputWarning, stacklevel=3)
    return tracks_within
