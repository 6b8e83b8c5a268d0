"""Whether the status ``lost`` says the truth: within ten frames of losing the target, and not while it is followed.

The constants of `recognition` were chosen on the first generated chases, which are therefore counted apart.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np

from tsuiseki.tracking.features.networks.exported import Appearance
from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.trackers.single.combined import CombinedSettings
from tsuiseki.tracking.trackers.single.kcf_particle_settings import ROBUST
from tsuiseki.tracking.trackers.single.recognition import Recognised
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.experiments.experiment import Outcome, Table
from tsuiseki.trainers.experiments.single.runs import Clip, Ours, generated_clips, seeds_of, start
from tsuiseki.trainers.experiments.store import Store

WITHIN = 10
FOLLOWED = 0.5
SEEN, CHASES = 8, 24


@dataclass(frozen=True)
class Watched:
    """A tracker whose status is looked at.

    Attributes:
        entrant: the tracker.
        network: of appearance, which also has a say in its status; None leaves it out.
    """

    entrant: Ours
    network: Path | None = None


TRACKERS: Mapping[str, Watched] = {
    "combined": Watched(CombinedSettings()),
    "combined, --recognise": Watched(CombinedSettings(), shipped("appearance_people")),
    "kcf-particle, robust": Watched(ROBUST),
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


def watch(clip: Clip, watched: Watched, seed: int) -> list[list[float]]:
    """Overlap and whether the status was lost, a row a frame after the first."""
    tracker, truth = start(watched.entrant, seed), clip.sequence.boxes
    if watched.network is not None:
        tracker = Recognised(tracker, Appearance(watched.network, threads=1).describe)
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
    for watched in TRACKERS.values():
        for clip in everything:
            for seed in seeds_of(watched.entrant, seeds):
                yield partial(store.recall, watch, clip, watched, seed)


def lost_status(store: Store, clips: Sequence[Clip], seeds: Sequence[int]) -> Outcome:
    """A row a tracker and kind of clip: the given ones, and generated chases."""
    rows, values = [], {}
    chases = _chases(CHASES)
    groups = {
        "given clips": clips,
        f"generated chases 1 to {SEEN}": chases[:SEEN],
        f"generated chases {SEEN + 1} to {CHASES}": chases[SEEN:],
    }
    for name, watched in TRACKERS.items():
        for kind, group in groups.items():
            counts = LostCounts()
            for clip in group:
                for seed in seeds_of(watched.entrant, seeds):
                    found = np.array(store.recall(watch, clip, watched, seed))
                    counts += count_losses(found[:, 0], found[:, 1] > 0)
            share = 100 * counts.alarms / counts.followed if counts.followed else 0.0
            rows.append((name, kind, f"{counts.noticed} of {counts.losses}", f"{share:.1f}"))
            values[f"{name}, {kind}"] = vars(counts)
    columns = ("tracker", "clips", "losses noticed within 10 frames", "called lost while followed [% of frames]")
    return Outcome({"status": values}, [Table("Status lost", columns, rows)])
