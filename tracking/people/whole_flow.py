"""The flow over a whole video: tracks come at its end, though most of it is solved while it comes.

They are reported with gaps filled and boxes smoothed, in pixels of their own frames (`reported`).

Of a video of many hours, tracks that nothing to come can reach are finished every `RELEASE` seconds, and their
detections are let go of. Which detections follow each other is decided as without that. Only what the whole video says
of scores, places and smoothing is by then what all of it up to there showed.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.association.clutter import standing_clutter
from tsuiseki.tracking.association.detection_tables import DetectionTable
from tsuiseki.tracking.association.flow_rounds import WINDOW
from tsuiseki.tracking.association.flow_window import FlowWindow
from tsuiseki.tracking.association.sliding_flow import Decision
from tsuiseki.tracking.association.smoothing import SmoothingSettings, fill_gaps, smooth
from tsuiseki.tracking.association.solved_network import NetworkRecord, SolvedNetwork
from tsuiseki.tracking.association.tracklets import (
    APPEARANCE_WINDOW,
    JOIN_WINDOW,
    Tracklets,
    join,
    straddling_tracks,
)
from tsuiseki.tracking.people.flow_input import SETTLE, FlowInput, FlowSettings, least_logit, solve_window
from tsuiseki.tracking.types import Detections, FloatArray, IntArray, Track
from tsuiseki.tracking.types.tracks import rows_of_each

# Seconds from one time that finished tracks are let go of to the next; the first is when as many more have come.
RELEASE = 3600.0


class WholeFlow:
    """Solves a sliding window (`sliding_flow`), and joins what it decided when the tracks are asked for.

    Features and network are held for the undecided detections only; what remains of a decided one is its row in the
    result.

    Args:
        settings: of the tracker.
        flow_input: prepares the detections.
        window: a fresh one.
        drop_straddling: see `FlowTracker`.
    """

    def __init__(
        self, settings: FlowSettings, flow_input: FlowInput, window: FlowWindow, drop_straddling: bool
    ) -> None:
        self.settings, self.input, self.window, self.drop_straddling = settings, flow_input, window, drop_straddling
        self.actions: list[FloatArray | None] = []
        self._tracklets = Tracklets()
        self._record = NetworkRecord()
        self._joins: list[tuple[IntArray, IntArray, FloatArray]] = []
        self._frame = 0
        self._waiting: list[Detections] = []
        self._rows = DetectionTable.empty(flow_input.frame_rate, flow_input.size)
        self._parts: list[DetectionTable] = []
        self._scores, self._origin = np.empty(0), np.empty((0, 2), dtype=np.int64)
        self._released: list[FinishedTrack] = []
        self._release_at = round(2 * RELEASE * flow_input.frame_rate)

    @property
    def finished_early(self) -> int:
        """Tracks that were finished before the end; see the head of this file."""
        return len(self._released)

    def update(self, detections: Detections) -> None:
        """Take the next frame."""
        self._waiting.append(detections)
        self._frame += 1
        interval, rate = self.settings.decide_every, self.input.frame_rate
        # Where much stays undecided, new frames are awaited in proportion.
        undecided = len(self.window.flow.undecided)
        if interval is not None and len(self._waiting) >= interval * rate and sum(map(len, self._waiting)) >= undecided:
            self._decide()

    def ended(self) -> WholeFlow:
        """A copy for which the video ends here, so that asking changes nothing."""
        clone = copy(self)
        clone.input, clone.window, clone._tracklets = self.input.copy(), self.window.copy(), self._tracklets.copy()
        clone._parts, clone._released = [*self._parts], [*self._released]
        clone._record, clone._joins = self._record.copy(), []
        return clone

    def tracks(self) -> list[Track]:
        """Decide all that is left; the tracks."""
        self._absorb()
        window = self.window
        solve_window(window, self.input, self._scores[window.table.numbers])
        remainder = window.flow.remainder()
        self._record.add(remainder, window.flow.undecided, window.flow.graph)
        self._chain(remainder, window.table)
        table = self._table()
        finished = sorted(
            [*self._released, *self._finished(table, self._joined(table))], key=lambda person: person.first
        )
        self.actions = [person.actions for person in finished]
        return [replace(person.track, id=number) for number, person in enumerate(finished, 1)]

    def _joined(self, table: DetectionTable) -> IntArray:
        """``(N,)`` track of each row, tracklets joined; -1 for none."""
        labels = self._tracklets.labels(len(self._scores))[table.numbers]
        if not len(table):
            return labels
        window, appearance = self.window, self._tracklets.appearance()
        places = window.place_costs(table.image)
        if self._released:
            # Those of tracklets that were let go of do not count.
            remaining, compact = np.unique(labels[labels >= 0], return_inverse=True)
            appearance = None if appearance is None else appearance[remaining]
            labels[labels >= 0] = compact
        return join(table, labels, appearance, window.costs.link, window.changes, None, places, self._joins)

    def _release(self) -> None:
        """Finish the tracks that nothing to come can reach, and let go of their detections."""
        table, rate = self._table(), self.input.frame_rate
        joined, undecided = self._joined(table), np.isin(table.numbers, self.window.table.numbers)
        frontier = int(table.frames[undecided].min(initial=self._frame))
        reach = round(max(JOIN_WINDOW, APPEARANCE_WINDOW, self.settings.fill) * rate)
        # By the track, and at last for detections of none: the last frame that it has.
        last = np.full(int(joined.max(initial=-1)) + 2, -1)
        np.maximum.at(last, joined, np.where(undecided, self._frame, table.frames))
        closed = np.where(joined >= 0, last[joined], table.frames) < frontier - reach
        self._tracklets.merge(table.numbers[~closed], joined[~closed])
        self._released += self._finished(table.select(closed), joined[closed])
        self._rows = table.select(~closed)
        # So long a result is not corrected by its network.
        self._record, self._joins = NetworkRecord(), []
        self.input.camera.forget(int(self._rows.frames.min(initial=frontier)))
        self._release_at = self._frame + round(RELEASE * rate)

    def _decide(self) -> None:
        """Solve the window and let go of what is decided."""
        self._absorb()
        window = self.window
        solve_window(window, self.input, self._scores[window.table.numbers])
        table, numbers, solved = window.table, window.flow.undecided, window.flow.graph
        margin = round((WINDOW + SETTLE) * self.input.frame_rate)
        decision = window.decide(self._frame - 1, self._frame - margin)
        self._record.add(decision, numbers, solved)
        self._chain(decision, table)
        if self._frame >= self._release_at and table.actions is None and self.input.inferences.even:
            self._release()

    def network(self, tracks: Sequence[Track]) -> SolvedNetwork:
        """What the tracks were chosen from, once they were asked for.

        Args:
            tracks: those that are reported, in the frames of the detections.
        """
        table, rate = self._table(), self.input.frame_rate
        row = {
            key: track.id
            for track in tracks
            for key in zip(track.frames[track.observed].tolist(), track.detection[track.observed].tolist(), strict=True)
        }
        keys = zip(table.frames.tolist(), self._origin[:, 0].tolist(), strict=True)
        return SolvedNetwork(
            table.frames,
            table.image,
            self._scores,
            self._origin,
            self._record.graph(len(table), self._joins),
            np.array([row.get(key, 0) for key in keys], dtype=np.int64),
            self.settings.fewest(rate, self._frame),
            round(self.settings.fill * rate * self.input.inferences.stride),
            rate * self.input.inferences.stride,
        )

    def _absorb(self) -> None:
        if not self._waiting:
            return
        table, scores, origin = self.input.rows(self._waiting)
        self._waiting = []
        self.window.costs = self.input.flow_costs(self.settings.costs)
        self.window.add(table)
        self._parts.append(replace(table, features=None))
        self._scores, self._origin = np.append(self._scores, scores), np.concatenate([self._origin, origin])

    def _chain(self, decision: Decision, table: DetectionTable) -> None:
        used = decision.used
        place = np.searchsorted(table.numbers, decision.numbers[used])
        features = None if table.features is None else table.features[place]
        self._tracklets.add(decision.numbers[used], decision.follower[used], features)

    def _table(self) -> DetectionTable:
        self._rows, self._parts = self._rows.and_then(*self._parts), []
        return self._rows

    def _finished(self, table: DetectionTable, labels: IntArray) -> list[FinishedTrack]:
        """The tracks with enough detections, their gaps filled, by their first detections."""
        rate, settings = self.input.frame_rate, self.settings
        # A video of fast targets bears nothing out, so its own calibration judges no track.
        least, logit = least_logit(self.input.observation), self.input.logits(self._scores[table.numbers])
        pieces = [p for p in long_tracks(labels, settings.fewest(rate, self._frame)) if not logit[p].mean() < least]
        finished = [self._piece(table, piece) for piece in pieces]
        if self.input.observation is None and not settings.standing:
            tracks, images = [person.track for person in finished], [person.image for person in finished]
            dropped = standing_clutter(tracks, images, rate)
            finished = [finished[n] for n in np.setdiff1d(np.arange(len(finished)), dropped)]
        smoothing = self.input.smoothing([person.track for person in finished]) if settings.smoothing else None
        longest = round(settings.fill * rate)
        finished = [
            replace(person, track=reported(person.track, person.image, self.input, longest, smoothing))
            for person in finished
        ]
        if not self.drop_straddling:
            return finished
        apart = ~straddling_tracks([person.track for person in finished])
        return list(itertools.compress(finished, apart))

    def _piece(self, table: DetectionTable, piece: IntArray) -> FinishedTrack:
        numbers = table.numbers[piece]
        scores, origin = np.nan_to_num(self._scores[numbers]), self._origin[numbers]
        track = Track(1, table.frames[piece], table.boxes[piece], scores, origin=origin, names=self.input.names)
        actions = None if table.actions is None else table.actions[piece]
        return FinishedTrack(track, table.image[piece], actions, int(numbers[0]))


@dataclass(frozen=True)
class FinishedTrack:
    """A track that nothing to come changes; the id is given when all are known.

    Attributes:
        track: its boxes as if the camera stood still, until it is reported.
        image: ``(T, 4)`` those of its detections where the image shows them.
        actions: ``(T, A)`` probabilities at the detections.
        first: number of the first detection.
    """

    track: Track
    image: FloatArray
    actions: FloatArray | None
    first: int


def reported(
    track: Track,
    image: FloatArray,
    flow_input: FlowInput,
    longest: int,
    smoothing: SmoothingSettings | None,
    first: int = 0,
) -> Track:
    """A track of detections as it is reported.

    Args:
        track: its boxes as if the camera stood still.
        image: ``(T, 4)`` the same where the image shows them.
        flow_input: knows where the frames lie, and when they came.
        longest: gap that is filled, frames.
        smoothing: of the boxes; None reports them as detected.
        first: frame before which nothing is reported.
    """
    filled = fill_gaps(track, longest, flow_input.inferences.ticks)
    smoothed = filled if smoothing is None else smooth(flow_input.on_grid(filled), smoothing)
    tail = slice(int(np.searchsorted(filled.frames, first)), None)
    frames, observed = filled.frames[tail], filled.observed[tail]
    boxes = flow_input.camera.from_first(smoothed.boxes[tail], frames)
    if smoothing is None:
        boxes = boxes.copy()
        boxes[observed] = image[len(image) - int(observed.sum()) :]
    return Track(track.id, frames, boxes, filled.scores[tail], observed, filled.origin[tail], track.names)


def long_tracks(labels: IntArray, fewest: int = 1) -> list[IntArray]:
    """Indices of the detections of each track that has enough of them, by the first.

    Args:
        labels: ``(N,)`` number of the track of each, -1 for none; in the order of the frames.
        fewest: detections that a track needs.
    """
    used = np.flatnonzero(labels >= 0)
    pieces = [used[rows] for rows in rows_of_each(labels[used])]
    return sorted((piece for piece in pieces if len(piece) >= fewest), key=lambda piece: int(piece[0]))
