"""Plots of answers: people in zones over time, flows, and where people walked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tsuiseki.tracking.answers.counting import Answers
from tsuiseki.tracking.report.plots import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BINS = 80


def occupancy_figure(answers: Answers, ink: str = "black") -> Figure:
    """People in each zone in each second."""
    figure, axes = _axes(ink, "seconds", "people")
    table = answers.tables["occupancy"]
    zones = np.array(table["zone"])
    for number, zone in enumerate(answers.scene.zones):
        own = zones == zone.name
        times, people = (np.array(table[name])[own] for name in ("time", "people"))
        axes.step(times, people, where="post", color=COLOURS[number % len(COLOURS)], label=_literal(zone.name))
    axes.set_ylim(bottom=0)
    _legend(axes, ink)
    return figure


def flow_figure(answers: Answers, ink: str = "black") -> Figure:
    """Crossings of each line and direction so far, over time."""
    figure, axes = _axes(ink, "seconds", "crossings so far")
    table = answers.tables["crossings"]
    times, names, ways = (np.array(table[name]) for name in ("time", "line", "direction"))
    for number, line in enumerate(answers.scene.lines):
        for way, style in zip(line.directions, ("-", "--"), strict=True):
            own = np.sort(times[(names == line.name) & (ways == way)]) if len(times) else np.empty(0)
            steps = [0, *own.tolist(), answers.length / answers.frame_rate]
            axes.step(
                steps, [*range(len(own) + 1), len(own)], style, where="post", color=COLOURS[number % len(COLOURS)],
                label=_literal(f"{line.name} {way}"),
            )  # fmt: skip
    axes.set_ylim(bottom=0)
    _legend(axes, ink)
    return figure


def place_figure(answers: Answers, ink: str = "black") -> Figure:
    """How long people were where, with the lines and zones of the scene."""
    figure, axes = _axes(ink, f"x, {answers.scene.unit}", f"y, {answers.scene.unit}")
    figure.set_size_inches(8, 6)
    points = answers.paths.points
    if len(points):
        weights = np.full(len(points), 1 / answers.frame_rate)
        seen = axes.hist2d(points[:, 0], points[:, 1], bins=BINS, cmin=1e-9, weights=weights, cmap="viridis")
        bar = figure.colorbar(seen[3], ax=axes, label="seconds of a person")
        bar.ax.tick_params(colors=ink)
        bar.ax.yaxis.label.set_color(ink)
    for name, ends in answers.scene.places():
        closed = np.vstack([ends, ends[:1]])
        axes.plot(*closed.T, color=COLOURS[4], linewidth=1.8)
        axes.annotate(_literal(name), ends[0], color=ink, fontsize=9)
    axes.set_aspect("equal", adjustable="datalim")
    if answers.scene.right_is > 0:
        axes.invert_yaxis()
    return figure


FIGURES = {"occupancy": occupancy_figure, "crossings": flow_figure, "places": place_figure}


def _axes(ink: str, across: str, up: str) -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.2), dpi=110, layout="constrained")
    axes = figure.subplots()
    axes.set_facecolor("none")
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(ink)
    axes.tick_params(colors=ink)
    axes.set_xlabel(across, color=ink)
    axes.set_ylabel(up, color=ink)
    return figure, axes


def _legend(axes: Axes, ink: str) -> None:
    if axes.get_legend_handles_labels()[0]:
        axes.legend(frameon=False, labelcolor=ink, loc="upper left", bbox_to_anchor=(1, 1))


def _literal(name: str) -> str:
    return name.replace("$", r"\$")
