"""What is known of detections along the tracks that they belong to, and what of it a new solution changes.

What the past of its track says at a detection depends on the last ones before it, what the future says on the next ones
after it. From one solution to the next most tracks stay as they are, so filters run again only near what has changed,
and only links with an end there need another price.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.association.flow.seen import Seen
from tsuiseki.tracking.association.tracklets.chain_motion import (
    RUN_UP,
    Beliefs,
    MotionNoise,
    beliefs_alone,
    beliefs_along,
    joined_beliefs,
)
from tsuiseki.tracking.types import BoolArray, IntArray


@dataclass(frozen=True)
class Along:
    """What is known at N detections.

    Attributes:
        follower: ``(N,)`` number of what follows each on its track, -1 for nothing.
        past: what the past of its track says at each detection.
        future: likewise of the future.
        ending: ``(N,)`` whether links over long gaps were looked for from there.
        beginning: ``(N,)`` whether they were looked for to there.
    """

    follower: IntArray
    past: Beliefs
    future: Beliefs
    ending: BoolArray
    beginning: BoolArray

    @classmethod
    def alone(cls, seen: Seen, motion: MotionNoise) -> Along:
        """Of detections of which each is a track by itself."""
        never = np.zeros(len(seen), dtype=np.bool_)
        past, future = (beliefs_alone(seen.measured, motion) for _ in range(2))
        return cls(np.full(len(seen), -1), past, future, never, never)

    def select(self, which: BoolArray) -> Along:
        """Of the detections at a mask."""
        return Along(
            self.follower[which],
            self.past.select(which),
            self.future.select(which),
            self.ending[which],
            self.beginning[which],
        )

    def and_then(self, other: Along) -> Along:
        """Of these and of further detections."""
        return Along(
            np.append(self.follower, other.follower),
            joined_beliefs(self.past, other.past),
            joined_beliefs(self.future, other.future),
            np.append(self.ending, other.ending),
            np.append(self.beginning, other.beginning),
        )


@dataclass(frozen=True)
class Changed:
    """Where something is known anew.

    Attributes:
        past: ``(N,)`` whether the past of its track has changed at each detection.
        future: ``(N,)`` likewise the future.
    """

    past: BoolArray
    future: BoolArray


def followed(
    known: Along, seen: Seen, labels: IntArray, follower: IntArray, motion: MotionNoise, reach: int
) -> tuple[Along, Changed]:
    """What is known along other tracks.

    Args:
        known: what was known along the tracks before.
        seen: the detections.
        labels: ``(N,)`` track of each now, -1 for none.
        follower: ``(N,)`` number of what follows each now, -1 for nothing.
        motion: noise of the filter.
        reach: detections of its track by which something is known of a detection; see `RUN_UP`.
    """
    own = np.where(labels < 0, int(labels.max(initial=-1)) + 1 + np.arange(len(seen)), labels)
    order = np.argsort(own, kind="stable")
    stretch = Stretches.of(own[order])
    before, after = seen.rows(known.follower), seen.rows(follower)
    past = stretch.any_within((_came_from(before) != _came_from(after))[order], reach, 0)
    future = stretch.any_within((before != after)[order], 0, reach)
    needed = stretch.any_within(past, 0, RUN_UP) | stretch.any_within(future, RUN_UP, 0)
    changed = Changed(np.empty(len(seen), np.bool_), np.empty(len(seen), np.bool_))
    changed.past[order], changed.future[order] = past, future
    # A part of a track that lies apart from its other parts is filtered by itself.
    part = np.cumsum(np.diff(stretch.first, prepend=-1).astype(np.bool_) | (needed & ~np.roll(needed, 1)))
    label = np.empty(len(seen), dtype=np.int64)
    label[order] = part
    again = np.sort(order[needed])
    behind, ahead = beliefs_along(label[again], seen.measured.select(again), motion)
    now = Along(
        follower.copy(),
        known.past.replaced(again[changed.past[again]], behind.select(changed.past[again])),
        known.future.replaced(again[changed.future[again]], ahead.select(changed.future[again])),
        known.ending,
        known.beginning,
    )
    return now, changed


def _came_from(after: IntArray) -> IntArray:
    """``(N,)`` index of what comes before each detection, -1 for nothing."""
    before = np.full(len(after), -1)
    linked = np.flatnonzero(after >= 0)
    before[after[linked]] = linked
    return before


@dataclass(frozen=True)
class Stretches:
    """Rows of which those of one track follow each other.

    Attributes:
        first: ``(N,)`` first row of the track of each.
        last: ``(N,)`` last row of it.
    """

    first: IntArray
    last: IntArray

    @classmethod
    def of(cls, track: IntArray) -> Stretches:
        """For ``(N,)`` numbers from 0 on, the same ones side by side."""
        starts = np.flatnonzero(np.diff(track, prepend=-1))
        length = np.diff(np.append(starts, len(track)))
        return cls(np.repeat(starts, length), np.repeat(starts + length - 1, length))

    def any_within(self, flags: BoolArray, before: int, after: int) -> BoolArray:
        """``(N,)`` whether a flag is set from so many rows before each to so many after it, in its track."""
        row, total = np.arange(len(flags)), np.append(0, np.cumsum(flags))
        first, last = np.maximum(row - before, self.first), np.minimum(row + after, self.last)
        return np.asarray(total[last + 1] > total[first])
