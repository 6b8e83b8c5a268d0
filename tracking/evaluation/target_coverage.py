"""How well the tracks of many follow the one person who is labelled: frames covered, by how many tracks, switches.

Data sets of one target label one person of several in view. Scores over all tracks would count the others as false.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from tsuiseki.tracking.evaluation.coverage import coverage, spans
from tsuiseki.tracking.evaluation.multi import restrict
from tsuiseki.tracking.evaluation.pairs import RESULT_PLACES, SINGLE_RESULT_PLACES, result_file
from tsuiseki.tracking.evaluation.stretch import warn_of_other_frames
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.formats.single import SingleSequence
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.frame_range import EVERY_FRAME, FrameRange
from tsuiseki.tracking.types.labels import GroundTruth


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
    """Which of ``tracks`` are on a target when.

    Args:
        boxes: ``(T, 4)`` of the target, NaN where it is not to be seen.
        tracks: of everybody.
        overlap: of boxes from which a track is on the target, in (0, 1].
    """
    frames = np.flatnonzero(np.isfinite(boxes).all(axis=1))
    if not len(frames):
        return TargetCoverage(0, 0, 0, 0, 0, None, len(tracks))
    everyone = np.ones(len(frames), dtype=np.bool_)
    truth = GroundTruth(frames, everyone.astype(np.int64), boxes[frames], everyone, ~everyone, np.ones(len(frames)))
    (found,) = coverage(truth, tracks, overlap)
    ids = found.track_ids
    on = ids[ids > 0]
    stretches = [span.last - span.first + 1 for span in spans(found.frames, ids) if span.value]
    return TargetCoverage(
        len(frames), len(on), len(np.unique(on)), int((np.diff(on) != 0).sum()), max(stretches, default=0),
        int(found.frames[ids > 0][0]) if len(on) else None, len(tracks) - len(np.unique(on)),
    )  # fmt: skip


def cover_targets(
    sequences: Sequence[SingleSequence], result: Path, overlap: float, frames: FrameRange = EVERY_FRAME
) -> dict[str, TargetCoverage]:
    """Every labelled target, by the name of its sequence, against its tracks.

    A result that is of other frames than those that are scored is warned of.

    Args:
        sequences: with one labelled target each.
        result: a MOTChallenge text file where there is one sequence, or a folder, see `pairs`.
        overlap: see `target_coverage`.
        frames: that are scored.

    Raises:
        RequestError: a sequence has no result, or it is broken, or ``frames`` reaches beyond it.
    """
    return {one.name: _cover(one, result, len(sequences) == 1, overlap, frames) for one in sequences}


def _cover(target: SingleSequence, result: Path, alone: bool, overlap: float, frames: FrameRange) -> TargetCoverage:
    file = result_file(target.name, result, alone, RESULT_PLACES, SINGLE_RESULT_PLACES)
    tracks = read_tracks(file)
    wanted = frames.within(len(target.boxes))
    assert wanted.last is not None
    warn_of_other_frames(file, wanted.first, wanted.last)
    boxes = target.boxes.copy()
    boxes[~wanted.mask(np.arange(len(boxes)))] = np.nan
    return target_coverage(boxes, restrict(tracks, wanted), overlap)


def coverage_table(results: Mapping[str, Mapping[str, TargetCoverage]]) -> Table:
    """A row a sequence and result, for `rich`."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for heading in ("Sequence", "Result"):
        table.add_column(heading, no_wrap=True)
    for heading in ("Frames", "Covered [%]", "Tracks on it", "Switches", "Longest", "First frame", "Other tracks"):
        table.add_column(heading, justify="right", no_wrap=True)
    for sequence in next(iter(results.values())):
        for number, (name, found) in enumerate(results.items()):
            one = found[sequence]
            share = f"{100 * one.covered / one.labelled:.1f}" if one.labelled else "-"
            first = "-" if one.first is None else str(one.first + 1)
            counts = (one.tracks, one.switches, one.longest, first, one.others)
            table.add_row(
                Text("" if number else sequence), Text(name), str(one.labelled), share, *(str(c) for c in counts)
            )
        table.add_section()
    return table


def coverage_values(results: Mapping[str, Mapping[str, TargetCoverage]]) -> dict[str, Any]:
    """The same as plain values."""
    return {name: {sequence: asdict(one) for sequence, one in found.items()} for name, found in results.items()}
