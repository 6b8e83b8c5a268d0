"""Plots of the drone experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure


def plot_iterations(curves: Mapping[str, Sequence[Mapping[str, float]]]) -> Figure:
    """Fig. 5.8: recall and precision, and switches and MOTA, over the iterations of the alternation."""
    figure = Figure(figsize=(9, 4.2), dpi=90, layout="constrained")
    left, right = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2)
    other = right.twinx()
    for number, (method, rows) in enumerate(curves.items()):
        steps = range(1, len(rows) + 1)
        style = ("-", "--", ":")[number % 3]
        left.plot(steps, [row["recall"] for row in rows], style, color="C0", marker="o", label=f"recall, {method}")
        left.plot(
            steps, [row["precision"] for row in rows], style, color="C1", marker="s", label=f"precision, {method}"
        )
        switches = [row["id_switches"] for row in rows]
        right.plot(steps, switches, style, color="C3", marker="o", label=f"switches, {method}")
        other.plot(steps, [row["mota"] for row in rows], style, color="C2", marker="s", label=f"MOTA, {method}")
    left.set(xlabel="iteration", ylabel="percent", title="(a) recall and precision")
    right.set(xlabel="iteration", ylabel="ID switches", title="(b) switches and MOTA")
    other.set_ylabel("MOTA, percent")
    for axes, lines in ((left, left.get_lines()), (right, [*right.get_lines(), *other.get_lines()])):
        names = [str(line.get_label()) for line in lines]
        axes.legend(lines, names, fontsize="x-small", loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2)
    return figure


def plot_gains(gains: Mapping[str, float | None]) -> Figure:
    """Fig. 5.11: change of the average precision of every action from iteration 1 to iteration 10."""
    shown = {name: value for name, value in gains.items() if value is not None}
    figure = Figure(figsize=(7, 3.4), dpi=90, layout="constrained")
    axes = figure.add_subplot()
    colours = ["C0" if value >= 0 else "C3" for value in shown.values()]
    axes.barh(list(shown), list(shown.values()), color=colours)
    axes.axvline(0, color="black", linewidth=0.8)
    axes.invert_yaxis()
    axes.set(xlabel="AP after iteration 10 minus AP after iteration 1, points")
    return figure
