"""The flow with a bounded delay: each frame is answered a fixed time after it came, and the answer is final.

When a frame has to be answered, the window up to the newest frame is solved (`flow_window`), its tracks are joined to
those that ended before (`join`), and the next few frames are settled together, since one solution serves them all.

* *Settled* are which detections of those frames are used, how they follow each other, and whose they are. What follows
  the last detection of a person stays open for as long as links and joins can reach.
* *A person* is answered from the frame on in which all that is known by then makes a track long enough, and keeps the
  id. Joined to somebody who was answered can only be who was not.
* *A gap* is filled from the frame on in which its end is known.

Nothing is asked of the future beyond the delay: the camera's steps, the worth of scores, the motion and the appearance
along tracks are those of the frames that have come. What is kept is the undecided frames and those that joins need.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field

import numpy as np

from tsuiseki.tracking.association.costs import unit_means
from tsuiseki.tracking.association.flow_rounds import WINDOW
from tsuiseki.tracking.association.flow_window import CONTEXT, FlowWindow
from tsuiseki.tracking.association.nearby import Pairs
from tsuiseki.tracking.association.smoothing import SmoothingSettings
from tsuiseki.tracking.association.tracklets import APPEARANCE_WINDOW, JOIN_WINDOW, join
from tsuiseki.tracking.people.flow_input import FlowInput, FlowSettings, least_logit, solve_window
from tsuiseki.tracking.people.whole_flow import long_tracks, reported
from tsuiseki.tracking.types import BoolArray, Columns, Detections, FloatArray, IntArray, Targets, Track
from tsuiseki.tracking.types.tracks import rows_of_each

# Decisions in one delay: the more, the later in its delay a frame is settled, and the more is computed.
DECISIONS = 4
# Rounds of costs in every decision but the first; costs are kept from one to the next.
ROUNDS = 2
# Seconds between two choices of how far boxes are smoothed.
FIT_EVERY = 5.0


@dataclass(frozen=True)
class SettledPeople:
    """What is settled of K people.

    Attributes:
        ids: ``(K,)``, 0 as long as not answered.
        sums: ``(K, 3 + D)`` sums over their settled detections, see `evidence`.
    """

    ids: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    sums: FloatArray = field(default_factory=lambda: np.empty((0, 3)))


@dataclass(frozen=True)
class ReportedBoxes(Columns):
    """The people of frames, by frame and id: boxes, scores, whether and which detection supports each, classes."""

    frames: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    ids: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    boxes: FloatArray = field(default_factory=lambda: np.empty((0, 4)))
    scores: FloatArray = field(default_factory=lambda: np.empty(0))
    observed: BoolArray = field(default_factory=lambda: np.empty(0, np.bool_))
    origin: IntArray = field(default_factory=lambda: np.empty((0, 2), np.int64))
    votes: IntArray = field(default_factory=lambda: np.empty(0, np.int64))

    @classmethod
    def of(cls, tracks: Sequence[Track], votes: Sequence[int], end: int) -> ReportedBoxes:
        """Tracks before the frame ``end``; ``votes`` are their classes."""
        boxes = cls()
        for track, vote in zip(tracks, votes, strict=True):
            ids, classes = (np.full(len(track), number) for number in (track.id, vote))
            columns = track.boxes, track.scores, track.observed, track.origin
            boxes = boxes.and_then(cls(track.frames, ids, *columns, classes))
        boxes = boxes.select(boxes.frames < end)
        return boxes.select(np.lexsort((boxes.ids, boxes.frames)))

    def targets(self, frame: int, names: Mapping[int, str]) -> Targets:
        """A frame as a tracker answers it."""
        people = self.select(slice(*np.searchsorted(self.frames, [frame, frame + 1]).tolist()))
        status = np.where(people.observed, "tracking", "searching")
        scores = np.where(people.observed, people.scores, 0.0)
        origin = np.column_stack([people.origin[:, 0], people.votes])
        return Targets(frame, people.ids, people.boxes, scores, status, origin, names)

    def tracks(self, names: Mapping[int, str]) -> list[Track]:
        """The tracks, by id."""
        tracks = map(self.select, rows_of_each(self.ids))
        return [Track(int(e.ids[0]), e.frames, e.boxes, e.scores, e.observed, e.origin, names) for e in tracks]


class DelayedFlow:
    """Answers every frame a fixed number of frames later.

    Args:
        settings: of the tracker.
        flow_input: prepares the detections.
        window: a fresh one.
        delay: frames.
    """

    def __init__(self, settings: FlowSettings, flow_input: FlowInput, window: FlowWindow, delay: int) -> None:
        self.settings, self.input, self.window, self.delay = settings, flow_input, window, delay
        longest = max(WINDOW, settings.fill, JOIN_WINDOW, APPEARANCE_WINDOW)
        self._reach = round((longest + CONTEXT) * flow_input.frame_rate)
        self._waiting: tuple[Detections, ...] = ()
        self._frame = self._answered = self._reported = 0
        # Of the detections that the window keeps: their scores, and whose they are; -1 where not settled, or a false
        # positive.
        self._scores, self._owner = np.empty(0), np.empty(0, dtype=np.int64)
        self._origin = np.empty((0, 2), dtype=np.int64)
        self._people = SettledPeople()
        self._ids = 0
        self._answers = ReportedBoxes()
        self._smoothing: SmoothingSettings | None = None
        self._fitted = 0

    def update(self, detections: Detections) -> Targets | None:
        """Take the next frame; the people of the frame ``delay`` before, None as long as there is none."""
        self._waiting = (*self._waiting, detections)
        self._frame += 1
        answered = self._frame - 1 - self.delay
        if answered < 0:
            return None
        if answered == self._answered:
            self._decide(answered + max(1, (self.delay + 1) // DECISIONS))
        self._reported = answered + 1
        return self._answers.targets(answered, self.input.names)

    def ended(self) -> DelayedFlow:
        """A copy for which the video ends here, so that asking changes nothing: all its frames are answered."""
        clone = copy(self)
        clone.input, clone.window = self.input.copy(), self.window.copy()
        if clone._answered < clone._frame:
            clone._decide(clone._frame)
        return clone

    def tracks(self) -> list[Track]:
        """The tracks of all frames that are answered and not forgotten."""
        return self._answers.tracks(self.input.names)

    def forget(self) -> None:
        """Drop the answers that were given from `tracks`."""
        self._answers = self._answers.select(self._answers.frames >= self._reported)
        first = min(self._answered - self._reach, int(self.window.table.frames.min(initial=self._answered)))
        self.input.inferences.forget(max(0, min(first, self._reported) - 2))

    def _decide(self, end: int) -> None:
        """Solve the window, and answer the frames before ``end``."""
        self._absorb()
        # The first window has no costs from before.
        solve_window(self.window, self.input, self._scores, None if self._answered == 0 else ROUNDS)
        tracks = self._tracks()
        joins, ids = self._settle(tracks, end)
        self._answer(tracks, ids, end)
        self._forget(joins, end)
        self._answered = end

    def _absorb(self) -> None:
        if not self._waiting:
            return
        table, scores, origin = self.input.rows(self._waiting)
        self._waiting = ()
        self.window.costs = self.input.flow_costs(self.settings.costs)
        self.window.add(table)
        self._scores, self._origin = np.append(self._scores, scores), np.concatenate([self._origin, origin])
        self._owner = np.append(self._owner, np.full(len(table), -1))

    def _tracks(self) -> IntArray:
        """``(N,)`` track of each detection as far as is known now, tracklets joined; -1 for none."""
        table = self.window.table
        labels = self.window.labels()
        # A detection that was forgotten as a false positive stays one.
        labels[~self.window.free() & (self._owner < 0)] = -1
        if not (labels >= 0).any():
            return labels
        people = self._people_of(labels, (self._owner < 0) & (labels >= 0))
        features = None if table.features is None else unit_means(people.sums[:, 3:])
        return join(table, labels, features, self.window.costs.link, self.window.changes, people.ids > 0)

    def _people_of(self, tracks: IntArray, rows: BoolArray) -> SettledPeople:
        """What is known of M tracks: what is settled of the people in them, and detections besides."""
        count, owned = int(tracks.max(initial=-1)) + 1, self._owner >= 0
        track = np.full(len(self._people.ids), -1)
        track[self._owner[owned]] = tracks[owned]
        new = self._evidence(rows)
        ids, sums = np.zeros(count, dtype=np.int64), np.zeros((count, new.shape[1]))
        present = track >= 0
        np.maximum.at(ids, track[present], self._people.ids[present])
        np.add.at(sums[:, : self._people.sums.shape[1]], track[present], self._people.sums[present])
        np.add.at(sums, tracks[rows], new)
        return SettledPeople(ids, sums)

    def _evidence(self, rows: BoolArray) -> FloatArray:
        """``(K, 3 + D)`` of detections: 1, the logit of the probability, whether described, and the features."""
        logit = self.input.logits(self._scores[rows])
        evidence = [np.ones(len(logit)), logit]
        features = self.window.table.features
        if features is None:
            return np.column_stack([*evidence, np.zeros(len(logit))])
        described = np.asarray(~np.isnan(features[rows]).any(axis=1))
        return np.column_stack([*evidence, described, np.where(described[:, None], features[rows], 0)])

    def _settle(self, tracks: IntArray, end: int) -> tuple[Pairs, IntArray]:
        """Settle who is answered before the frame ``end``; of others only what no link can reach any more.

        Returns:
            The numbers of detections that joins put one after the other, and ``(M,)`` ids of tracks, 0 for none.
        """
        table, free = self.window.table, (self._owner < 0) & (tracks >= 0)
        people = self._people_of(tracks, free)
        detections, logits = people.sums[:, 0], people.sums[:, 1]
        enough = detections >= self.settings.fewest(self.input.frame_rate, self._frame)
        good = logits >= least_logit(self.input.observation) * np.maximum(detections, 1)
        confirmed = (people.ids > 0) | (enough & good)
        until = np.append(np.where(confirmed, end, min(end, self._frame + 1 - self.window.overlap)), -1)
        bound = free & (table.frames < until[tracks])
        settled = np.flatnonzero((self._owner >= 0) | bound)
        track, first, person = np.unique(tracks[settled], return_index=True, return_inverse=True)
        fresh = np.flatnonzero(confirmed[track] & (people.ids[track] == 0))
        ids = people.ids.copy()
        ids[track[fresh[np.argsort(first[fresh])]]] = self._ids + 1 + np.arange(len(fresh))
        self._ids += len(fresh)
        self._people = SettledPeople(ids[track], self._people_of(tracks, bound).sums[track])
        self._owner = self._owner.copy()
        self._owner[settled] = person
        order = settled[np.argsort(tracks[settled], kind="stable")]
        earlier, later = order[:-1], order[1:]
        joined = (tracks[earlier] == tracks[later]) & (self.window.follower[earlier] != table.numbers[later])
        return (table.numbers[earlier[joined]], table.numbers[later[joined]]), ids

    def _answer(self, tracks: IntArray, ids: IntArray, end: int) -> None:
        table, longest = self.window.table, round(self.settings.fill * self.input.frame_rate)
        people, images = [], []
        for rows in long_tracks(tracks):
            number = int(ids[tracks[rows[0]]])
            if number and table.frames[rows[-1]] >= self._answered:
                frames, boxes, scores = table.frames[rows], table.boxes[rows], np.nan_to_num(self._scores[rows])
                people.append(Track(number, frames, boxes, scores, origin=self._origin[rows]))
                images.append(table.image[rows])
        smoothing = self._strength(people)
        parts = [
            reported(track, image, self.input, longest, smoothing, self._answered)
            for track, image in zip(people, images, strict=True)
        ]
        votes = [track.class_id for track in people]
        self._answers = self._answers.and_then(ReportedBoxes.of(parts, votes, end))

    def _strength(self, tracks: list[Track]) -> SmoothingSettings | None:
        """How far these tracks are smoothed: chosen anew every few seconds."""
        rate = self.input.frame_rate
        if not self.settings.smoothing:
            return None
        if self._smoothing is None or self._frame >= self._fitted + FIT_EVERY * rate:
            self._smoothing, self._fitted = self.input.smoothing(tracks), self._frame
        return self._smoothing

    def _forget(self, joins: Pairs, end: int) -> None:
        """Let go of what no later frame can ask for."""
        numbers, first = self.window.table.numbers, end - self._reach
        self.window.settle(numbers[self._owner >= 0], end, self._frame - 1, joins, first)
        remaining = np.isin(numbers, self.window.table.numbers, assume_unique=True)
        self._scores, self._owner, self._origin = (
            self._scores[remaining],
            self._owner[remaining],
            self._origin[remaining],
        )
        self.input.camera.forget(min(first, int(self.window.table.frames.min(initial=first))))
        if self.input.path is not None:
            # Others may follow the same path, and have yet to ask how the camera came to the newest frame.
            self.input.path.forget(self.input.inferences.frame - 1)
