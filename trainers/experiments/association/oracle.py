"""What the right links over given boxes would score, and by which links a result falls short of it.

A box belongs to the label it overlaps by at least 0.5, one to one; a box on an ignored label is left out, as it is in
the scores; a box on nobody is false. The right links join the boxes of one identity in the order of their frames, as
long as the gap between two of them is not too long.

`repaired` mends one kind of error of a result and leaves the rest as it is, so the gain in scores says what that kind
costs: all wrong and missed links, false boxes, false tracks. Links of one length cannot be mended alone, since one that
is set right contradicts others that are not; `link_counts` says how many of each length are missed and wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from tsuiseki.tracking.evaluation.coverage import IGNORED, NOBODY, owners_of
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray, Track
from tsuiseki.tracking.types.labels import GroundTruth

Repair = Literal["links", "false boxes", "false tracks"]
REPAIRS: tuple[Repair, ...] = get_args(Repair)
# Upper ends of the bins of gaps in which links are counted, seconds; the first is that of one frame to the next.
GAP_BINS = (0.4, 0.8, 2.0)


def right_links(
    detections: Sequence[Detections], truth: GroundTruth, longest: float = np.inf, filled: bool = False
) -> list[Track]:
    """The tracks that the right links over the detections give.

    Args:
        detections: of each frame.
        truth: the labels, their frames counted as those of the detections.
        longest: most frames from one detection to the next of the same track; 1 allows no gap.
        filled: put boxes on a straight line into the gaps.
    """
    frames = np.repeat(np.arange(len(detections)), [len(found) for found in detections])
    boxes, scores = _joined(detections)
    owners = owners_of(frames, boxes, truth)
    tracks: list[Track] = []
    for identity in np.unique(owners[owners >= 0]):
        mine = np.flatnonzero(owners == identity)
        for part in np.split(mine, np.flatnonzero(np.diff(frames[mine]) > longest) + 1):
            one = Track(len(tracks) + 1, frames[part], boxes[part], scores[part])
            tracks.append(straight(one, longest) if filled else one)
    return tracks


def straight(track: Track, longest: float) -> Track:
    """``track`` with boxes on straight lines in its gaps, where they are no longer than ``longest`` frames."""
    every = np.arange(track.frames[0], track.frames[-1] + 1)
    before = np.searchsorted(track.frames, every, side="right") - 1
    gap = np.diff(track.frames, append=track.frames[-1] + 1)[before]
    every = every[(gap <= longest) | np.isin(every, track.frames)]
    boxes = np.stack([np.interp(every, track.frames, side) for side in track.boxes.T], axis=1)
    scores = np.interp(every, track.frames, track.scores)
    return Track(track.id, every, boxes, scores, np.isin(every, track.frames[track.observed]))


@dataclass(frozen=True)
class LinkCounts:
    """How many links of each length there are to make, and what a result made of them.

    Attributes:
        bins: names of the lengths.
        right: ``(B,)`` pairs of successive boxes of one identity among the boxes of the result.
        made: ``(B,)`` those of them that bear one id.
        wrong: ``(B,)`` links of the result whose two boxes are not of one identity, both on somebody.
    """

    bins: tuple[str, ...]
    right: IntArray
    made: IntArray
    wrong: IntArray


@dataclass(frozen=True)
class _Boxes:
    """The detected boxes of a result as nodes, by frame, and the links between them."""

    frames: IntArray
    ids: IntArray
    boxes: FloatArray
    scores: FloatArray
    owners: IntArray
    ours: IntArray
    right: IntArray

    def gaps(self, links: IntArray) -> IntArray:
        return np.subtract(self.frames[links[:, 1]], self.frames[links[:, 0]])

    def agree(self, links: IntArray) -> BoolArray:
        return np.equal(self.owners[links[:, 0]], self.owners[links[:, 1]])


def link_counts(tracks: Sequence[Track], truth: GroundTruth, rate: float) -> LinkCounts:
    """Links of a result that are right, missed and wrong, by the length of the gap.

    Args:
        tracks: the result; boxes that were filled in are passed over.
        truth: the labels.
        rate: frames a second.
    """
    nodes = _boxes(tracks, truth)
    ends = (1.0, *(seconds * rate for seconds in GAP_BINS))
    right = np.searchsorted(ends, nodes.gaps(nodes.right))
    made = nodes.ids[nodes.right[:, 0]] == nodes.ids[nodes.right[:, 1]]
    both = (nodes.owners[nodes.ours] >= 0).all(axis=1)
    wrong = np.searchsorted(ends, nodes.gaps(nodes.ours))[both & ~nodes.agree(nodes.ours)]
    count = len(ends) + 1
    return LinkCounts(
        ("1 frame", *(f"≤ {seconds:g} s" for seconds in GAP_BINS), "longer"),
        np.bincount(right, minlength=count),
        np.bincount(right[made], minlength=count),
        np.bincount(wrong, minlength=count),
    )


def repaired(tracks: Sequence[Track], truth: GroundTruth, what: Repair) -> list[Track]:
    """The result's detected boxes with one kind of error mended; boxes that were filled in are left out.

    Args:
        tracks: the result.
        truth: the labels.
        what: links are replaced by the right ones wherever they meet somebody; false boxes are those on nobody; a track
            is false if more than half of its boxes are.
    """
    nodes = _boxes(tracks, truth)
    if what in ("false boxes", "false tracks"):
        nobody = nodes.owners == NOBODY
        if what == "false tracks":
            _, members = np.unique(nodes.ids, return_inverse=True)
            nobody = (np.bincount(members, nobody) > 0.5 * np.bincount(members))[members]
        return _tracks(nodes, nodes.ids, ~nobody)
    among_nobody = nodes.ours[(nodes.owners[nodes.ours] < 0).all(axis=1)]
    chains = _chains(len(nodes.frames), np.concatenate([nodes.right, among_nobody]))
    return _tracks(nodes, chains, np.ones(len(nodes.frames), dtype=np.bool_))


def _chains(count: int, links: IntArray) -> IntArray:
    """``(count,)`` a number a chain."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64) + 1


def _boxes(tracks: Sequence[Track], truth: GroundTruth) -> _Boxes:
    seen = [(t.frames[t.observed], np.full(int(t.observed.sum()), t.id), t.boxes[t.observed], t.scores[t.observed])
            for t in tracks]  # fmt: skip
    if not seen:
        none = np.empty(0, np.int64)
        return _Boxes(none, none, np.empty((0, 4)), np.empty(0), none, np.empty((0, 2), np.int64), none.reshape(0, 2))
    frames, ids, boxes, scores = (np.concatenate(parts) for parts in zip(*seen, strict=True))
    order = np.lexsort([ids, frames])
    frames, ids, boxes, scores = frames[order], ids[order], boxes[order], scores[order]
    owners = owners_of(frames, boxes, truth)
    counted = owners != IGNORED
    frames, ids, boxes, scores, owners = (a[counted] for a in (frames, ids, boxes, scores, owners))
    return _Boxes(frames, ids, boxes, scores, owners, _successive(frames, ids), _successive(frames, owners))


def _successive(frames: IntArray, keys: IntArray) -> IntArray:
    """``(L, 2)`` successive boxes of one key, keys below 0 left out."""
    order = np.lexsort([frames, keys])
    order = order[keys[order] >= 0]
    pairs = np.stack([order[:-1], order[1:]], axis=1)
    return np.asarray(pairs[keys[pairs[:, 0]] == keys[pairs[:, 1]]], dtype=np.int64)


def _tracks(nodes: _Boxes, ids: IntArray, which: BoolArray) -> list[Track]:
    tracks = []
    for number in np.unique(ids[which]):
        mine = np.flatnonzero((ids == number) & which)
        tracks.append(Track(int(number), nodes.frames[mine], nodes.boxes[mine], nodes.scores[mine]))
    return tracks


def _joined(detections: Sequence[Detections]) -> tuple[FloatArray, FloatArray]:
    if not detections:
        return np.empty((0, 4)), np.empty(0)
    return np.concatenate([d.boxes for d in detections]), np.concatenate([d.scores for d in detections])
