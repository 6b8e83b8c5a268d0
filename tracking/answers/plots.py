"""Plots of answers: how many at a time, crossings over time, and from where to where."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tsuiseki.tracking.answers.counting import Answers
from tsuiseki.tracking.report.plots import COLOURS, dress, literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Draw = Callable[[Answers, str], "Figure"]


def counts_figure(answers: Answers, ink: str = "black") -> Figure:
    """All in view in each second."""
    table = answers.tables["counts"]
    return _steps(ink, "in view", [("", *_up_to_the_end(answers, table["time"], table["people"]))])


def occupancy_figure(answers: Answers, ink: str = "black") -> Figure:
    """Those in each zone in each second."""
    table = answers.tables["occupancy"]
    lines = []
    for zone in answers.scene.zones:
        own = [row for row, name in enumerate(table["zone"]) if name == zone.name]
        times, people = ([table[name][row] for row in own] for name in ("time", "people"))
        lines.append((zone.name, *_up_to_the_end(answers, times, people)))
    return _steps(ink, "in the zone", lines)


def flow_figure(answers: Answers, ink: str = "black") -> Figure:
    """Crossings of each line and direction so far, over time."""
    table, end = answers.tables["crossings"], answers.length / answers.frame_rate
    lines = []
    for line in answers.scene.lines:
        for way in line.directions:
            rows = zip(table["time"], table["line"], table["direction"], strict=True)
            times = sorted(time for time, name, direction in rows if (name, direction) == (line.name, way))
            lines.append((f"{line.name} {way}", [0, *times, end], [*range(len(times) + 1), len(times)]))
    return _steps(ink, "crossings so far", lines, paired=True)


def ways_figure(name: str) -> Draw:
    """What draws the table of origins and destinations of that name."""

    def draw(answers: Answers, ink: str = "black") -> Figure:
        origins, destinations, counts = matrix(answers.tables[name])
        figure, axes = _axes(ink, "to", "from")
        figure.set_size_inches(1.5 + 0.9 * len(destinations), 1.2 + 0.6 * len(origins))
        if counts.size:
            axes.imshow(counts, cmap="Blues", vmin=0, aspect="auto")
        axes.set_xticks(range(len(destinations)), [literal(one) for one in destinations])
        axes.set_yticks(range(len(origins)), [literal(one) for one in origins])
        for (row, column), count in np.ndenumerate(counts):
            axes.text(
                column,
                row,
                str(count),
                ha="center",
                va="center",
                color="white" if 2 * count > counts.max() else "black",
            )
        return figure

    return draw


def matrix(table: Any) -> tuple[list[str], list[str], Any]:
    """Origins, destinations, and how many went from which to which ``(O, D)``."""
    origins, destinations = (list(dict.fromkeys(table[name])) for name in ("origin", "destination"))
    counts = np.zeros((len(origins), len(destinations)), dtype=np.int64)
    for origin, destination, count in zip(*table.values(), strict=True):
        counts[origins.index(origin), destinations.index(destination)] = count
    return origins, destinations, counts


FIGURES: dict[str, Draw] = {
    "counts": counts_figure,
    "occupancy": occupancy_figure,
    "crossings": flow_figure,
    "turns": ways_figure("turns"),
    "sides": ways_figure("sides"),
}


def _up_to_the_end(
    answers: Answers, times: Sequence[float], values: Sequence[float]
) -> tuple[list[float], list[float]]:
    return [*times, answers.length / answers.frame_rate], [*values, *values[-1:]] if len(values) else [0]


def _steps(ink: str, up: str, lines: Iterable[tuple[str, Any, Any]], paired: bool = False) -> Figure:
    """Step functions of time, each with its name; of pairs the second is dashed."""
    figure, axes = _axes(ink, "seconds", up)
    for number, (name, times, values) in enumerate(lines):
        colour, style = (number // 2, "--" if number % 2 else "-") if paired else (number, "-")
        axes.step(times, values, style, where="post", color=COLOURS[colour % len(COLOURS)], label=literal(name))
    axes.set_ylim(bottom=0)
    if any(axes.get_legend_handles_labels()[1]):
        axes.legend(frameon=False, labelcolor=ink, loc="upper left", bbox_to_anchor=(1, 1))
    return figure


def _axes(ink: str, across: str, up: str) -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.2), dpi=110, layout="constrained")
    axes = figure.subplots()
    dress(axes, ink)
    axes.set_xlabel(across, color=ink)
    axes.set_ylabel(up, color=ink)
    return figure, axes
