"""`tsuiseki reproduce drone-action-features`."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tsuiseki.tracking.cli.extra import needs_train_extra


def action_features(
    out: Path = Path("out/drone-action-features"),
    work: Path = Path("out/cache/drone-experiment"),
    seeds: int = 3,
    clips: int = 6,
    frames: int = 300,
    full: bool = False,
    affinity: Path | None = None,
    actions: list[Path] | None = None,
    appearance: Path | None = None,
    detector: Path | None = None,
    simulated_detections: bool = False,
    keep_camera_motion: bool = False,
    overwrite: bool = False,
) -> None:
    """Thesis chapter 5 on generated clips from a violently moving drone: Tables 5.3, 5.4 and 5.5, Figs. 5.8 and 5.11.

    Clips and what the networks say of them stay in --work: what was interrupted goes on from there. DIR gets
    results.json, iterations.png, action_gain.png and pictures of switches like Figs. 5.7, 5.9 and 5.10: prevented.jpg,
    remaining.jpg, second.jpg.

    Args:
        out: folder for the results.
        work: folder that keeps clips and observations.
        seeds: sets of test clips.
        clips: of each set.
        frames: of each clip.
        full: 5 sets of 10 clips of 600 frames, whatever the three options above say.
        affinity: folder with the costs that tsuiseki train affinity-drone wrote; by default the shipped ones.
        actions: exported action streams, separated by commas; by default the shipped ones.
        appearance: exported appearance network; by default the shipped one.
        detector: exported detector; by default the shipped one.
        simulated_detections: draw faulty detections from the labels instead.
        keep_camera_motion: compare places as they are in the pictures; costs should be learnt likewise.
        overwrite: replace an earlier result.
    """
    with needs_train_extra():
        from tsuiseki.trainers.experiments.drone.clips import Networks
        from tsuiseki.trainers.experiments.drone.experiment import Plan, reproduce_drone
        from tsuiseki.trainers.experiments.drone.rows import Costs
    from tsuiseki.tracking.cli.models import shipped
    from tsuiseki.tracking.cli.reproduce_phd import at_least_one, finish
    from tsuiseki.tracking.features.action_inputs import STREAMS
    from tsuiseki.tracking.output import output_folder

    at_least_one(seeds=seeds, clips=clips, frames=frames)
    plan = Plan(5, 10, 600) if full else Plan(seeds, clips, frames)
    networks = Networks(
        tuple(actions or [shipped(f"action_{name}") for name in STREAMS]),
        appearance or shipped("appearance"),
        None if simulated_detections else detector or shipped("detector_drone"),
    )
    costs = Costs.read(affinity or shipped("affinity_drone").parent)
    with output_folder(out, overwrite) as folder:
        values = reproduce_drone(folder, work, plan, networks, costs, _say, compensate=not keep_camera_motion)
        settings: dict[str, Any] = {"seeds": plan.seeds, "clips": plan.clips, "frames": plan.frames}
        finish(folder, values, "drone-action-features", settings)
    _show(values, compensate=not keep_camera_motion)
    print(f"plots, pictures and results.json: {out}")


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _show(values: Mapping[str, Any], *, compensate: bool) -> None:
    from tsuiseki.tracking.cli.reproduce_phd import show_rows
    from tsuiseki.trainers.experiments.drone.experiment import PAPER_ACTIONS, PAPER_PEOPLE, PAPER_SECOND

    columns = ("method", "Rcll", "Prcn", "IDs", "MOTA", "MOTP", "100(1-IoU)", "IDF1", "HOTA")
    heading = (*columns, "paper: Rcll Prcn IDs MOTA MOTP")
    print("Table 5.3")
    show_rows(heading, [_person_row(name, row, PAPER_PEOPLE) for name, row in values["people"].items()])
    held = values["conditions"]
    print(
        f"flow alone: {held['switches_of_flow_in_100_frames']:.1f} switches in 100 frames at a recall of "
        f"{held['recall_of_flow']:.1f} %; the conditions {'hold' if held['hold'] else 'do not hold'}"
    )
    print("Table 5.4, everything learnt carried over to other clips")
    show_rows(heading, [_person_row(name, row, PAPER_SECOND) for name, row in values["second"].items()])
    print(f"Ablation, costs of places with the camera's motion {'taken out' if compensate else 'left in'} in all rows")
    show_rows(("", "motion taken out", "bridging", *columns[1:]), [_ablation_row(row) for row in values["ablation"]])
    print("Table 5.5, F1 at 0.4 of every action, tracks given; percent")
    actions = values["actions"]
    first = next(iter(actions.values()))
    rows = [[name, *(_percent(actions[kind]["actions"][name]["f1"]) for kind in actions)] for name in first["actions"]]
    rows.append(["average", *(_percent(actions[kind]["mean_f1"]) for kind in actions)])
    rows.append(["mAP", *(_percent(actions[kind]["mean_average_precision"]) for kind in actions)])
    rows.append(["average in the paper", *(f"{PAPER_ACTIONS[kind]:.2f}" for kind in actions)])
    show_rows(["", *actions], rows)


def _person_row(name: str, row: Mapping[str, float], paper: Mapping[Any, Sequence[float]]) -> list[str]:
    cells = [f"{row[k]:.2f}" for k in ("recall", "precision", "mota", "motp", "motp_as_printed", "idf1", "hota")]
    switches = f"{row['id_switches']:.0f}"
    printed = " ".join(f"{value:g}" for value in paper[name]) if name in paper else ""
    return [name, *cells[:2], switches, *cells[2:], printed]


def _ablation_row(row: Mapping[str, Any]) -> list[str]:
    chosen = ["yes" if row[name] else "no" for name in ("camera_motion", "bridging")]
    return [row["method"], *chosen, *_person_row(row["method"], row, {})[1:-1]]


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.2f}"
