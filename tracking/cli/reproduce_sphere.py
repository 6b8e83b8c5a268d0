"""`tsuiseki reproduce`: the sphere paper's experiment, and the drone's."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tsuiseki.tracking.errors import RequestError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tsuiseki.trainers.experiments.sphere.multiview_drone import DroneScores, Trial
    from tsuiseki.trainers.experiments.sphere.stereo_sphere import Configuration, Outcome

# The paper's rows stand below the two configurations that are its own.
PAPER_BELOW = 1
TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20)
HEADINGS = ("to position: mean", "max", "sd", "to path: mean", "max", "sd")


def stereo_sphere(
    out: Path = Path("out/stereo-sphere"),
    seeds: int = 3,
    frames: int = 100,
    only: bool = False,
    kept: Path = Path("out/cache/stereo-sphere"),
    seed: int = 0,
    overwrite: bool = False,
) -> None:
    """Section 3 of the sphere paper: a ball moved by hand, by background difference and by outline, paper beside here.

    Args:
        out: folder for results.json, table.md and errors.png.
        seeds: number of films, each with its own room, person, ball and noise.
        frames: of each film.
        only: leave out the error against particles, cameras and covered frames, which needs six cameras.
        kept: folder where the scores of finished films are kept, so that a run can be stopped and taken up again;
            delete it when the code has changed.
        seed: of the first film; the others follow.
        overwrite: replace what is in the folder.
    """
    from tsuiseki.datamodules.scenes.ball.carried import BallSettings
    from tsuiseki.tracking.cli.progress import progress
    from tsuiseki.tracking.output import RunRecord, check_output_folder, output_folder
    from tsuiseki.trainers.experiments.sphere.stereo_sphere import configurations, kept_film

    if seeds < 1 or frames < 2:
        raise RequestError(f"expected at least 1 seed and 2 frames, got {seeds} and {frames}")
    check_output_folder(out, overwrite)
    rows = [row for row in configurations() if row.group == "section 3" or not only]
    settings = BallSettings(cameras=max(row.cameras for row in rows), frames=frames)
    outcomes = {}
    for number in range(seed, seed + seeds):
        name = f"film {number - seed + 1} of {seeds}"
        outcomes[number] = kept_film(kept, number, settings, rows, partial(progress, what=name, total=frames))
    with output_folder(out, overwrite) as work:
        table = _sphere_markdown(rows, outcomes)
        (work / "table.md").write_text(table, encoding="utf-8")
        (work / "results.json").write_text(json.dumps(_values(rows, outcomes), indent=1) + "\n", encoding="utf-8")
        if not only:
            _sphere_figure(rows, outcomes).savefig(work / "errors.png", dpi=110, facecolor="white")
        given = {"seeds": seeds, "frames": frames, "film": dataclasses.asdict(settings)}
        RunRecord(("tsuiseki", "reproduce", "stereo-sphere"), given, seed).write(work)
    print(table)


def multiview_drone(
    out: Path = Path("out/multiview-drone"),
    data: Path = Path("../shared/data/stereo/multiview-drone-3"),
    kept: Path = Path("out/cache/multiview-drone"),
    seed: int = 0,
    overwrite: bool = False,
) -> None:
    """The 3D filter on measured pixels of a flying drone (six cameras, RTK), beside triangulation frame by frame.

    Args:
        out: folder for results.json and table.md.
        data: folder of the data set multiview-drone-3, with the folder calibration beside it.
        kept: folder where each finished number of cameras is kept, so that a run can be stopped and taken up again;
            delete it when the code or the data have changed.
        seed: of all random numbers.
        overwrite: replace what is in the folder.
    """
    import numpy as np

    from tsuiseki.datamodules.readers.multiview_drone import read_drone_flight
    from tsuiseki.tracking.cli.progress import progress
    from tsuiseki.tracking.output import RunRecord, check_output_folder, output_folder
    from tsuiseki.trainers.experiments.sphere import multiview_drone as experiment

    check_output_folder(out, overwrite)
    flight = read_drone_flight(data)
    cameras = experiment.calibrate_flight(flight, lambda views: progress(views, "calibrating", len(flight.views)))
    scores, trials = [], {}
    for count in experiment.CAMERA_COUNTS:
        watch = partial(progress, what=f"{count} cameras, choosing on the first half")
        found, trials[count] = experiment.kept_comparison(kept, flight, cameras[:count], seed, watch)
        scores.append(found)
    settings = {count: experiment.chosen(tried).settings for count, tried in trials.items()}
    lines = [_drone_markdown(scores), ""]
    lines += ["| camera | fitted pixels, median error | time of frame 0, s | frames/s |", "|---|---|---|---|"]
    lines += [
        f"| {k} | {np.median(c.residuals):.2f} px | {c.offset:.3f} | {1 / c.period:.3f} |"
        for k, c in enumerate(cameras)
    ]
    lines += ["", *_choice_markdown(trials)]
    survey = data / "camera-locations" / "campos.txt"
    if survey.is_file():
        # The file lists the cameras in another order than the rest of the data set.
        away = experiment.surveyed_errors(cameras, np.loadtxt(survey)[[0, 4, 2, 1, 3, 5]])
        lines += [
            "",
            f"Distance to the surveyed camera positions (a check only): {', '.join(f'{v:.2f}' for v in away)} m",
        ]
    table = "\n".join(lines)
    with output_folder(out, overwrite) as work:
        (work / "table.md").write_text(table + "\n", encoding="utf-8")
        tried = {str(count): [dataclasses.asdict(t) for t in s] for count, s in trials.items()}
        content = {"scores": [dataclasses.asdict(s) for s in scores], "trials": tried}
        (work / "results.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        given = {"data": str(data), "settings": {str(c): dataclasses.asdict(s) for c, s in settings.items()}}
        RunRecord(("tsuiseki", "reproduce", "multiview-drone"), given, seed).write(work)
    print(table)


def _sphere_markdown(rows: Sequence[Configuration], outcomes: Mapping[int, Sequence[Outcome]]) -> str:
    from tsuiseki.trainers.experiments.sphere.stereo_sphere import PAPER, over_seeds

    lines = [f"Errors in cm over {len(outcomes)} films: mean over films of mean and sd, greatest max."]
    group = ""
    for number, row in enumerate(rows):
        if row.group != group:
            group = row.group
            lines += ["", f"| {group} | {' | '.join(HEADINGS)} |", "|---" * 7 + "|"]
        values = [100 * v for s in over_seeds(outcomes, number) for v in (s.mean, s.maximum, s.deviation)]
        lines.append(f"| {row.name} | {' | '.join(f'{v:.2f}' for v in values)} |")
        if number == PAPER_BELOW:
            for name, paper in PAPER.items():
                lines.append(f"| {name}, the paper | | | | {' | '.join(f'{100 * v:.2f}' for v in paper)} |")
    lines += ["", f"| mean distance to the position in film | {' | '.join(map(str, outcomes))} |"]
    lines.append("|---" * (len(outcomes) + 1) + "|")
    for number, row in enumerate(rows):
        if row.group == "section 3":
            means = " | ".join(f"{100 * found[number].to_position.mean:.2f}" for found in outcomes.values())
            lines.append(f"| {row.name} | {means} |")
    return "\n".join(lines)


def _values(rows: Sequence[Configuration], outcomes: Mapping[int, Sequence[Outcome]]) -> list[dict[str, Any]]:
    return [
        {
            "group": row.group,
            "name": row.name,
            "films": {str(seed): dataclasses.asdict(found[number]) for seed, found in outcomes.items()},
        }
        for number, row in enumerate(rows)
    ]


def _sphere_figure(rows: Sequence[Configuration], outcomes: Mapping[int, Sequence[Outcome]]) -> Figure:
    from matplotlib.figure import Figure

    from tsuiseki.tracking.evaluation.plots import COLOURS
    from tsuiseki.trainers.experiments.sphere.stereo_sphere import over_seeds

    figure = Figure(figsize=(11, 3.4), layout="constrained")
    panels = (("particles", "particles"), ("cameras", "cameras"), ("covered", "covered"))
    for axes, (group, label) in zip(figure.subplots(1, 3, sharey=True), panels, strict=True):
        series: dict[str, list[tuple[float, float]]] = {}
        for number, row in enumerate(rows):
            if row.group != group:
                continue
            name = row.name.partition(", ")[2] if group == "covered" else "contour"
            x = {"particles": row.particles, "cameras": row.cameras, "covered": row.covered}[group]
            series.setdefault(name, []).append((x, 100 * over_seeds(outcomes, number)[0].mean))
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


def _choice_markdown(trials: Mapping[int, Sequence[Trial]]) -> list[str]:
    from tsuiseki.trainers.experiments.sphere.multiview_drone import chosen

    lines = [
        "| cameras | chosen on the first half: agitation, m/s | inflation | lag, s | median there, m: filter "
        "| triangulation | rms acceleration there, m/s²: filter | triangulation "
        "| the evidence's choice: agitation | inflation |",
        "|---" * 10 + "|",
    ]
    for count, tried in trials.items():
        best = chosen(tried)
        likely = max(tried, key=lambda t: t.log_evidence).settings
        s, f = best.settings, best.scores
        lines.append(
            f"| {count} | {s.agitation:g} | {s.inflation:g} | {s.lag:g} | {f.filter_median:.4f} "
            f"| {f.triangulation_median:.4f} | {f.filter_acceleration:.1f} | {f.triangulation_acceleration:.1f} "
            f"| {likely.agitation:g} | {likely.inflation:g} |"
        )
    return lines


def _drone_markdown(scores: Sequence[DroneScores]) -> str:
    lines = [
        "| cameras | moments | median, m: filter | triangulation | 95 %, m: filter | triangulation "
        "| rms acceleration, m/s²: filter | triangulation | one camera only: moments | median, m | 95 %, m |",
        "|---" * 11 + "|",
    ]
    lines += [
        f"| {s.cameras} | {s.moments} | {s.filter_median:.4f} | {s.triangulation_median:.4f} | {s.filter_tail:.3f} "
        f"| {s.triangulation_tail:.3f} | {s.filter_acceleration:.1f} | {s.triangulation_acceleration:.1f} "
        f"| {s.alone} | {s.alone_median:.2f} | {s.alone_tail:.2f} |"
        for s in scores
    ]
    return "\n".join(lines)
