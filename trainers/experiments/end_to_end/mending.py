"""What the default's errors cost: its boxes with one kind of error mended, and the right links over all detections.

Nothing is filled into gaps here, since a mended track is known at its detections alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tsuiseki.tracking.evaluation.resampling import score_sums
from tsuiseki.tracking.types import FloatArray, Track
from tsuiseki.trainers.experiments.association.labelled import with_labels
from tsuiseki.trainers.experiments.association.oracle import Repair
from tsuiseki.trainers.experiments.association.runs import Result, repaired_sums, right_sums
from tsuiseki.trainers.experiments.association.sequences import Clip, tracks_of
from tsuiseki.trainers.experiments.end_to_end.runs import default_table
from tsuiseki.trainers.experiments.experiment import Bench

UNFILLED = "default, gaps not filled"
MENDED: dict[str, Repair] = {"… its links mended": "links", "… its false boxes left out": "false boxes"}
RIGHT = "right links over all detections"


def mended(bench: Bench, clips: Sequence[Clip], gap: float) -> list[Result]:
    """Rows of the default, of it with its links mended, without its false boxes, and of the right links.

    Args:
        bench: where it works.
        clips: the sequences.
        gap: seconds that the right links bridge at most.
    """
    recall = bench.store.recall
    tables = [recall(default_table, clip) for clip in bench.watch.over(clips, UNFILLED)]
    pairs = list(zip(clips, tables, strict=True))
    rows = [Result(UNFILLED, np.stack([recall(unfilled_sums, *pair) for pair in pairs]), "the tracker's own")]
    rows += [
        Result(name, np.stack([recall(repaired_sums, *pair, what) for pair in pairs]), "labels")
        for name, what in MENDED.items()
    ]
    return [*rows, Result(RIGHT, np.stack([recall(right_sums, clip, gap, False) for clip in clips]), "labels")]


def unfilled_sums(clip: Clip, table: FloatArray) -> FloatArray:
    """Sums of a result without the boxes that were filled in, see `score_sums`."""
    return score_sums(with_labels(clip, [_seen(track) for track in tracks_of(table)]))


def _seen(track: Track) -> Track:
    part = track.observed
    return replace(
        track, frames=track.frames[part], boxes=track.boxes[part], scores=track.scores[part], observed=part[part]
    )
