"""Labels out of tracks: whom the tracker is sure of, what it rejects, and what never moves.

A confident track is labelled in every frame, also where it was filled in: those are the misses that teach most. What no
label covers is background to learn from, except where somebody unknown may stand, or somebody known is hidden behind
others: there nothing is learnt.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.datamodules.identity_crops import uncovered
from tsuiseki.tracking.association.tracklets import EXPLAINED, explained_boxes, is_straddling
from tsuiseki.tracking.geometry import areas, clip_boxes, intersections, iou_matrix, shared_with_all
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray, Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.adapt.certain import BACKGROUND, PERSON, SAME, CertainBoxes
from tsuiseki.trainers.adapt.foreground import (
    Difference,
    covered_share,
    detected_boxes,
    drawn_to_silhouettes,
    moving_blobs,
    usual_offset,
)
from tsuiseki.trainers.adapt.watch import Foreground, Watched

TAKEN, STILL, UNSURE, SHORT, TWICE, DELETED = "taken", "never moves", "unsure", "short", "twice", "deleted"
# Least mean score of the detections of a track that becomes labels, and least seconds of them.
_SURE, _LEAST_SECONDS = 0.5, 0.6
# Least share of a box that differs from the empty view, the median over the track: what differs less never moves.
_MOVING = 0.2
# Share of the way that boxes are moved onto silhouettes: their own where one is clear, or as boxes usually lie off.
ONTO_SILHOUETTES = 0.5
# A rejected detection of which this share differs from the empty view may be somebody.
_SOMEBODY = 0.35
_COVERED = 0.5
_LOWEST_PERSON = 0.6
_NAMES_OF_OTHERS = 1_000_000


@dataclass(frozen=True)
class Verdict:
    """What became of a track.

    Attributes:
        id: of the track.
        verdict: taken, never moves, unsure (a low score, or filled in for the most part), short, twice (it lies on
            surer tracks), or deleted by a correction.
        boxes: of it.
        filled: of them that no detection supports.
        score: mean of its detections.
        moving: median share of its boxes that differs from the empty view; 1 where there is none.
    """

    id: int
    verdict: str
    boxes: int
    filled: int
    score: float
    moving: float


@dataclass(frozen=True)
class TrackLabels:
    """What a video teaches.

    Attributes:
        people: labels of the kept pictures, by their number: evaluated ones teach, ignored ones do not.
        verdicts: on the tracks.
        everyone: all tracks, their boxes moved as silhouettes usually lie; in frames of the video.
        offset: ``(4,)`` by how much those were moved, left, top, right and bottom, in widths and heights.
    """

    people: GroundTruth
    verdicts: tuple[Verdict, ...]
    everyone: tuple[Track, ...]
    offset: FloatArray

    @property
    def tracks(self) -> list[Track]:
        """Those taken."""
        return [t for t, v in zip(self.everyone, self.verdicts, strict=True) if v.verdict == TAKEN]


@dataclass(frozen=True)
class _Entries:
    """What tracks say: ``(N,)`` frames, ids, whether the box is an example, and was detected; ``(N, 4)`` boxes."""

    frames: IntArray
    ids: IntArray
    boxes: FloatArray
    sure: BoolArray
    detected: BoolArray

    def select(self, which: BoolArray) -> _Entries:
        """Those at a mask ``(N,)``."""
        return _Entries(self.frames[which], self.ids[which], self.boxes[which], self.sure[which], self.detected[which])


def label(
    watched: Watched,
    foreground: Foreground | None,
    tracks: Sequence[Track],
    found: Sequence[Detections],
    sitting: bool = False,
    onto_silhouettes: float = ONTO_SILHOUETTES,
    certain: CertainBoxes | None = None,
) -> TrackLabels:
    """Choose what to learn from.

    Args:
        watched: the video.
        foreground: of its kept pictures; None where the camera moves.
        tracks: of the video, frames counted as in the video.
        found: detections of each kept picture; those that lie on no track are rejected.
        sitting: what never moves is left out of the learning; otherwise it is background to learn from.
        onto_silhouettes: share of the way that boxes are moved onto silhouettes, in [0, 1].
        certain: what corrections say of the video.
    """
    number_of = {frame: number for number, frame in enumerate(watched.frames)}
    shares = _moving(tracks, foreground, number_of)
    verdicts = [_judge(track, share, watched.frame_rate) for track, share in zip(tracks, shares, strict=True)]
    verdicts = [_as_given(one, track, certain) for one, track in zip(verdicts, tracks, strict=True)]
    # Of each track the boxes that lie on those of tracks that are taken.
    covered = explained_boxes(tracks, [one.verdict == TAKEN for one in verdicts])
    verdicts = [_unless_twice(one, track, on) for one, track, on in zip(verdicts, tracks, covered, strict=True)]
    verdicts = [_as_given(one, track, certain) for one, track in zip(verdicts, tracks, strict=True)]
    offset = _offset(tracks, verdicts, foreground, number_of, onto_silhouettes)
    # A box that was filled in where others are shows a person who is hidden: no example.
    entries = _together([
        _entries(track, one, on & ~track.observed, sitting)
        for track, one, on in zip(tracks, verdicts, covered, strict=True)
    ])  # fmt: skip
    rejected = _rejected(watched.frames, found, tracks)
    rows = []
    for number, frame in enumerate(watched.frames):
        picture = None if foreground is None else foreground.picture(number)
        people = _placed(entries.select(entries.frames == frame), found[number], picture, offset, onto_silhouettes)
        people = people.select(_reach_in(people.boxes, watched.size))
        given = None if certain is None else certain.at(frame)
        rows.append(_rows(number, people, rejected[number], picture, given))
    moved = tuple(_moved(track, offset, watched.size) for track in tracks)
    columns = ("frames", "ids", "boxes", "evaluated", "ignored", "visibility")
    joined = GroundTruth(*(np.concatenate([getattr(part, name) for part in rows]) for name in columns))
    return TrackLabels(joined, tuple(verdicts), moved, offset)


def _moving(tracks: Sequence[Track], foreground: Foreground | None, number_of: dict[int, int]) -> list[float]:
    """Of each track the median share of its boxes that differs from the empty view; 1 where nothing tells."""
    if foreground is None:
        return [1.0] * len(tracks)
    frames = np.concatenate([np.empty(0, np.int64), *(track.frames for track in tracks)])
    boxes = np.concatenate([np.empty((0, 4)), *(track.boxes for track in tracks)])
    shares = np.full(len(frames), np.nan)
    for frame, number in number_of.items():
        here = np.flatnonzero(frames == frame)
        if len(here):
            shares[here] = covered_share(foreground.picture(number).different, boxes[here])
    ends = np.cumsum([0, *map(len, tracks)])
    own = [shares[first:end] for first, end in itertools.pairwise(ends)]
    return [float(np.nanmedian(each)) if np.isfinite(each).any() else 1.0 for each in own]


def _judge(track: Track, moving: float, frame_rate: float) -> Verdict:
    observed = track.observed
    score = float(track.scores[observed].mean()) if observed.any() else 0.0
    if moving < _MOVING:
        verdict = STILL
    elif score < _SURE or 2 * observed.sum() < len(track):
        verdict = UNSURE
    elif observed.sum() < max(3, _LEAST_SECONDS * frame_rate):
        verdict = SHORT
    else:
        verdict = TAKEN
    return Verdict(track.id, verdict, len(track), int((~observed).sum()), score, moving)


def _unless_twice(verdict: Verdict, track: Track, explained: BoolArray) -> Verdict:
    """The verdict, or that most detections of the track lie on surer ones."""
    twice = verdict.verdict != STILL and is_straddling(track, explained)
    return replace(verdict, verdict=TWICE) if twice else verdict


def _as_given(verdict: Verdict, track: Track, certain: CertainBoxes | None) -> Verdict:
    """The verdict, or what corrections say: deleted where most detections were, taken where one is a person."""
    kinds = np.empty(0) if certain is None else certain.on(track.frames, track.boxes)
    if 2 * (kinds == BACKGROUND).sum() > track.observed.sum():
        return replace(verdict, verdict=DELETED)
    return replace(verdict, verdict=TAKEN) if (kinds != BACKGROUND).any() else verdict


def _offset(
    tracks: Sequence[Track],
    verdicts: Sequence[Verdict],
    foreground: Foreground | None,
    number_of: dict[int, int],
    share: float,
) -> FloatArray:
    """By how much to move boxes: part of what those of taken tracks usually lie off their silhouettes."""
    if foreground is None or share == 0:
        return np.zeros(4)
    boxes: dict[int, list[FloatArray]] = {}
    for track, verdict in zip(tracks, verdicts, strict=True):
        if verdict.verdict == TAKEN:
            for frame, box in zip(track.frames[track.observed].tolist(), track.boxes[track.observed], strict=True):
                boxes.setdefault(frame, []).append(box)
    found = [
        foreground.picture(number).offsets(np.stack(boxes[frame]))
        for frame, number in number_of.items()
        if frame in boxes
    ]
    return share * usual_offset(np.concatenate([np.empty((0, 4)), *found]))


def _moved(track: Track, offset: FloatArray, size: tuple[int, int]) -> Track:
    boxes = track.boxes + offset * np.tile(track.boxes[:, 2:] - track.boxes[:, :2], 2)
    kept_rows = _reach_in(boxes, size)
    return Track(
        track.id, track.frames[kept_rows], boxes[kept_rows], track.scores[kept_rows], track.observed[kept_rows]
    )


def _reach_in(boxes: FloatArray, size: tuple[int, int]) -> BoolArray:
    """``(N,)`` of which boxes more than a line lies in the picture."""
    inside = clip_boxes(boxes, *size)
    return np.asarray(((inside[:, 2:] - inside[:, :2]) >= 2).all(axis=1))


def _entries(track: Track, verdict: Verdict, unseen: BoolArray, sitting: bool) -> _Entries:
    """What a track says in each frame; nothing, where it is background to learn from."""
    background = verdict.verdict in (TWICE, DELETED) or (verdict.verdict == STILL and not sitting)
    sure = (verdict.verdict == TAKEN) & ~unseen
    every = _Entries(track.frames, np.full(len(track), track.id), track.boxes, sure, track.observed)
    return every.select(np.full(len(track), not background))


def _together(parts: Sequence[_Entries]) -> _Entries:
    """What all tracks say."""
    return _Entries(
        np.concatenate([np.empty(0, np.int64), *(each.frames for each in parts)]),
        np.concatenate([np.empty(0, np.int64), *(each.ids for each in parts)]),
        np.concatenate([np.empty((0, 4)), *(each.boxes for each in parts)]),
        np.concatenate([np.empty(0, np.bool_), *(each.sure for each in parts)]),
        np.concatenate([np.empty(0, np.bool_), *(each.detected for each in parts)]),
    )


def _placed(
    people: _Entries, found: Detections, picture: Difference | None, offset: FloatArray, share: float
) -> _Entries:
    """What tracks say in one frame, each box where its person is in that frame."""
    boxes = detected_boxes(people.boxes, people.detected, found.boxes)
    if picture is not None:
        boxes = drawn_to_silhouettes(boxes, people.detected, picture, offset, share)
    return replace(people, boxes=boxes)


def _rows(
    number: int, people: _Entries, rejected: Detections, picture: Difference | None, given: CertainBoxes | None
) -> GroundTruth:
    """Labels of one picture."""
    people = people if given is None else _corrected(people, given)
    others = _perhaps_people(people.boxes, people.sure, rejected, picture)
    others = others if given is None else others[~_alike(others, given.boxes[given.kinds == BACKGROUND])]
    every = np.concatenate([people.boxes, others])
    counted = np.concatenate([people.sure, np.zeros(len(others), dtype=np.bool_)])
    visibility = np.ones(len(every))
    visibility[: len(people.boxes)] = uncovered(people.boxes)
    names = np.concatenate([people.ids, _NAMES_OF_OTHERS + np.arange(len(others))])
    return GroundTruth(np.full(len(every), number), names.astype(np.int64), every, counted, ~counted, visibility)


def _corrected(people: _Entries, given: CertainBoxes) -> _Entries:
    """Boxes of tracks in one frame, without false positives, with those drawn, and those that no track has."""
    kept = people.select(~_alike(people.boxes, given.boxes[given.kinds != PERSON]))
    boxes = given.boxes[(given.kinds != BACKGROUND) & ~_alike(given.boxes, kept.boxes)]
    numbers, there = _NAMES_OF_OTHERS - 1 - np.arange(len(boxes)), np.ones(len(boxes), dtype=np.bool_)
    return _together([kept, _Entries(numbers, numbers, boxes, there, there)])


def _alike(boxes: FloatArray, others: FloatArray) -> BoolArray:
    return np.asarray((iou_matrix(boxes, others) >= SAME).any(axis=1))


def _perhaps_people(
    people: FloatArray, sure: BoolArray, rejected: Detections, picture: Difference | None
) -> FloatArray:
    """``(M, 4)`` where somebody may be whom no track tells: neither an example nor a counter-example."""
    known = people[sure]
    free = ~_on(rejected.boxes, known)
    if picture is None:
        return rejected.boxes[free]
    somebody = free & (covered_share(picture.different, rejected.boxes) > _SOMEBODY)
    boxes = rejected.boxes[somebody]
    if not len(known):
        return boxes
    least = _LOWEST_PERSON * float((known[:, 3] - known[:, 1]).min())
    blobs = moving_blobs(picture.bright, np.concatenate([people, boxes]), least)
    return np.concatenate([boxes, blobs])


def _on(boxes: FloatArray, known: FloatArray) -> BoolArray:
    """``(N,)`` which boxes lie mostly on one of ``known``, or nearly whole on several."""
    shared = intersections(boxes[:, None], known[None])
    on_one = (shared > _COVERED * areas(boxes)[:, None]).any(axis=1)
    return np.asarray(on_one | (shared_with_all(boxes, known) >= EXPLAINED))


def _rejected(kept: Sequence[int], found: Sequence[Detections], tracks: Sequence[Track]) -> list[Detections]:
    """The detections of each kept picture, of frames ``kept``, that lie on no track."""
    frames: IntArray = np.concatenate([np.empty(0, np.int64), *(t.frames for t in tracks)])
    boxes = np.concatenate([np.empty((0, 4)), *(t.boxes for t in tracks)])
    return [here.select(~_on(here.boxes, boxes[frames == frame])) for frame, here in zip(kept, found, strict=True)]
