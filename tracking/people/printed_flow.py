"""The flow of the thesis as printed: MCF (eq. 2.11-2.17), MHT-SAF (eq. 5.2) and MHT-MAF (eq. 5.3).

The cheapest flow over all detections is solved exactly. A detection costs eq. 2.12-2.13. A link costs eq. 2.14 by
boosted trees over the overlap and the appearance distance (eq. 2.15), of MHT-SAF and MHT-MAF also over the distance of
the action features (eq. 5.2). A start and an end cost 10 each, and b is −0.5 (5.4.2). MHT-MAF solves six times. Between
two times it averages the action features along the tracks found (eq. 5.3): 17 frames about each detection, since the
printed sum runs from ⌊t − 15/2⌋ to ⌈t + 15/2⌉. The divisor does not matter to a cosine.

Open in the text and decided here: the trees are fitted on action distances of single frames, and MHT-MAF applies the
same trees to distances of means. Trees fitted on means along tracks trust them too much: both ends of a wrong link
share their mean, so that no later time mends it. Detections are linked over at most as many frames as the trees were
fitted on, within `PRINTED_GATE`. Missed frames cost nothing. Boxes are compared where the picture shows them, and no
gap is filled.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tsuiseki.tracking.association.costs import window_means
from tsuiseki.tracking.association.detection_tables import DetectionRows, rows_of
from tsuiseki.tracking.association.learnt_costs import Affinity
from tsuiseki.tracking.association.network_flow import build_graph, solve, track_labels
from tsuiseki.tracking.association.pairwise_flow import PRINTED_GATE, pairs_with_costs
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.people.whole_flow import long_tracks
from tsuiseki.tracking.types import Detections, FloatArray, IntArray, Track

# c_entr = c_exit, what a start and an end of a track cost each (5.4.2).
ENTRY = 10.0
# b of the costs of detections (5.4.2).
BIAS = -0.5
# Frames before and after a detection whose action features eq. 5.3 averages, from λ = 15.
HALF_WINDOW = 8
# How often MHT-MAF solves the flow.
ITERATIONS = 6


class PrintedFlow:
    """MCF, MHT-SAF and MHT-MAF as the thesis prints them; a `PeopleTracker` that answers at the end.

    Args:
        affinity: trees over the features ``thesis`` (MCF), or ``thesis_action``, which compares actions.
        iterations: how often the flow is solved: 1 is MHT-SAF, 6 MHT-MAF. Without actions once is enough.

    Raises:
        RequestError: the trees take other features.
    """

    def __init__(self, affinity: Affinity, iterations: int = ITERATIONS) -> None:
        if affinity.features not in ("thesis", "thesis_action"):
            raise RequestError(
                f"expected costs of links by the features thesis or thesis_action, got {affinity.features}; fit them "
                "with train affinity --features thesis"
            )
        self._affinity = affinity
        self._iterations = iterations if affinity.acting else 1
        self._detections: list[Detections] = []
        self.actions: list[FloatArray | None] = []

    def update(self, detections: DetectionsLike) -> None:
        """Take the next frame, with actions where the trees compare them."""
        detections = as_detections(detections)
        if self._affinity.acting and detections.actions is None and len(detections):
            raise RequestError("expected action features, which the costs of links compare, got detections without")
        self._detections.append(detections)

    def skip(self) -> None:
        """Take a frame without inference."""
        self._detections.append(Detections.empty())

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far; ``actions`` becomes ``(D, A)`` probabilities at the boxes of each."""
        if not self._detections:
            return []
        rows = rows_of(self._detections, 0, 0)
        origin = np.concatenate([entry.origin for entry in self._detections])
        pieces = long_tracks(self._labels(rows))
        self.actions = [None if rows.actions is None else rows.actions[piece] for piece in pieces]
        scores = np.nan_to_num(rows.scores)
        names = self._detections[-1].names
        return [
            Track(number, rows.frames[p], rows.boxes[p], scores[p], origin=origin[p], names=names)
            for number, p in enumerate(pieces, start=1)
        ]

    def facts(self) -> dict[str, Any]:
        """What ``run.json`` tells of the tracker."""
        return {"preset": "printed", "iterations": self._iterations}

    def _labels(self, rows: DetectionRows) -> IntArray:
        """``(N,)`` track of each detection, -1 for none."""
        observation = replace(self._affinity.observation, b=BIAS)(rows.scores)
        labels, averaged = np.full(len(rows), -1), rows.actions
        gate = replace(PRINTED_GATE, window=self._affinity.window)
        for iteration in range(self._iterations):
            if iteration and rows.actions is not None:
                reach = (HALF_WINDOW, HALF_WINDOW)
                averaged = window_means(rows.frames, labels, rows.actions, rows.frames, labels, reach)
            links = pairs_with_costs(replace(rows, actions=averaged), gate, self._affinity)
            previous, labels = labels, track_labels(solve(build_graph(observation, links, ENTRY, ENTRY)))
            if np.array_equal(previous, labels):
                break
        return labels
