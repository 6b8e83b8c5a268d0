"""Success and precision curves of trackers of one target, and bars by attribute."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tsuiseki.tracking.evaluation.single import DISTANCES, OVERLAPS, PRECISION_AT
from tsuiseki.tracking.evaluation.single_table import MeanCurves
from tsuiseki.tracking.report.plots import COLOURS
from tsuiseki.tracking.types import Estimate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STYLES = ("-", "--", ":")


def curves_figure(results: Mapping[str, Mapping[str, MeanCurves]]) -> Figure:
    """Success and precision over all sequences, and by attribute where there are attributes.

    Args:
        results: by name of the tracker and group (``ALL`` or an attribute).
    """
    from matplotlib.figure import Figure

    groups = [g for g in next(iter(results.values())) if g != "ALL"]
    figure = Figure(figsize=(13, 8.2 if groups else 4.4), layout="constrained")
    axes = figure.subplot_mosaic(
        [["success", "precision"], ["groups", "groups"]] if groups else [["success", "precision"]]
    )
    ranked = sorted(results.items(), key=lambda item: -item[1]["ALL"].auc)
    for number, (name, curves) in enumerate(ranked):
        colour, line = COLOURS[number % len(COLOURS)], STYLES[number // len(COLOURS) % len(STYLES)]
        whole = curves["ALL"]
        label = f"{_plain(name)} [{100 * whole.auc:.1f}]"
        axes["success"].plot(OVERLAPS, 100 * whole.success, label=label, color=colour, ls=line)
        label = f"{_plain(name)} [{100 * whole.precision[PRECISION_AT]:.1f}]"
        axes["precision"].plot(DISTANCES, 100 * whole.precision, label=label, color=colour, ls=line)
    _label(axes["success"], "Overlap threshold", "Frames above it [%]", "Success [area under the curve]")
    _label(axes["precision"], "Distance of the centres [pixels]", "Frames within it [%]", "Precision [at 20 pixels]")
    if groups:
        _bars(axes["groups"], dict(ranked), groups)
    return figure


def save_curves(results: Mapping[str, Mapping[str, MeanCurves]], path: Path) -> None:
    """Write `curves_figure` as the image that the suffix of ``path`` names."""
    curves_figure(results).savefig(path, dpi=130, facecolor="white")


def _bars(axes: Axes, results: Mapping[str, Mapping[str, MeanCurves]], groups: list[str]) -> None:
    width = 0.8 / len(results)
    for number, curves in enumerate(results.values()):
        heights = [100 * curves[g].auc if g in curves else np.nan for g in groups]
        offset = (number - (len(results) - 1) / 2) * width
        axes.bar(np.arange(len(groups)) + offset, heights, 0.92 * width, color=COLOURS[number % len(COLOURS)])
    axes.set_xticks(np.arange(len(groups)), groups)
    axes.set_ylabel("Area under the success curve [%]")
    axes.set_title("By attribute", loc="left")
    axes.spines[["top", "right"]].set_visible(False)


def _label(axes: Axes, x: str, y: str, title: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title, loc="left")
    axes.set_ylim(0, 100)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1, 1))


def _plain(name: str) -> str:
    return name.replace("$", r"\$")


def peaks_figure(estimates: Sequence[Estimate]) -> Figure:
    """The score of every frame, with the frames of search and of loss shaded."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3), layout="constrained")
    axes = figure.subplots()
    frames = np.array([e.frame + 1 for e in estimates])[1:]
    axes.plot(frames, [e.score for e in estimates][1:], color=COLOURS[0], linewidth=1.2)
    for status, colour in (("searching", COLOURS[1]), ("lost", COLOURS[4])):
        chosen = [e.frame + 1 for e in estimates if e.status == status]
        for n, frame in enumerate(chosen):
            axes.axvspan(
                frame - 0.5, frame + 0.5, color=colour, alpha=0.25, linewidth=0, label=status if n == 0 else None
            )
    axes.set_xlabel("Frame")
    axes.set_ylabel("Score")
    axes.spines[["top", "right"]].set_visible(False)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
    return figure


def save_peaks(estimates: Sequence[Estimate], path: Path) -> None:
    """Write `peaks_figure` as the image that the suffix of ``path`` names."""
    peaks_figure(estimates).savefig(path, dpi=130, facecolor="white")
