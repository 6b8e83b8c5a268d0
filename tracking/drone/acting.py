"""What people do along their tracks: probabilities of single frames, and averaged over windows (thesis eq. 5.3)."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.association.tracklets.window_means import window_means
from tsuiseki.tracking.types import FloatArray, Track
from tsuiseki.tracking.types.tracks import ActingTrack


def acting_track(track: Track, actions: FloatArray | None, half: int) -> ActingTrack:
    """A track with what the person does in each of its frames; where it was not detected, as in between.

    Args:
        track: observed in D frames.
        actions: ``(D, A)`` probabilities in those; None where nothing recognised them.
        half: frames of the window before and after.
    """
    if actions is None:
        return ActingTrack(track)
    frames = track.frames[track.observed]
    single = np.stack([np.interp(track.frames, frames, column) for column in actions.T], axis=1)
    mine, at = np.zeros(len(frames), np.int64), np.zeros(len(track), np.int64)
    multi = window_means(frames, mine, actions, track.frames, at, (half, half))
    return ActingTrack(track, single, np.where(np.isnan(multi), single, multi))
