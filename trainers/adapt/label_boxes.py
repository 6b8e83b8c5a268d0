"""Where the box of a label lies: as it was detected in that frame, and drawn towards the silhouette there.

A track smooths its boxes and does not know how far the legs are apart in a frame; the detection and the silhouette do.
One silhouette is rough, so a box goes only part of the way to it; where none can be told, as far as others usually go.
"""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.trainers.adapt.foreground import Difference

# A detection is that of a track's box from this overlap on.
_SAME = 0.5
# A silhouette that lies farther off, in widths and heights of the box, is torn or joined with something else.
FARTHEST = 0.2


def detected_boxes(boxes: FloatArray, seen: BoolArray, found: FloatArray) -> FloatArray:
    """``(N, 4)`` the detections that tracks were made of, in one frame.

    Args:
        boxes: ``(N, 4)`` of the tracks.
        seen: ``(N,)`` whether a detection supports each; the others stay.
        found: ``(M, 4)`` detections.
    """
    if not len(boxes) or not len(found):
        return boxes
    overlaps = iou_matrix(boxes, found)
    best = overlaps.argmax(axis=1)
    taken = seen & (overlaps.max(axis=1) >= _SAME)
    return np.where(taken[:, None], found[best], boxes)


def drawn_to_silhouettes(
    boxes: FloatArray, seen: BoolArray, picture: Difference, usual: FloatArray, share: float
) -> FloatArray:
    """``(N, 4)`` boxes of one frame, moved ``share`` of the way to their own silhouettes.

    Args:
        boxes: ``(N, 4)``.
        seen: ``(N,)`` whether each was detected; only then a silhouette is looked for.
        picture: of the frame.
        usual: ``(4,)`` by how much the others move, in widths and heights.
        share: in [0, 1].
    """
    if not len(boxes) or share == 0:
        return boxes
    own = np.where(seen[:, None], picture.offsets(boxes), np.nan)
    moves = np.where(np.isnan(own), usual, share * np.clip(own, -FARTHEST, FARTHEST))
    return np.asarray(boxes + moves * np.tile(boxes[:, 2:] - boxes[:, :2], 2))
