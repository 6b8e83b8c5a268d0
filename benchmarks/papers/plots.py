"""Plots of what an experiment measured: panels of lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from tsuiseki.tracking.report.plots import COLOURS
from tsuiseki.tracking.types import FloatArray


@dataclass(frozen=True)
class Curve:
    """A line of a plot.

    Attributes:
        label: in the legend.
        x: ``(N,)``.
        y: ``(N,)``.
        error: ``(N,)``, or ``(2, N)`` below and above, of the bars; None for none.
        style: of Matplotlib.
    """

    label: str
    x: Sequence[float] | FloatArray
    y: Sequence[float] | FloatArray
    error: FloatArray | Sequence[float] | None = None
    style: str = "o-"


def curves(
    panels: Mapping[str, Sequence[Curve]], across: Sequence[str], up: str, size: tuple[float, float] = (4.5, 3.6)
) -> Figure:
    """A panel beside the other, each with its lines and a legend; its axes can be changed afterwards.

    Args:
        panels: lines by title.
        across: label of the horizontal axis of each panel.
        up: label of the vertical axis of the first.
        size: of a panel, inches.
    """
    figure = Figure(figsize=(size[0] * len(panels), size[1]), dpi=100, layout="constrained")
    for place, (title, lines) in enumerate(panels.items()):
        axes = figure.add_subplot(1, len(panels), place + 1)
        for number, line in enumerate(lines):
            colour = COLOURS[number % len(COLOURS)]
            axes.errorbar(line.x, line.y, line.error, fmt=line.style, color=colour, label=line.label, capsize=2)
        axes.set_title(title, loc="left")
        axes.set(xlabel=across[place], ylabel=up if place == 0 else "")
        axes.grid(alpha=0.3)
        axes.legend(frameon=False, fontsize="small")
    return figure
