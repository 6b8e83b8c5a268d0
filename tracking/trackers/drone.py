"""People in drone video: network flow with action features (thesis chapter 5).

One tracker covers three methods. Without action features it is the flow of 2.3.2. With one iteration it uses
single-frame action features (SAF). With several it alternates between tracking and multi-frame action features (MAF).
Where the camera's motion is known, boxes are compared after compensating it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tsuiseki.tracking.association.costs import HandSetCost, ObservationCost
from tsuiseki.tracking.association.rows import DetectionRows, join_rows, no_rows, rows_of
from tsuiseki.tracking.association.tracklets.action_refinement import (
    Iteration,
    Past,
    Prices,
    RefinementSettings,
    refine,
    window_means,
)
from tsuiseki.tracking.association.tracklets.interpolation import GapSettings, SmoothingSettings, fill_gaps, smooth
from tsuiseki.tracking.features.motion.camera_trajectory import CameraStep, CameraTrajectory
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray, Track
from tsuiseki.tracking.types.tracks import ActingTrack

# Of scores that nothing was learnt about: 0.5 is as good as even, and ten good detections are worth a track's ends.
HAND_SET_OBSERVATION = ObservationCost(alpha=4.4, beta=-8.8, b=-0.5)


@dataclass(frozen=True)
class DroneSettings:
    """Settings of the drone tracker.

    Attributes:
        refinement: the flow and its alternation with the action features.
        min_detections: tracks of fewer detections are dropped; those that only a correlation filter found do not count.
        gaps: which gaps are filled; None fills none.
        smoothing: how far boxes are smoothed; None reports them as detected.
        chunk: frames that are decided at a time in the sliding-window mode; None solves all frames at once in the end.
        overlap: frames that stay undecided at the end of a window, for the next one to change.
    """

    refinement: RefinementSettings = field(default_factory=RefinementSettings)
    min_detections: int = 4
    gaps: GapSettings | None = field(default_factory=GapSettings)
    smoothing: SmoothingSettings | None = None
    chunk: int | None = None
    overlap: int = 45

    def __post_init__(self) -> None:
        if self.chunk is not None and self.chunk < 1:
            raise ValueError(f"expected a chunk of at least 1 frame, got {self.chunk}")
        if self.overlap <= self.refinement.gate.window:
            raise ValueError(
                f"expected an overlap above the gate's window of {self.refinement.gate.window} frames, got "
                f"{self.overlap}"
            )


class DroneTracker:
    """The cheapest set of tracks, refined by the actions along them.

    With ``chunk`` set, the flow is solved window by window during the video. The tracks of a window are final except
    in its last ``overlap`` frames. Appearance features and the network are held only for detections that are not
    final. The result is not the optimum of the whole video, but close to it where the overlap is much longer than the
    gaps.

    Args:
        settings: of the flow and what follows.
        prices: of detections and pairs; by default set by hand.
    """

    def __init__(self, settings: DroneSettings | None = None, prices: Prices | None = None) -> None:
        self.settings = settings or DroneSettings()
        self.prices = prices or Prices(HAND_SET_OBSERVATION, HandSetCost())
        self._camera = CameraTrajectory("images")
        self._waiting: list[Detections] = []
        self._open = _Described(no_rows(), None)
        self._continued = np.empty(0, dtype=np.int64)
        self._done: list[_Described] = []
        self._done_labels: list[IntArray] = []
        self._first_open = 0
        self._next = 0
        self._recent = _Recent(np.empty(0, np.int64), np.empty(0, np.int64), None)

    @property
    def held_rows(self) -> int:
        """Number of detections that are not final."""
        return len(self._open)

    def update(self, detections: Detections, motion: CameraStep | None = None) -> None:
        """Take the next frame.

        Args:
            detections: with appearance features where they are known, and with probabilities of actions in all frames
                or in none.
            motion: of the camera since the frame before; None for none.
        """
        self._waiting.append(detections)
        self._camera.append(None if motion is None else motion.similarity)
        chunk = self.settings.chunk
        if chunk is not None and len(self._camera) - self._first_open >= chunk + self.settings.overlap:
            self._decide(len(self._camera) - self.settings.overlap)

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far, by id; as they are if the video ends here."""
        return [person.track for person in self.people()]

    def people(self) -> list[ActingTrack]:
        """The same with what each person does."""
        *_, last = self.iterations()
        return self.people_with(last.labels)

    def iterations(self) -> Iterator[Iteration]:
        """The flows over what is not final yet, one after the other."""
        self._absorb()
        yield from self._refined(None)

    def _refined(self, goes_on: BoolArray | None) -> Iterator[Iteration]:
        rows, actions = self._open.rows, self._open.actions
        return refine(rows, actions, self.prices, self.settings.refinement, self._past(), goes_on)

    def people_with(self, labels: IntArray) -> list[ActingTrack]:
        """The result if the detections that are not final belong to other tracks.

        Args:
            labels: ``(N,)`` as those of an `Iteration`, in the order in which the detections came.
        """
        self._absorb()
        every = _joined([*self._done, self._open])
        labels = np.concatenate([*self._done_labels, labels])
        settings = self.settings
        found = finished_tracks(every.rows, labels, settings.min_detections, settings.gaps, settings.smoothing)
        return [self._acting(track, every, tracklet) for track, tracklet in found]

    def _acting(self, track: Track, every: _Described, tracklet: IntArray) -> ActingTrack:
        """``track`` where the camera sees it, with the actions of its detections ``tracklet``."""
        seen = replace(track, boxes=self._camera.from_first(track.boxes, track.frames))
        if every.actions is None:
            return ActingTrack(seen)
        actions, frames = every.actions[tracklet], every.rows.frames[tracklet]
        single = np.stack([np.interp(track.frames, frames, column) for column in actions.T], axis=1)
        zeros, at = np.zeros(len(tracklet), np.int64), np.zeros(len(track), np.int64)
        half = self.settings.refinement.window // 2
        multi = window_means(frames, zeros, actions, track.frames, at, (half, half))
        return ActingTrack(seen, single, np.where(np.isnan(multi), single, multi))

    def _absorb(self) -> None:
        """Add the waiting frames to what is not final."""
        if not self._waiting:
            return
        first = len(self._camera) - len(self._waiting)
        number = sum(len(part) for part in (*self._done, self._open))
        rows = rows_of(self._waiting, first, number)
        rows = replace(rows, boxes=self._camera.to_first(rows.boxes, rows.frames))
        given = [found.actions for found in self._waiting if found.actions is not None]
        if given and any(found.actions is None and len(found) for found in self._waiting):
            raise ValueError("expected action features for all frames or for none")
        self._waiting = []
        self._open = _joined([self._open, _Described(rows, np.concatenate(given) if given else None)])
        self._continued = np.append(self._continued, np.full(len(rows), -1))

    def _decide(self, before: int) -> None:
        """Make what lies before the frame ``before`` final."""
        self._absorb()
        *_, last = self._refined(self._open.rows.frames >= len(self._camera) - self.settings.refinement.gate.window)
        done = self._open.rows.frames < before
        decided, labels = self._open.select(done), last.labels[done]
        self._done.append(decided.without_appearance())
        self._done_labels.append(labels)
        self._next = max(self._next, int(labels.max(initial=-1)) + 1)
        self._remember(decided, labels, before)
        leaving = np.flatnonzero(done & (last.solution.follower >= 0))
        self._continued[last.solution.follower[leaving]] = last.labels[leaving]
        self._open, self._continued = self._open.select(~done), self._continued[~done]
        self._first_open = before

    def _remember(self, decided: _Described, labels: IntArray, before: int) -> None:
        """Keep the final detections that the windows of later ones reach back to."""
        frames = np.append(self._recent.frames, decided.rows.frames)
        near = frames >= before - self.settings.refinement.window
        actions = decided.actions
        if actions is not None and self._recent.actions is not None:
            actions = np.concatenate([self._recent.actions, actions])
        self._recent = _Recent(
            frames[near], np.append(self._recent.tracks, labels)[near], None if actions is None else actions[near]
        )

    def _past(self) -> Past | None:
        recent = self._recent
        return Past(recent.frames, recent.tracks, recent.actions, self._continued, self._next) if self._done else None


def finished_tracks(
    rows: DetectionRows,
    labels: IntArray,
    min_detections: int,
    gaps: GapSettings | None,
    smoothing: SmoothingSettings | None,
) -> list[tuple[Track, IntArray]]:
    """The tracks with enough detections, their gaps filled and boxes smoothed, by the frame they start in.

    Args:
        rows: the detections.
        labels: ``(N,)`` number of the track of each, -1 for none.
        min_detections: tracks of fewer that a detector scored are dropped; what it did not score gets 0.
        gaps: which gaps are filled; None fills none.
        smoothing: how far boxes are smoothed; None leaves them as they were detected.

    Returns:
        Each track, and the indices of its detections in the order of its observed frames.
    """
    used = np.flatnonzero(labels >= 0)
    order = used[np.lexsort((rows.frames[used], labels[used]))]
    tracklets = np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)
    scored = ~np.isnan(rows.scores)
    long = [tracklet for tracklet in tracklets if scored[tracklet].sum() >= max(min_detections, 1)]
    tracks = []
    for number, tracklet in enumerate(sorted(long, key=lambda tracklet: int(tracklet[0])), start=1):
        track = Track(number, rows.frames[tracklet], rows.boxes[tracklet], np.nan_to_num(rows.scores[tracklet]))
        if gaps is not None:
            track = fill_gaps(track, gaps)
        tracks.append((smooth(track, smoothing) if smoothing is not None else track, tracklet))
    return tracks


@dataclass(frozen=True)
class _Described:
    """Detections with their action features."""

    rows: DetectionRows
    actions: FloatArray | None

    def __len__(self) -> int:
        return len(self.rows)

    def select(self, which: BoolArray) -> _Described:
        return _Described(self.rows.select(which), None if self.actions is None else self.actions[which])

    def without_appearance(self) -> _Described:
        return _Described(replace(self.rows, features=None), self.actions)


@dataclass(frozen=True)
class _Recent:
    """Final detections of the last frames, and the tracks they belong to."""

    frames: IntArray
    tracks: IntArray
    actions: FloatArray | None


def _joined(parts: Sequence[_Described]) -> _Described:
    """The detections of several parts, one after the other."""
    actions = [part.actions for part in parts if part.actions is not None]
    return _Described(join_rows([part.rows for part in parts]), np.concatenate(actions) if actions else None)
