"""How far the tracks of a video are to be smoothed, learnt from those tracks without labels.

One detector errs more than another, and cars that come near change faster than people who walk. So the strength of the
smoothing (`interpolation.smooth`) is the one that predicts left-out boxes best: runs of boxes are taken out of the
tracks, curves through the rest are laid across the gaps, and their mean distance from what was taken out is compared.
The runs are longer than a detector's errors mostly persist: single boxes would be predicted best by copying the errors
of their neighbours. What persists still longer is allowed for by a factor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from tsuiseki.tracking.association.tracklets.interpolation import SmoothingSettings
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Track


@dataclass(frozen=True)
class FittedSmoothing:
    """How the strength of smoothing is chosen.

    Attributes:
        strengths: those that are tried, for centres and for sizes by themselves.
        left_out: length of the runs that are left out, seconds.
        persisting: factor on the best strength, for errors that persist longer than these runs.
        farthest: a box further from the curve counts as this far, longer sides.
        most: boxes that are looked at, those of the longest tracks.
        otherwise: strengths at 30 frames a second where no track is long enough.
    """

    strengths: tuple[float, ...] = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 10000.0)
    left_out: float = 0.4
    persisting: float = 3.0
    farthest: float = 0.2
    most: int = 4000
    otherwise: SmoothingSettings = field(default_factory=lambda: SmoothingSettings(60.0, 5000.0))

    def __post_init__(self) -> None:
        if not self.strengths or min(self.strengths) <= 0 or min(self.left_out, self.farthest, self.persisting) <= 0:
            raise ValueError("expected strengths, left_out, persisting and farthest above 0")


def fit_smoothing(tracks: Sequence[Track], frame_rate: float, settings: FittedSmoothing) -> SmoothingSettings:
    """The strengths that predict boxes of these tracks best.

    Args:
        tracks: their boxes as if the camera stood still; those that are not observed are passed over.
        frame_rate: frames a second.
        settings: of the choice.
    """
    run = max(2, round(settings.left_out * frame_rate))
    chosen: list[Track] = []
    for track in sorted(tracks, key=lambda one: (-int(one.observed.sum()), one.id)):
        if track.observed.sum() < 3 * run or sum(map(len, chosen)) >= settings.most:
            break
        chosen.append(track)
    if not chosen:
        # The strength weighs squared second differences, which grow with the time between two frames.
        scale = (frame_rate / 30) ** 3
        return SmoothingSettings(settings.otherwise.position * scale, settings.otherwise.size * scale)
    row, boundaries, values, kept = _one_after_the_other(chosen, run)
    off = np.zeros((len(settings.strengths), 2))
    for k, strength in enumerate(settings.strengths):
        for fold in kept:
            distance = np.abs(_curve(row, boundaries, values, fold, strength) - values)[~fold]
            distance = np.minimum(distance, settings.farthest)
            off[k] += distance[:, :2].sum(), distance[:, 2:].sum()
    position, size = (settings.persisting * settings.strengths[int(k)] for k in off.argmin(axis=0))
    return SmoothingSettings(position, size)


def _one_after_the_other(
    tracks: Sequence[Track], run: int
) -> tuple[IntArray, IntArray, FloatArray, tuple[BoolArray, BoolArray]]:
    """The observed boxes of tracks as rows of one system.

    Returns:
        ``(N,)`` row of each box, ``(M + 1,)`` the first row of each track and the number of rows, ``(N, 4)`` centres
        and sizes in longer sides, and twice ``(N,)`` which boxes are kept: every third run is left out, but no end.
    """
    rows, values = [], []
    folds: tuple[list[BoolArray], list[BoolArray]] = ([], [])
    boundaries = [0]
    for track in tracks:
        boxes, frames = track.boxes[track.observed], track.frames[track.observed]
        centre, size = (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]
        values.append(np.concatenate([centre, size], axis=1) / size.max(axis=1).mean())
        rows.append(frames - frames[0] + boundaries[-1])
        boundaries.append(int(rows[-1][-1]) + 1)
        for fold, shift in zip(folds, (0, run // 2), strict=True):
            kept = (np.arange(len(frames)) + shift) // run % 3 != 1
            kept[[0, -1]] = True
            fold.append(kept)
    first, second = (np.concatenate(fold) for fold in folds)
    return np.concatenate(rows), np.array(boundaries), np.concatenate(values), (first, second)


def _curve(row: IntArray, boundaries: IntArray, values: FloatArray, kept: BoolArray, strength: float) -> FloatArray:
    """``(N, 4)`` the smooth curves through the kept values, at all of them; tracks do not touch each other."""
    length = int(boundaries[-1])
    weight, target = np.zeros(length), np.zeros((length, values.shape[1]))
    weight[row[kept]], target[row[kept]] = 1, values[kept]
    # Second differences within a track only: their middles are neither its first nor its last row.
    middle = np.ones(length)
    middle[boundaries[:-1]] = middle[boundaries[1:] - 1] = 0
    middle *= strength
    bands = np.zeros((3, length))
    bands[2] = weight + 4 * middle
    bands[2, :-1] += middle[1:]
    bands[2, 1:] += middle[:-1]
    bands[1, 1:] = -2 * (middle[:-1] + middle[1:])
    bands[0, 2:] = middle[1:-1]
    return np.asarray(scipy.linalg.solveh_banded(bands, target)[row])
