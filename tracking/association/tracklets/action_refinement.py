"""Tracks and action features that improve each other (thesis 5.2.2 and 5.3).

Single-frame action features price the first flow (eq. 5.2). Along the tracks of every flow the features are averaged
over a window (eq. 5.3), and these multi-frame features price the next one. The printed sum of eq. 5.3 runs over 17
frames and divides by 15; here it runs from t-7 to t+7 and divides by the number of frames in which the person was
detected.

A window centred on a link's detections reaches beyond the link on both sides: where the flow has handed a track from
one person to another, both ends of that link see the same mixture of the two, and the link looks all the better. So
windows can also be one-sided (not in the thesis): the earlier detection of a pair is compared by what its track did
until then, the later one by what its track does from there on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from tsuiseki.tracking.association.costs import ObservationCost, TransitionCost
from tsuiseki.tracking.association.flow.network_flow import FlowSolution, solve, track_labels
from tsuiseki.tracking.association.flow.repricing import (
    ALL_NEW,
    SAME_DISTANCE,
    action_distances,
    network,
    price_pairs,
    reprice,
)
from tsuiseki.tracking.association.gating import GateSettings
from tsuiseki.tracking.association.rows import DetectionRows
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class RefinementSettings:
    """The flow of chapter 5 and its alternation with the action features.

    Attributes:
        gate: which detections may be linked, and over how many frames.
        entry: cost of a track's start, c_entr.
        exit: cost of a track's end, c_exit.
        miss: cost of every frame between two linked detections.
        bridged: cost of a detection that no detector scored but a correlation filter found (see `trackers.bridging`).
        window: λ, frames that an action feature is averaged over; odd.
        windows: ``centred`` compares eq. 5.3 at both detections of a pair, as the thesis does; ``one-sided`` the half
            of the window up to the earlier one with the half from the later one on.
        iterations: most flows that are solved; 1 is the flow with single-frame features.
    """

    gate: GateSettings = field(default_factory=lambda: GateSettings(10, reach=2.0, speed=0.3))
    entry: float = 10.0
    exit: float = 10.0
    miss: float = 0.1
    bridged: float = 0.4
    window: int = 15
    windows: Literal["centred", "one-sided"] = "one-sided"
    iterations: int = 6

    def __post_init__(self) -> None:
        if not all(0 <= cost < np.inf for cost in (self.entry, self.exit, self.miss, self.bridged)):
            raise ValueError("expected finite entry, exit, miss and bridged costs of 0 or more")
        if self.window < 1 or self.window % 2 == 0:
            raise ValueError(f"expected an odd window of at least 1 frame, got {self.window}")
        if self.iterations < 1:
            raise ValueError(f"expected at least 1 iteration, got {self.iterations}")


@dataclass(frozen=True)
class Prices:
    """What detections and pairs of them cost.

    Attributes:
        observation: c_obsv.
        single: c_tran with single-frame action features, or without any.
        multi: c_tran with multi-frame ones; None takes ``single`` again.
    """

    observation: ObservationCost
    single: TransitionCost
    multi: TransitionCost | None = None


@dataclass(frozen=True)
class Past:
    """Decided detections that come before the rows, for the windows that reach back to them.

    Attributes:
        frames: ``(K,)``.
        tracks: ``(K,)`` number of the track of each.
        actions: ``(K, A)`` single-frame features, or None.
        continued: ``(N,)`` for each row, number of the track that it continues, -1 where it continues none.
        first_free: number of the first new track.
    """

    frames: IntArray
    tracks: IntArray
    actions: FloatArray | None
    continued: IntArray
    first_free: int


@dataclass(frozen=True)
class Iteration:
    """One flow.

    Attributes:
        solution: of the flow.
        labels: ``(N,)`` number of the track of each detection, -1 where it belongs to none.
        actions: ``(N, A)`` multi-frame features along these tracks; None without action features.
    """

    solution: FlowSolution
    labels: IntArray
    actions: FloatArray | None


def refine(
    rows: DetectionRows,
    actions: FloatArray | None,
    prices: Prices,
    settings: RefinementSettings,
    past: Past | None = None,
    goes_on: BoolArray | None = None,
) -> Iterator[Iteration]:
    """Solve flows in turn with the action features of the tracks before; stops early when tracks come again.

    Args:
        rows: the detections, boxes as the camera would have seen them had it stood still.
        actions: ``(N, A)`` probabilities of single frames; None solves one flow without.
        prices: of detections and pairs.
        settings: of flow and alternation.
        past: what is already decided.
        goes_on: ``(N,)`` detections after which the video goes on beyond the rows: a track may end there for nothing.
    """
    observation = np.where(np.isnan(rows.scores), settings.bridged, prices.observation(rows.scores))
    priced = price_pairs(rows, actions, prices.single, settings.gate, settings.miss)
    seen: set[bytes] = set()
    for number in range(1 if actions is None else settings.iterations):
        graph = network(observation, priced, settings.entry, settings.exit, goes_on)
        solution = solve(graph, None if past is None else past.continued >= 0)
        labels = _labels(solution, past)
        half = settings.window // 2
        multi = None if actions is None else _averaged(rows, labels, actions, (half, half), past)
        yield Iteration(solution, labels, multi)
        key = labels.tobytes()
        if actions is None or key in seen or number + 1 == settings.iterations:
            return
        seen.add(key)
        distances = action_distances(*compared_features(rows, labels, actions, settings, past), priced.i, priced.j)
        # The first multi-frame prices may come from other trees, so that all of them are new.
        smallest = ALL_NEW if number == 0 and prices.multi is not None else SAME_DISTANCE
        priced = reprice(priced, distances, prices.multi or prices.single, smallest)


def compared_features(
    rows: DetectionRows,
    labels: IntArray,
    actions: FloatArray,
    settings: RefinementSettings,
    past: Past | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Multi-frame features ``(N, A)`` of detections as the earlier and as the later one of a pair."""
    half = settings.window // 2
    if settings.windows == "centred":
        multi = _averaged(rows, labels, actions, (half, half), past)
        return multi, multi
    return _averaged(rows, labels, actions, (half, 0), past), _averaged(rows, labels, actions, (0, half), past)


def window_means(
    frames: IntArray,
    labels: IntArray,
    actions: FloatArray,
    at_frames: IntArray,
    at_labels: IntArray,
    reach: tuple[int, int],
) -> FloatArray:
    """Eq. 5.3: ``(M, A)`` means of a track's features over windows at frames in which it need not be detected.

    Args:
        frames: ``(N,)`` of the detections.
        labels: ``(N,)`` of their tracks, -1 for none.
        actions: ``(N, A)`` of the detections.
        at_frames: ``(M,)`` where the means are wanted.
        at_labels: ``(M,)`` of which tracks. Where the window holds no detection, or the label is -1, the m-th mean is
            that of the detection with the same index, if M is N, and NaN otherwise.
        reach: of the windows, frames back and frames ahead.
    """
    back, ahead = reach
    fallback = actions if len(at_frames) == len(frames) else np.full((len(at_frames), actions.shape[1]), np.nan)
    used = np.flatnonzero(labels >= 0)
    if len(used) == 0:
        return fallback.copy()
    first, span = frames[used].min() - back, int(frames[used].max() - frames[used].min()) + 2 * (back + ahead) + 1
    key = labels[used] * span + (frames[used] - first)
    order = np.argsort(key, kind="stable")
    key = key[order]
    sums = np.zeros((len(key) + 1, actions.shape[1]))
    np.cumsum(actions[used[order]], axis=0, out=sums[1:])
    wanted = at_labels * span + (at_frames - first)
    low, high = np.searchsorted(key, wanted - back), np.searchsorted(key, wanted + ahead, side="right")
    count = np.where(at_labels >= 0, high - low, 0)
    means = (sums[high] - sums[low]) / np.maximum(count, 1)[:, None]
    return np.where(count[:, None] > 0, means, fallback)


def _labels(solution: FlowSolution, past: Past | None) -> IntArray:
    """``(N,)`` track numbers; tracks that go on keep theirs, new ones are counted on from there."""
    labels = track_labels(solution)
    if past is None:
        return labels
    names = past.first_free + np.arange(int(labels.max(initial=-1)) + 1)
    continued = np.flatnonzero(past.continued >= 0)
    names[labels[continued]] = past.continued[continued]
    return np.append(names, -1)[labels]


def _averaged(
    rows: DetectionRows, labels: IntArray, actions: FloatArray, reach: tuple[int, int], past: Past | None
) -> FloatArray:
    if past is None or past.actions is None:
        return window_means(rows.frames, labels, actions, rows.frames, labels, reach)
    frames, tracks = np.append(past.frames, rows.frames), np.append(past.tracks, labels)
    every = np.concatenate([past.actions, actions])
    return window_means(frames, tracks, every, frames, tracks, reach)[len(past.frames) :]
