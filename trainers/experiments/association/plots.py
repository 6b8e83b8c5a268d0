"""The association's picture: what each row scores, and by how much ours is above it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from tsuiseki.tracking.evaluation.resampling import scores_of
from tsuiseki.trainers.experiments.association.runs import Result
from tsuiseki.trainers.experiments.association.tables import intervals

OURS, OTHER, LIMIT = "#b5121b", "#31688e", "#777777"


def plot_scores(sets: Mapping[str, Sequence[Result]], ours: str, limits: Mapping[str, Result]) -> Figure:
    """A panel a data set: HOTA and IDF1 of each row, and the difference of IDF1 to ours with its interval.

    Args:
        sets: the rows by title of the data set.
        ours: the row that the others are compared with.
        limits: what the right links reach, by title.
    """
    figure = Figure(figsize=(12, 2.9 * len(sets)), layout="constrained")
    panels = figure.subplots(len(sets), 2, squeeze=False, width_ratios=(1, 1))
    for (left, right), (title, results) in zip(panels, sets.items(), strict=True):
        names = [result.name for result in results]
        places = range(len(names))[::-1]
        base = next(result for result in results if result.name == ours)
        for place, result in zip(places, results, strict=True):
            found = scores_of(result.sums.sum(axis=0))
            colour = OURS if result.name == ours else OTHER
            left.plot(float(found["hota"]), place, "o", color=colour)
            left.plot(float(found["idf1"]), place, "o", color=colour, markerfacecolor="white")
            if result.name != ours:
                gap = intervals(base, result)["idf1"]
                right.plot([gap.low, gap.high], [place, place], color=colour, linewidth=2)
                right.plot(gap.difference, place, "o", color=colour)
        if title in limits:
            best = scores_of(limits[title].sums.sum(axis=0))
            left.axvline(float(best["hota"]), color=LIMIT, linestyle="--", linewidth=1)
            left.axvline(float(best["idf1"]), color=LIMIT, linestyle=":", linewidth=1)
        left.set_yticks(list(places), names)
        left.set_title(f"{title}: HOTA (filled), IDF1 (hollow); lines: the right links", fontsize=9)
        right.set_yticks([])
        right.set_ylim(left.get_ylim())
        right.axvline(0, color="black", linewidth=0.8)
        right.set_title("IDF1 of ours above the row, 95 % over sequences", fontsize=9)
        for panel in (left, right):
            panel.grid(axis="x", color="#dddddd", linewidth=0.6)
            panel.set_axisbelow(True)
    return figure
