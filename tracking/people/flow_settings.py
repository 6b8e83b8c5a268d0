"""Settings of the flow tracker."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from tsuiseki.tracking.association.flow.flow_window import FlowCosts
from tsuiseki.tracking.association.tracklets.joining import JoinSettings
from tsuiseki.tracking.association.tracklets.smoothness import FittedSmoothing
from tsuiseki.tracking.people.flow_input import InputSettings


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
        straddling: share of a box that those of surer tracks cover together, from which on they explain it; a track
            most of whose detections are explained is no further person, and dropped; only where the answer comes at the
            end. 0 keeps all, and so does None, except with `people_tracker`, which knows whose boxes they are.
        fill: longest gap that is filled, on a straight line.
        smoothing: how it is chosen how far boxes are smoothed; None reports them as detected.
        decide_every: least time between two decisions; None solves all frames at once in the end.
        settle: time that stays undecided beyond the longest link, for the motion on both sides of what is decided.
        most_undecided: most time that may stay undecided; None lets it grow until every decision is exact.
    """

    input: InputSettings = field(default_factory=InputSettings)
    costs: FlowCosts = field(default_factory=FlowCosts)
    join: JoinSettings | None = field(default_factory=JoinSettings)
    min_detections: int = 3
    min_time: float = 0.16
    least: float = 1.0
    straddling: float | None = None
    fill: float = 2.0
    smoothing: FittedSmoothing | None = field(default_factory=FittedSmoothing)
    decide_every: float | None = 20.0
    settle: float = 0.7
    most_undecided: float | None = None

    def __post_init__(self) -> None:
        if self.decide_every is not None and self.decide_every <= 0:
            raise ValueError(f"expected decide_every above 0 seconds, got {self.decide_every}")
        if min(self.min_detections, self.min_time, self.fill, self.settle) < 0:
            raise ValueError("expected min_detections, min_time, fill and settle from 0")
        if self.straddling is not None and not 0 <= self.straddling <= 1:
            raise ValueError(f"expected straddling in [0, 1], got {self.straddling}")
        if self.most_undecided is not None and self.most_undecided <= self.costs.rounds.window + self.settle:
            raise ValueError(f"expected most_undecided above window + settle, got {self.most_undecided}")

    def alike(self) -> FlowSettings:
        """These settings with entry and exit costs that take all places alike."""
        return replace(self, costs=replace(self.costs, places=None))

    def fewest(self, frame_rate: float) -> int:
        """Detections that a track needs."""
        return max(self.min_detections, round(self.min_time * frame_rate), 1)
