"""Cutting tracks where what comes before a link and what comes after it do not go together.

When two people cross, the flow over detections may hand one's track to the other: every single link looks good. Seen
from both sides of the link the change shows: the motion before it and the motion after it do not meet, or the looks
differ. There the track is cut; joining the pieces by the same evidence then finds who is who. This is the thesis's
alternation (5.3) once around: tracks give features over several frames, and those give better tracks.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field

import numpy as np

from tsuiseki.tracking.association.ends import MEMORY, backwards, mean_looks, meeting, motion_at_end, trail
from tsuiseki.tracking.association.pieces import Links
from tsuiseki.tracking.association.rows import DetectionRows, join_rows, no_rows
from tsuiseki.tracking.association.windows import Decision
from tsuiseki.tracking.filters.kalman import BoxMotion
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# No two cuts of a track lie closer than this many frames.
APART = 5
BLOCK = 20_000


@dataclass(frozen=True)
class SplitSettings:
    """When the two sides of a link are taken for different people.

    Attributes:
        limit: how much likelier two people must be than one, as a logarithm, for a cut.
        bias: that logarithm where the two sides fit perfectly, of neutral looks.
        size: scale of the log ratio of the heights.
        tails: degrees of freedom of the distributions of place, velocity and size, as in `HandSetCost`.
        appearance: weight of the cosine distance of the mean features of both sides.
        neutral: cosine distance that speaks neither for nor against.
        motion: noise of the filter that estimates the motion of each side.
    """

    limit: float = 2.0
    bias: float = -4.0
    size: float = 0.1
    tails: float = 5.0
    appearance: float = 18.0
    neutral: float = 0.24
    motion: BoxMotion = field(default_factory=lambda: BoxMotion(0.08, 0.01, 0.05))


class Splitter:
    """Takes decided detections and gives them on, cut, once it has seen enough of what comes after them.

    What is cut does not depend on how the detections arrive. Kept are those of about the last ``MEMORY`` frames of
    each track.

    Args:
        settings: when to cut.
        longest_gap: most frames between two linked detections.
    """

    def __init__(self, settings: SplitSettings, longest_gap: int) -> None:
        self._settings = settings
        self._ahead = APART + longest_gap + MEMORY
        self._rows = no_rows()
        self._follower = np.empty(0, dtype=np.int64)
        self._costs = np.empty((0, 2))
        self._given = np.empty(0, dtype=np.bool_)

    @property
    def held(self) -> int:
        """Number of detections that are kept."""
        return len(self._rows)

    def copy(self) -> Splitter:
        """A copy that goes on by itself."""
        return copy(self)

    def add(self, rows: DetectionRows, decision: Decision) -> None:
        """Take decided detections.

        Args:
            rows: those of the decision, in its order.
            decision: its detections that belong to no track are passed over.
        """
        used = decision.used
        numbers = np.append(self._rows.numbers, decision.numbers[used])
        # Undecided detections may have lower numbers than decided ones of tracks that are clearer.
        order = np.argsort(numbers, kind="stable")
        self._rows = join_rows([self._rows, rows.select(used)]).select(order)
        self._follower = np.append(self._follower, decision.follower[used])[order]
        costs = np.stack([decision.cost[used], decision.link[used]], axis=1)
        self._costs = np.concatenate([self._costs, costs])[order]
        self._given = np.append(self._given, np.zeros(used.sum(), dtype=np.bool_))[order]

    def release(self, at_end: bool = False) -> Links:
        """The detections whose links are now certain, cut where they have to be.

        Args:
            at_end: nothing more will come, so all are.
        """
        following, unknown = self._following()
        ripe = np.ones(len(self._rows), np.bool_) if at_end else self._ripe(following, unknown)
        going = ripe & ~self._given
        cut = self._cuts(following, going)
        links = Links(
            self._rows.numbers[going],
            np.where(cut, -1, self._follower)[going],
            (self._costs[:, 0] + np.where(cut, 0, self._costs[:, 1]))[going],
            None if self._rows.features is None else self._rows.features[going],
        )
        self._forget(self._given | going)
        return links

    def _following(self) -> tuple[IntArray, BoolArray]:
        """Index of the next detection of the track, -1 if there is none here, and whether one is still to come."""
        numbers, follower = self._rows.numbers, self._follower
        if len(numbers) == 0:
            return follower, np.empty(0, dtype=np.bool_)
        place = np.searchsorted(numbers, follower).clip(max=len(numbers) - 1)
        here = (follower >= 0) & (numbers[place] == follower)
        return np.where(here, place, -1), (follower >= 0) & ~here

    def _ripe(self, following: IntArray, unknown: BoolArray) -> BoolArray:
        """Detections whose track is known as far ahead as cutting looks."""
        ripe = np.ones(len(following), dtype=np.bool_)
        origin = current = np.arange(len(following))
        frames = self._rows.frames
        while len(current):
            ripe[origin[unknown[current]]] = False
            further = (following[current] >= 0) & (frames[current] - frames[origin] < self._ahead)
            origin, current = origin[further], following[current[further]]
        return ripe

    def _cuts(self, following: IntArray, going: BoolArray) -> BoolArray:
        """Which of the detections that go are cut from their follower: where the evidence is most within its reach."""
        evidence = np.full(len(following), -np.inf)
        if not going.any():
            return np.zeros(len(following), dtype=np.bool_)
        frames = self._rows.frames
        first, last = frames[going].min() - APART, frames[going].max() + APART
        previous = _reversed(following)
        tails = np.flatnonzero((following >= 0) & (frames >= first) & (frames <= last))
        for start in range(0, len(tails), BLOCK):
            block = tails[start : start + BLOCK]
            evidence[block] = self._evidence(block, following, previous)
        cut = going & (evidence > self._settings.limit)
        for neighbour, beats in ((previous, np.greater_equal), (following, np.greater)):
            origin = np.flatnonzero(cut)
            current = neighbour[origin]
            while len(current):
                near = (current >= 0) & (np.abs(frames[current] - frames[origin]) <= APART)
                origin, current = origin[near], current[near]
                cut[origin[beats(evidence[current], evidence[origin])]] = False
                current = neighbour[current]
        return cut

    def _evidence(self, tails: IntArray, following: IntArray, previous: IntArray) -> FloatArray:
        """``(P,)`` how much likelier two people are than one, as a logarithm, at the links from ``tails``."""
        rows, settings = self._rows, self._settings
        heads = following[tails]
        before, after = trail(tails, previous, rows.frames), trail(heads, following, rows.frames)
        end = motion_at_end(before, rows.boxes, settings.motion)
        start = backwards(motion_at_end(after, rows.boxes, settings.motion))
        gap = rows.frames[heads] - rows.frames[tails]
        evidence, _ = meeting(end, start, gap, settings.motion, settings.size, settings.tails)
        evidence += settings.bias
        if rows.features is not None:
            (left, some), (right, others) = mean_looks(before, rows.features), mean_looks(after, rows.features)
            known = np.minimum(some, others)
            # Looks of few detections are not sure, and those of none say nothing.
            weight = settings.appearance * known / (known + 2)
            evidence += weight * (1 - np.einsum("pd,pd->p", left, right) - settings.neutral)
        return evidence

    def _forget(self, given: BoolArray) -> None:
        """Keep what has not been given on, and what may be looked back at from there."""
        frames = self._rows.frames
        oldest = frames[~given].min() if not given.all() else np.inf
        kept = frames >= oldest - APART - MEMORY
        self._rows, self._follower, self._costs = self._rows.select(kept), self._follower[kept], self._costs[kept]
        self._given = given[kept]


def _reversed(following: IntArray) -> IntArray:
    previous = np.full(len(following), -1, dtype=np.int64)
    linked = np.flatnonzero(following >= 0)
    previous[following[linked]] = linked
    return previous
