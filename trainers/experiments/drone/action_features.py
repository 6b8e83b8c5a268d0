"""The experiments of thesis chapter 5 on generated clips (`reproduce drone-action-features`).

Clips and what the networks say of them are kept, so that a run that was interrupted goes on from there, and one with
other costs takes a minute.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.tables import action_values
from tsuiseki.tracking.features.action import STREAMS
from tsuiseki.tracking.weights import shipped, shipped_or_file
from tsuiseki.trainers.experiments.drone.bridging_rows import bridging_rows
from tsuiseki.trainers.experiments.drone.camera_errors import flight_errors
from tsuiseki.trainers.experiments.drone.clips import (
    FAULTS,
    FIRST_SEED,
    SECOND_SCENE,
    SECOND_SEED,
    SEEN,
    TEST_SCENE,
    Clip,
    ClipPlan,
    Networks,
    observations_in,
    prepare_clips,
)
from tsuiseki.trainers.experiments.drone.pictures import draw_pictures, draw_second
from tsuiseki.trainers.experiments.drone.plots import plot_gains, plot_iterations
from tsuiseki.trainers.experiments.drone.rows import (
    METHODS,
    MOST_ITERATIONS,
    action_scores,
    by_iteration,
    difference,
    mean_rows,
    people_row,
    people_scores,
    recognition,
    track_all,
    with_labelled_actions,
)
from tsuiseki.trainers.experiments.drone.tables import tables
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, at_least_one

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
    clips: int = 2
    frames: int = 300


def reproduce(
    bench: Bench,
    seeds: int = 3,
    clips: int = 2,
    frames: int = 300,
    full: bool = False,
    actions: list[Path] | None = None,
    appearance: Path | None = None,
    detector: Path | None = None,
    simulated_detections: bool = False,
) -> Outcome:
    """Thesis chapter 5 on generated clips from a violently moving drone: Tables 5.3, 5.4 and 5.5, Figs. 5.8 and 5.11.

    DIR gets results.json, tables.md, iterations.png, action_gain.png and pictures of switches like Figs. 5.7, 5.9 and
    5.10: prevented.jpg, remaining.jpg, second.jpg.

    Args:
        bench: where it works; clips and what the networks say of them are kept.
        seeds: sets of test clips.
        clips: of each set.
        frames: of each clip.
        full: 5 sets of 10 clips of 600 frames, whatever the three options above say.
        actions: exported action streams, separated by commas; by default the shipped ones.
        appearance: exported appearance network; by default the shipped one.
        detector: exported detector, or the name of a shipped one; by default drone, with which the settings of the
            methods that are compared were chosen.
        simulated_detections: draw faulty detections from the labels instead.

    Raises:
        RequestError: a number below 1, a clip that something was learnt from, or a model that is not there.
    """
    at_least_one(seeds=seeds, clips=clips, frames=frames)
    plan = Plan(5, 10, 600) if full else Plan(seeds, clips, frames)
    check_unseen(plan)
    networks = Networks(
        tuple(actions or [shipped(f"action_drone_{name}") for name in STREAMS]),
        appearance or shipped("appearance_people"),
        None if simulated_detections else _detector_file(detector),
    )
    return run_plan(bench, plan, networks)


def _detector_file(given: Path | None) -> Path:
    return shipped("detector_drone") if given is None else shipped_or_file("detector", given)


def run_plan(bench: Bench, plan: Plan, networks: Networks) -> Outcome:
    """All tables, figures and pictures.

    Args:
        bench: where it works.
        plan: how much.
        networks: exported models.
    """
    say = bench.watch.say
    # All clips in one go, so that every core has one to draw until the end.
    clips = prepare_clips(bench.store, [*_test_plans(plan), *_second_plans(plan)], networks, say)
    every, carried = clips[: plan.seeds * plan.clips], clips[plan.seeds * plan.clips :]
    sets = _in_sets(every, plan)
    say("tracking")
    people = {"taken out": _people(sets, compensate=True), "left in": _people(sets, compensate=False)}
    oracle = [with_labelled_actions(clip, np.random.default_rng(n)) for n, clip in enumerate(every)]
    people["taken out, actions as labelled"] = _people(_in_sets(oracle, plan), compensate=True)
    iterations = {}
    for method in METHODS:
        if method.startswith("flow-maf"):
            say(f"iterations of {method}")
            iterations[str(method)] = by_iteration(every, method, compensate=True)
    curves = {m: [people_row(people_scores(every, found)) for found in results] for m, results in iterations.items()}
    say("recognising actions")
    recognised = recognition(every)
    gains = _gains(every, iterations["flow-maf"])
    say("showing switches")
    flow = track_all(every, "flow", compensate=True)
    repeated = by_iteration(carried, "flow-maf, one-sided", compensate=True, count=2)
    drawn = draw_pictures(every, flow, iterations["flow-maf, one-sided"]) | draw_second(carried, repeated)
    values: dict[str, Any] = {
        "plan": asdict(plan),
        "conditions": _conditions(people["taken out"], plan),
        "people": people,
        "iterations": curves,
        "second": _people([carried], compensate=True),
        "camera": {
            name: asdict(bench.store.recall(flight_errors, scene, seed, [one.motion for one in clip.seen]))
            for (name, scene, seed), clip in zip([*_test_plans(plan), *_second_plans(plan)], clips, strict=True)
        },
        "bridging": bridging_rows(sets, observations_in(bench.store), networks, say),
        "actions": action_values(recognised),
        "action_gain": gains,
        "pictures": {name: picture.shows for name, picture in drawn.items()},
        "faults": None if networks.detector else asdict(FAULTS),
    }
    return Outcome(
        values,
        tables(values),
        {"iterations": plot_iterations(curves), "action_gain": plot_gains(gains)},
        {f"{name}.jpg": picture.jpeg for name, picture in drawn.items()},
        [_said_of_conditions(values["conditions"])],
    )


def _in_sets(clips: Sequence[Clip], plan: Plan) -> list[Sequence[Clip]]:
    return [clips[first : first + plan.clips] for first in range(0, len(clips), plan.clips)]


def check_unseen(plan: Plan) -> None:
    """Refuse to score a clip that networks learnt from, that chose settings or that costs come from.

    Raises:
        RequestError: there is one.
    """
    if seen := sorted({seed for _, _, seed in [*_test_plans(plan), *_second_plans(plan)]} & SEEN):
        raise RequestError(f"expected clips that nothing was learnt from, got seed {seen[0]}; give fewer `seeds`")


def _test_plans(plan: Plan) -> list[ClipPlan]:
    """The clips of Table 5.3, set by set."""
    scene = replace(TEST_SCENE, frames=plan.frames)
    seeds = [FIRST_SEED + 100 * number + k for number in range(plan.seeds) for k in range(plan.clips)]
    return [(f"test-{seed}-{plan.frames}", scene, seed) for seed in seeds]


def _second_plans(plan: Plan) -> list[ClipPlan]:
    """The clips of Table 5.4, to which everything learnt is carried over."""
    scene = replace(SECOND_SCENE, frames=min(SECOND_SCENE.frames, plan.frames))
    return [(f"second-{seed}-{scene.frames}", scene, seed) for seed in range(SECOND_SEED, SECOND_SEED + plan.clips)]


def _people(sets: Sequence[Sequence[Clip]], *, compensate: bool) -> dict[str, dict[str, Any]]:
    """Table 5.3: a row a method, means over the sets, and differences to the flow with intervals over the clips."""
    every = [clip for clips in sets for clip in clips]
    flow = track_all(every, "flow", compensate=compensate)
    rows: dict[str, dict[str, Any]] = {}
    for method in METHODS:
        found = flow if method == "flow" else track_all(every, method, compensate=compensate)
        first, parts = 0, []
        for clips in sets:
            parts.append(people_row(people_scores(clips, found[first : first + len(clips)])))
            first += len(clips)
        against = {name: asdict(interval) for name, interval in difference(every, found, flow).items()}
        by_seed = [row["id_switches"] for row in parts]
        rows[method] = {**mean_rows(parts), "by_seed": by_seed, "against_flow": against}
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


def _said_of_conditions(held: Mapping[str, Any]) -> str:
    return (
        f"flow alone: {held['switches_of_flow_in_100_frames']:.1f} switches in 100 frames at a recall of "
        f"{held['recall_of_flow']:.1f} %; the conditions {'hold' if held['hold'] else 'do not hold'}"
    )
