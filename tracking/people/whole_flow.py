"""The flow over a whole video: tracks come at its end, though most of it is solved while it comes."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np

from tsuiseki.tracking.association.flow.flow_window import FlowWindow
from tsuiseki.tracking.association.flow.seen import Seen, joined_detections, no_detections
from tsuiseki.tracking.association.flow.sliding_flow import Decision
from tsuiseki.tracking.association.tracklets.joining import join
from tsuiseki.tracking.association.tracklets.smoothness import fit_smoothing
from tsuiseki.tracking.association.tracklets.straddling import straddling_tracks
from tsuiseki.tracking.association.tracklets.tracklets import Chained, Tracklets
from tsuiseki.tracking.people.flow_input import FlowInput, solve_window
from tsuiseki.tracking.people.flow_output import long_tracks, reported
from tsuiseki.tracking.people.flow_settings import FlowSettings
from tsuiseki.tracking.types import Detections, FloatArray, IntArray, Track


class WholeFlow:
    """Solves a sliding window (`sliding_flow`), and joins what it decided when the tracks are asked for.

    Features and network are held for the undecided detections only; what remains of a decided one is its row in the
    result.

    Args:
        settings: of the tracker.
        given: prepares the detections.
        window: a fresh one.
    """

    def __init__(self, settings: FlowSettings, given: FlowInput, window: FlowWindow) -> None:
        self.settings, self.input, self.window = settings, given, window
        self.clutter = 0
        self.actions: list[FloatArray | None] = []
        self._tracklets = Tracklets()
        self._frame = 0
        self._waiting: list[Detections] = []
        self._every = no_detections(given.frame_rate, given.size)
        self._parts: list[Seen] = []
        self._scores = np.empty(0)

    def update(self, found: Detections) -> None:
        """Take the next frame."""
        self._waiting.append(found)
        self._frame += 1
        every, rate = self.settings.decide_every, self.input.frame_rate
        # Where much stays undecided, new frames are awaited in proportion.
        undecided = len(self.window.undecided())
        if every is not None and len(self._waiting) >= every * rate and sum(map(len, self._waiting)) >= undecided:
            self._decide()

    def ended(self) -> WholeFlow:
        """A copy for which the video ends here, so that asking changes nothing."""
        other = copy(self)
        other.input, other.window, other._tracklets = self.input.copy(), self.window.copy(), self._tracklets.copy()
        other._parts, other.actions = [*self._parts], []
        return other

    def tracks(self) -> list[Track]:
        """Decide all that is left; the tracks."""
        self._absorb()
        window, tracklets = self.window, self._tracklets
        solve_window(window, self.input, self._scores[window.seen.numbers])
        rest = window.remainder()
        tracklets.add(self._chained(rest, window.seen))
        every = self._table()
        labels = tracklets.labels(len(every))
        if self.settings.join is not None and len(every):
            appearance = tracklets.appearance()
            link, places = window.costs.link, None
            if window.costs.places is not None:
                places = window.place_costs(every.image)
            labels = join(every, labels, appearance, link, self.settings.join, window.changes, None, places)
        return self._finished(every, labels)

    def _decide(self) -> None:
        """Solve the window and let go of what is decided."""
        self._absorb()
        window, settings = self.window, self.settings
        solve_window(window, self.input, self._scores[window.seen.numbers])
        seen = window.seen
        margin = round((settings.costs.rounds.window + settings.settle) * self.input.frame_rate)
        decision = window.decide(self._frame - 1, self._frame - margin)
        self._tracklets.add(self._chained(decision, seen))

    def _absorb(self) -> None:
        """Take in the waiting frames."""
        if not self._waiting:
            return
        seen, scores = self.input.rows(self._waiting)
        self._waiting = []
        self.window.costs = self.input.flow_costs(self.settings.costs)
        self.window.add(seen)
        self._parts.append(replace(seen, features=None))
        self._scores = np.append(self._scores, scores)

    @staticmethod
    def _chained(decision: Decision, seen: Seen) -> Chained:
        used = decision.used
        place = np.searchsorted(seen.numbers, decision.numbers[used])
        features = None if seen.features is None else seen.features[place]
        return Chained(decision.numbers[used], decision.follower[used], features)

    def _table(self) -> Seen:
        """The rows of all detections."""
        for part in self._parts:
            self._every = joined_detections(self._every, part)
        self._parts = []
        return self._every

    def _finished(self, every: Seen, labels: IntArray) -> list[Track]:
        """The tracks with enough detections, their gaps filled, by the frame they start in."""
        rate, settings = self.input.frame_rate, self.settings
        longest = round(settings.fill * rate)
        tracks: list[Track] = []
        images: list[FloatArray] = []
        # A video of fast targets bears nothing out, so its own calibration judges no track.
        least = -np.inf if self.input.observation is None else settings.least
        logit = self.input.logits(self._scores[every.numbers])
        fewest = max(min(settings.fewest(rate), self._frame), 1)
        for piece in long_tracks(labels, fewest):
            if logit[piece].mean() < least:
                self.clutter += 1
                continue
            track = Track(len(tracks) + 1, every.frames[piece], every.boxes[piece], np.nan_to_num(self._scores[piece]))
            self.actions.append(None if every.actions is None else every.actions[piece])
            tracks.append(track)
            images.append(every.image[piece])
        smoothing = None if settings.smoothing is None else fit_smoothing(tracks, rate, settings.smoothing)
        result = [reported(*one, self.input.camera, longest, smoothing) for one in zip(tracks, images, strict=True)]
        return self._without_straddling(result, settings.straddling) if settings.straddling else result

    def _without_straddling(self, tracks: list[Track], share: float) -> list[Track]:
        """Those that are further people, numbered anew; what the others do is left out, too."""
        kept = np.flatnonzero(~straddling_tracks(tracks, share)).tolist()
        self.clutter += len(tracks) - len(kept)
        self.actions = [self.actions[n] for n in kept]
        return [replace(tracks[n], id=number) for number, n in enumerate(kept, start=1)]
