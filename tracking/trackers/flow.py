"""All people of a video at once, by minimum-cost flow (thesis 2.3.2, eq. 2.11-2.17)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tsuiseki.tracking.association.costs import HandSetCost, ObservationCost, TransitionCost, priced_pairs
from tsuiseki.tracking.association.gating import GateSettings
from tsuiseki.tracking.association.interpolation import GapSettings, SmoothingSettings, fill_gaps, smooth
from tsuiseki.tracking.association.network_flow import build_graph
from tsuiseki.tracking.association.tracklets import JoinSettings, Pieces, join, make_tracklets
from tsuiseki.tracking.association.windows import Decision, WindowedFlow
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray, Track


@dataclass(frozen=True)
class FlowSettings:
    """Settings of the flow tracker.

    Attributes:
        gate: which detections may be linked, and over how many frames.
        entry: cost of a track's start, c_entr.
        exit: cost of a track's end, c_exit.
        miss: cost of every frame between two linked detections.
        join: how pieces of tracks are joined over longer gaps; None leaves the pieces apart.
        min_detections: tracks of fewer detections are dropped.
        gaps: which gaps are filled; None fills none.
        smoothing: how far boxes are smoothed; None reports them as detected.
        chunk: frames after which detections are decided in the sliding-window mode; None solves all frames at once.
        longest: most frames that the sliding window may hold; None lets it grow until every decision is exact.
    """

    gate: GateSettings = field(default_factory=lambda: GateSettings(window=3))
    entry: float = 2.0
    exit: float = 2.0
    miss: float = 0.065
    join: JoinSettings | None = field(default_factory=JoinSettings)
    min_detections: int = 4
    gaps: GapSettings | None = field(default_factory=GapSettings)
    smoothing: SmoothingSettings | None = field(default_factory=SmoothingSettings)
    chunk: int | None = None
    longest: int | None = None

    def __post_init__(self) -> None:
        if not (0 <= self.entry < np.inf and 0 <= self.exit < np.inf and 0 <= self.miss < np.inf):
            raise ValueError("expected finite entry, exit and miss costs of 0 or more")
        if self.chunk is not None and self.chunk < 1:
            raise ValueError(f"expected a chunk of at least 1 frame, got {self.chunk}")


class FlowTracker:
    """The cheapest set of tracks that explains all detections.

    The flow over detections is solved exactly; its pieces are joined over longer gaps by the same network with pieces
    for detections, then weak tracks are dropped, gaps filled as far as the evidence goes, and boxes smoothed.

    With ``chunk`` set the flow is solved while the video comes, over a sliding window (`windows`): the tracks are the
    same, but features and network are held for the undecided frames only. What remains of a decided detection is its
    row in the result.

    Args:
        settings: costs and stages.
        transition: prices pairs of detections; by default `HandSetCost`.
        observation: prices detections; by default `ObservationCost`.
    """

    def __init__(
        self,
        settings: FlowSettings | None = None,
        transition: TransitionCost | None = None,
        observation: ObservationCost | None = None,
    ) -> None:
        self.settings = settings or FlowSettings()
        self._transition = transition or HandSetCost()
        self._observation = observation or ObservationCost()
        self._flow = WindowedFlow(self.settings.gate.window + 1, self.settings.entry, self.settings.longest)
        self._pieces = Pieces()
        self._frame = 0
        self._waiting: list[Detections] = []
        self._open = _rows_of([Detections.empty()], 0, 0)
        self._rows: list[_Rows] = [self._open]

    @property
    def exact(self) -> bool:
        """False once ``longest`` has forced a decision before its time."""
        return self._flow.exact

    def update(self, detections: Detections) -> None:
        """Take the detections of the next frame."""
        self._waiting.append(detections)
        self._frame += 1
        if self.settings.chunk is not None and len(self._waiting) >= self.settings.chunk:
            self._absorb()
            self._add(self._pieces, self._flow.decide(self._frame - 1))
            self._open = self._open.select(np.isin(self._open.numbers, self._flow.undecided, assume_unique=True))

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far, by id; as they are if the video ends here."""
        self._absorb()
        pieces = self._pieces.copy()
        self._add(pieces, self._flow.remainder())
        rows = _joined(self._rows)
        labels = pieces.labels(len(rows))
        if self.settings.join is not None and len(rows):
            motion = self.settings.join.motion
            tracklets = make_tracklets(rows.frames, rows.boxes, pieces.costs, labels, pieces.looks(), motion)
            # The appended -1 keeps detections outside all pieces outside all tracks.
            labels = np.append(join(tracklets, self.settings.join), -1)[labels]
        return _finished(rows, labels, self.settings)

    def _absorb(self) -> None:
        """Extend the network by the waiting frames."""
        if not self._waiting:
            return
        start = self._frame - len(self._waiting)
        count = sum(len(rows) for rows in self._rows)
        new = _rows_of(self._waiting, start, count)
        self._waiting = []
        self._rows.append(replace(new, features=None))
        old = len(self._open)
        self._open = rows = _joined([self._open, new])
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

    def _add(self, pieces: Pieces, decision: Decision) -> None:
        features = self._open.features
        place = np.searchsorted(self._open.numbers, decision.numbers)
        pieces.add(decision, None if features is None else features[place])


@dataclass(frozen=True)
class _Rows:
    """Detections of several frames in one table, in order.

    Attributes:
        numbers: ``(N,)`` counted over the whole video.
        frames: ``(N,)``.
        boxes: ``(N, 4)`` pixels.
        scores: ``(N,)``.
        features: ``(N, D)``, NaN where not known; None where no detection has any.
    """

    numbers: IntArray
    frames: IntArray
    boxes: FloatArray
    scores: FloatArray
    features: FloatArray | None

    def __len__(self) -> int:
        return len(self.numbers)

    def select(self, which: BoolArray) -> _Rows:
        features = None if self.features is None else self.features[which]
        return _Rows(self.numbers[which], self.frames[which], self.boxes[which], self.scores[which], features)


def _rows_of(detections: Sequence[Detections], first_frame: int, first_number: int) -> _Rows:
    """The detections of consecutive frames."""
    lengths = [len(found) for found in detections]
    boxes = np.concatenate([found.boxes for found in detections])
    return _Rows(
        first_number + np.arange(len(boxes)),
        first_frame + np.repeat(np.arange(len(detections)), lengths),
        boxes,
        np.concatenate([found.scores for found in detections]),
        _stacked([found.features for found in detections], lengths),
    )


def _joined(rows: Sequence[_Rows]) -> _Rows:
    """The rows of several tables, one after the other."""
    return _Rows(
        np.concatenate([part.numbers for part in rows]),
        np.concatenate([part.frames for part in rows]),
        np.concatenate([part.boxes for part in rows]),
        np.concatenate([part.scores for part in rows]),
        _stacked([part.features for part in rows], [len(part) for part in rows]),
    )


def _stacked(features: Sequence[FloatArray | None], lengths: Sequence[int]) -> FloatArray | None:
    """Features one below the other, NaN for those that are not known.

    Raises:
        ValueError: they are of different lengths.
    """
    known = {part.shape[1] for part in features if part is not None and len(part)}
    if not known:
        return None
    if len(known) > 1:
        raise ValueError(f"expected features of one length, got lengths {sorted(known)}")
    width = known.pop()
    return np.concatenate(
        [
            np.full((length, width), np.nan) if part is None else part.reshape(length, width)
            for part, length in zip(features, lengths, strict=True)
        ]
    )


def _finished(rows: _Rows, labels: IntArray, settings: FlowSettings) -> list[Track]:
    """The tracks with enough detections, their gaps filled and boxes smoothed, by the frame they start in."""
    used = np.flatnonzero(labels >= 0)
    order = used[np.lexsort((rows.frames[used], labels[used]))]
    pieces = np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)
    pieces = sorted(
        (piece for piece in pieces if len(piece) >= max(settings.min_detections, 1)), key=lambda piece: int(piece[0])
    )
    tracks = []
    for number, piece in enumerate(pieces, start=1):
        track = Track(number, rows.frames[piece], rows.boxes[piece], rows.scores[piece])
        if settings.gaps is not None:
            track = fill_gaps(track, settings.gaps)
        tracks.append(smooth(track, settings.smoothing) if settings.smoothing is not None else track)
    return tracks
