"""Plots of scores and tracks, drawn without a display.

Colours are readable on white and on black, and for the colour-blind (Okabe and Ito's set without yellow and black).
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tsuiseki.tracking.evaluation.multi import PeopleEvaluation
from tsuiseki.tracking.evaluation.success_curves import DISTANCES, OVERLAPS, PRECISION_AT, MeanCurves
from tsuiseki.tracking.types import Estimate, Track
from tsuiseki.tracking.types.labels import GroundTruth

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9")
SHARES = (("HOTA", "hota"), ("DetA", "det_a"), ("AssA", "ass_a"), ("MOTA", "mota"), ("IDF1", "idf1"))
# Inches across of a figure on a telephone.
NARROW = 4.4
COUNTS = (("Id switches", "id_switches"), ("False boxes", "false_positives"), ("Missed boxes", "false_negatives"))


def comparison_figure(results: Mapping[str, PeopleEvaluation], ink: str = "black") -> Figure:
    """Scores of all sequences by name of the result: shares on the left, errors on the right; ``ink`` is for text."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 0.6 + 3.2 + 0.22 * len(results)), layout="constrained")
    shares, counts = figure.subplots(1, 2, width_ratios=(len(SHARES), len(COUNTS)))
    for axes, fields, form in ((shares, SHARES, "{:.2f}"), (counts, COUNTS, "{:.0f}")):
        heights = {name: [getattr(scores.combined, field) for _, field in fields] for name, scores in results.items()}
        _grouped_bars(axes, heights, [heading for heading, _ in fields], form)
    lowest = min(0.0, *(r.combined.mota for r in results.values()))
    shares.set_ylim(max(lowest, -1.0) * 1.08, 1.08)
    shares.set_title("Scores (higher is better)", color=ink, loc="left")
    counts.set_title("Errors (lower is better)", color=ink, loc="left")
    counts.set_yscale("symlog", linthresh=10)
    counts.yaxis.set_major_formatter("{x:.0f}")
    errors = max(getattr(r.combined, field) for r in results.values() for _, field in COUNTS)
    counts.set_ylim(0, max(10.0, 1.8 * errors))
    for axes in (shares, counts):
        dress(axes, ink)
        axes.axhline(0, color=ink, linewidth=0.8)
    handles, names = shares.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=min(4, len(results)), frameon=False, labelcolor=ink)
    return figure


def save_comparison(results: Mapping[str, PeopleEvaluation], path: Path) -> None:
    """Write `comparison_figure` as the image that the suffix of ``path`` names."""
    figure = comparison_figure(results)
    figure.savefig(path, dpi=150, facecolor="white")


def count_figure(truth: GroundTruth, results: Mapping[str, Sequence[Track]], length: int, ink: str = "black") -> Figure:
    """Number of people in each frame: labelled, and by each result's tracks; ``ink`` is the colour of text."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(10, 3), layout="constrained")
    axes = figure.subplots()
    numbers = np.arange(1, length + 1)
    labelled = np.bincount(truth.frames[truth.evaluated], minlength=length)[:length]
    axes.step(numbers, labelled, where="mid", color=ink, linewidth=2.5, alpha=0.35, label="ground truth")
    for n, (name, tracks) in enumerate(results.items()):
        frames = np.concatenate([np.empty(0, np.int64), *(track.frames for track in tracks)])
        counts = np.bincount(frames, minlength=length)[:length]
        axes.step(numbers, counts, where="mid", color=COLOURS[n % len(COLOURS)], linewidth=1.2, label=literal(name))
    axes.set_xlim(1, max(length, 2))
    axes.set_ylim(bottom=0)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    dress(axes, ink, "frame")
    figure.legend(loc="outside lower center", ncols=min(4, len(results) + 1), frameon=False, labelcolor=ink)
    return figure


def inline_svg(draw: Callable[[str], Figure], name: str, narrow: bool = False) -> Markup:
    """A figure in the page's own text colour, from behind ``<svg``.

    Args:
        draw: gives the figure, by the colour of its text.
        name: unlike that of others on the page.
        narrow: as wide as a telephone shows it with letters of their size.
    """
    import matplotlib
    from markupsafe import Markup

    # matplotlib knows no currentColor: draw in a colour nothing else has, and exchange it.
    stand_in = "#010203"
    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": name, "font.family": "sans-serif"}):
        figure = draw(stand_in)
        if narrow:
            _narrow(figure, stand_in)
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    return Markup(buffer.getvalue().partition("<svg")[2].replace(stand_in, "currentColor"))


def _narrow(figure: Figure, ink: str) -> None:
    """Make a figure as wide as a telephone: panels below each other, two columns of legend, no numbers on bars."""
    from matplotlib.gridspec import GridSpec

    panels = [axes for axes in figure.axes if axes.get_subplotspec() is not None]
    height = max(NARROW * 0.6, 0.9 * figure.get_figheight())
    figure.set_size_inches(NARROW, height if len(panels) < 2 else NARROW * 0.75 * len(panels))
    grid = GridSpec(max(len(panels), 1), 1, figure=figure)
    for row, axes in enumerate(panels):
        axes.set_subplotspec(grid[row])
        for number in axes.texts[:] if axes.containers else ():
            number.remove()
    for legend in figure.legends[:]:
        lines = [line for line in legend.legend_handles if line is not None]
        texts = [text.get_text() for text in legend.get_texts()]
        legend.remove()
        figure.legend(lines, texts, loc="outside lower center", ncols=2, frameon=False, labelcolor=ink)


def dress(axes: Axes, ink: str, across: str = "", up: str = "") -> None:
    """Axes in the colour ``ink``, open above and on the right, with labels ``across`` and ``up``."""
    axes.set_facecolor("none")
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(ink)
    axes.tick_params(colors=ink)
    axes.set_xlabel(across, color=ink)
    axes.set_ylabel(up, color=ink)


def _grouped_bars(axes: Axes, results: Mapping[str, Sequence[float]], ticks: Sequence[str], form: str = "") -> None:
    """A group of bars a tick, one by name of each result; of up to four results with their heights as ``form`` says."""
    width = 0.8 / len(results)
    places = np.arange(len(ticks))
    for number, (name, heights) in enumerate(results.items()):
        offset = (number - (len(results) - 1) / 2) * width
        colour = COLOURS[number % len(COLOURS)]
        bars = axes.bar(places + offset, heights, 0.92 * width, color=colour, label=literal(name))
        if form and len(results) <= 4:
            axes.bar_label(bars, [form.format(h) for h in heights], padding=2, fontsize=8, color="gray")
    axes.set_xticks(places, ticks)


def literal(name: str) -> str:
    """``name`` for a label in which a dollar sign would start a formula."""
    return name.replace("$", r"\$")


STYLES = ("-", "--", ":")


def curves_figure(results: Mapping[str, Mapping[str, MeanCurves]]) -> Figure:
    """Success and precision over all sequences, and by attribute, by name of the tracker and group, such as ``ALL``."""
    from matplotlib.figure import Figure

    groups = [g for g in next(iter(results.values())) if g != "ALL"]
    figure = Figure(figsize=(13, 8.2 if groups else 4.4), layout="constrained")
    axes = figure.subplot_mosaic(
        [["success", "precision"], ["groups", "groups"]] if groups else [["success", "precision"]]
    )
    ranked = sorted(results.items(), key=lambda item: -item[1]["ALL"].auc)
    for number, (name, curves) in enumerate(ranked):
        colour, line = COLOURS[number % len(COLOURS)], STYLES[number // len(COLOURS) % len(STYLES)]
        overall = curves["ALL"]
        label = f"{literal(name)} [{100 * overall.auc:.1f}]"
        axes["success"].plot(OVERLAPS, 100 * overall.success, label=label, color=colour, ls=line)
        label = f"{literal(name)} [{100 * overall.precision[PRECISION_AT]:.1f}]"
        axes["precision"].plot(DISTANCES, 100 * overall.precision, label=label, color=colour, ls=line)
    _label(axes["success"], "Overlap threshold", "Frames above it [%]", "Success [area under the curve]")
    _label(axes["precision"], "Distance of the centres [pixels]", "Frames within it [%]", "Precision [at 20 pixels]")
    if groups:
        heights = {name: [100 * c[g].auc if g in c else np.nan for g in groups] for name, c in ranked}
        _grouped_bars(axes["groups"], heights, groups)
        axes["groups"].set_ylabel("Area under the success curve [%]")
        axes["groups"].set_title("By attribute", loc="left")
        axes["groups"].spines[["top", "right"]].set_visible(False)
    return figure


def _label(axes: Axes, x: str, y: str, title: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title, loc="left")
    axes.set_ylim(0, 100)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1, 1))


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
