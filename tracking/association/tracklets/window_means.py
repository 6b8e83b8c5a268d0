"""Features averaged over windows along tracks (thesis eq. 5.3)."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import FloatArray, IntArray


def window_means(
    frames: IntArray,
    labels: IntArray,
    actions: FloatArray,
    at_frames: IntArray,
    at_labels: IntArray,
    reach: tuple[int, int],
) -> FloatArray:
    """``(M, A)`` means of a track's features over windows at frames in which it need not be detected.

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
