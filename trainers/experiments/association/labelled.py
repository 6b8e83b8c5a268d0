"""What the sequences' results are scored against."""

from __future__ import annotations

from dataclasses import replace

from tsuiseki.tracking.evaluation.multi import SequencePair, restrict
from tsuiseki.tracking.evaluation.truths import read_truths
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.experiments.association.sequences import Clip


def read_labels(clip: Clip) -> GroundTruth:
    """The labels of the frames that are kept, numbered from 0 as the tracks are."""
    (truth,) = read_truths(clip.labels, clip.stretch)
    labels, kept = truth.labels, clip.kept
    moved = labels.frames - kept.start
    labels = replace(labels, frames=moved // clip.every)
    return labels.select((moved >= 0) & (moved % clip.every == 0))


def with_labels(clip: Clip, tracks: list[Track]) -> SequencePair:
    """Labels and a result, whose frames count from 0 among those kept."""
    count = len(clip.kept)
    return SequencePair(clip.name, read_labels(clip), restrict(tracks, FrameRange(0, count - 1)), count)
