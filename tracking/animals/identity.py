"""Who is who after a contact: tracks of animals that parted are exchanged where their appearance says so.

The flow carries identities through a contact by motion. Size and brightness are steadier than that: for two tracks that
were in contact, what each looked like before and after is compared, both ways round.
"""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.animals.pose import AnimalPose
from tsuiseki.tracking.types import FloatArray, IntArray

EVIDENCE = 4.0
"""By how much the exchanged way must be likelier, in units of log-likelihood."""
FEWEST = 5
# Frames before and after a contact that are compared, and the farthest that appearances may differ, in deviations.
WINDOW = 100
FARTHEST = 5.0
NEAR = 1.0
"""Two animals are in contact where their pixels were told apart and they are nearer than this many lengths."""


def exchanged_after_contacts(
    labels: list[IntArray], poses: list[list[AnimalPose]], evidence: float = EVIDENCE
) -> tuple[list[IntArray], int]:
    """Tracks of the poses in each frame, exchanged where their appearance says so, and how often they were.

    Args:
        labels: for each frame ``(N,)`` the track of each pose, 0 for none.
        poses: of each frame.
        evidence: see `EVIDENCE`.
    """
    labels = [row.copy() for row in labels]
    exchanges = 0
    pending = contacts(labels, poses)
    while pending:
        first, last, one, other = pending.pop(0)
        before, after = (range(max(0, first - WINDOW), first), range(last + 1, min(len(labels), last + 1 + WINDOW)))
        appearances = [
            _appearance(labels, poses, frames, track) for frames in (before, after) for track in (one, other)
        ]
        if min(map(len, appearances)) < FEWEST:
            continue
        if _gain(appearances) > evidence:
            for row in labels[last + 1 :]:
                was_one, was_other = row == one, row == other
                row[was_one], row[was_other] = other, one
            pending = [_renamed(contact, last, {one: other, other: one}) for contact in pending]
            exchanges += 1
    return labels, exchanges


def contacts(labels: list[IntArray], poses: list[list[AnimalPose]]) -> list[tuple[int, int, int, int]]:
    """First and last frame of each contact, and the two tracks, by the first frame; short partings do not end one."""
    running: dict[tuple[int, int], tuple[int, int]] = {}
    ended: list[tuple[int, int, int, int]] = []
    for frame, (row, found) in enumerate(zip(labels, poses, strict=True)):
        touching = [n for n, pose in enumerate(found) if pose.contact and row[n] > 0]
        for i, a in enumerate(touching):
            for b in touching[i + 1 :]:
                away = float(np.linalg.norm(found[a].place - found[b].place))
                if away > NEAR * max(found[a].length, found[b].length):
                    continue
                pair = (int(min(row[a], row[b])), int(max(row[a], row[b])))
                first, last = running.get(pair, (frame, frame))
                if frame - last > FEWEST:
                    ended.append((first, last, *pair))
                    first = frame
                running[pair] = (first, frame)
    return sorted(ended + [(*span, *pair) for pair, span in running.items()])


def _renamed(contact: tuple[int, int, int, int], after: int, names: dict[int, int]) -> tuple[int, int, int, int]:
    """A contact with the names that its tracks have since an exchange ``after`` that frame."""
    first, last, a, b = contact
    if first <= after:
        return contact
    a, b = sorted((names.get(a, a), names.get(b, b)))
    return first, last, a, b


def _appearance(labels: list[IntArray], poses: list[list[AnimalPose]], frames: range, track: int) -> FloatArray:
    """``(T, 3)`` appearance of a track in frames in which nothing touches it."""
    found = [
        pose.appearance
        for frame in frames
        for label, pose in zip(labels[frame], poses[frame], strict=True)
        if label == track and not pose.contact
    ]
    return np.array(found).reshape(-1, 3)


def _gain(appearances: list[FloatArray]) -> float:
    """How much likelier it is that the two were exchanged: one and other before, one and other after."""
    middle = [np.median(part, axis=0) for part in appearances]
    spread = np.concatenate([part - centre for part, centre in zip(appearances, middle, strict=True)])
    deviation = np.maximum(1.4826 * np.median(np.abs(spread), axis=0), 0.02)
    # Frames that follow each other look alike: each side counts as one observation.

    def away(a: FloatArray, b: FloatArray) -> float:
        return float((np.minimum(np.abs(a - b) / deviation, FARTHEST) ** 2).sum())

    one, other, then_one, then_other = middle
    return 0.5 * (away(one, then_one) + away(other, then_other) - away(one, then_other) - away(other, then_one))
