"""Labels out of tracks: whom the tracker is sure of, what it rejects, what never moves, and what a reviewer corrected.

A confident track is labelled in every frame, also where it was filled in: those are the misses that teach most. What no
label covers is background to learn from, except where somebody unknown may stand, or somebody known is hidden behind
others: there nothing is learnt.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.identity_crops import uncovered
from tsuiseki.tracking.association.tracklets import EXPLAINED, explained_boxes, is_straddling
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.correction_log import CORRECTIONS_FILE, CorrectedVideo, Correction, read_corrections
from tsuiseki.tracking.geometry import areas, clip_boxes, intersections, iou_matrix, iou_pairs, shared_with_all
from tsuiseki.tracking.types import BoolArray, Columns, Detections, FloatArray, IntArray, Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.adapt.foreground import (
    Difference,
    covered_share,
    detected_boxes,
    drawn_to_silhouettes,
    moving_blobs,
    usual_offset,
)
from tsuiseki.trainers.adapt.watch import Watched

TAKEN = "taken"
STILL = "never moves"
UNSURE = "unsure"
SHORT = "short"
TWICE = "twice"
DELETED = "deleted"
# Least mean score of the detections of a track that becomes labels.
_SURE = 0.5
# Least time over which such a track is detected, seconds.
_LEAST_SECONDS = 0.6
# Least share of a box that differs from the empty view, the median over the track: what differs less never moves.
_MOVING = 0.2
# Share of the way that boxes are moved onto silhouettes: their own where one is clear, or as boxes usually lie off.
ONTO_SILHOUETTES = 0.5
# A rejected detection of which this share differs from the empty view may be somebody.
_SOMEBODY = 0.35
# A box lies on another from this share of its area on.
_COVERED = 0.5
# Lowest moving blob that may be somebody, in heights of the lowest person.
_LOWEST_PERSON = 0.6
# First number of boxes of no track, above all ids of tracks.
_NAMES_OF_OTHERS = 1_000_000


# Label of a box that shows no person.
BACKGROUND = 0
# Label of a box that shows a person.
PERSON = 1
# Label of a person whose box was drawn by hand.
DRAWN = 2
SAME = 0.5
"""Intersection over union from which two boxes of a frame are one."""


@dataclass(frozen=True)
class CertainBoxes(Columns):
    """What corrections say of boxes.

    Attributes:
        frames: ``(N,)`` 0-based.
        boxes: ``(N, 4)`` pixels.
        kinds: ``(N,)`` `BACKGROUND`, `PERSON`, or `DRAWN` for a person whose box was drawn by hand.
    """

    frames: IntArray
    boxes: FloatArray
    kinds: IntArray

    def on(self, frames: IntArray, boxes: FloatArray) -> IntArray:
        """Kinds of those that lie on a track, whose ``(T,)`` ``frames`` increase."""
        place = np.searchsorted(frames, self.frames).clip(max=len(frames) - 1)
        overlapping = iou_pairs(boxes[place], self.boxes) >= SAME
        return np.asarray(self.kinds[overlapping & (frames[place] == self.frames)])


def corrections_in(path: Path, sources: Sequence[str]) -> Path:
    """The file of corrections of the only source: itself, or that of a reviewed result.

    Raises:
        RequestError: it is not there, or there are more sources.
    """
    if len(sources) > 1:
        raise RequestError(f"`corrections` speak of one video, got {len(sources)}; adapt to the corrected one")
    file = path / CORRECTIONS_FILE if path.is_dir() else path
    if not file.is_file():
        raise RequestError(f"`corrections`: expected a reviewed result or its {CORRECTIONS_FILE}, got {path}")
    return file


def certain_boxes(file: Path, size: tuple[int, int]) -> CertainBoxes:
    """The boxes of corrections of a video of a ``size``.

    Raises:
        RequestError: they cannot be read, or speak of a video of another size.
    """
    labelled = [
        row
        for correction in read_corrections(file, CorrectedVideo("", size, 0)).corrections
        for row in _boxes(correction)
    ]
    rows = np.array(labelled, dtype=np.float64).reshape(-1, 6)
    boxes = np.column_stack([rows[:, 1:3], rows[:, 1:3] + rows[:, 3:5]])
    return CertainBoxes(rows[:, 0].astype(np.int64), boxes, rows[:, 5].astype(np.int64))


def _boxes(correction: Correction) -> Iterator[tuple[float, ...]]:
    for part in correction.parts:
        yield from _boxes(part)
    kind = {"not_person": BACKGROUND, "delete": BACKGROUND, "box": DRAWN}.get(correction.kind, PERSON)
    yield from ((*box, kind) for box in correction.there[-1 if correction.kind == "box" else 0 :])


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
        """Those that became labels."""
        return [t for t, v in zip(self.everyone, self.verdicts, strict=True) if v.verdict == TAKEN]


@dataclass(frozen=True)
class _Entries(Columns):
    """Boxes ``(N, 4)`` of tracks with ``(N,)`` frames, places of the tracks, ids, and whether each was detected."""

    frames: IntArray
    places: IntArray
    ids: IntArray
    boxes: FloatArray
    detected: BoolArray
    sure: BoolArray
    """Whether the box is an example."""

    @classmethod
    def of(cls, tracks: Sequence[Track]) -> _Entries:
        """All boxes, none of them an example."""
        places = np.repeat(np.arange(len(tracks)), [len(track) for track in tracks])
        return cls(
            np.concatenate([np.empty(0, np.int64), *(track.frames for track in tracks)]),
            places,
            np.array([track.id for track in tracks], dtype=np.int64)[places],
            np.concatenate([np.empty((0, 4)), *(track.boxes for track in tracks)]),
            np.concatenate([np.empty(0, np.bool_), *(track.observed for track in tracks)]),
            np.zeros(len(places), dtype=np.bool_),
        )


def label(
    watched: Watched,
    tracks: Sequence[Track],
    detections: Sequence[Detections],
    sitting: bool = False,
    onto_silhouettes: float = ONTO_SILHOUETTES,
    certain: CertainBoxes | None = None,
) -> TrackLabels:
    """Choose what to learn from.

    Args:
        watched: the video.
        tracks: of the video, frames counted as in the video.
        detections: of each kept picture; those that lie on no track are rejected.
        sitting: what never moves is left out of the learning; otherwise it is background to learn from.
        onto_silhouettes: share of the way that boxes are moved onto silhouettes, in [0, 1].
        certain: what corrections say of the video.
    """
    tracked = _Entries.of(tracks)
    shares = _moving(tracked, len(tracks), watched)
    verdicts = [_judge(track, share, watched.frame_rate) for track, share in zip(tracks, shares, strict=True)]
    verdicts = [_as_given(verdict, track, certain) for verdict, track in zip(verdicts, tracks, strict=True)]
    # Of each track the boxes that lie on those of tracks that are taken.
    covered = explained_boxes(tracks, [verdict.verdict == TAKEN for verdict in verdicts])
    verdicts = [_unless_twice(verdict, track, on) for verdict, track, on in zip(verdicts, tracks, covered, strict=True)]
    verdicts = [_as_given(verdict, track, certain) for verdict, track in zip(verdicts, tracks, strict=True)]
    labelled = np.array([verdict.verdict == TAKEN for verdict in verdicts], dtype=np.bool_)[tracked.places]
    offset = _offset(tracked.select(labelled & tracked.detected), watched, onto_silhouettes)
    # A box that was filled in where others are shows a person who is hidden: no example.
    hidden = np.concatenate([np.empty(0, np.bool_), *covered]) & ~tracked.detected
    unlearnt = {TWICE, DELETED} if sitting else {TWICE, DELETED, STILL}
    background = np.array([verdict.verdict in unlearnt for verdict in verdicts], dtype=np.bool_)[tracked.places]
    entries = replace(tracked, sure=labelled & ~hidden).select(~background)
    rows = []
    for number, (frame, of_frame) in enumerate(zip(watched.frames, detections, strict=True)):
        picture, people = watched.difference(number), entries.select(entries.frames == frame)
        boxes = detected_boxes(people.boxes, people.detected, of_frame.boxes)
        if picture is not None:
            boxes = drawn_to_silhouettes(boxes, people.detected, picture, offset, onto_silhouettes)
        people = replace(people, boxes=boxes).select(_reach_in(boxes, watched.size))
        rejected = of_frame.select(~_on(of_frame.boxes, tracked.boxes[tracked.frames == frame]))
        certain_here = None if certain is None else certain.select(certain.frames == frame)
        rows.append(_rows(number, people, rejected, picture, certain_here))
    moved = tuple(_moved(track, offset, watched.size) for track in tracks)
    return TrackLabels(reduce(GroundTruth.and_then, rows), tuple(verdicts), moved, offset)


def _moving(entries: _Entries, count: int, watched: Watched) -> list[float]:
    """Of each of ``count`` tracks the median share of its boxes that is not the empty view; 1 where nothing tells."""
    shares = np.full(len(entries), np.nan)
    for number, frame in enumerate(watched.frames):
        rows = np.flatnonzero(entries.frames == frame)
        picture = watched.difference(number) if len(rows) else None
        if picture is not None:
            shares[rows] = covered_share(picture.different, entries.boxes[rows])
    by_track = [shares[entries.places == place] for place in range(count)]
    return [float(np.nanmedian(of_track)) if np.isfinite(of_track).any() else 1.0 for of_track in by_track]


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


def _offset(entries: _Entries, watched: Watched, share: float) -> FloatArray:
    """By how much to move boxes: part of what the detected ones of taken tracks usually lie off their silhouettes."""
    if share == 0:
        return np.zeros(4)
    offsets = [np.empty((0, 4))]
    for number, frame in enumerate(watched.frames):
        boxes = entries.boxes[entries.frames == frame]
        picture = watched.difference(number) if len(boxes) else None
        if picture is not None:
            offsets.append(picture.offsets(boxes))
    return share * usual_offset(np.concatenate(offsets))


def _moved(track: Track, offset: FloatArray, size: tuple[int, int]) -> Track:
    boxes = track.boxes + offset * np.tile(track.boxes[:, 2:] - track.boxes[:, :2], 2)
    in_view = _reach_in(boxes, size)
    return Track(track.id, track.frames[in_view], boxes[in_view], track.scores[in_view], track.observed[in_view])


def _reach_in(boxes: FloatArray, size: tuple[int, int]) -> BoolArray:
    """``(N,)`` of which boxes more than a line lies in the picture."""
    inside = clip_boxes(boxes, *size)
    return np.asarray(((inside[:, 2:] - inside[:, :2]) >= 2).all(axis=1))


def _rows(
    number: int, people: _Entries, rejected: Detections, picture: Difference | None, certain: CertainBoxes | None
) -> GroundTruth:
    """Labels of one picture."""
    people = people if certain is None else _corrected(people, certain)
    others = _perhaps_people(people.boxes, people.sure, rejected, picture)
    others = others if certain is None else others[~_alike(others, certain.boxes[certain.kinds == BACKGROUND])]
    boxes = np.concatenate([people.boxes, others])
    counted = np.concatenate([people.sure, np.zeros(len(others), dtype=np.bool_)])
    visibility = np.ones(len(boxes))
    visibility[: len(people.boxes)] = uncovered(people.boxes)
    names = np.concatenate([people.ids, _NAMES_OF_OTHERS + np.arange(len(others))])
    return GroundTruth(np.full(len(boxes), number), names.astype(np.int64), boxes, counted, ~counted, visibility)


def _corrected(people: _Entries, certain: CertainBoxes) -> _Entries:
    """Boxes of tracks in one frame, without false positives, with those drawn, and those that no track has."""
    still_people = people.select(~_alike(people.boxes, certain.boxes[certain.kinds != PERSON]))
    boxes = certain.boxes[(certain.kinds != BACKGROUND) & ~_alike(certain.boxes, still_people.boxes)]
    numbers, there = _NAMES_OF_OTHERS - 1 - np.arange(len(boxes)), np.ones(len(boxes), dtype=np.bool_)
    return still_people.and_then(_Entries(numbers, numbers, numbers, boxes, there, there))


def _alike(boxes: FloatArray, others: FloatArray) -> BoolArray:
    return np.asarray((iou_matrix(boxes, others) >= SAME).any(axis=1))


def _perhaps_people(
    people: FloatArray, sure: BoolArray, rejected: Detections, picture: Difference | None
) -> FloatArray:
    """``(M, 4)`` where somebody may be whom no track tells: neither an example nor a counter-example."""
    certain = people[sure]
    free = ~_on(rejected.boxes, certain)
    if picture is None:
        return rejected.boxes[free]
    different = free & (covered_share(picture.different, rejected.boxes) > _SOMEBODY)
    boxes = rejected.boxes[different]
    if not len(certain):
        return boxes
    least = _LOWEST_PERSON * float((certain[:, 3] - certain[:, 1]).min())
    blobs = moving_blobs(picture.bright, np.concatenate([people, boxes]), least)
    return np.concatenate([boxes, blobs])


def _on(boxes: FloatArray, others: FloatArray) -> BoolArray:
    """``(N,)`` which boxes lie mostly on one of ``others``, or nearly whole on several."""
    shared = intersections(boxes[:, None], others[None])
    on_one = (shared > _COVERED * areas(boxes)[:, None]).any(axis=1)
    return np.asarray(on_one | (shared_with_all(boxes, others) >= EXPLAINED))
