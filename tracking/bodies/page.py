"""Contours of bodies drawn over the video, each in the colour of its id, and plots of their states over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tsuiseki.tracking.bodies.body import Body
from tsuiseki.tracking.bodies.contour import Points
from tsuiseki.tracking.report.overlay import Colour, draw_label, track_colour
from tsuiseki.tracking.types import Frame, ImageArray
from tsuiseki.tracking.types.tracks import BodyTrack

# Fractions of a pixel that OpenCV draws with, in bits.
SHIFT = 4


def draw_bodies(frame: Frame, body: Body, tracks: Sequence[BodyTrack]) -> ImageArray:
    """The image of ``frame`` with the contours over it, ``(H, W, 3)`` uint8 RGB; the frame stays as it is."""
    image = frame.image.copy()
    for track in tracks:
        row = int(np.searchsorted(track.frames, frame.index))
        if row == len(track) or track.frames[row] != frame.index:
            continue
        contour = body.contour(track.states[row : row + 1])[0]
        colour = track_colour(track.id)
        draw_contour(image, body, contour, colour, tracked=track.statuses[row] == "tracking")
        x, y = np.clip(np.round(track.states[row, :2]), -1e6, 1e6).astype(int).tolist()
        reach = round(0.5 * float(body.radius))
        text = str(track.id) if track.statuses[row] == "tracking" else f"{track.id} {track.statuses[row]}"
        draw_label(image, text, (x + reach, y - reach), colour)
    draw_label(image, f"{frame.index + 1}", (4, image.shape[0] - 4), (60, 60, 60))
    return image


def draw_contour(image: ImageArray, body: Body, contour: Points, colour: Colour, tracked: bool = True) -> None:
    """Draw the strokes of a contour ``(K, 2)`` into ``image``; as dots where it is not ``tracked``."""
    # Far outside the image OpenCV's fixed-point coordinates would overflow.
    contour = np.clip(contour, -1e4, 1e4)
    fixed = np.round(contour * 2**SHIFT).astype(np.int32)
    for stroke in body.strokes:
        points = fixed[stroke.first : stroke.last]
        if tracked:
            cv2.polylines(image, [points], stroke.closed, colour, 2, cv2.LINE_AA, SHIFT)
            continue
        for x, y in points.tolist():
            cv2.circle(image, (x, y), 2**SHIFT, colour, cv2.FILLED, cv2.LINE_AA, SHIFT)


def plot_states(path: Path, body: Body, tracks: Sequence[BodyTrack]) -> None:
    """Write one panel for each column of the state, a line for each body in the colour of its id.

    Frames in which a body was missed are shaded in its colour along the bottom of each panel. Angles run on over
    180 degrees instead of jumping.

    Args:
        path: image to write.
        body: names the columns.
        tracks: what to show.
    """
    figure = Figure(figsize=(9, 1.7 * len(body.fields)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(body.fields), 1, sharex=True)
    for column, axes in enumerate(panels):
        for track in tracks:
            colour, values = np.array(track_colour(track.id)) / 255 * 0.85, track.states[:, column]
            values = np.degrees(np.unwrap(values)) if column in body.angles else values
            axes.plot(track.frames + 1, values, color=colour, linewidth=1.1, label=f"{track.id}")
            missed = track.frames[~track.tracking] + 1
            if len(missed):
                bottom = np.zeros(len(missed))
                axes.plot(missed, bottom, "|", color=colour, transform=axes.get_xaxis_transform(), clip_on=False)
        unit = "degrees" if column in body.angles else "pixels" if column < 2 else ""
        axes.set_ylabel(f"{body.fields[column]}\n{unit}".strip())
        axes.grid(visible=True, alpha=0.3)
    panels[-1].set_xlabel("frame; marks at the bottom: missed" if tracks else "frame")
    if 0 < len(tracks) <= 10:
        figure.legend(*panels[0].get_legend_handles_labels(), title="id", loc="outside right upper", frameon=False)
    figure.savefig(path, dpi=100, facecolor="white")
