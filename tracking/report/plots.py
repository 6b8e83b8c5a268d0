"""Plots of scores and tracks, drawn without a display.

Colours are readable on white and on black, and for the colour-blind (Okabe and Ito's set without yellow and black).
"""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tsuiseki.tracking.evaluation.multi import PeopleEvaluation
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.labels import GroundTruth

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9")
SHARES = (("HOTA", "hota"), ("DetA", "det_a"), ("AssA", "ass_a"), ("MOTA", "mota"), ("IDF1", "idf1"))
COUNTS = (("Id switches", "id_switches"), ("False boxes", "false_positives"), ("Missed boxes", "false_negatives"))


def comparison_figure(results: Mapping[str, PeopleEvaluation], ink: str = "black") -> Figure:
    """Combined scores of several results side by side: shares on the left, errors on the right.

    Args:
        results: an evaluation by name of the result.
        ink: colour of text and axes.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 0.6 + 3.2 + 0.22 * len(results)), layout="constrained")
    shares, counts = figure.subplots(1, 2, width_ratios=(len(SHARES), len(COUNTS)))
    _grouped_bars(shares, results, SHARES, "{:.2f}")
    _grouped_bars(counts, results, COUNTS, "{:.0f}")
    lowest = min(0.0, *(r.combined.mota for r in results.values()))
    shares.set_ylim(max(lowest, -1.0) * 1.08, 1.08)
    shares.set_title("Scores (higher is better)", color=ink, loc="left")
    counts.set_title("Errors (lower is better)", color=ink, loc="left")
    counts.set_yscale("symlog", linthresh=10)
    counts.yaxis.set_major_formatter("{x:.0f}")
    most = max(dataclasses.asdict(r.combined)[field] for r in results.values() for _, field in COUNTS)
    counts.set_ylim(0, max(10.0, 1.8 * most))
    for axes in (shares, counts):
        _dress(axes, ink)
        axes.axhline(0, color=ink, linewidth=0.8)
    handles, names = shares.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=min(4, len(results)), frameon=False, labelcolor=ink)
    return figure


def save_comparison(results: Mapping[str, PeopleEvaluation], path: Path) -> None:
    """Write `comparison_figure` as the image that the suffix of ``path`` names."""
    figure = comparison_figure(results)
    figure.savefig(path, dpi=150, facecolor="white")


def count_figure(truth: GroundTruth, results: Mapping[str, Sequence[Track]], length: int, ink: str = "black") -> Figure:
    """Number of people in each frame: labelled, and by each result.

    Args:
        truth: the labels.
        results: tracks by name of the result.
        length: number of frames.
        ink: colour of text and axes.
    """
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
        axes.step(numbers, counts, where="mid", color=COLOURS[n % len(COLOURS)], linewidth=1.2, label=_literal(name))
    axes.set_xlabel("frame", color=ink)
    axes.set_xlim(1, max(length, 2))
    axes.set_ylim(bottom=0)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    _dress(axes, ink)
    figure.legend(loc="outside lower center", ncols=min(4, len(results) + 1), frameon=False, labelcolor=ink)
    return figure


def inline_svg(draw: Callable[[str], Figure], name: str) -> str:
    """A figure as SVG for a page whose text colour it takes.

    Args:
        draw: makes the figure, given the colour of text and axes.
        name: unlike that of any other figure on the page; goes into the ids of its parts.
    """
    import matplotlib

    # matplotlib knows no currentColor: draw in a colour nothing else has, and exchange it.
    stand_in = "#010203"
    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": name, "font.family": "sans-serif"}):
        draw(stand_in).savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :].replace(stand_in, "currentColor")
    return svg.replace("<svg", '<svg class="plot" role="img"', 1)


def _dress(axes: Axes, ink: str) -> None:
    axes.set_facecolor("none")
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(ink)
    axes.tick_params(colors=ink)


def _grouped_bars(
    axes: Axes, results: Mapping[str, PeopleEvaluation], fields: tuple[tuple[str, str], ...], label: str
) -> None:
    width = 0.8 / len(results)
    places = np.arange(len(fields))
    for number, (name, evaluation) in enumerate(results.items()):
        values = dataclasses.asdict(evaluation.combined)
        heights = [values[field] for _, field in fields]
        offset = (number - (len(results) - 1) / 2) * width
        bars = axes.bar(
            places + offset, heights, 0.92 * width, color=COLOURS[number % len(COLOURS)], label=_literal(name)
        )
        if len(results) <= 4:
            axes.bar_label(bars, [label.format(h) for h in heights], padding=2, fontsize=8, color="gray")
    axes.set_xticks(places, [heading for heading, _ in fields])


def _literal(name: str) -> str:
    """``name`` for a label in which a dollar sign would start a formula."""
    return name.replace("$", r"\$")
