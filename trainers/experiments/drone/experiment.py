"""`tsuiseki reproduce drone-action-features`: the experiments of thesis chapter 5 on generated clips.

Clips and what the networks say of them stay in a folder of their own, so that a run that was interrupted goes on from
there, and one with other costs takes a minute.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.evaluation.action_table import action_values
from tsuiseki.trainers.experiments.drone.ablation import ablation
from tsuiseki.trainers.experiments.drone.clips import (
    FAULTS,
    FIRST_SEED,
    SECOND_SCENE,
    SECOND_SEED,
    TEST_SCENE,
    Clip,
    ClipPlan,
    Networks,
    prepare_clips,
)
from tsuiseki.trainers.experiments.drone.pictures import draw_pictures, draw_second
from tsuiseki.trainers.experiments.drone.plots import plot_gains, plot_iterations
from tsuiseki.trainers.experiments.drone.rows import (
    METHODS,
    MOST_ITERATIONS,
    Costs,
    Method,
    action_scores,
    by_iteration,
    mean_rows,
    people_row,
    people_scores,
    recognition,
    track_all,
)

# Thesis Table 5.3: recall, precision, IDs, MOTA, MOTP; the names are those of the table's rows.
PAPER_PEOPLE: dict[Method, tuple[float, float, int, float, float]] = {
    "deepsort": (29.10, 70.81, 584, 17.29, 32.85),
    "flow": (32.42, 73.93, 597, 21.43, 32.99),
    "flow-saf": (32.13, 74.10, 558, 21.20, 33.01),
    "flow-maf": (32.48, 74.24, 528, 21.57, 33.01),
}
# Table 5.4, the second data set.
PAPER_SECOND: dict[Method, tuple[float, float, int, float, float]] = {
    "flow-saf": (89.68, 83.23, 47, 41.29, 33.98),
    "flow-maf": (89.68, 83.23, 43, 43.87, 33.98),
}
# Table 5.5, averages.
PAPER_ACTIONS = {
    "Single frame (local)": 42.88,
    "Single frame (local+global)": 45.94,
    "Multi frames (local)": 45.09,
    "Multi frames (local+global)": 47.80,
}
LEAST_SWITCHES, RECALL = 2.0, (30.0, 90.0)


@dataclass(frozen=True)
class Plan:
    """How much is run.

    Attributes:
        seeds: sets of test clips.
        clips: of a set.
        frames: of each clip.
    """

    seeds: int = 3
    clips: int = 6
    frames: int = 300


def reproduce_drone(
    out: Path,
    work: Path,
    plan: Plan,
    networks: Networks,
    costs: Costs,
    say: Callable[[str], None],
    *,
    compensate: bool,
) -> dict[str, Any]:
    """Run everything; returns the values of all tables and figures, and draws plots and pictures into ``out``.

    Args:
        out: folder for plots and pictures.
        work: folder that keeps clips and observations.
        plan: how much.
        networks: exported models.
        costs: learnt.
        say: gets a line of progress.
        compensate: take the camera's motion out of the places.
    """
    # All clips in one go, so that every core has one to draw until the end.
    clips = prepare_clips(work, [*_test_plans(plan), *_second_plans(plan)], networks, say)
    sets = [clips[first : first + plan.clips] for first in range(0, plan.seeds * plan.clips, plan.clips)]
    carried = clips[plan.seeds * plan.clips :]
    say("tracking")
    people = _people(sets, costs, compensate=compensate)
    every = [clip for clips in sets for clip in clips]
    iterations = {}
    for method in METHODS:
        if method.startswith("flow-maf"):
            say(f"iterations of {method}")
            iterations[str(method)] = by_iteration(every, method, costs, compensate=compensate)
    curves = {m: [people_row(people_scores(every, found)) for found in results] for m, results in iterations.items()}
    say("recognising actions")
    actions = recognition(every)
    gains = _gains(every, iterations["flow-maf"])
    second = {
        str(method): people_row(people_scores(carried, track_all(carried, method, costs, compensate=compensate)))
        for method in METHODS
    }
    plot_iterations(curves, out / "iterations.png")
    plot_gains(gains, out / "action_gain.png")
    say("showing switches")
    flow = track_all(every, "flow", costs, compensate=compensate)
    repeated = by_iteration(carried, "flow-maf, one-sided", costs, compensate=compensate, count=2)
    pictures = draw_pictures(every, flow, iterations["flow-maf, one-sided"], out) | draw_second(carried, repeated, out)
    return {
        "plan": asdict(plan),
        "conditions": _conditions(people, plan),
        "people": people,
        "iterations": curves,
        "second": second,
        "ablation": ablation(sets, work / "observations", networks, costs, say),
        "actions": action_values(actions),
        "action_gain": gains,
        "pictures": pictures,
        "faults": None if networks.detector else asdict(FAULTS),
    }


def _test_plans(plan: Plan) -> list[ClipPlan]:
    """The clips of Table 5.3, set by set."""
    scene = replace(TEST_SCENE, frames=plan.frames)
    seeds = [FIRST_SEED + 100 * number + k for number in range(plan.seeds) for k in range(plan.clips)]
    return [(f"test-{seed}-{plan.frames}", scene, seed) for seed in seeds]


def _second_plans(plan: Plan) -> list[ClipPlan]:
    """The clips of Table 5.4, to which everything learnt is carried over."""
    scene = replace(SECOND_SCENE, frames=min(SECOND_SCENE.frames, plan.frames))
    return [(f"second-{seed}-{scene.frames}", scene, seed) for seed in range(SECOND_SEED, SECOND_SEED + plan.clips)]


def _people(sets: Sequence[Sequence[Clip]], costs: Costs, *, compensate: bool) -> dict[str, dict[str, Any]]:
    """Table 5.3: a row a method, means over the seeds."""
    rows: dict[str, dict[str, Any]] = {}
    for method in METHODS:
        found = [
            people_row(people_scores(clips, track_all(clips, method, costs, compensate=compensate))) for clips in sets
        ]
        rows[method] = {**mean_rows(found), "by_seed": [row["id_switches"] for row in found]}
    return rows


def _gains(clips: Sequence[Clip], results: Sequence[Any]) -> dict[str, float | None]:
    """Fig. 5.11: change of the average precision of each action from iteration 1 to 10, end to end, in points."""
    first, last = (action_scores(clips, results[k], "multi") for k in (0, MOST_ITERATIONS - 1))
    change = 100 * (last.average_precision - first.average_precision)
    return {n: None if np.isnan(c) else float(c) for n, c in zip(first.names, change.tolist(), strict=True)}


def _conditions(people: Mapping[str, Mapping[str, Any]], plan: Plan) -> dict[str, Any]:
    """What was to hold of the clips before anything is compared."""
    frames = plan.seeds * plan.clips * plan.frames
    switches = 100 * people["flow"]["id_switches"] / frames
    recall = people["flow"]["recall"]
    return {
        "switches_of_flow_in_100_frames": switches,
        "recall_of_flow": recall,
        "hold": bool(switches >= LEAST_SWITCHES and RECALL[0] <= recall <= RECALL[1]),
    }
