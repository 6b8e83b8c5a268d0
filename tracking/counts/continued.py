"""Tracks that go on under another id: one ends, and another begins in the next frame at the same place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import FloatArray, Track

# Least IoU of the last box of a track and the first of the next, as for a right detection.
SAME = 0.5


def continued(tracks: Sequence[Track]) -> dict[int, int]:
    """The number of the track that goes on where each of some ended; of several the nearest."""
    by_frame = dict[int, list[int]]()
    for number, track in enumerate(tracks):
        if len(track):
            by_frame.setdefault(int(track.frames[0]), []).append(number)
    ended = dict[int, list[int]]()
    for number, track in enumerate(tracks):
        if len(track) and int(track.frames[-1]) + 1 in by_frame:
            ended.setdefault(int(track.frames[-1]) + 1, []).append(number)
    successors = dict[int, int]()
    for frame, earlier in ended.items():
        later = by_frame[frame]
        lasts = np.array([tracks[number].boxes[-1] for number in earlier])
        steps = np.array([_last_step(tracks[number]) for number in earlier])
        shares = nearness(lasts, steps, np.array([tracks[number].boxes[0] for number in later]))
        alike = [[_are_alike(tracks[end], tracks[start]) for start in later] for end in earlier]
        pairs = matched(np.where(alike, shares, 0.0))
        successors |= {earlier[end]: later[start] for end, start in pairs}
    return successors


def nearness(lasts: FloatArray, steps: FloatArray, firsts: FloatArray) -> FloatArray:
    """``(E, B)`` IoU of boxes that end with boxes that begin in the next frame.

    Args:
        lasts: ``(E, 4)`` where tracks ended.
        steps: ``(E, 4)`` by how much they moved in a frame, then; they may also have stopped.
        firsts: ``(B, 4)`` where others begin.
    """
    return np.maximum(iou_matrix(lasts + steps, firsts), iou_matrix(lasts, firsts))


def matched(shares: FloatArray) -> list[tuple[int, int]]:
    """Pairs of ``(E, B)`` boxes that are one person's: the nearest first, each box once."""
    pairs, shares = list[tuple[int, int]](), shares.copy()
    while shares.size and shares.max() >= SAME:
        earlier, later = divmod(int(shares.argmax()), shares.shape[1])
        pairs.append((earlier, later))
        shares[earlier], shares[:, later] = 0.0, 0.0
    return pairs


def chained(successors: dict[int, int], count: int) -> list[list[int]]:
    """Numbers of ``count`` tracks as chains, each of them that are one person's."""
    joined, chains = set(successors.values()), list[list[int]]()
    for number in (number for number in range(count) if number not in joined):
        chain = [number]
        while chain[-1] in successors:
            chain.append(successors[chain[-1]])
        chains.append(chain)
    return chains


def _last_step(track: Track) -> FloatArray:
    """``(4,)`` by how much the box moved in the last frame."""
    if len(track) < 2:
        return np.zeros(4)
    return np.asarray((track.boxes[-1] - track.boxes[-2]) / (track.frames[-1] - track.frames[-2]))


def _are_alike(track: Track, successor: Track) -> bool:
    """Whether the classes of two tracks do not differ, as far as they are known."""
    return len({track.class_id, successor.class_id} - {-1}) < 2
