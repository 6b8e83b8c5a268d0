"""Tracks of the flow as they are reported: gaps filled, boxes smoothed, in pixels of their own frames."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.association.tracklets.interpolation import GapSettings, SmoothingSettings, fill_gaps, smooth
from tsuiseki.tracking.features.motion.camera_trajectory import CameraTrajectory
from tsuiseki.tracking.types import FloatArray, IntArray, Track


def reported(
    track: Track,
    image: FloatArray,
    camera: CameraTrajectory,
    longest: int,
    smoothing: SmoothingSettings | None,
    first: int = 0,
) -> Track:
    """A track of detections as it is reported.

    Args:
        track: its boxes as if the camera stood still.
        image: ``(T, 4)`` the same where the image shows them.
        camera: where the frames lie.
        longest: gap that is filled, frames.
        smoothing: of the boxes; None reports them as detected.
        first: frame before which nothing is reported.
    """
    filled = fill_gaps(track, GapSettings(longest_gap=longest, support=np.inf, mismatch=np.inf))
    smoothed = filled if smoothing is None else smooth(filled, smoothing)
    asked = slice(int(np.searchsorted(filled.frames, first)), None)
    frames, observed = filled.frames[asked], filled.observed[asked]
    boxes = camera.from_first(smoothed.boxes[asked], frames)
    if smoothing is None:
        boxes = boxes.copy()
        boxes[observed] = image[len(image) - int(observed.sum()) :]
    return Track(track.id, frames, boxes, filled.scores[asked], observed)


def long_tracks(labels: IntArray, fewest: int = 1) -> list[IntArray]:
    """Indices of the detections of each track that has enough of them, by the first.

    Args:
        labels: ``(N,)`` number of the track of each, -1 for none; in the order of the frames.
        fewest: detections that a track needs.
    """
    used = np.flatnonzero(labels >= 0)
    order = used[np.argsort(labels[used], kind="stable")]
    pieces = np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)
    return sorted((piece for piece in pieces if len(piece) >= fewest), key=lambda piece: int(piece[0]))
