"""Whether the status ``lost`` says the truth: within ten frames of losing the target, and not while it is followed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.trackers.single.combined import CombinedSettings
from tsuiseki.tracking.trackers.single.kcf_particle_settings import ROBUST
from tsuiseki.tracking.trackers.single.regularised import RegularisedSettings
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.trainers.experiments.experiment import Outcome, Table
from tsuiseki.trainers.experiments.single.runs import Clip, Ours, generated_clips, seeds_of, start
from tsuiseki.trainers.experiments.store import Store

WITHIN = 10
FOLLOWED = 0.5
CHASES = 16
TRACKERS: Mapping[str, Ours] = {
    "combined": CombinedSettings(),
    "regularised": RegularisedSettings(),
    "kcf-particle, robust": ROBUST,
}


@dataclass(frozen=True)
class LostCounts:
    """What the status said.

    Attributes:
        losses: stretches of ten frames and more without any overlap.
        noticed: of them, those called lost within ten frames.
        followed: frames with an overlap above 0.5.
        alarms: of them, those called lost.
    """

    losses: int = 0
    noticed: int = 0
    followed: int = 0
    alarms: int = 0

    def __add__(self, other: LostCounts) -> LostCounts:
        return LostCounts(
            self.losses + other.losses,
            self.noticed + other.noticed,
            self.followed + other.followed,
            self.alarms + other.alarms,
        )


def count_losses(overlaps: FloatArray, lost: BoolArray) -> LostCounts:
    """Counts of one pass.

    Args:
        overlaps: ``(T,)`` with the true box, in [0, 1]; NaN without label, which ends a stretch.
        lost: ``(T,)`` whether the status was ``lost``.
    """
    gone = np.concatenate([[False], overlaps <= 0, [False]]).astype(np.int8)
    starts, ends = np.flatnonzero(np.diff(gone) == 1), np.flatnonzero(np.diff(gone) == -1)
    long = ends - starts >= WITHIN
    noticed = sum(bool(lost[begin : begin + WITHIN].any()) for begin in starts[long])
    followed = overlaps > FOLLOWED
    return LostCounts(int(long.sum()), noticed, int(followed.sum()), int((followed & lost).sum()))


def watch(clip: Clip, entrant: Ours, seed: int) -> list[list[float]]:
    """Overlap and whether the status was lost, a row a frame after the first."""
    tracker, truth = start(entrant, seed), clip.sequence.boxes
    tracker.start(clip.images[0], truth[0])
    states = [tracker.follow(image) for image in clip.images[1:]]
    overlaps = iou_pairs(truth[1:], np.array([state.box for state in states]))
    return [[float(o), float(s.status == "lost")] for o, s in zip(overlaps, states, strict=True)]


@cache
def _chases(count: int) -> list[Clip]:
    """The generated clips, drawn once for the passes and the table."""
    return generated_clips(count)


def passes(store: Store, clips: Sequence[Clip], seeds: Sequence[int]) -> Iterator[partial[list[list[float]]]]:
    """Every pass that `lost_status` asks for."""
    everything = [*clips, *_chases(CHASES)]
    for entrant in TRACKERS.values():
        for clip in everything:
            for seed in seeds_of(entrant, seeds):
                yield partial(store.recall, watch, clip, entrant, seed)


def lost_status(store: Store, clips: Sequence[Clip], seeds: Sequence[int]) -> Outcome:
    """A row a tracker and kind of clip: the given ones, and generated chases."""
    rows, values = [], {}
    groups = {"given clips": clips, f"{CHASES} generated chases": _chases(CHASES)}
    for name, entrant in TRACKERS.items():
        for kind, group in groups.items():
            counts = LostCounts()
            for clip in group:
                for seed in seeds_of(entrant, seeds):
                    found = np.array(store.recall(watch, clip, entrant, seed))
                    counts += count_losses(found[:, 0], found[:, 1] > 0)
            share = 100 * counts.alarms / counts.followed if counts.followed else 0.0
            rows.append((name, kind, f"{counts.noticed} of {counts.losses}", f"{share:.1f}"))
            values[f"{name}, {kind}"] = vars(counts)
    columns = ("tracker", "clips", "losses noticed within 10 frames", "called lost while followed [% of frames]")
    return Outcome({"status": values}, [Table("Status lost", columns, rows)])
