"""The flow with prices of pairs alone, over a whole video at once: for few frames a second, and for comparison."""

from __future__ import annotations

from dataclasses import dataclass, field

from tsuiseki.tracking.association.costs import HandSetCost, ObservationCost, TransitionCost, priced_pairs
from tsuiseki.tracking.association.flow.network_flow import build_graph, solve, track_labels
from tsuiseki.tracking.association.gating import GateSettings
from tsuiseki.tracking.association.rows import DetectionRows
from tsuiseki.tracking.types import IntArray


@dataclass(frozen=True)
class PairwiseCosts:
    """What the flow costs.

    Attributes:
        gate: which detections may be linked.
        observation: of detections, c_obsv.
        transition: of pairs, c_tran.
        entry: of a track's start, and of its end.
        miss: of every frame between two linked detections.
    """

    gate: GateSettings = field(default_factory=GateSettings)
    observation: ObservationCost = field(default_factory=ObservationCost)
    transition: TransitionCost = field(default_factory=HandSetCost)
    entry: float = 2.0
    miss: float = 0.1


def pairwise_tracks(rows: DetectionRows, costs: PairwiseCosts) -> IntArray:
    """``(N,)`` track of each detection from 0 on, -1 for none."""
    pairs = priced_pairs(rows.frames, rows.boxes, rows.features, costs.gate, costs.transition, costs.miss)
    return track_labels(solve(build_graph(costs.observation(rows.scores), pairs, costs.entry, costs.entry)))
