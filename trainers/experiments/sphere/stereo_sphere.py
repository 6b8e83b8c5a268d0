"""Section 3 of the sphere paper (`reproduce stereo-sphere`): a ball in space from two cameras, paper beside here."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from tsuiseki.datamodules.scenes.ball.carried import CarriedBallSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.report.plots import COLOURS
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, Table, at_least_one
from tsuiseki.trainers.experiments.sphere.films import Configuration, FilmErrors, configurations, over_seeds, run_film

# Mean, maximum and standard deviation of the distance to the path, metres (section 3).
PAPER = {"background": (0.200, 0.295, 0.0990), "contour": (0.0320, 0.0488, 0.0103)}
# The paper's rows stand below the two configurations that are its own.
PAPER_BELOW = 1
TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20)
COLUMNS = ("to position: mean", "max", "sd", "to path: mean", "max", "sd")
NOT_THE_PAPERS = ("–", "–", "–")


def reproduce(bench: Bench, seeds: int = 3, frames: int = 100, only: bool = False, seed: int = 0) -> Outcome:
    """Section 3 of the sphere paper: a ball moved by hand, by background difference and by outline, paper beside here.

    DIR gets results.json, tables.md and errors.png.

    Args:
        bench: where it works.
        seeds: number of films, each with its own room, person, ball and noise.
        frames: of each film.
        only: leave out the error against particles, cameras and covered frames, which needs six cameras.
        seed: of the first film; the others follow.

    Raises:
        RequestError: no film, or one of a single frame.
    """
    at_least_one(seeds=seeds)
    if frames < 2 or seed < 0:
        raise RequestError(f"expected at least 2 frames and a seed from 0, got {frames} frames and seed {seed}")
    rows = [row for row in configurations() if row.group == "section 3" or not only]
    settings = CarriedBallSettings(cameras=max(row.cameras for row in rows), frames=frames)
    films = {n: bench.store.recall(run_film, n, settings, rows, bench.watch) for n in range(seed, seed + seeds)}
    values = [
        {
            "group": row.group,
            "name": row.name,
            "films": {str(film): dataclasses.asdict(found[number]) for film, found in films.items()},
        }
        for number, row in enumerate(rows)
    ]
    groups = dict.fromkeys(row.group for row in rows)
    tables = [*(_group_table(group, rows, films) for group in groups), _film_table(rows, films)]
    plots = {} if only else {"errors": _figure(rows, films)}
    notes = [f"Errors in cm over {len(films)} films: mean over films of mean and sd, greatest max."]
    return Outcome(values, tables, plots, notes=notes)


def _group_table(group: str, rows: Sequence[Configuration], films: Mapping[int, Sequence[FilmErrors]]) -> Table:
    lines: list[Sequence[str]] = []
    for number, row in enumerate(rows):
        if row.group != group:
            continue
        values = [100 * v for s in over_seeds(films, number) for v in (s.mean, s.maximum, s.deviation)]
        lines.append((row.name, *(f"{v:.2f}" for v in values)))
        if number == PAPER_BELOW:
            lines += [
                (f"{name}, the paper", *NOT_THE_PAPERS, *(f"{100 * v:.2f}" for v in paper))
                for name, paper in PAPER.items()
            ]
    return Table("", (group, *COLUMNS), lines)


def _film_table(rows: Sequence[Configuration], films: Mapping[int, Sequence[FilmErrors]]) -> Table:
    lines = [
        (row.name, *(f"{100 * found[number].to_position.mean:.2f}" for found in films.values()))
        for number, row in enumerate(rows)
        if row.group == "section 3"
    ]
    return Table("", ("mean distance to the position in film", *map(str, films)), lines)


def _figure(rows: Sequence[Configuration], films: Mapping[int, Sequence[FilmErrors]]) -> Figure:
    figure = Figure(figsize=(11, 3.4), dpi=110, layout="constrained")
    panels = (("particles", "particles"), ("cameras", "cameras"), ("covered", "covered"))
    for axes, (group, label) in zip(figure.subplots(1, 3, sharey=True), panels, strict=True):
        series: dict[str, list[tuple[float, float]]] = {}
        for number, row in enumerate(rows):
            if row.group != group:
                continue
            name = row.name.partition(", ")[2] if group == "covered" else "contour"
            x = {"particles": row.particles, "cameras": row.cameras, "covered": row.covered}[group]
            series.setdefault(name, []).append((x, 100 * over_seeds(films, number)[0].mean))
        for colour, (name, points) in zip(COLOURS, series.items(), strict=False):
            axes.plot(*zip(*points, strict=True), "o-", color=colour, label=name)
        axes.set_xlabel({"covered": "covered frames of camera 1"}.get(label, label))
        axes.set_yscale("log")
        axes.set_yticks(TICKS, [f"{tick:g}" for tick in TICKS], minor=False)
        axes.minorticks_off()
        axes.grid(alpha=0.3)
        if group == "particles":
            axes.set_ylabel("mean distance to the true position, cm")
            axes.set_xscale("log")
            axes.set_xticks([row.particles for row in rows if row.group == group])
            axes.xaxis.set_major_formatter("{x:g}")
        if len(series) > 1:
            axes.legend(frameon=False, fontsize=8)
    return figure
