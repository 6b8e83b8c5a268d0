"""Bodies drawn over the video by their states: an ellipse where the size is known, an arrow ahead, points, the id."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from tsuiseki.tracking.report.overlay import draw_label, line_unit, track_colour
from tsuiseki.tracking.types import Frame, ImageArray
from tsuiseki.tracking.types.tracks import BodyTrack, PointTable

# Pixels of a plain picture that the arrow of a body of unknown size has.
_ARROW = 30


def draw_marks(
    frame: Frame, tracks: Sequence[BodyTrack], names: Sequence[str], points: PointTable | None = None
) -> ImageArray:
    """The image of ``frame`` with its bodies drawn in, ``(H, W, 3)`` uint8 RGB; thin where nothing supports them.

    Args:
        frame: stays as it is.
        tracks: states that begin with the place ``a, b`` in pixels and the heading ``theta``.
        names: of all columns of the states; ``length`` and ``width`` follow where the size is known.
        points: of all bodies, where they are known.
    """
    image, sized = frame.image.copy(), tuple(names[3:5]) == ("length", "width")
    for track in tracks:
        row = int(np.searchsorted(track.frames, frame.index))
        if row == len(track) or track.frames[row] != frame.index:
            continue
        a, b, theta, *sizes = np.clip(track.states[row, :5], -1e5, 1e5).tolist()
        length, width = sizes if sized else (2 * _ARROW * line_unit(image), 0.0)
        colour, thickness = track_colour(track.id), 2 if track.statuses[row] == "tracking" else 1
        axes = (max(1, round(length / 2)), max(1, round(width / 2)))
        centre = (round(a), round(b))
        if sized:
            cv2.ellipse(image, centre, axes, float(np.degrees(theta)), 0, 360, colour, thickness, cv2.LINE_AA)
        tip = (round(a + 0.5 * length * np.cos(theta)), round(b + 0.5 * length * np.sin(theta)))
        cv2.arrowedLine(image, centre, tip, colour, thickness, cv2.LINE_AA, tipLength=0.3)
        draw_label(image, str(track.id), (centre[0] + axes[1], centre[1] - axes[1]), colour)
    if points is not None:
        for row in np.flatnonzero(points.frames == frame.index).tolist():
            for x, y in points.points[row][np.isfinite(points.points[row]).all(axis=1)].round().astype(int).tolist():
                cv2.circle(image, (x, y), 2, (255, 255, 255), cv2.FILLED, cv2.LINE_AA)
    draw_label(image, f"{frame.index + 1}", (4, image.shape[0] - 4), (60, 60, 60))
    return image
