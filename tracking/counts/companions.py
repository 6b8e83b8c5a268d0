"""Who is hidden behind somebody goes on with them: tracks joined and made longer where nothing could be detected.

A track that another goes on with in the next frame is one with it. A track that ends in the midst of the picture behind
a nearer person, and a later one that begins behind the same person, are taken for one: of all such pairs those with the
shortest gaps first. Who is left without a partner and walks along with that person is taken to have done so since they
came, or until they left. Both give places that no detection supports.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tsuiseki.tracking.counts.continued import chained, continued
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Track

# Least share of a box that the nearer person covers where tracks are joined, chosen on generated streets of seeds < 50.
COVERED = 0.2
# The same where a track is made longer.
COVERED_ALONG = 0.4
# Heights from the border of the picture within which a track comes in or leaves.
EDGE = 0.3
# Heights in a second by which people who walk together change places at most.
STEADY = 0.3
# Heights in a second by which they go on at least.
WALKS = 0.2
# Heights by which the feet of the nearer person may be higher.
SLACK = 0.1


class _Boxes(NamedTuple):
    """The boxes of all tracks by frame: ``(N,)`` frames and numbers of their tracks, and ``(N, 4)`` boxes."""

    frames: IntArray
    tracks: IntArray
    boxes: FloatArray


def with_hidden(tracks: Sequence[Track], size: tuple[int, int] | None, length: int, rate: float) -> list[list[Track]]:
    """Tracks with the times at which their people were hidden, as chains of parts that are one person's.

    ``size`` are width and height of the picture, None where its border is not known; ``length`` is in frames.
    """
    frames = np.concatenate([np.empty(0, np.int64), *(track.frames for track in tracks)])
    boxes = np.concatenate([np.empty((0, 4)), *(track.boxes for track in tracks)])
    order = np.argsort(frames, kind="stable")
    numbers = np.repeat(np.arange(len(tracks)), [len(track) for track in tracks])
    by_frame = _Boxes(frames[order], numbers[order], boxes[order])
    successors = continued(tracks)
    ends, begins = (
        {
            number: _hiding(by_frame, number, track.boxes[row], int(track.frames[row]))
            for number, track in enumerate(tracks)
            if number not in joined and _midst(track, row, size, length)
        }
        for row, joined in ((-1, successors.keys()), (0, set(successors.values())))
    )
    chains = list[list[Track]]()
    for chain in chained(successors | _joined(tracks, ends, begins), len(tracks)):
        first, last = chain[0], chain[-1]
        lead = _company(tracks, begins.get(first, {}), first, False, rate)
        parts = [tracks[number] for number in chain]
        chains.append([*lead, *parts, *_company(tracks, ends.get(last, {}), last, True, rate)])
    return chains


def with_changed_ids(tracks: Sequence[Track]) -> list[list[Track]]:
    """Tracks as chains of parts that are one animal's: its id changed from one frame to the next."""
    return [[tracks[number] for number in chain] for chain in chained(continued(tracks), len(tracks))]


def _hiding(by_frame: _Boxes, track: int, box: FloatArray, frame: int) -> dict[int, float]:
    """Share of the box ``(4,)`` of a track that each nearer person covers in a frame, by number of their track."""
    rows = slice(*np.searchsorted(by_frame.frames, [frame, frame + 1]))
    others, numbers, high = by_frame.boxes[rows], by_frame.tracks[rows], box[3] - box[1]
    across = np.minimum(others[:, 2], box[2]) - np.maximum(others[:, 0], box[0])
    down = np.minimum(others[:, 3], box[3]) - np.maximum(others[:, 1], box[1])
    shares = np.maximum(across, 0) * np.maximum(down, 0) / max((box[2] - box[0]) * high, 1e-9)
    near = (shares >= COVERED) & (numbers != track) & (others[:, 3] >= box[3] - SLACK * high)
    return dict(zip(numbers[near].tolist(), shares[near].tolist(), strict=True))


def _midst(track: Track, row: int, size: tuple[int, int] | None, length: int) -> bool:
    """Whether a track begins (row 0) or ends (row -1) elsewhere than at the border of the picture or of the video."""
    box, frame = track.boxes[row], track.frames[row]
    feet, margin = np.array([0.5 * (box[0] + box[2]), box[3]]), EDGE * (box[3] - box[1])
    inside = size is None or bool(((feet > margin) & (feet < np.array(size) - margin)).all())
    return 0 < frame < length - 1 and inside


def _joined(
    tracks: Sequence[Track], ends: dict[int, dict[int, float]], begins: dict[int, dict[int, float]]
) -> dict[int, int]:
    """The track that goes on where each of some ended."""
    by_person = dict[int, list[int]]()
    for number, hiding in begins.items():
        for person in hiding:
            by_person.setdefault(person, []).append(number)
    pairs = sorted(
        (int(tracks[later].frames[0] - tracks[earlier].frames[-1]), earlier, later)
        for earlier, hiding in ends.items()
        for person in hiding
        for later in by_person.get(person, ())
        if tracks[later].frames[0] > tracks[earlier].frames[-1]
    )
    successors, followed = dict[int, int](), set[int]()
    for _, earlier, later in pairs:
        if earlier not in successors and later not in followed:
            successors[earlier] = later
            followed.add(later)
    return successors


def _company(tracks: Sequence[Track], hiding: dict[int, float], number: int, end: bool, rate: float) -> list[Track]:
    """The way of the person who hides an end of a track, from there on; nothing where no track goes along with it."""
    track = tracks[number]
    for person in sorted(hiding, key=hiding.__getitem__, reverse=True):
        companion = tracks[person]
        rows: BoolArray = companion.frames > track.frames[-1] if end else companion.frames < track.frames[0]
        if hiding[person] >= COVERED_ALONG and rows.any() and _along(track, companion, end, max(2, round(rate))):
            frames, count = companion.frames[rows], int(rows.sum())
            return [Track(track.id, frames, companion.boxes[rows], np.zeros(count), np.zeros(count, np.bool_))]
    return []


def _along(track: Track, companion: Track, end: bool, steps: int) -> bool:
    """Whether two people walk, and keep their places to each other, during the last or first steps of one."""
    frames = track.frames[-steps:] if end else track.frames[:steps]
    _, mine, theirs = np.intersect1d(frames, companion.frames, return_indices=True)
    if len(mine) < 0.9 * steps:
        return False
    boxes = (track.boxes[-steps:] if end else track.boxes[:steps])[mine], companion.boxes[theirs]
    ours, company = (np.column_stack([0.5 * (corners[:, 0] + corners[:, 2]), corners[:, 3]]) for corners in boxes)
    high = float((boxes[0][:, 3] - boxes[0][:, 1]).mean())
    apart = company - ours
    return bool(
        np.abs(apart[-1] - apart[0]).max() < STEADY * high < STEADY / WALKS * np.abs(company[-1] - company[0]).max()
    )
