"""Whether the status ``lost`` says the truth: within ten frames of losing the target, and not while it is followed.

Beside it stands how well the same passes follow. The constants of `recognition` and `seen_before` were chosen on the
given clips and on the first generated chases, which are therefore counted apart from those that nothing was chosen on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.single.constants import ROBUST, CombinedSettings
from tsuiseki.tracking.single.kcf import KcfSettings
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.experiments.single.runs import Clip, Ours, generated_clip, seeds_of, start
from tsuiseki.trainers.experiments.single.unseen import interval
from tsuiseki.trainers.experiments.store import Store
from tsuiseki.trainers.experiments.study import Outcome, Table

WITHIN = 10
FOLLOWED = 0.5
FIRST, SEEN, CHASES = 24, 48, 96
"""Chases up to the first of these chose `combined` and `recognition`, those up to the second `recognition` alone."""


@dataclass(frozen=True)
class Watched:
    """A tracker whose status is looked at.

    Attributes:
        entrant: the tracker.
        network: of appearance, by which it recognises a person; None leaves it out.
    """

    entrant: Ours
    network: Path | None = None


TRACKERS: Mapping[str, Watched] = {
    "KCF": Watched(KcfSettings()),
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
    tracker, truth = start(watched.entrant, seed, watched.network), clip.sequence.boxes
    tracker.start(clip.images[0], truth[0])
    states = [tracker.follow(image) for image in clip.images[1:]]
    overlaps = iou_pairs(truth[1:], np.array([state.box for state in states]))
    overlaps[~np.isfinite(truth[1:]).all(axis=1)] = np.nan
    return [[float(o), float(s.status == "lost")] for o, s in zip(overlaps, states, strict=True)]


def watch_chase(number: int, watched: Watched, seed: int) -> list[list[float]]:
    """`watch` on a generated chase."""
    return watch(_chase(number), watched, seed)


@lru_cache(maxsize=1)
def _chase(number: int) -> Clip:
    """Drawn once for all trackers, which follow it in turn: all chases together would fill the memory."""
    return generated_clip(number)


def _recalled(store: Store, clip: Clip | int, watched: Watched, seed: int) -> list[list[float]]:
    """`watch` of a given clip, or of the chase of a number."""
    if isinstance(clip, int):
        return store.recall(watch_chase, clip, watched, seed)
    return store.recall(watch, clip, watched, seed)


def _groups(clips: Sequence[Clip]) -> dict[str, Sequence[Clip | int]]:
    """The clips by kind; chases are numbers."""
    parts = [(0, FIRST), (FIRST, SEEN), (SEEN, CHASES), (FIRST, CHASES)]
    chases = {f"generated chases {low + 1} to {high}": range(low, high) for low, high in parts if low < high <= CHASES}
    return {"given clips": clips, **chases}


def passes(store: Store, clips: Sequence[Clip], seeds: Sequence[int]) -> Iterator[Callable[[], object]]:
    """Every pass that `lost_status` asks for, clip by clip."""
    for clip in [*clips, *range(CHASES)]:
        for watched in TRACKERS.values():
            for seed in seeds_of(watched.entrant, seeds):
                yield partial(_recalled, store, clip, watched, seed)


def lost_status(store: Store, clips: Sequence[Clip], seeds: Sequence[int]) -> Outcome:
    """A row a kind of clip and tracker: the given clips, and generated chases."""
    rows: list[tuple[str, ...]] = []
    values: dict[str, Any] = {}
    for kind, group in _groups(clips).items():
        base = None
        for name, watched in TRACKERS.items():
            passes = [
                [np.array(_recalled(store, clip, watched, seed)) for seed in seeds_of(watched.entrant, seeds)]
                for clip in group
            ]
            counts = sum((count_losses(one[:, 0], one[:, 1] > 0) for each in passes for one in each), LostCounts())
            areas = np.array([np.mean([area_of(one[:, 0]) for one in each]) for each in passes])
            base = areas if base is None else base
            mean, low, high = interval(areas - base)
            share = 100 * counts.alarms / counts.followed if counts.followed else 0.0
            over = "" if base is areas else f"{mean:+.1f} [{low:.1f}, {high:.1f}]"
            noticed = f"{counts.noticed} of {counts.losses}"
            rows.append((kind, name, f"{areas.mean():.1f}", over, noticed, f"{share:.1f}"))
            values[f"{name}, {kind}"] = {**vars(counts), "areas": areas.tolist()}
    columns = (
        "clips", "tracker", "AUC [%]", f"over {next(iter(TRACKERS))}, 95 % interval over clips",
        "losses noticed within 10 frames", "called lost while followed [% of frames]",
    )  # fmt: skip
    return Outcome({"status": values}, [Table("Status lost", columns, rows)])


def area_of(overlaps: FloatArray) -> float:
    """Area under the success curve in percent, 21 thresholds, of frames after the first, which counts as found."""
    known = np.append(overlaps[np.isfinite(overlaps)], 1.0)
    return 100 * float(np.mean(known[:, None] > np.linspace(0, 1, 21)))
