"""Which track follows which person when: what a timeline shows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.evaluation.multi import MATCH_OVERLAP, restrict, rows_by_frame
from tsuiseki.tracking.evaluation.result_files import RESULT_PLACES, result_file, warn_of_other_frames
from tsuiseki.tracking.evaluation.tables import sequence_table
from tsuiseki.tracking.formats.exports import read_boxes
from tsuiseki.tracking.formats.single import SingleSequence
from tsuiseki.tracking.formats.tracked_video import boxes_of_tracks
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import FloatArray, IntArray, Track
from tsuiseki.tracking.types.frame_range import EVERY_FRAME, FrameRange
from tsuiseki.tracking.types.labels import GroundTruth

if TYPE_CHECKING:
    from rich.table import Table


@dataclass(frozen=True)
class Coverage:
    """One person of the ground truth and the tracks that follow them.

    Attributes:
        id: of the person.
        frames: ``(N,)`` 0-based frames in which they are labelled and count.
        track_ids: ``(N,)`` id of the track on them in each, 0 where none is.
    """

    id: int
    frames: IntArray
    track_ids: IntArray


@dataclass(frozen=True)
class Span:
    """Frames ``first`` to ``last``, both included, in which a value stays the same."""

    first: int
    last: int
    value: int


def coverage(truth: GroundTruth, tracks: Iterable[Track], overlap: float = MATCH_OVERLAP) -> list[Coverage]:
    """The tracks on every person, matched frame by frame from an ``overlap`` on, in the order of appearance."""
    rows = truth.select(truth.evaluated)
    reported = boxes_of_tracks(tracks)
    label = matched_labels(reported.frames, reported.boxes, rows, overlap)
    track_ids = np.zeros(len(rows), dtype=np.int64)
    track_ids[label[label != UNMATCHED]] = reported.ids[label != UNMATCHED]
    people, first = np.unique(rows.ids, return_index=True)
    return [
        Coverage(int(person), rows.frames[rows.ids == person], track_ids[rows.ids == person])
        for person in people[np.argsort(first, kind="stable")]
    ]


def spans(frames: IntArray, values: IntArray) -> list[Span]:
    """Runs of equal ``values`` over consecutive ``frames``.

    >>> spans(np.array([0, 1, 2, 5]), np.array([7, 7, 0, 0]))
    [Span(first=0, last=1, value=7), Span(first=2, last=2, value=0), Span(first=5, last=5, value=0)]
    """
    breaks = np.flatnonzero((np.diff(frames) != 1) | (np.diff(values) != 0)) + 1
    pieces = np.split(np.arange(len(frames)), breaks) if len(frames) else []
    return [Span(int(frames[p[0]]), int(frames[p[-1]]), int(values[p[0]])) for p in pieces]


@dataclass(frozen=True)
class TargetCoverage:
    """Tracks against one labelled target.

    Attributes:
        labelled: frames in which the target is labelled.
        covered: of them, those in which a track is on it.
        tracks: that are on it in some frame.
        switches: how often another track than the last one is on it.
        longest: frames in a row with the same track on it.
        first: frame of the first of them all, from 0; None where no track ever is.
        others: tracks that are never on it.
    """

    labelled: int
    covered: int
    tracks: int
    switches: int
    longest: int
    first: int | None
    others: int


def target_coverage(boxes: np.ndarray, tracks: Sequence[Track], overlap: float = 0.5) -> TargetCoverage:
    """Which of ``tracks`` are on a target with boxes ``(T, 4)``, NaN out of view, from an ``overlap`` in (0, 1] on."""
    frames = np.flatnonzero(np.isfinite(boxes).all(axis=1))
    if not len(frames):
        return TargetCoverage(0, 0, 0, 0, 0, None, len(tracks))
    truth = GroundTruth.of_boxes(frames, np.ones(len(frames), dtype=np.int64), boxes[frames])
    (target,) = coverage(truth, tracks, overlap)
    ids = target.track_ids
    on = ids[ids > 0]
    lengths = [span.last - span.first + 1 for span in spans(target.frames, ids) if span.value]
    return TargetCoverage(
        len(frames), len(on), len(np.unique(on)), int((np.diff(on) != 0).sum()), max(lengths, default=0),
        int(target.frames[ids > 0][0]) if len(on) else None, len(tracks) - len(np.unique(on)),
    )  # fmt: skip


def cover_targets(
    sequences: Sequence[SingleSequence], result: Path, overlap: float, frames: FrameRange = EVERY_FRAME
) -> dict[str, TargetCoverage]:
    """Every labelled target, by the name of its sequence, against its tracks; see `target_coverage`.

    A result that is of other frames than those that are scored is warned of. It is a MOTChallenge text file where there
    is one sequence, or a folder, see `result_file`.

    Raises:
        RequestError: a sequence has no result, or it is broken, or ``frames`` reaches beyond it.
    """
    covered = {}
    for target in sequences:
        file = result_file(target.name, result, len(sequences) == 1, RESULT_PLACES)
        tracks = read_boxes(file)
        scored = frames.within(len(target.boxes))
        assert scored.last is not None
        warn_of_other_frames(file, scored.first, scored.last)
        boxes = np.where(scored.mask(np.arange(len(target.boxes)))[:, None], target.boxes, np.nan)
        covered[target.name] = target_coverage(boxes, restrict(tracks, scored), overlap)
    return covered


def coverage_table(results: Mapping[str, Mapping[str, TargetCoverage]]) -> Table:
    """A row a sequence and result."""
    headings = ("Frames", "Covered [%]", "Tracks on it", "Switches", "Longest", "First frame", "Other tracks")
    rows = {
        name: {sequence: _cells(target) for sequence, target in covered.items()} for name, covered in results.items()
    }
    return sequence_table(headings, rows)


def _cells(target: TargetCoverage) -> list[str]:
    share = f"{100 * target.covered / target.labelled:.1f}" if target.labelled else "-"
    first = "-" if target.first is None else str(target.first + 1)
    counts = target.tracks, target.switches, target.longest, first, target.others
    return [str(target.labelled), share, *map(str, counts)]


# Stands for the label of a box that is on none.
UNMATCHED = -1
# Stands for the owner of a box on a label that is neither right nor wrong.
IGNORED = -2


def matched_labels(frames: IntArray, boxes: FloatArray, truth: GroundTruth, least: float = MATCH_OVERLAP) -> IntArray:
    """``(N,)`` row of the label that each box is matched to for the largest sum of overlaps, or `UNMATCHED`.

    Args:
        frames: ``(N,)``.
        boxes: ``(N, 4)`` pixels.
        truth: the labels.
        least: intersection over union from which a box and a label match.
    """
    label = np.full(len(frames), UNMATCHED, dtype=np.int64)
    shared, parts = np.intersect1d(frames, truth.frames), []
    for numbers in (frames, truth.frames):
        order = np.argsort(numbers, kind="stable")
        parts.append([order[rows] for rows in rows_by_frame(numbers[order], shared)])
    for here, labels in zip(*parts, strict=True):
        rows, columns = assign_overlaps(iou_matrix(truth.boxes[labels], boxes[here]), least)
        label[here[columns]] = labels[rows]
    return label


def owners_of(frames: IntArray, boxes: FloatArray, truth: GroundTruth, least: float = MATCH_OVERLAP) -> IntArray:
    """``(N,)`` whose each box is: an id of the labels, `UNMATCHED` or `IGNORED`.

    Args:
        frames: ``(N,)``.
        boxes: ``(N, 4)`` pixels.
        truth: the labels; those that are neither evaluated nor ignored own nothing.
        least: intersection over union from which a label owns a box.
    """
    labels = truth.select(truth.evaluated | truth.ignored)
    label = matched_labels(frames, boxes, labels, least)
    # Index -1, a false positive, picks the appended one.
    return np.append(np.where(labels.ignored, IGNORED, labels.ids), UNMATCHED)[label]
