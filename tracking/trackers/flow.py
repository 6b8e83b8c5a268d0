"""All people of a video at once, by minimum-cost flow (thesis 2.3.2, eq. 2.11-2.17)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from tsuiseki.tracking.association.costs import HandSetCost, ObservationCost, TransitionCost, priced_pairs
from tsuiseki.tracking.association.gating import GateSettings
from tsuiseki.tracking.association.interpolation import GapSettings, SmoothingSettings, fill_gaps, smooth
from tsuiseki.tracking.association.network_flow import build_graph
from tsuiseki.tracking.association.pieces import Links, Pieces
from tsuiseki.tracking.association.rows import DetectionRows, join_rows, no_rows, rows_of
from tsuiseki.tracking.association.splitting import SplitSettings, Splitter
from tsuiseki.tracking.association.tracklets import JoinSettings, join, make_tracklets
from tsuiseki.tracking.association.windows import Decision, WindowedFlow
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.types import Detections, IntArray, Track


@dataclass(frozen=True)
class FlowSettings:
    """Settings of the flow tracker.

    Attributes:
        gate: which detections may be linked, and over how many frames. This one is for hand-set costs.
        entry: cost of a track's start, c_entr.
        exit: cost of a track's end, c_exit.
        miss: cost of every frame between two linked detections.
        transition: prices pairs of detections where nothing learnt does, c_tran.
        observation: prices detections where nothing learnt does, c_obsv.
        split: where tracks are cut that changed from one person to another; None cuts nothing.
        join: how pieces of tracks are joined over longer gaps; None leaves the pieces apart.
        min_detections: tracks of fewer detections are dropped.
        gaps: which gaps are filled; None fills none.
        smoothing: how far boxes are smoothed; None reports them as detected.
        chunk: least number of frames between two decisions in the sliding-window mode; None solves all frames at once
            in the end.
        longest: most frames that the sliding window may hold; None lets it grow until every decision is exact.
    """

    gate: GateSettings = field(default_factory=lambda: GateSettings(window=5))
    entry: float = 2.0
    exit: float = 2.0
    miss: float = 0.1
    transition: HandSetCost = field(default_factory=HandSetCost)
    observation: ObservationCost = field(default_factory=ObservationCost)
    split: SplitSettings | None = field(default_factory=SplitSettings)
    join: JoinSettings | None = field(default_factory=JoinSettings)
    min_detections: int = 4
    gaps: GapSettings | None = field(default_factory=GapSettings)
    smoothing: SmoothingSettings | None = field(default_factory=SmoothingSettings)
    chunk: int | None = 50
    longest: int | None = None

    def __post_init__(self) -> None:
        if not (0 <= self.entry < np.inf and 0 <= self.exit < np.inf and 0 <= self.miss < np.inf):
            raise ValueError("expected finite entry, exit and miss costs of 0 or more")
        if self.chunk is not None and self.chunk < 1:
            raise ValueError(f"expected a chunk of at least 1 frame, got {self.chunk}")


class FlowTracker:
    """The cheapest set of tracks that explains all detections.

    The flow over detections is solved exactly (`network_flow`). Its tracks are cut where they changed from one person
    to another (`splitting`) and the pieces joined over longer gaps by the same network with pieces for detections
    (`tracklets`). Weak tracks are dropped, gaps filled as far as the evidence goes, and boxes smoothed.

    With ``chunk`` set the flow is solved while the video comes, over a sliding window (see `windows`): the tracks are
    the same, but features and network are held for the undecided detections only. What remains of a decided detection
    is its row in the result.

    Args:
        settings: costs and stages.
        transition: learnt prices of pairs of detections; by default the hand-set ones of the settings. An `Affinity`
            brings the window it was learnt on, where the settings have the gate of `FlowSettings`.
        observation: learnt prices of detections; by default those of the settings.
        seed: draws nothing here; see `trackers.base`.
    """

    def __init__(
        self,
        settings: FlowSettings | None = None,
        transition: TransitionCost | None = None,
        observation: ObservationCost | None = None,
        seed: int = 0,
    ) -> None:
        self.seed = seed
        self.settings = _with_learnt_window(settings or FlowSettings(), transition)
        self._transition: TransitionCost = transition or self.settings.transition
        self._observation = observation or self.settings.observation
        self._flow = WindowedFlow(self.settings.gate.window + 1, self.settings.entry, self.settings.longest)
        split = self.settings.split
        self._splitter = None if split is None else Splitter(split, self.settings.gate.window)
        self._pieces = Pieces()
        self._frame = 0
        self._waiting: list[Detections] = []
        self._open = no_rows()
        self._rows: list[DetectionRows] = [self._open]

    @property
    def exact(self) -> bool:
        """False once ``longest`` has forced a decision before its time."""
        return self._flow.exact

    def update(self, detections: DetectionsLike) -> None:
        """Take the detections of the next frame."""
        self._waiting.append(as_detections(detections))
        self._frame += 1
        if self.settings.chunk is not None and self._is_due(self.settings.chunk):
            self._decide()

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far, by id; as they are if the video ends here."""
        self._absorb()
        rest = self._flow.remainder()
        pieces = self._pieces.copy()
        if self._splitter is None:
            pieces.add(_uncut(self._rows_at(rest), rest))
        else:
            splitter = self._splitter.copy()
            splitter.add(self._rows_at(rest), rest)
            pieces.add(splitter.release(at_end=True))
        rows = join_rows(self._rows)
        labels = pieces.labels(len(rows))
        if self.settings.join is not None and len(rows):
            motion = self.settings.join.motion
            tracklets = make_tracklets(rows.frames, rows.boxes, pieces.costs, labels, pieces.looks(), motion)
            # The appended -1 keeps detections outside all pieces outside all tracks.
            labels = np.append(join(tracklets, self.settings.join), -1)[labels]
        settings = self.settings
        return [t for t, _ in finished_tracks(rows, labels, settings.min_detections, settings.gaps, settings.smoothing)]

    def _is_due(self, chunk: int) -> bool:
        """Whether to decide now: where much stays undecided, new frames are awaited in proportion, up to a limit."""
        frames = len(self._waiting)
        return frames >= chunk and (frames >= 10 * chunk or sum(map(len, self._waiting)) >= len(self._open))

    def _decide(self) -> None:
        """Solve the window and let go of what is decided."""
        self._absorb()
        decision = self._flow.decide(self._frame - 1)
        rows = self._rows_at(decision)
        if self._splitter is None:
            self._pieces.add(_uncut(rows, decision))
        else:
            self._splitter.add(rows, decision)
            self._pieces.add(self._splitter.release())
        self._open = self._open.select(np.isin(self._open.numbers, self._flow.undecided, assume_unique=True))

    def _absorb(self) -> None:
        """Extend the network by the waiting frames."""
        if not self._waiting:
            return
        start = self._frame - len(self._waiting)
        count = sum(len(rows) for rows in self._rows)
        new = rows_of(self._waiting, start, count)
        self._waiting = []
        self._rows.append(replace(new, features=None))
        old = len(self._open)
        self._open = rows = join_rows([self._open, new])
        pairs = priced_pairs(
            rows.frames,
            rows.boxes,
            rows.features,
            self.settings.gate,
            self._transition,
            self.settings.miss,
            first_head=old,
        )
        transitions = ((rows.numbers[tail], rows.numbers[head], cost) for tail, head, cost in pairs)
        graph = build_graph(self._observation(new.scores), transitions, self.settings.entry, self.settings.exit)
        self._flow.extend(new.frames, graph)

    def _rows_at(self, decision: Decision) -> DetectionRows:
        return self._open.select(np.searchsorted(self._open.numbers, decision.numbers))


def _with_learnt_window(settings: FlowSettings, transition: TransitionCost | None) -> FlowSettings:
    """Learnt costs are right about longer gaps than hand-set ones, but not beyond those they were learnt on."""
    window = getattr(transition, "window", None)
    if window is None or settings.gate != FlowSettings().gate:
        return settings
    return replace(settings, gate=replace(settings.gate, window=window))


def _uncut(rows: DetectionRows, decision: Decision) -> Links:
    """The tracks as the flow has them."""
    used = decision.used
    features = None if rows.features is None else rows.features[used]
    return Links(decision.numbers[used], decision.follower[used], (decision.cost + decision.link)[used], features)


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
    pieces = np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)
    scored = ~np.isnan(rows.scores)
    long = [piece for piece in pieces if scored[piece].sum() >= max(min_detections, 1)]
    tracks = []
    for number, piece in enumerate(sorted(long, key=lambda piece: int(piece[0])), start=1):
        track = Track(number, rows.frames[piece], rows.boxes[piece], np.nan_to_num(rows.scores[piece]))
        if gaps is not None:
            track = fill_gaps(track, gaps)
        tracks.append((smooth(track, smoothing) if smoothing is not None else track, piece))
    return tracks
