"""Filling the gaps of tracks, and smoothing their boxes by as much as suits the video.

The strength of the smoothing (`smooth`) is learnt from the tracks without labels: it is the one that predicts left-
out boxes best. Runs of boxes are taken out, curves through the rest are laid across the gaps, and their mean distance
from the boxes that were taken out is compared. The runs are longer than a detector's errors mostly persist; otherwise
copying the errors of the neighbours would predict best. What persists still longer is allowed for by a factor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import scipy
from pydantic import NonNegativeFloat
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.association.nearby import sizes
from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Track


@dataclass(frozen=True, config=SETTINGS)
class SmoothingSettings:
    """How far boxes are smoothed: the squared noise of a detected box over that of its change of velocity.

    Attributes:
        position: for the centre; 0 leaves it where it was detected.
        size: for width and height, which change more slowly; 0 leaves them as they were detected.
    """

    position: NonNegativeFloat = 250.0
    size: NonNegativeFloat = 20_000.0


def fill_gaps(track: Track, longest: int, clock: Callable[[IntArray], IntArray] = np.asarray) -> Track:
    """``track`` with its gaps filled: boxes and scores on straight lines, not observed.

    Args:
        track: of at least one box.
        longest: most frames of a gap that is filled.
        clock: times of frames; by default they are as far apart as their numbers.

    >>> track = Track(1, np.array([0, 1, 3]), np.array([[t, 0, t + 9, 9.0] for t in (0, 1, 3)]), np.ones(3))
    >>> fill_gaps(track, 1).boxes[2].tolist()
    [2.0, 0.0, 11.0, 9.0]
    """
    missing = np.diff(track.frames) - 1
    short = np.flatnonzero((missing > 0) & (missing <= longest))
    if len(short) == 0:
        return track
    added = np.concatenate([np.arange(track.frames[gap] + 1, track.frames[gap + 1]) for gap in short])
    frames = np.concatenate([track.frames, added])
    times, added_times = clock(track.frames), clock(added)
    between = np.stack([np.interp(added_times, times, coordinate) for coordinate in track.boxes.T], axis=1)
    boxes = np.concatenate([track.boxes, between])
    scores = np.concatenate([track.scores, np.interp(added_times, times, track.scores)])
    observed = np.concatenate([track.observed, np.zeros(len(added), dtype=np.bool_)])
    order = np.argsort(frames, kind="stable")
    origin = np.concatenate([track.origin, np.full((len(added), 2), -1)])
    return Track(track.id, frames[order], boxes[order], scores[order], observed[order], origin[order], track.names)


def smooth(track: Track, settings: SmoothingSettings) -> Track:
    """``track`` with its boxes on smooth curves through the observed ones.

    Centre and size become the most likely path of a body whose velocity changes at random, given noisy detections:
    the minimiser x of ``sum (x_t - z_t)^2 + strength * sum (x_{t-1} - 2 x_t + x_{t+1})^2``, the first sum over the
    observed frames. Boxes that are not observed take part only through the second sum, so what was filled in on a
    straight line becomes the natural curve through the gap. Straight motion is left as it is.
    """
    observed = track.observed
    if len(track) < 3 or observed.sum() < 3:
        return track
    centre, size = centres(track.boxes), sizes(track.boxes)
    times = track.frames - track.frames[0]
    centre = _smoothed(times, centre, observed, settings.position)
    # A size that shrinks along a long gap must not turn negative.
    size = np.maximum(_smoothed(times, size, observed, settings.size), size.min(axis=0))
    return replace(track, boxes=np.concatenate([centre - size / 2, centre + size / 2], axis=1))


def _smoothed(times: IntArray, values: FloatArray, observed: BoolArray, strength: float) -> FloatArray:
    """``(T, 2)`` the minimiser of `smooth` at ``(T,)`` times."""
    if strength == 0:
        return values
    return _curve(times, np.array([0, times[-1] + 1]), values, observed, strength)


# Strengths that are tried, for centres and for sizes by themselves.
STRENGTHS = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 10000.0)
# Length of the runs that are left out, seconds.
LEFT_OUT = 0.4
# Boxes that are compared, about; those of the longest tracks.
MOST_BOXES = 4000
# Factor on the best strength, for errors that persist longer than the runs.
PERSISTING = 3.0
# A box further from the curve than this counts as this far, longer sides.
FARTHEST_OFF = 0.2
# Strengths at 30 frames a second where no track is long enough.
USUAL = SmoothingSettings(60.0, 5000.0)


def fit_smoothing(tracks: Sequence[Track], frame_rate: float, ticks: int = 1) -> SmoothingSettings:
    """The strengths that predict boxes of these tracks best.

    Args:
        tracks: their boxes as if the camera stood still; those that are not observed are passed over.
        frame_rate: boxes a second of somebody who is always detected.
        ticks: steps of time from one such box to the next, on average.
    """
    # The strength weighs squared second differences, which grow with the time between two steps.
    finer = float(ticks) ** 3
    run = max(2, round(LEFT_OUT * frame_rate))
    chosen: list[Track] = []
    for track in sorted(tracks, key=lambda track: (-int(track.observed.sum()), track.id)):
        if track.observed.sum() < 3 * run or sum(map(len, chosen)) >= MOST_BOXES:
            break
        chosen.append(track)
    if not chosen:
        scale = finer * (frame_rate / 30) ** 3
        return SmoothingSettings(USUAL.position * scale, USUAL.size * scale)
    row, boundaries, values, folds = _one_after_the_other(chosen, run)
    off = np.zeros((len(STRENGTHS), 2))
    for k, strength in enumerate(STRENGTHS):
        for fold in folds:
            distance = np.abs(_curve(row, boundaries, values, fold, finer * strength) - values)[~fold]
            distance = np.minimum(distance, FARTHEST_OFF)
            off[k] += distance[:, :2].sum(), distance[:, 2:].sum()
    position, size = (finer * PERSISTING * STRENGTHS[int(k)] for k in off.argmin(axis=0))
    return SmoothingSettings(position, size)


def _one_after_the_other(
    tracks: Sequence[Track], run: int
) -> tuple[IntArray, IntArray, FloatArray, tuple[BoolArray, BoolArray]]:
    """The observed boxes of tracks as rows of one system.

    Returns:
        ``(N,)`` row of each box, ``(M + 1,)`` the first row of each track and the number of rows, ``(N, 4)`` centres
        and sizes in longer sides, and twice ``(N,)`` which boxes are used: every third run is left out, but no end.
    """
    rows, values = [], []
    folds: tuple[list[BoolArray], list[BoolArray]] = ([], [])
    boundaries = [0]
    for track in tracks:
        boxes, frames = track.boxes[track.observed], track.frames[track.observed]
        values.append(np.concatenate([centres(boxes), sizes(boxes)], axis=1) / sizes(boxes).max(axis=1).mean())
        rows.append(frames - frames[0] + boundaries[-1])
        boundaries.append(int(rows[-1][-1]) + 1)
        for fold, shift in zip(folds, (0, run // 2), strict=True):
            used = (np.arange(len(frames)) + shift) // run % 3 != 1
            used[[0, -1]] = True
            fold.append(used)
    first, second = (np.concatenate(fold) for fold in folds)
    return np.concatenate(rows), np.array(boundaries), np.concatenate(values), (first, second)


def _curve(row: IntArray, boundaries: IntArray, values: FloatArray, used: BoolArray, strength: float) -> FloatArray:
    """``(N, D)`` the smooth curves through the used values, at all of them: one banded system over all frames.

    Args:
        row: ``(N,)`` of each box.
        boundaries: ``(M + 1,)`` the first row of each track, and the number of rows; tracks do not touch each other.
        values: ``(N, D)``.
        used: ``(N,)``.
        strength: see `smooth`.
    """
    length = int(boundaries[-1])
    weight, target = np.zeros(length), np.zeros((length, values.shape[1]))
    weight[row[used]], target[row[used]] = 1, values[used]
    # Second differences within a track only: their middles are neither its first nor its last row.
    middle = np.ones(length)
    middle[boundaries[:-1]] = middle[boundaries[1:] - 1] = 0
    middle *= strength
    # D'D of second differences D, in the upper banded form.
    bands = np.zeros((3, length))
    bands[2] = weight
    bands[2, :-1] += middle[1:]
    bands[2] += 4 * middle
    bands[2, 1:] += middle[:-1]
    bands[1, 1:] = -2 * (middle[:-1] + middle[1:])
    bands[0, 2:] = middle[1:-1]
    return np.asarray(scipy.linalg.solveh_banded(bands, target)[row])
