"""Entry and exit costs that know the places where tracks of this video begin and end.

A track may begin anywhere, but most begin at the border, at a door or behind a pillar. With K a Gaussian kernel of so
many heights, of detections d and of those s among them with which tracks so far begin, the share that begins at a
place z is

    ρ(z) = (Σ_s K(z − z_s) + κ ρ̄) / (Σ_d K(z − z_d) + κ),        ρ̄ = |s| / |d|,

and the entry cost there becomes c_entr − w log(ρ(z) / ρ̄), within bounds: the negative logarithm of the probability of
a start, as far as it differs from the average over the video. Ends likewise. Who is there when the video begins, or
still there at its end, tells nothing.

Places are those in the image, since its border moves with the camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.association.nearby import sizes
from tsuiseki.tracking.association.network_flow import Ends
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.types import BoolArray, Columns, FloatArray, IntArray

# Cells along the longer side of what the boxes cover.
CELLS = 64
# Latest detections of decided tracks that are remembered.
MEMORY = 30_000
# Seconds at the beginning and at the end of the video in which starts and ends tell nothing.
UNKNOWN = 0.5
# Fewest detections of the tracks that tell.
SHORTEST = 5
# Largest change of a cost, nats.
MOST_BY_PLACE = 2.0
# Deviation of the kernel K, mean heights of boxes.
WIDTH = 1.0
# κ: how many detections the average over the video weighs as much as.
PRIOR = 1000.0


@dataclass(frozen=True)
class EntryCounts(Columns):
    """What tracks so far say of N detections of them.

    Attributes:
        boxes: ``(N, 4)`` pixels, where the image shows them.
        starts: ``(N,)`` whether a track begins there.
        ends: ``(N,)`` whether one ends there.
    """

    boxes: FloatArray
    starts: BoolArray
    ends: BoolArray


# Before any track is decided.
NO_COUNTS = EntryCounts(np.empty((0, 4)), np.empty(0, dtype=np.bool_), np.empty(0, dtype=np.bool_))


def starts_and_ends(
    labels: IntArray, frames: IntArray, bounds: tuple[float, float], shortest: int = SHORTEST
) -> tuple[BoolArray, BoolArray]:
    """``(N,)`` detections with which tracks begin, and ``(N,)`` those with which they end.

    Args:
        labels: ``(N,)`` track of each detection, -1 for none.
        frames: ``(N,)`` increasing.
        bounds: the frames from which on starts, and up to which ends tell something.
        shortest: detections of the tracks that tell.
    """
    tracks, counts = Ends.of(labels), np.bincount(labels[labels >= 0])
    long = counts[tracks.track] >= shortest
    starts, ends = np.zeros(len(labels), dtype=np.bool_), np.zeros(len(labels), dtype=np.bool_)
    starts[tracks.first[long]], ends[tracks.last[long]] = True, True
    return starts & (frames >= bounds[0]), ends & (frames <= bounds[1])


def place_costs(counts: EntryCounts, boxes: FloatArray, size: tuple[int, int] | None) -> tuple[FloatArray, FloatArray]:
    """``(N,)`` changes of the entry costs, and of the exit costs, of detections with ``(N, 4)`` boxes in the image.

    Args:
        counts: what the tracks so far say.
        boxes: pixels.
        size: width and height of the image; None takes the part that boxes cover.
    """
    nothing = np.zeros(len(boxes))
    if len(counts.boxes) == 0 or len(boxes) == 0:
        return nothing, nothing
    height = float(sizes(counts.boxes)[:, 1].mean())
    middle = centres(counts.boxes)
    low, high = (middle.min(axis=0), middle.max(axis=0)) if size is None else (np.zeros(2), np.array(size))
    cell = max(float((high - low).max()), height) / CELLS
    shape = np.maximum(np.ceil((high - low) / cell), 1).astype(np.int64)
    sigma = WIDTH * height / cell
    reach = 2 * round(4 * sigma) + 1

    def density(which: FloatArray) -> FloatArray:
        """How many of some boxes lie within the kernel, which is 1 in its middle, around each cell."""
        index = _cells(which, low, cell, shape)
        table = np.bincount(index, minlength=int(shape.prod())).reshape(shape[1], shape[0]).astype(np.float64)
        import cv2

        smooth = cv2.GaussianBlur(table, (reach, reach), sigma, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(smooth * max(2 * np.pi * sigma**2, 1.0))

    detected, at = density(counts.boxes), _cells(boxes, low, cell, shape)
    changes = []
    for chosen in (counts.starts, counts.ends):
        mean = max(float(chosen.mean()), 1 / len(chosen))
        begun, around = density(counts.boxes[chosen]).ravel()[at], detected.ravel()[at]
        ratio = (begun / mean + PRIOR) / (around + PRIOR)
        changes.append(np.clip(-np.log(ratio), -MOST_BY_PLACE, MOST_BY_PLACE))
    return changes[0], changes[1]


def _cells(boxes: FloatArray, low: FloatArray, cell: float, shape: IntArray) -> IntArray:
    """``(N,)`` number of the cell of each box; those outside count to the nearest one."""
    column, row = np.clip(((centres(boxes) - low) / cell).astype(np.int64), 0, shape - 1).T
    return np.asarray(row * shape[0] + column)
