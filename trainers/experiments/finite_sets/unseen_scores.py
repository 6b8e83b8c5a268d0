"""Scores of a filter's targets on one scenario of `reproduce phd-unseen`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.evaluation.points import PointScores, PointTracks, evaluate_points
from tsuiseki.trainers.experiments.finite_sets.unseen_scenarios import UnseenSettings

CUT_OFF = 100.0


@dataclass(frozen=True)
class UnseenRun:
    """One filter on one scenario.

    Attributes:
        scores: OSPA and the like.
        milliseconds: processor time of a step, median.
        scans: how far it came; a filter that took too long was given up on.
    """

    scores: PointScores
    milliseconds: float
    scans: int


def inside(settings: UnseenSettings, rows: Sequence[Sequence[float]]) -> list[Sequence[float]]:
    """Rows scan, id, x, y of places in the region: no target can be outside."""
    half = 0.5 * settings.side
    return [row for row in rows if max(abs(row[2]), abs(row[3])) <= half]


def scored(truth: PointTracks, rows: Sequence[Sequence[float]], milliseconds: Sequence[float]) -> UnseenRun:
    """Scores up to the last scan that the filter did."""
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    # A mixture may name two components alike: the first counts.
    _, first = np.unique(table[:, :2], axis=0, return_index=True)
    table = table[np.sort(first)]
    found = PointTracks(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:])
    count = len(milliseconds)
    scores = evaluate_points(truth.between(0, count - 1), found, count, CUT_OFF)
    return UnseenRun(scores, float(np.median(milliseconds)), count)
