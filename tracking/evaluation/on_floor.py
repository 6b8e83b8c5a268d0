"""People on a floor against their true places.

* IDF1, MOTA and HOTA (`identity_metrics`) with the similarity ``max(0, 1 - d / 2)`` of a distance of d metres, so that
  the threshold of one half lies at 1 m, as trackers on WILDTRACK are scored.
* MODA and MODP (Kasturi et al., 2009) with ``max(0, 1 - d / t)`` and t = 0.5 m, as detectors are. Each moment is
  matched by itself, MODA = 1 - (misses + false) / true, MODP = the mean of 1 - d / t over the matches.
* GOSPA of order 2 with a cut-off of 1 m, the mean over the moments.

Only labelled moments count; of the results between them, the nearest in time within half a step of the labels.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from tsuiseki.tracking.cameras.multicamera import PlacedTruth
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.identity_metrics import LabelledSequence, clear, hota, identity
from tsuiseki.tracking.evaluation.point_distances import gospa
from tsuiseki.tracking.evaluation.result_files import tracked_times
from tsuiseki.tracking.types import FloatArray, IntArray


@dataclass(frozen=True)
class OnFloorScores:
    """Scores of one result; shares in [0, 1], distances in metres.

    Attributes:
        idf1: of identities, within `distance`.
        mota: of tracks, within `distance`.
        hota: over the thresholds of similarity.
        switches: changes of identity.
        moda: of detections, within `near`.
        modp: precision of places of detections, within `near`.
        recall: share of the true places reported within `near`.
        precision: share of the results that are right there.
        gospa: mean over the moments.
        labelled: true places.
    """

    idf1: float
    mota: float
    hota: float
    switches: int
    moda: float
    modp: float
    recall: float
    precision: float
    gospa: float
    labelled: int


def while_tracked(labels: PlacedTruth, result: Path) -> PlacedTruth:
    """The labels from the first to the last moment that the run in a folder tracked; all where nothing says so."""
    times = tracked_times(result)
    if len(times) < 2:
        return labels
    half = (times[-1] - times[0]) / (len(times) - 1) / 2
    inside = (labels.times >= times[0] - half) & (labels.times <= times[-1] + half)
    if inside.all() or not inside.any():
        return labels
    left = len(np.unique(labels.times[~inside]))
    said = f"{result}: {left} labelled moments are left out, for it was tracked from {times[0]:g} to {times[-1]:g} s"
    warnings.warn(said, InputWarning, stacklevel=2)
    return PlacedTruth(labels.times[inside], labels.ids[inside], labels.places[inside])


def evaluate_on_floor(
    truth: PlacedTruth, reported: PlacedTruth, distance: float = 1.0, near: float = 0.5
) -> OnFloorScores:
    """Scores of a result whose tracks are on a person within a ``distance``, metres; ``near`` is for MODA and MODP.

    Raises:
        RequestError: there is no label, or no result at a labelled time.
    """
    if not len(truth.times):
        raise RequestError("expected at least one labelled place, got none")
    times = np.unique(truth.times)
    at, rows = _nearest(times, reported)
    if len(reported.times) and not len(rows):
        raise RequestError(
            f"expected results at the labels' times, {times[0]:g} to {times[-1]:g} s, got "
            f"{reported.times.min():g} to {reported.times.max():g} s"
        )
    ids, places = reported.ids[rows], reported.places[rows]
    moment = np.searchsorted(times, truth.times)
    sets = [(np.flatnonzero(moment == k), np.flatnonzero(at == k)) for k in range(len(times))]
    apart = [cdist(truth.places[a], places[b]).reshape(len(a), len(b)) for a, b in sets]
    overlaps = [np.maximum(0.0, 1.0 - d / (2 * distance)) for d in apart]
    sequence = LabelledSequence.of([truth.ids[a] for a, _ in sets], [ids[b] for _, b in sets], overlaps)
    counts = clear(sequence)
    hits, closeness = _matched(apart, near)
    return OnFloorScores(
        identity(sequence).idf1,
        counts.mota,
        float(hota(sequence).hota.mean()),
        counts.switches,
        (2 * hits - len(rows)) / len(truth.ids),
        closeness / max(hits, 1),
        hits / len(truth.ids),
        hits / max(len(rows), 1),
        float(np.mean([gospa(truth.places[a], places[b], distance, 2.0).distance for a, b in sets])),
        len(truth.ids),
    )


def _nearest(times: FloatArray, reported: PlacedTruth) -> tuple[IntArray, IntArray]:
    """The label's moment ``(M,)`` of the results that count, and their rows: of each id the nearest in time."""
    if not len(reported.times):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    slack = 0.5 * float(np.median(np.diff(times))) if len(times) > 1 else 0.5
    later = np.clip(np.searchsorted(times, reported.times), 1, max(len(times) - 1, 1))
    earlier = later - 1
    later = np.minimum(later, len(times) - 1)
    closer = np.abs(reported.times - times[earlier]) <= np.abs(reported.times - times[later])
    at = np.where(closer, earlier, later)
    away = np.abs(reported.times - times[at])
    order = np.lexsort([away, reported.ids, at])
    order = order[away[order] <= slack * (1 + 1e-6)]
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (np.diff(at[order]) != 0) | (np.diff(reported.ids[order]) != 0)
    rows = order[first]
    return at[rows], rows


def _matched(apart: Sequence[FloatArray], near: float) -> tuple[int, float]:
    """Matches within ``near`` of every moment, as many and as close as can be, and the sum of ``1 - d / near``."""
    hits, closeness = 0, 0.0
    for distances in apart:
        gain = np.where(distances <= near, 1000.0 + 1.0 - distances / near, 0.0)
        rows, columns = linear_sum_assignment(gain, maximize=True)
        good = gain[rows, columns] > 0
        hits += int(good.sum())
        closeness += float((gain[rows, columns][good] - 1000.0).sum())
    return hits, closeness
