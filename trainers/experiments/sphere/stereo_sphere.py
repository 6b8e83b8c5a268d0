"""Section 3 of the sphere paper (`reproduce stereo-sphere`): a ball in space from two cameras, paper beside here."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from itertools import islice
from typing import Literal

import numpy as np
from matplotlib.figure import Figure

from tsuiseki.datamodules.scenes.sphere_clip import CarriedBallSettings, plan_sphere
from tsuiseki.tracking.errors import RequestError
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, Table, at_least_one
from tsuiseki.trainers.experiments.intervals import interval
from tsuiseki.trainers.experiments.sphere.configurations import Configuration, Group, configurations
from tsuiseki.trainers.experiments.sphere.films import FilmErrors, over_seeds, run_film
from tsuiseki.trainers.experiments.sphere.plots import Results, errors_figure, paths_figure, pictures_figure

# Mean, maximum and standard deviation of the distance to the path, metres (section 3).
PAPER = {"background": (0.200, 0.295, 0.0990), "contour": (0.0320, 0.0488, 0.0103)}
# The paper's own numbers stand below the row that is their method.
PAPER_BELOW = {"background": "background", "printed": "contour"}
COLUMNS = ("to position: mean, 95 % over films", "max", "sd", "to path: mean, 95 %", "max", "sd")
NOT_THE_PAPERS = ("–", "–", "–")
VARIED: tuple[Group, ...] = ("particles", "cameras", "covered")
ALONE: tuple[Group, ...] = ("disturbed", "small")
"""Their films have two cameras; the others share films of as many as any of them needs."""
PAPER_FRAME = 20
"""The frame of figures 2 and 5, counted from 1."""


def reproduce(
    bench: Bench, seeds: int = 3, frames: int = 100, only: Group | Literal["varied"] | None = None, seed: int = 0
) -> Outcome:
    """Section 3 of the sphere paper: a ball moved by hand, by background difference and by outline, paper beside here.

    The contour likelihood is there as printed, and then with one addition after the other. DIR gets results.json,
    tables.md, figures 2 to 5 as pictures.png and paths.png, and errors.png.

    Args:
        bench: where it works.
        seeds: number of films, each with its own room, person, ball and noise.
        frames: of each film.
        only: one table alone: section 3; or disturbed, the error with inexact cameras and radius, blur and clocks that
            differ; or small, a ball of 7 pixels and a lens out of focus; or the error against particles, cameras or
            covered frames, or varied: these three and their figure.
        seed: of the first film; the others follow.

    Raises:
        RequestError: no film, or one of a single frame.
    """
    at_least_one(seeds=seeds)
    if frames < 2 or seed < 0:
        raise RequestError(f"expected at least 2 `frames` and a `seed` from 0, got {frames} frames and seed {seed}")
    chosen = VARIED if only == "varied" else (only,)
    rows = [row for row in configurations() if only is None or row.group in chosen]
    results: dict[Configuration, dict[int, FilmErrors]] = {row: {} for row in rows}
    for number in range(seed, seed + seeds):
        for kind in dict.fromkeys((row.group in ALONE, row.of_film) for row in rows):
            alike = [row for row in rows if (row.group in ALONE, row.of_film) == kind]
            found = bench.store.recall(run_film, number, _film_settings(alike, frames), alike, bench.watch)
            for row, errors in zip(alike, found, strict=True):
                results[row][number] = errors
    groups = dict.fromkeys(row.group for row in rows)
    tables = [_group_table(group, results) for group in groups]
    if "section 3" in groups:
        tables.append(_film_table(results))
    return Outcome(
        [_values(row, films) for row, films in results.items()],
        tables,
        _plots(results, frames, seed),
        notes=[f"Errors in cm over {seeds} films: mean over films of mean and sd, greatest max; 95 % by Student's t."],
    )


def _film_settings(rows: Sequence[Configuration], frames: int) -> CarriedBallSettings:
    ball, exposure, defocus, readout, late, clear = rows[0].of_film
    cameras = max(row.cameras for row in rows)
    lateness = (0.0, late, *[0.0] * (cameras - 2)) if late else ()
    return CarriedBallSettings(
        cameras=cameras, frames=frames, radius=ball, exposure=exposure, defocus=defocus, readout=readout,
        lateness=lateness, clear=clear,
    )  # fmt: skip


def _values(row: Configuration, films: Mapping[int, FilmErrors]) -> dict[str, object]:
    scores = {
        str(number): {
            "to_position": dataclasses.asdict(film.to_position),
            "to_path": dataclasses.asdict(film.to_path),
        }
        for number, film in films.items()
    }
    return {"group": row.group, "name": row.name, "films": scores}


def _group_table(group: str, results: Results) -> Table:
    lines: list[Sequence[str]] = []
    for row, films in results.items():
        if row.group != group:
            continue
        cells = []
        for pooled, name in zip(over_seeds(films), ("to_position", "to_path"), strict=True):
            mean, low, high = interval(100 * np.array([getattr(one, name).mean for one in films.values()]))
            between = f" [{low:.2f}, {high:.2f}]" if len(films) > 1 else ""
            cells += [f"{mean:.2f}{between}", f"{100 * pooled.maximum:.2f}", f"{100 * pooled.deviation:.2f}"]
        lines.append((row.name, *cells))
        paper = PAPER_BELOW.get(row.likelihood) if group == "section 3" else None
        if paper is not None:
            lines.append((f"{paper}, the paper's film", *NOT_THE_PAPERS, *(f"{100 * v:.2f}" for v in PAPER[paper])))
    return Table("", (group, *COLUMNS), lines)


def _film_table(results: Results) -> Table:
    chosen = {row: films for row, films in results.items() if row.group == "section 3"}
    lines = [(row.name, *(f"{100 * f.to_position.mean:.2f}" for f in films.values())) for row, films in chosen.items()]
    numbers = next(iter(results.values()))
    return Table("", ("mean distance to the position in film", *map(str, numbers)), lines)


def _plots(results: Results, frames: int, seed: int) -> dict[str, Figure]:
    groups = {row.group for row in results}
    plots: dict[str, Figure] = {}
    if "section 3" in groups:
        scene = plan_sphere(CarriedBallSettings(frames=frames), seed)
        frame = min(PAPER_FRAME, frames) - 1
        images, _ = next(islice(scene.frames(), frame, None))
        plots["pictures"] = pictures_figure(images, scene.backgrounds(), frame + 1)
        plots["paths"] = paths_figure(results, scene.truth, seed)
    if groups.issuperset(VARIED):
        plots["errors"] = errors_figure(results)
    return plots
