"""Picture of a learnt body: its mean outline, and what each bend does to it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tsuiseki.trainers.bodies.body import BodyFit

SHOWN_BENDS = (-2.0, -1.0, 0.0, 1.0, 2.0)


def plot_body(path: Path, fit: BodyFit) -> None:
    """Draws one panel for each mode: the outline at bends of -2 to 2 standard deviations, the heading to the right."""
    count = len(fit.body.modes)
    figure = Figure(figsize=(4.6 * count + 0.8, 2.7), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, count, squeeze=False, sharex=True, sharey=True)[0]
    for mode, axes in enumerate(panels):
        for bend in SHOWN_BENDS:
            state = np.zeros((1, len(fit.body.fields)))
            state[0, 3 + mode] = bend
            outline = fit.body.contour(state)[0]
            closed = np.concatenate([outline, outline[:1]])
            colour = "0.2" if bend == 0 else colormaps["coolwarm"](0.5 + bend / 5)
            width = 2.0 if bend == 0 else 1.2
            axes.plot(*closed.T, color=colour, linewidth=width, label=f"{bend:+.0f}" if bend else "0")
        axes.plot(0, 0, "+", color="0.5")
        axes.set_title(f"{fit.body.fields[3 + mode]}: {100 * fit.explained[mode]:.0f} % of the variance", fontsize=10)
        axes.set_aspect("equal")
        axes.set_xlabel("pixels, heading to the right")
    panels[0].invert_yaxis()
    figure.legend(*panels[0].get_legend_handles_labels(), title="bend", loc="outside right upper", frameon=False)
    figure.savefig(path, dpi=100, facecolor="white")
