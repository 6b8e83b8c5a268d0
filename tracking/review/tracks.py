"""Tracks as they are reported after corrections, with the ids that they had."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from tsuiseki.tracking.association.smoothing import GapSettings, fill_gaps
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.types import FloatArray, IntArray, Track
from tsuiseki.tracking.types.tracks import ActingTrack


class Reporter:
    """Makes tracks of labelled detections; what did not change is reported as it was.

    Args:
        solved: the tracks of the result, before any correction.

    Attributes:
        most: the highest id of these.
    """

    def __init__(self, solved: Sequence[Track]) -> None:
        self.most = max((track.id for track in solved), default=0)
        self._solved = {track.id: track for track in solved}
        self._names = next((track.names for track in solved if track.names), {})
        self._made: dict[tuple[int, bytes], Track] = {}

    def tracks(self, network: SolvedNetwork, ids: IntArray, shown: Mapping[int, FloatArray]) -> list[Track]:
        """The tracks by id.

        Args:
            network: of the detections.
            ids: ``(N,)`` of the track of each, 0 for none.
            shown: boxes that take the place of those of detections.
        """
        used = np.flatnonzero(ids)
        # Detections that were drawn come last, whatever their frames.
        used = used[np.lexsort((network.frames[used], ids[used]))]
        pieces = np.split(used, np.flatnonzero(np.diff(ids[used])) + 1) if len(used) else []
        before, self._made = self._made, {}
        for rows in pieces:
            here = [(n, box) for n, box in shown.items() if ids[n] == ids[rows[0]]]
            key = (
                int(ids[rows[0]]),
                rows.tobytes() + b"".join(bytes(str(n), "ascii") + box.tobytes() for n, box in here),
            )
            self._made[key] = before.get(key) or self._track(network, rows, key[0], dict(here))
        return list(self._made.values())

    def _track(self, network: SolvedNetwork, rows: IntArray, number: int, shown: Mapping[int, FloatArray]) -> Track:
        whole = np.flatnonzero(network.track == network.track[rows[0]])
        solved = self._solved.get(int(network.track[rows[0]]))
        if solved is not None and not shown and np.array_equal(whole, rows):
            return solved if solved.id == number else replace(solved, id=number)
        boxes = network.boxes[rows].copy()
        for own in np.unique(network.track[rows]).tolist():
            if own in self._solved:
                track, mine = self._solved[own], network.track[rows] == own
                place = np.searchsorted(track.frames, network.frames[rows[mine]]).clip(max=len(track) - 1)
                there = track.frames[place] == network.frames[rows[mine]]
                boxes[np.flatnonzero(mine)[there]] = track.boxes[place[there]]
        for n, box in shown.items():
            boxes[rows == n] = box
        scores, origin = np.nan_to_num(network.scores[rows]), network.origin[rows]
        track = Track(number, network.frames[rows], boxes, scores, origin=origin, names=self._names)
        return fill_gaps(track, GapSettings(network.fill, np.inf, np.inf))


def acting(tracks: Sequence[Track], solved: Sequence[ActingTrack]) -> list[ActingTrack]:
    """Tracks with what people do there: of the solved track that had the box, and in between on straight lines.

    Args:
        tracks: corrected.
        solved: with actions.
    """
    known = {
        (frame, *box): (person.single[n], person.multi[n])
        for person in solved
        if person.single is not None and person.multi is not None
        for n, (frame, box) in enumerate(_places(person.track))
    }
    return [_acting(track, known) for track in tracks]


def _places(track: Track) -> Iterator[tuple[int, tuple[float, ...]]]:
    return zip(track.frames.tolist(), map(tuple, track.boxes.round(2).tolist()), strict=True)


def _acting(track: Track, known: Mapping[tuple[float, ...], tuple[FloatArray, FloatArray]]) -> ActingTrack:
    found = [(frame, *known[frame, *box]) for frame, box in _places(track) if (frame, *box) in known]
    if not found:
        return ActingTrack(track)
    frames, single, multi = (np.array(column) for column in zip(*found, strict=True))
    every = (np.stack([np.interp(track.frames, frames, one) for one in both.T], axis=1) for both in (single, multi))
    return ActingTrack(track, *every)


def track_ids(before: IntArray, labels: IntArray, most: int) -> IntArray:
    """``(N,)`` ids of detections of ``(N,)`` tracks, 0 for none.

    A track has the id that most of its detections had, where no other has more of them; the others are numbered anew
    by their first detections.

    Args:
        before: ``(N,)`` ids in the result, 0 for none.
        labels: ``(N,)`` numbers of the tracks now, -1 for none.
        most: the highest id of the result.
    """
    known = (before > 0) & (labels >= 0)
    pairs, counts = np.unique(np.column_stack([labels[known], before[known]]), axis=0, return_counts=True)
    given: dict[int, int] = {}
    taken: set[int] = set()
    for n in np.lexsort((pairs[:, 1], -counts)).tolist():
        label, number = pairs[n].tolist()
        if label not in given and number not in taken:
            given[label] = number
            taken.add(number)
    used = labels[labels >= 0]
    for label in used[np.sort(np.unique(used, return_index=True)[1])].tolist():
        if label not in given:
            most += 1
            given[label] = most
    table = np.zeros(int(labels.max(initial=-1)) + 2, dtype=np.int64)
    table[list(given)] = list(given.values())
    table[-1] = 0
    return table[labels]
