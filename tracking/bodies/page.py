"""Contours of bodies drawn over the video, each in the colour of its id; dotted where the tracker does not see it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.tracking.bodies.body import Body
from tsuiseki.tracking.bodies.contour import Points
from tsuiseki.tracking.report.overlay import Colour, draw_label, track_colour, write_drawn
from tsuiseki.tracking.types import Frame, ImageArray
from tsuiseki.tracking.types.tracks import BodyTrack

# Fractions of a pixel that OpenCV draws with, in bits.
SHIFT = 4


class BodyOverlay:
    """Draws tracked bodies into frames.

    Args:
        body: theirs.
        tracks: what to draw.
    """

    def __init__(self, body: Body, tracks: Sequence[BodyTrack]) -> None:
        self.body, self.tracks = body, tracks

    def draw(self, frame: Frame) -> ImageArray:
        """The image of ``frame`` with the contours over it, ``(H, W, 3)`` uint8 RGB; the frame stays as it is."""
        image = frame.image.copy()
        for track in self.tracks:
            row = int(np.searchsorted(track.frames, frame.index))
            if row == len(track) or track.frames[row] != frame.index:
                continue
            contour = self.body.contour(track.states[row : row + 1])[0]
            colour = track_colour(track.id)
            draw_contour(image, self.body, contour, colour, seen=track.statuses[row] == "tracking")
            x, y = np.clip(np.round(track.states[row, :2]), -1e6, 1e6).astype(int).tolist()
            reach = round(0.5 * float(self.body.radius))
            text = str(track.id) if track.statuses[row] == "tracking" else f"{track.id} {track.statuses[row]}"
            draw_label(image, text, (x + reach, y - reach), colour)
        draw_label(image, f"{frame.index + 1}", (4, image.shape[0] - 4), (60, 60, 60))
        return image


def draw_contour(
    image: ImageArray, body: Body, contour: Points, colour: Colour, thickness: int = 2, seen: bool = True
) -> None:
    """Draw the strokes of a contour ``(K, 2)`` into ``image``; as dots where it is not ``seen``."""
    # Far outside the image OpenCV's fixed-point coordinates would overflow.
    contour = np.clip(contour, -1e4, 1e4)
    fixed = np.round(contour * 2**SHIFT).astype(np.int32)
    for stroke in body.strokes:
        points = fixed[stroke.first : stroke.last]
        if seen:
            cv2.polylines(image, [points], stroke.closed, colour, thickness, cv2.LINE_AA, SHIFT)
            continue
        for x, y in points.tolist():
            cv2.circle(image, (x, y), 2**SHIFT, colour, cv2.FILLED, cv2.LINE_AA, SHIFT)


def write_contours(
    path: Path, frames: Iterable[Frame], body: Body, tracks: Sequence[BodyTrack], frame_rate: float
) -> None:
    """Write the video with its contours as WebM.

    Raises:
        RunError: the video breaks off, or WebM cannot be written.
    """
    write_drawn(path, frames, frame_rate, BodyOverlay(body, tracks).draw)
