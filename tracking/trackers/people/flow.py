"""All targets of a video at once, by minimum-cost flow (thesis 2.3.2, eq. 2.11-2.17)."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tsuiseki.tracking.association.costs import ObservationCost, TransitionCost
from tsuiseki.tracking.association.flow.cost_network import CostChanges
from tsuiseki.tracking.association.flow.flow_rounds import Seen
from tsuiseki.tracking.association.flow.flow_window import FlowCosts, FlowWindow, joined_detections, no_detections
from tsuiseki.tracking.association.flow.sliding_flow import Decision
from tsuiseki.tracking.association.tracklets.interpolation import GapSettings, SmoothingSettings, fill_gaps, smooth
from tsuiseki.tracking.association.tracklets.joining import JoinSettings, join
from tsuiseki.tracking.association.tracklets.tracklets import Chained, Tracklets
from tsuiseki.tracking.features.motion.camera_path import CameraPath
from tsuiseki.tracking.features.motion.camera_trajectory import CameraTrajectory
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.trackers.people.flow_input import FlowInput, InputSettings
from tsuiseki.tracking.types import Detections, FloatArray, IntArray, Track


@dataclass(frozen=True)
class FlowSettings:
    """Settings of the flow tracker. Times are in seconds, so that they hold at any frame rate.

    Attributes:
        input: how detections are prepared: the worth of their scores, the motion of the camera, duplicates.
        costs: of the flow over detections.
        join: how tracklets are joined over longer gaps; None leaves them apart.
        min_detections: tracks of fewer detections are dropped, unless the video itself has fewer frames.
        min_time: and so are those of fewer than this many seconds of detections.
        least: mean logit of the probability of a track's detections, under which it is taken for clutter; only where
            learnt prices say what scores are worth.
        fill: longest gap that is filled, on a straight line.
        smoothing: how far boxes are smoothed; None reports them as detected.
        chunk: least time between two decisions; None solves all frames at once in the end.
        settle: time that stays undecided beyond the longest link, for the motion on both sides of what is decided.
        longest: most time that may stay undecided; None lets it grow until every decision is exact.
    """

    input: InputSettings = field(default_factory=InputSettings)
    costs: FlowCosts = field(default_factory=FlowCosts)
    join: JoinSettings | None = field(default_factory=JoinSettings)
    min_detections: int = 3
    min_time: float = 0.16
    least: float = 1.0
    fill: float = 2.0
    smoothing: SmoothingSettings | None = field(default_factory=lambda: SmoothingSettings(60.0, 5000.0))
    chunk: float | None = 20.0
    settle: float = 0.7
    longest: float | None = None

    def __post_init__(self) -> None:
        if self.chunk is not None and self.chunk <= 0:
            raise ValueError(f"expected a chunk above 0 seconds, got {self.chunk}")
        if min(self.min_detections, self.min_time, self.fill, self.settle) < 0:
            raise ValueError("expected min_detections, min_time, fill and settle from 0")
        if self.longest is not None and self.longest <= self.costs.rounds.window + self.settle:
            raise ValueError(f"expected longest above window + settle, got {self.longest}")

    def fewest(self, frame_rate: float) -> int:
        """Detections that a track needs."""
        return max(self.min_detections, round(self.min_time * frame_rate), 1)


class FlowTracker:
    """The cheapest set of tracks that explains all detections.

    What a score is worth is learnt from the video (`score_calibration`), and the camera's motion is taken out
    (`camera_from_boxes`). The flow over detections is solved exactly (`network_flow`), in turn with the prices of its
    links by the motion along its tracks (`flow_rounds`). Its tracks are joined over longer gaps (`joining`), weak ones
    are dropped, and gaps filled.

    With ``chunk`` set the flow is solved while the video comes, over a sliding window (`sliding_flow`). Features and
    network are held for the undecided detections only; what remains of a decided one is its row in the result.

    Args:
        settings: costs and stages.
        transition: learnt prices of pairs of detections, taken beside the motion; by default none.
        observation: learnt prices of scores, taken for their calibration; by default the video calibrates them.
        frame_rate: frames a second.
        size: width and height of the image, so that leaving it is told from being missed; None where not known.
        camera: its motion from images, which gets each frame before its detections come here; None takes the boxes.
        seed: taken as by all trackers; nothing is drawn.
        changes: by how much costs learnt on whole tracks differ from the settings'; by default not at all.
    """

    def __init__(
        self,
        settings: FlowSettings | None = None,
        transition: TransitionCost | None = None,
        observation: ObservationCost | None = None,
        frame_rate: float = 25.0,
        size: tuple[int, int] | None = None,
        camera: CameraPath | None = None,
        seed: int = 0,  # noqa: ARG002
        changes: CostChanges | None = None,
    ) -> None:
        if not 0 < frame_rate < np.inf:
            raise ValueError(f"expected a frame rate above 0, got {frame_rate}")
        self.settings = settings = settings or FlowSettings()
        self._observation = observation
        self._input = FlowInput(settings.input, settings.costs.link.motion, frame_rate, size, camera)
        self._looked_at, self._clutter = self._input, 0
        longest = None if settings.longest is None else round(settings.longest * frame_rate)
        self._window = FlowWindow(settings.costs, frame_rate, size, longest, transition, changes)
        self._changes = changes
        self._tracklets = Tracklets()
        self._frame = 0
        self._waiting: list[Detections] = []
        self._every = no_detections(frame_rate, size)
        self._parts: list[Seen] = []
        self._scores = np.empty(0)

    @property
    def exact(self) -> bool:
        """False once ``longest`` has forced a decision before its time."""
        return self._window.exact

    @property
    def camera(self) -> CameraTrajectory:
        """Where the frames lie, as of the last time that the tracks were asked for."""
        return self._looked_at.camera

    @property
    def duplicates(self) -> int:
        """Boxes left out because they lay on another, as of the last time that the tracks were asked for."""
        return self._looked_at.duplicates

    def facts(self) -> dict[str, Any]:
        """What ``run.json`` tells of the tracker, as of the last time that the tracks were asked for."""
        camera = self.camera
        return {
            "exact": self.exact,
            "camera_from": camera.source,
            "camera_unknown": [frame + 1 for frame in camera.unknown],
            "duplicates": self.duplicates,
            "clutter_tracks": self._clutter,
        }

    def update(self, detections: DetectionsLike) -> None:
        """Take the detections of the next frame."""
        self._waiting.append(as_detections(detections))
        self._frame += 1
        chunk, rate = self.settings.chunk, self._input.frame_rate
        # Where much stays undecided, new frames are awaited in proportion.
        undecided = len(self._window.undecided())
        if chunk is not None and len(self._waiting) >= chunk * rate and sum(map(len, self._waiting)) >= undecided:
            self._decide()

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far, by id; as they are if the video ends here."""
        rest = self._copy()
        rest._clutter = 0
        tracks = rest._finish()
        self._looked_at, self._clutter = rest._input, rest._clutter
        return tracks

    def _copy(self) -> FlowTracker:
        """A copy that ends by itself, so that asking changes nothing."""
        other = copy(self)
        other._input, other._window, other._tracklets = self._input.copy(), self._window.copy(), self._tracklets.copy()
        other._parts = [*self._parts]
        return other

    def _finish(self) -> list[Track]:
        """Decide all that is left."""
        self._absorb()
        window, tracklets = self._window, self._tracklets
        if len(window.undecided()):
            self._solve()
        rest = window.remainder()
        tracklets.add(self._chained(rest, window.seen))
        every = self._table()
        labels = tracklets.labels(len(every))
        if self.settings.join is not None and len(every):
            appearance = tracklets.appearance()
            labels = join(every, labels, appearance, self.settings.costs.link, self.settings.join, self._changes)
        return self._finished(every, labels)

    def _decide(self) -> None:
        """Solve the window and let go of what is decided."""
        self._absorb()
        window, settings = self._window, self.settings
        self._solve()
        seen = window.seen
        margin = round((settings.costs.rounds.window + settings.settle) * self._input.frame_rate)
        decision = window.decide(self._frame - 1, self._frame - margin)
        self._tracklets.add(self._chained(decision, seen))

    def _absorb(self) -> None:
        """Take in the waiting frames."""
        if not self._waiting:
            return
        seen, scores = self._input.rows(self._waiting)
        self._waiting = []
        self._window.add(seen)
        self._parts.append(replace(seen, features=None))
        self._scores = np.append(self._scores, scores)

    def _solve(self) -> None:
        """Alternate between the flow of what is not decided and the prices of its links."""
        window = self._window
        observation = self._costs(window.undecided())
        if self._changes is None:
            window.solve(observation)
            return
        numbers = window.seen.numbers
        probability = self._probability(numbers)
        change = window.learnt(np.log(probability / (1 - probability)), self._costs(numbers))
        window.solve(observation + change[:, 0], change[:, 1], change[:, 2])

    def _costs(self, numbers: IntArray) -> FloatArray:
        """``(U,)`` what using detections costs."""
        return self.settings.input.detection(self._probability(numbers), self._input.frame_rate)

    def _probability(self, numbers: IntArray) -> FloatArray:
        """``(U,)`` of detections being right: as learnt, and by what the video says where nothing is."""
        scores, least = self._scores[numbers], self.settings.input.detection.least
        if self._observation is None:
            return self._input.calibration(scores)
        odds = np.exp(self._observation(np.nan_to_num(scores)) - self._observation.b)
        return np.clip(1 / (1 + odds), least, 1 - least)

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
        rate, settings = self._input.frame_rate, self.settings
        gaps = GapSettings(longest=round(settings.fill * rate), support=np.inf, mismatch=np.inf)
        tracks: list[Track] = []
        # A video of fast targets bears nothing out, so its own calibration judges no track.
        least = -np.inf if self._observation is None else settings.least
        probability = self._probability(every.numbers)
        logit = np.log(probability / (1 - probability))
        fewest = max(min(settings.fewest(rate), self._frame), 1)
        for piece in long_tracks(labels, fewest):
            if logit[piece].mean() < least:
                self._clutter += 1
                continue
            track = Track(len(tracks) + 1, every.frames[piece], every.boxes[piece], np.nan_to_num(self._scores[piece]))
            track = fill_gaps(track, gaps)
            if settings.smoothing is not None:
                boxes = self._input.camera.from_first(smooth(track, settings.smoothing).boxes, track.frames)
            else:
                boxes = self._input.camera.from_first(track.boxes, track.frames)
                boxes[track.observed] = every.image[piece]
            tracks.append(replace(track, boxes=boxes))
        return tracks


def long_tracks(labels: IntArray, fewest: int) -> list[IntArray]:
    """Indices of the detections of each track that has enough of them, by the first.

    Args:
        labels: ``(N,)`` number of the track of each, -1 for none; in the order of the frames.
        fewest: detections that a track needs.
    """
    used = np.flatnonzero(labels >= 0)
    order = used[np.argsort(labels[used], kind="stable")]
    pieces = np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)
    return sorted((piece for piece in pieces if len(piece) >= fewest), key=lambda piece: int(piece[0]))
