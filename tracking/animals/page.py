"""Animals drawn over the video: an ellipse of the size of each, an arrow to its head, its points and its id."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from tsuiseki.tracking.report.overlay import draw_label, track_colour
from tsuiseki.tracking.types import Frame, ImageArray
from tsuiseki.tracking.types.tracks import BodyTrack, PointTable


def draw_animals(frame: Frame, tracks: Sequence[BodyTrack], points: PointTable | None = None) -> ImageArray:
    """The image of ``frame`` with its animals drawn in, ``(H, W, 3)`` uint8 RGB; thin where nothing supports them."""
    image = frame.image.copy()
    for track in tracks:
        row = int(np.searchsorted(track.frames, frame.index))
        if row == len(track) or track.frames[row] != frame.index:
            continue
        a, b, theta, length, width = np.clip(track.states[row, :5], -1e5, 1e5).tolist()
        colour, thickness = track_colour(track.id), 2 if track.statuses[row] == "tracking" else 1
        axes = (max(1, round(length / 2)), max(1, round(width / 2)))
        centre = (round(a), round(b))
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
