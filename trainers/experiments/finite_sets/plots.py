"""Plots of the finite-set experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.finite_sets.runs import Scaling, ScenarioRow

DPI = 90


def plot_ospa(rows: Sequence[ScenarioRow]) -> Figure:
    """OSPA over the clutter rate, a panel for each scenario, with the peers' values as crosses."""
    kinds = list(dict.fromkeys(row.scenario for row in rows))
    figure = Figure(figsize=(4.5 * max(len(kinds), 1), 3.6), dpi=DPI, layout="constrained")
    for place, kind in enumerate(kinds, start=1):
        axes = figure.add_subplot(1, len(kinds), place)
        for method in dict.fromkeys(row.method for row in rows):
            chosen = [row for row in rows if row.scenario == kind and row.method == method]
            clutter = [row.clutter for row in chosen]
            line = axes.errorbar(
                clutter, [r.ospa1 for r in chosen], [2 * r.ospa1_error for r in chosen], marker="o", label=method
            )
            peers = [(r.clutter, r.peer) for r in chosen if r.peer is not None]
            if peers:
                axes.plot(*zip(*peers, strict=True), "x", color=line[0].get_color(), label=f"{method}, peer")
        axes.set(title=kind, xlabel="false measurements a step", ylabel="OSPA, p = 1, c = 100", ylim=(0, None))
        axes.legend(fontsize="small")
    return figure


def plot_scaling(grown: Sequence[Scaling]) -> Figure:
    """Milliseconds a step over clutter and over targets, both axes logarithmic."""
    figure = Figure(figsize=(9, 3.6), dpi=DPI, layout="constrained")
    times = [value for one in grown for value in one.milliseconds]
    ticks = [tick for tick in (0.5, 1, 2, 5, 10, 20, 50, 100, 200) if min(times) / 1.5 <= tick <= max(times) * 1.5]
    for place, what in enumerate(("clutter", "targets"), start=1):
        axes = figure.add_subplot(1, 2, place)
        for one in (one for one in grown if one.what == what):
            axes.loglog(one.sizes, one.milliseconds, marker="o", label=f"{one.method}: slope {one.slope:.2f}")
        axes.set(xlabel="false measurements a step" if what == "clutter" else what, ylabel="milliseconds a step")
        sizes = sorted({size for one in grown if one.what == what for size in one.sizes})
        axes.set_xticks(sizes, labels=[str(size) for size in sizes])
        axes.set_yticks(ticks, labels=[f"{tick:g}" for tick in ticks])
        axes.set_ylim(min(times) / 1.5, max(times) * 1.5)
        axes.minorticks_off()
        axes.legend(fontsize="small")
        axes.grid(visible=True, alpha=0.3)
    return figure


def plot_particles(counts: Mapping[str, FloatArray], lost: Mapping[str, FloatArray], purity: FloatArray) -> Figure:
    """Particles on each target over time, and below how many of the clips still have it; a column for each method.

    Args:
        counts: ``(T, K)`` mean over the clips.
        lost: ``(S, K)`` frame at which each clip lost each target, ``T`` where it never did.
        purity: ``(K,)`` of the targets.
    """
    figure = Figure(figsize=(3.6 * len(counts), 5.4), dpi=DPI, layout="constrained")
    panels = figure.subplots(2, len(counts), sharex=True, sharey="row", squeeze=False)
    for name, (above, below) in zip(counts, panels.T, strict=True):
        frames = np.arange(len(counts[name]))
        for target in np.argsort(-purity):
            above.plot(frames, counts[name][:, target], label=f"purity {purity[target]:.2f}")
            below.plot(frames, np.mean(lost[name][:, target, None] > frames, axis=0))
        above.set(title=name, ylim=(0, None))
        below.set(xlabel="frame", ylim=(0, 1.05))
    panels[0, 0].set_ylabel("particles on the target")
    panels[1, 0].set_ylabel("share of clips that still have it")
    panels[0, 0].legend(fontsize="small")
    return figure
