"""Scores of several people tracked at once: HOTA, CLEAR MOT and identity scores.

Sequences are prepared as MOTChallenge does it: results matched to a labelled box on which they are neither right nor
wrong are taken out, then only the pedestrians that count are scored. Where only every n-th frame was labelled, results
in the others are taken out, too. Boxes match from an overlap of 0.5 on; HOTA
averages over the overlaps 0.05, 0.10, … 0.95. The metrics are in `identity_metrics`.
"""

from __future__ import annotations

import functools
import operator
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.association.inference_times import inferred_frames, stride_of
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.identity_metrics import (
    Clear,
    Hota,
    Identity,
    LabelledSequence,
    Sums,
    clear,
    hota,
    identity,
)
from tsuiseki.tracking.formats.label_checks import compare_with_labels
from tsuiseki.tracking.formats.tracked_video import TrackedBoxes, boxes_of_tracks
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Track
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.types.labels import GroundTruth

# Intersection over union from which a box and a label match.
MATCH_OVERLAP = 0.5
# Share of the boxes outside the labelled frames that is worth a note.
MANY = 0.2


@dataclass(frozen=True)
class PeopleScores:
    """How well the people of one sequence, or of several together, were tracked.

    Attributes:
        hota: mean over the overlaps of the geometric mean of ``det_a`` and ``ass_a``, in [0, 1].
        det_a: detection accuracy, in [0, 1].
        ass_a: association accuracy, in [0, 1].
        mota: 1 minus misses, false boxes and switches per labelled box, thesis eq. 4.5; at most 1, may be negative.
        motp: mean overlap of the matched boxes, in [0, 1].
        idf1: share of the boxes that bear the right identity throughout, in [0, 1].
        id_switches: times that a person's id changed.
        false_positives: boxes on no labelled object.
        false_negatives: labelled boxes that were missed.
        recall: detected share of the labelled boxes, in [0, 1].
        precision: right share of the boxes, in [0, 1].
        labelled: number of labelled boxes.
    """

    hota: float
    det_a: float
    ass_a: float
    mota: float
    motp: float
    idf1: float
    id_switches: int
    false_positives: int
    false_negatives: int
    recall: float
    precision: float
    labelled: int


@dataclass(frozen=True)
class SequencePair:
    """The truth and the result of one sequence; a length of None takes the last frame of either."""

    name: str
    truth: GroundTruth
    tracks: list[Track]
    length: int | None = None


@dataclass(frozen=True)
class PeopleEvaluation:
    """Scores of a result on every sequence, and on all of them as if they were one."""

    sequences: Mapping[str, PeopleScores]
    combined: PeopleScores


@dataclass(frozen=True)
class PeopleSums(Sums):
    """The sums of a sequence, from which those of several are added up."""

    hota: Hota
    clear: Clear
    identity: Identity


def evaluate_sequence(truth: GroundTruth, tracks: list[Track], length: int | None = None) -> PeopleScores:
    """Scores of ``tracks`` against ``truth``.

    Args:
        truth: labels; those that are neither evaluated nor ignored (vehicles, say) are no target, but may take a match.
        tracks: the result.
        length: number of frames; None takes the last frame of either.

    Raises:
        RequestError: no labelled box counts, a track has a frame beyond ``length``, or two tracks bear one id.
    """
    return _summary(people_sums(SequencePair("sequence", truth, tracks, length)))


def evaluate_sequences(pairs: Iterable[SequencePair]) -> PeopleEvaluation:
    """Scores of every sequence and of all together.

    Raises:
        RequestError: there is no sequence, two bear one name, or `evaluate_sequence` refuses one.
    """
    sums: dict[str, PeopleSums] = {}
    for pair in pairs:
        if pair.name in sums:
            raise RequestError(f"expected sequences of different names, got {pair.name} twice")
        sums[pair.name] = people_sums(pair)
    if not sums:
        raise RequestError("expected a sequence to evaluate, got none")
    combined = functools.reduce(operator.add, sums.values())
    return PeopleEvaluation({name: _summary(total) for name, total in sums.items()}, _summary(combined))


def restrict(tracks: Iterable[Track], frames: FrameRange, listed: IntArray | None = None) -> list[Track]:
    """The parts of ``tracks`` within ``frames``, and in ``(N,)`` frames that are listed; None for all."""
    names = ("frames", "boxes", "scores", "observed", "origin")
    masks = [(track, frames.mask(track.frames)) for track in tracks]
    masks = masks if listed is None else [(part, inside & np.isin(part.frames, listed)) for part, inside in masks]
    return [
        replace(part, **{name: getattr(part, name)[inside] for name in names}) for part, inside in masks if inside.any()
    ]


def people_sums(pair: SequencePair) -> PeopleSums:
    """The sums of a sequence.

    Raises:
        RequestError: as `evaluate_sequence`.
    """
    if len({track.id for track in pair.tracks}) < len(pair.tracks):
        raise RequestError(f"{pair.name}: expected tracks of different ids, got an id twice")
    result = boxes_of_tracks(pair.tracks)
    sequence = labelled_sequence(pair.name, pair.truth, result, pair.length)
    counts = clear(sequence, MATCH_OVERLAP)
    if counts.false:
        compare_with_labels(pair.name, counts.hits, result.boxes, pair.truth.boxes)
    return PeopleSums(hota(sequence), counts, identity(sequence, MATCH_OVERLAP))


def _summary(sums: PeopleSums) -> PeopleScores:
    counts = sums.clear
    return PeopleScores(
        hota=float(sums.hota.hota.mean()),
        det_a=float(sums.hota.det_a.mean()),
        ass_a=float(sums.hota.ass_a.mean()),
        mota=counts.mota,
        motp=counts.motp,
        idf1=sums.identity.idf1,
        id_switches=counts.switches,
        false_positives=counts.false,
        false_negatives=counts.misses,
        recall=counts.recall,
        precision=counts.precision,
        labelled=counts.hits + counts.misses,
    )


def labelled_sequence(name: str, labels: GroundTruth, result: TrackedBoxes, length: int | None) -> LabelledSequence:
    """The boxes of a sequence that count, those of a result in the frames that `where_labelled` tells.

    Raises:
        RequestError: no labelled box counts, or a box has a frame beyond ``length``.
    """
    if not labels.evaluated.any():
        raise RequestError(f"{name}: expected a labelled box that counts, got none; is this the right file?")
    if not len(result.frames):
        warnings.warn(f"{name}: the result has no box; every score is 0", InputWarning, stacklevel=3)
    last = max(int(labels.frames[-1]), int(result.frames[-1]) if len(result.frames) else -1)
    if length is not None and last >= length:
        raise RequestError(
            f"{name}: expected frames up to {length}, got a box in frame {last + 1}; "
            "is this the result of another sequence?"
        )
    labelled = where_labelled(name, labels.frames, result.frames, length)
    return counted_boxes(labels, TrackedBoxes._make(column[labelled] for column in result))


def counted_boxes(labels: GroundTruth, result: TrackedBoxes) -> LabelledSequence:
    """The boxes that count: per frame the ids, numbered from 0, and the overlaps."""
    # Frames in which there is nothing change no score, and a file may have many of them.
    filled = np.unique(np.concatenate([labels.frames, result.frames]))
    true, reported, overlaps = [], [], []
    for a, b in zip(rows_by_frame(labels.frames, filled), rows_by_frame(result.frames, filled), strict=True):
        shared = iou_matrix(labels.boxes[a], result.boxes[b])
        counted = ~_on_ignored(shared, labels.ignored[a])
        true.append(labels.ids[a][labels.evaluated[a]])
        reported.append(result.ids[b][counted])
        overlaps.append(shared[labels.evaluated[a]][:, counted])
    return LabelledSequence.of(true, reported, overlaps)


def rows_by_frame(ordered: IntArray, frames: Sequence[int] | IntArray) -> list[slice]:
    """The rows of each of some ``frames`` in ``(N,)`` numbers of frames that are in order."""
    starts, ends = (np.searchsorted(ordered, frames, side=side).tolist() for side in ("left", "right"))
    return [slice(start, end) for start, end in zip(starts, ends, strict=True)]


def where_labelled(name: str, labels: IntArray, frames: IntArray, length: int | None) -> BoolArray:
    """``(N,)`` which boxes of a result lie in labelled frames, by `inferred_frames`; warns of others.

    Args:
        name: of the sequence.
        labels: frames of the labels, in order.
        frames: ``(N,)`` of the boxes, in order.
        length: number of frames, by the sequence's own word; None takes the last of either, and many boxes outside the
            labels' first and last frame are warned of.
    """
    first, end = int(labels[0]), int(labels[-1])
    outside = int(((frames < first) | (frames > end)).sum())
    if length is None and outside > MANY * len(frames):
        warnings.warn(
            f"{name}: {outside} of {len(frames)} boxes lie outside frames {first + 1}-{end + 1}, the "
            f"labelled ones, and count as false; `frames` {first + 1}-{end + 1} leaves them out",
            InputWarning,
            stacklevel=3,
        )
    last = int(max(end, frames.max(initial=0), (length or 1) - 1))
    labelled = inferred_frames(np.bincount(labels, minlength=last + 1))
    if labelled is None or labelled[frames].all():
        return np.ones(len(frames), dtype=np.bool_)
    warnings.warn(
        f"{name}: there are labels in {len(np.unique(labels))} of {last + 1} frames, about every "
        f"{stride_of(labelled):.3g}th one; the others are taken as not labelled, and results in them are not scored",
        InputWarning,
        stacklevel=3,
    )
    return np.asarray(labelled[frames])


def _on_ignored(overlaps: FloatArray, ignored: BoolArray) -> BoolArray:
    """``(M,)`` which results of a frame lie on ignored labels, from ``(N, M)`` overlaps with all its labels."""
    on_ignored = np.zeros(overlaps.shape[1], dtype=np.bool_)
    if not ignored.any():
        return on_ignored
    rows, columns = assign_overlaps(overlaps, MATCH_OVERLAP - np.finfo(np.float64).eps)
    on_ignored[columns[ignored[rows]]] = True
    return on_ignored
