"""Plots of answers and their numbers: how many at a time, crossings, from where to where, and time spent where."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tsuiseki.tracking.counts.counting import Answers, Table
from tsuiseki.tracking.counts.paths import support_of
from tsuiseki.tracking.report.plots import COLOURS, dress, literal
from tsuiseki.tracking.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# What people in a shop call the sides of the picture.
IN_SHOP = {"top": "far end", "bottom": "near end", "within": "in view"}
Draw = Callable[[Answers, str], "Figure"]


def counts_figure(answers: Answers, ink: str = "black") -> Figure:
    """All in view in each second."""
    table = answers.tables["counts"]
    return step_figure(ink, "in view", [("", *_up_to_the_end(answers, table["time"], table["people"]))])


def occupancy_figure(answers: Answers, ink: str = "black") -> Figure:
    """Those in each zone in each second."""
    table = answers.tables["occupancy"]
    lines = []
    for zone in answers.scene.zones:
        rows = [row for row, name in enumerate(table["zone"]) if name == zone.name]
        times, people = ([table[name][row] for row in rows] for name in ("time", "people"))
        lines.append((zone.name, *_up_to_the_end(answers, times, people)))
    return step_figure(ink, "in the zone", lines)


def flow_figure(answers: Answers, ink: str = "black") -> Figure:
    """Crossings of each line and direction so far, over time."""
    table, end = answers.tables["crossings"], answers.length / answers.frame_rate
    lines = []
    for line in answers.scene.lines:
        for way in line.directions:
            rows = zip(table["time"], table["line"], table["direction"], strict=True)
            times = sorted(time for time, name, direction in rows if (name, direction) == (line.name, way))
            lines.append((f"{line.name} {way}", [0, *times, end], [*range(len(times) + 1), len(times)]))
    return step_figure(ink, "crossings so far", lines, paired=True)


def ways_figure(name: str) -> Draw:
    """What draws the table of origins and destinations of that name."""

    def draw(answers: Answers, ink: str = "black") -> Figure:
        origins, destinations, counts = matrix(answers.tables[name])
        figure, axes = _axes(ink, "to", "from")
        figure.set_size_inches(1.5 + 0.9 * len(destinations), 1.2 + 0.6 * len(origins))
        if counts.size:
            axes.imshow(counts, cmap="Blues", vmin=0, aspect="auto")
        axes.set_xticks(range(len(destinations)), [literal(label) for label in destinations])
        axes.set_yticks(range(len(origins)), [literal(label) for label in origins])
        for (row, column), count in np.ndenumerate(counts):
            colour = "white" if 2 * count > counts.max() else "black"
            axes.text(column, row, str(count), ha="center", va="center", color=colour)
        return figure

    return draw


def matrix(table: Any) -> tuple[list[str], list[str], Any]:
    """Origins, destinations, and how many went from which to which ``(O, D)``."""
    origins, destinations = (list(dict.fromkeys(table[name])) for name in ("origin", "destination"))
    counts = np.zeros((len(origins), len(destinations)), dtype=np.int64)
    for origin, destination, count in zip(*table.values(), strict=True):
        counts[origins.index(origin), destinations.index(destination)] = count
    return [IN_SHOP.get(side, side) for side in origins], [IN_SHOP.get(side, side) for side in destinations], counts


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


def step_figure(ink: str, up: str, lines: Iterable[tuple[str, Any, Any]], paired: bool = False) -> Figure:
    """Step functions of time, each with its name; of pairs the second is dashed."""
    from matplotlib.ticker import MaxNLocator

    figure, axes = _axes(ink, "seconds", up)
    for number, (name, times, values) in enumerate(lines):
        colour, style = (number // 2, "--" if number % 2 else "-") if paired else (number, "-")
        axes.step(times, values, style, where="post", color=COLOURS[colour % len(COLOURS)], label=literal(name))
    axes.set_ylim(bottom=0)
    axes.yaxis.set_major_locator(MaxNLocator("auto", integer=True))
    if any(axes.get_legend_handles_labels()[1]):
        figure.legend(frameon=False, labelcolor=ink, loc="outside lower center", ncols=4)
    return figure


def _axes(ink: str, across: str, up: str) -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.2), dpi=110, layout="constrained")
    axes = figure.subplots()
    dress(axes, ink, across, up)
    return figure, axes


# Cells across the picture; they are square.
COLUMNS = 48
# Rows of a path in a second.
SAMPLES = 10


def seconds_in_cells(answers: Answers, pixels: FloatArray) -> FloatArray:
    """``(R, C)`` seconds spent in each cell of the picture by all of the ``(N, 2)`` pixels, row 0 at the top."""
    wide, high = answers.size.tolist()
    rows = max(1, round(COLUMNS * high / wide))
    edges = np.linspace(0, high, rows + 1), np.linspace(0, wide, COLUMNS + 1)
    return np.histogram2d(pixels[:, 1], pixels[:, 0], bins=edges)[0] / answers.frame_rate


def square_metres(answers: Answers, shape: tuple[int, int]) -> FloatArray | None:
    """``(R, C)`` floor in each cell, NaN where it shows none; None where metres are not known."""
    if not answers.scene.has_metres:
        return None
    x, y = (np.linspace(0, extent, count + 1) for extent, count in zip(answers.size, shape[::-1], strict=True))
    corners = answers.scene.metres(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(len(y), len(x), 2)
    down, across = corners[1:, 1:] - corners[:-1, :-1], corners[:-1, 1:] - corners[1:, :-1]
    areas = 0.5 * np.abs(down[..., 0] * across[..., 1] - down[..., 1] * across[..., 0])
    return np.where(areas > 0, areas, np.nan)


def heat_values(answers: Answers, pixels: FloatArray) -> tuple[FloatArray, str]:
    """``(R, C)`` seconds, a square metre where metres are known; and what they are."""
    seconds = seconds_in_cells(answers, pixels)
    metres = square_metres(answers, seconds.shape)
    return (seconds, "s in a cell") if metres is None else (seconds / metres, "s a square metre")


def heat_table(answers: Answers, pixels: FloatArray) -> Table:
    """The cells in which somebody was: the middle of each in pixels, and seconds."""
    seconds = seconds_in_cells(answers, pixels)
    metres = square_metres(answers, seconds.shape)
    rows, columns = np.nonzero(seconds)
    side = answers.size / seconds.shape[::-1]
    table = {
        "x": ((columns + 0.5) * side[0]).round(1).tolist(),
        "y": ((rows + 0.5) * side[1]).round(1).tolist(),
        "seconds": seconds[rows, columns].round(3).tolist(),
    }
    if metres is not None:
        table["seconds_per_square_metre"] = (seconds / metres)[rows, columns].round(4).tolist()
    return table


def path_table(answers: Answers, pixels: FloatArray) -> Table:
    """Where each was, up to `SAMPLES` times a second: pixels, and metres where they are known."""
    paths, rate = answers.paths, answers.frame_rate
    sampled = paths.frames % max(1, round(rate / SAMPLES)) == 0
    columns = {"time": paths.frames / rate, "id": paths.ids, "x": pixels[:, 0], "y": pixels[:, 1]}
    doubt = dict[str, list[Any]]()
    if (visitors := answers.visitors) is not None:
        rows = np.flatnonzero(sampled)
        doubt["support"] = support_of(paths, rows, visitors.doubtful)
        ends = (paths.frames[which].astype(np.float64) for which in (paths.first_rows[rows], rows))
        doubt["changed"] = visitors.changed(paths.ids[rows].tolist(), *ends)
    if paths.metres is not None:
        columns |= {"x_metres": paths.metres[:, 0], "y_metres": paths.metres[:, 1]}
    return {name: column[sampled].round(3).tolist() for name, column in columns.items()} | doubt
