"""Scores of results and of the right links on every sequence: what the experiment keeps beside the tracks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.evaluation.coverage import owners_of
from tsuiseki.tracking.evaluation.resampling import score_sums
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.association.labelled import read_labels, with_labels
from tsuiseki.trainers.experiments.association.oracle import (
    LinkCounts,
    Repair,
    link_counts,
    repaired,
    right_links,
)
from tsuiseki.trainers.experiments.association.sequences import (
    Clip,
    read_clip,
    tracks_of,
)


@dataclass(frozen=True)
class Result:
    """A result on some sequences.

    Attributes:
        name: of the row.
        sums: ``(S, 83)`` of each sequence, see `score_sums`.
        settings: where its settings come from.
    """

    name: str
    sums: FloatArray
    settings: str = ""


def clip_sums(clip: Clip, table: FloatArray) -> FloatArray:
    """Sums of a result on one sequence."""
    return score_sums(with_labels(clip, tracks_of(table)))


def right_sums(clip: Clip, seconds: float, filled: bool) -> FloatArray:
    """Sums of the right links over the detections, gaps of up to so many seconds bridged."""
    tracks = right_links(read_clip(clip), read_labels(clip), max(1.0, seconds * clip.rate), filled)
    return score_sums(with_labels(clip, tracks))


def repaired_sums(clip: Clip, table: FloatArray, what: Repair) -> FloatArray:
    """Sums of a result with one kind of error mended."""
    return score_sums(with_labels(clip, repaired(tracks_of(table), read_labels(clip), what)))


def counted_links(clip: Clip, table: FloatArray) -> LinkCounts:
    """Links of a result by the length of the gap."""
    return link_counts(tracks_of(table), read_labels(clip), clip.rate)


def found_counts(clip: Clip) -> tuple[int, int, int]:
    """Detections on a label that counts, one to one and without any ignored; labels that count; detections."""
    found, truth = read_clip(clip), read_labels(clip)
    frames = np.repeat(np.arange(len(found)), [len(one) for one in found])
    counting = truth.select(truth.evaluated)
    owners = owners_of(frames, np.concatenate([one.boxes for one in found]), counting)
    return int((owners >= 0).sum()), len(counting), len(frames)
