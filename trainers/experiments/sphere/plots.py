"""Figures 2 to 5 of the sphere paper, and the errors against particles, cameras and covered frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
from matplotlib.figure import Figure

from tsuiseki.tracking.report.plots import COLOURS
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.trainers.experiments.sphere.configurations import Configuration
from tsuiseki.trainers.experiments.sphere.films import FilmErrors, over_seeds

Results: TypeAlias = Mapping[Configuration, Mapping[int, FilmErrors]]
"""The errors of every configuration by the number of the film."""

TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20)
# Whose paths are drawn beside each other: figures 3 and 4, and what is done here.
SHOWN = {
    "background": "Figure 3: background, as printed",
    "printed": "Figure 4: contour, as printed",
    "contour": "`track sphere`",
}


def pictures_figure(images: Sequence[ImageArray], empty: Sequence[ImageArray], frame: int) -> Figure:
    """Figures 2 and 5: what two cameras show at one moment, and its difference from the empty scene."""
    figure = Figure(figsize=(9, 7), dpi=80, layout="constrained")
    panels = figure.subplots(2, 2)
    for axes, image, name in zip(panels[0], images, "ab", strict=False):
        axes.imshow(image)
        axes.set_title(f"Figure 2 ({name}): camera {'ab'.index(name) + 1}, frame {frame}", fontsize=9)
    for axes, image, background, name in zip(panels[1], images, empty, "ab", strict=False):
        difference = np.sqrt(np.square(image.astype(np.float64) - background).sum(axis=2))
        axes.imshow(difference, cmap="gray", vmin=0, vmax=200)
        axes.set_title(f"Figure 5 ({name}): difference from the background", fontsize=9)
    for axes in panels.ravel():
        axes.set_axis_off()
    return figure


def paths_figure(results: Results, truth: FloatArray, film: int) -> Figure:
    """Figures 3 and 4: the true path in blue and the estimates of every frame in red."""
    last = {str(row.likelihood): row for row in results if row.group == "section 3"}
    figure = Figure(figsize=(4.6 * len(SHOWN), 4.4), dpi=80, layout="constrained")
    middle, reach = truth.mean(axis=0), 0.6 * float(np.ptp(truth, axis=0).max()) + 0.25
    for place, (likelihood, title) in enumerate(SHOWN.items(), start=1):
        axes = figure.add_subplot(1, len(SHOWN), place, projection="3d")
        row = last.get(likelihood)
        if row is not None:
            points = results[row][film].points
            near = (np.abs(points - middle) <= reach).all(axis=1)
            axes.scatter(*points[near].T, s=9, color="#d62728", depthshade=False)
            title += "" if near.all() else f"\n{(~near).sum()} of {len(near)} points lie outside"
        axes.plot(*truth.T, color="#1f77b4", linewidth=2)
        for limits, centre in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle, strict=True):
            limits(centre - reach, centre + reach)
        axes.set(xlabel="x, m", ylabel="y, m", zlabel="z, m")
        axes.locator_params(nbins=4)
        axes.set_title(title, fontsize=9)
    return figure


def errors_figure(results: Results) -> Figure:
    """The mean error against particles, cameras and covered frames."""
    figure = Figure(figsize=(11, 3.4), dpi=110, layout="constrained")
    panels = (("particles", "particles"), ("cameras", "cameras"), ("covered", "covered frames of camera 1"))
    for axes, (group, label) in zip(figure.subplots(1, 3, sharey=True), panels, strict=True):
        series: dict[str, list[tuple[float, float]]] = {}
        for row, films in results.items():
            if row.group != group:
                continue
            name = row.name.partition(", ")[2] if group == "covered" else "contour"
            x = {"particles": row.particles, "cameras": row.cameras, "covered": row.covered}[group]
            series.setdefault(name, []).append((x, 100 * over_seeds(films)[0].mean))
        for colour, (name, points) in zip(COLOURS, series.items(), strict=False):
            axes.plot(*zip(*points, strict=True), "o-", color=colour, label=name)
        axes.set_xlabel(label)
        axes.set_yscale("log")
        axes.set_yticks(TICKS, [f"{tick:g}" for tick in TICKS], minor=False)
        axes.minorticks_off()
        axes.grid(alpha=0.3)
        if group == "particles":
            axes.set_ylabel("mean distance to the true position, cm")
            axes.set_xscale("log")
            axes.set_xticks([row.particles for row in results if row.group == group])
            axes.xaxis.set_major_formatter("{x:g}")
        if len(series) > 1:
            axes.legend(frameon=False, fontsize=8)
    return figure
