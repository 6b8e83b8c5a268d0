"""Plots of the states of bodies over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tsuiseki.tracking.bodies.body import Body
from tsuiseki.tracking.report.overlay import track_colour
from tsuiseki.tracking.types.tracks import BodyTrack

PIXEL_COLUMNS = 2


def plot_states(path: Path, body: Body, tracks: Sequence[BodyTrack], truth: Sequence[BodyTrack] = ()) -> None:
    """Write one panel for each column of the state, a line for each body in the colour of its id.

    Frames in which a body was not seen are shaded in its colour along the bottom of each panel. Angles run on over
    180 degrees instead of jumping.

    Args:
        path: image to write.
        body: names the columns.
        tracks: what to show.
        truth: drawn under it in grey.
    """
    figure = Figure(figsize=(9, 1.7 * len(body.fields)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(body.fields), 1, sharex=True)
    for column, axes in enumerate(panels):
        for track in truth:
            axes.plot(track.frames + 1, _shown(body, track, column), color="0.6", linewidth=2.5)
        for track in tracks:
            colour = np.array(track_colour(track.id)) / 255 * 0.85
            axes.plot(track.frames + 1, _shown(body, track, column), color=colour, linewidth=1.1, label=f"{track.id}")
            unseen = track.frames[~track.tracking] + 1
            if len(unseen):
                bottom = np.zeros(len(unseen))
                axes.plot(unseen, bottom, "|", color=colour, transform=axes.get_xaxis_transform(), clip_on=False)
        unit = "degrees" if column in body.angles else "pixels" if column < PIXEL_COLUMNS else ""
        axes.set_ylabel(f"{body.fields[column]}\n{unit}".strip())
        axes.grid(visible=True, alpha=0.3)
    panels[-1].set_xlabel("frame; marks at the bottom: not seen" if tracks else "frame")
    if 0 < len(tracks) <= 10:
        figure.legend(*panels[0].get_legend_handles_labels(), title="id", loc="outside right upper", frameon=False)
    figure.savefig(path, dpi=100, facecolor="white")


def _shown(body: Body, track: BodyTrack, column: int) -> np.ndarray:
    values = track.states[:, column]
    return np.degrees(np.unwrap(values)) if column in body.angles else values
