"""Tracks that may show nobody, or a person once more: what speaks for it.

A track of few detections that score less than the others, that stays in its place, or lies on the boxes of surer
tracks, is often a false positive or a second track on somebody. A track that begins in the midst of the picture, where
an earlier one ended, often shows the same person.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from tsuiseki.tracking.association.nearby import ranges
from tsuiseki.tracking.association.tracklets import explained_boxes
from tsuiseki.tracking.types import BoolArray, FloatArray, Track

FEATURES = ("seconds", "low", "joined", "midst", "covered", "still")
# Weights of the logit that a track shows nobody, or somebody whom a surer one shows; the constant last. Fitted on
# generated streets of seeds below 120.
NOBODY = np.array([-3.26, 1.38, 0.0, 0.0, 0.75, 3.5, -2.4])
# From this probability on a track is called doubtful.
DOUBTFUL = 0.5
# Longest time from the end of a track to the beginning of one that may go on with it, seconds.
LONGEST = 10.0
# Seconds of detections above which more of them say nothing.
ENOUGH = 1.35


def doubtful_tracks(tracks: Sequence[Track], rate: float, size: tuple[int, int] | None, length: int) -> BoolArray:
    """``(N,)`` which tracks rather show nobody, or somebody once more; arguments as of `track_features`."""
    if not tracks:
        return np.empty(0, dtype=np.bool_)
    return nobody(track_features(tracks, rate, size, length)) >= DOUBTFUL


def nobody(features: FloatArray) -> FloatArray:
    """``(N,)`` probability that tracks of ``(N, 6)`` `FEATURES` show nobody, or somebody whom a surer one shows."""
    return np.asarray(scipy.special.expit(features @ NOBODY[:-1] + NOBODY[-1]))


def track_features(tracks: Sequence[Track], rate: float, size: tuple[int, int] | None, length: int) -> FloatArray:
    """``(N, 6)`` `FEATURES` of tracks that each have a detection or more.

    The logarithm of the seconds of detections up to `ENOUGH`; how far the mean score lies under the middle one of all,
    by their quartiles; how well the beginning continues an earlier track; whether a large person begins in the midst;
    the share of boxes on those of surer tracks; and the second one again, of who stays in place.
    """
    first, last = (np.array([track.boxes[row] for track in tracks]) for row in (0, -1))
    start, end = (np.array([track.frames[row] for track in tracks]) for row in (0, -1))
    heights = np.concatenate([track.boxes[:, 3] - track.boxes[:, 1] for track in tracks])
    seconds = np.array([track.observed.sum() for track in tracks]) / rate
    scores = np.nan_to_num(np.concatenate([track.scores[track.observed] for track in tracks]))
    low, middle, high = np.quantile(scores, [0.25, 0.5, 0.75]) if len(scores) else np.zeros(3)
    means = np.array(
        [np.nan_to_num(track.scores[track.observed]).mean() if track.observed.any() else low for track in tracks]
    )
    under = np.clip(-0.5 - (means - middle) / max(high - low, 1e-6), 0, 2)
    feet = [np.column_stack([track.boxes[:, [0, 2]].mean(axis=1), track.boxes[:, 3]]) for track in tracks]
    tall = np.array([(track.boxes[:, 3] - track.boxes[:, 1]).mean() for track in tracks])
    moved = np.hypot(*np.array([np.ptp(way, axis=0) for way in feet]).T) / tall
    wide = np.array(size or np.concatenate([track.boxes[:, 2:] for track in tracks]).max(axis=0), dtype=np.float64)
    begun, ended = _midst(first, start / rate, wide), _midst(last, (length - 1 - end) / rate, wide)
    large = np.clip(np.log((first[:, 3] - first[:, 1]) / np.median(heights)) + 0.5, 0, 1)
    covered = np.array([boxes.mean() for boxes in explained_boxes(tracks, [True] * len(tracks))])
    columns = (
        np.log(np.clip(seconds, 0.05, ENOUGH)), under, _joined(tracks, feet, rate, begun, ended), begun * large,
        covered, under * (moved < 0.5),
    )  # fmt: skip
    return np.column_stack(columns)


def _midst(boxes: FloatArray, seconds: FloatArray, wide: FloatArray) -> FloatArray:
    """``(N,)`` from 0 to 1: boxes away from the border of the picture, and ``(N,)`` seconds from that of the video."""
    away = np.column_stack([boxes[:, :2], wide - boxes[:, 2:]]).min(axis=1) / (boxes[:, 3] - boxes[:, 1])
    return np.asarray((1 - np.exp(-seconds / 0.3)) * np.clip((away - 0.05) / 0.45, 0, 1))


def _joined(
    tracks: Sequence[Track], feet: Sequence[FloatArray], rate: float, begun: FloatArray, ended: FloatArray
) -> FloatArray:
    """``(N,)`` from 0 to 1: how well the beginning of each track continues an earlier one, the best of all."""
    start, end = (np.array([track.frames[row] for track in tracks]) for row in (0, -1))
    heights = [np.array([track.boxes[row, 3] - track.boxes[row, 1] for track in tracks]) for row in (0, -1)]
    places = [np.array([way[row] for way in feet]) for row in (0, -1)]
    speeds = [
        np.array([_speed(track, way, rate, row) for track, way in zip(tracks, feet, strict=True)]) for row in (0, -1)
    ]
    order = np.argsort(end, kind="stable")
    low = np.searchsorted(end[order], start - LONGEST * rate)
    later, place = ranges(low, np.maximum(np.searchsorted(end[order], start) - low, 0))
    earlier = order[place]
    gap = (start[later] - end[earlier]) / rate
    tall, reach = np.sqrt(heights[1][earlier] * heights[0][later]), np.minimum(gap, 1)[:, None]
    way = places[0][later] - places[1][earlier]
    misses = (way - speeds[1][earlier] * reach, way - speeds[0][later] * reach)
    apart = np.minimum(*(np.linalg.norm(miss, axis=1) for miss in misses)) / tall / (0.35 + 0.4 * gap)
    grown = np.log(heights[1][earlier] / heights[0][later]) / 0.25
    fit = np.exp(-0.5 * (apart**2 + grown**2)) / (1 + 0.3 * gap) * ended[earlier] * begun[later]
    best = np.zeros(len(tracks))
    np.maximum.at(best, later, fit)
    return best


def _speed(track: Track, feet: FloatArray, rate: float, row: int) -> FloatArray:
    """``(2,)`` pixels a second over the first second of a track (``row`` 0) or the last (``row`` -1)."""
    step = min(max(1, round(rate)), len(track) - 1)
    if step == 0:
        return np.zeros(2)
    a, b = (0, step) if row == 0 else (-1 - step, -1)
    return np.asarray((feet[b] - feet[a]) / (track.frames[b] - track.frames[a]) * rate)
