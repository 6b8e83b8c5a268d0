"""Tracks of points over what was measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from tsuiseki.tracking.report.plots import COLOURS
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.measurements import SensedTrack


def tracks_figure(tracks: Sequence[SensedTrack], measured: Sequence[FloatArray]) -> Figure:
    """The tracks seen from above, each with its id at its end, over all measurements as dots; 3D also from the side.

    Args:
        tracks: D is 2 or 3.
        measured: positions ``(M, D)`` of each scan's measurements.
    """
    every = np.concatenate(measured)
    panels = [(0, 1)] if every.shape[1] == 2 else [(0, 1), (0, 2)]
    figure = Figure(figsize=(6.4 * len(panels), 6), dpi=110, layout="constrained")
    for place, (a, b) in enumerate(panels, start=1):
        axes = figure.add_subplot(1, len(panels), place)
        axes.plot(every[:, a], every[:, b], ".", markersize=1.5, color="0.75", label="measured")
        for number, track in enumerate(tracks):
            colour = COLOURS[number % len(COLOURS)]
            axes.plot(track.positions[:, a], track.positions[:, b], color=colour, linewidth=1.6)
            axes.text(track.positions[-1, a], track.positions[-1, b], str(track.id), color=colour, fontsize=8)
        axes.set(xlabel="xyz"[a], ylabel="xyz"[b])
        axes.set_aspect("equal", adjustable="datalim")
        axes.grid(alpha=0.3)
    return figure
