"""Seconds and memory of the flow with hand-set costs: building the network, solving it, and the whole tracker.

    python benchmarks/flow.py [--frames 1000] [--people 10] [--window 30] [--repeat 5] [--features]

``build`` finds and prices the candidate pairs and makes the network, ``solve`` is our call, and ``bare`` is what
OR-tools itself takes on the same arrays. With ``--features`` the detections carry 128 appearance features, whose
distances are then part of ``build``. Steps take turns, and the best turn of each counts. Use one thread:
``OMP_NUM_THREADS=1``.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np
from ortools.graph.python import min_cost_flow
from walkers import machine, peak_memory, walking_people

from tsuiseki.tracking.association.costs import HandSetCost, ObservationCost, priced_pairs
from tsuiseki.tracking.association.network_flow import FlowGraph, add_arcs, build_graph, solve
from tsuiseki.tracking.trackers.flow import FlowSettings, FlowTracker
from tsuiseki.tracking.trackers.people import track_people
from tsuiseki.tracking.types import Detections

Result = TypeVar("Result")


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--people", type=int, default=10)
    parser.add_argument("--window", type=int, default=FlowSettings().gate.window)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--features", action="store_true")
    arguments = parser.parse_args()
    video = walking_people(arguments.frames, arguments.people, feature_length=128 if arguments.features else 0)
    settings = FlowSettings(gate=replace(FlowSettings().gate, window=arguments.window))
    best = dict.fromkeys(("build", "solve", "bare", "whole tracker"), float("inf"))
    for _ in range(arguments.repeat):
        graph = _timed(best, "build", lambda: _build(video, settings))
        _timed(best, "solve", lambda graph=graph: solve(graph))
        best["bare"] = min(best["bare"], _bare_solve(graph))
    memory = peak_memory()
    tracks = _timed(best, "whole tracker", lambda: track_people(video, FlowTracker(settings)))
    print(machine("numpy", "scipy", "ortools"))
    print(f"{len(video)} frames, {len(graph)} detections, {len(graph.tail)} transitions, {len(tracks)} tracks")
    for name, seconds in best.items():
        print(f"{name:16s}{seconds:9.3f} s{seconds / best['bare']:9.2f} times bare")
    ratio = (best["build"] + best["solve"]) / best["bare"]
    print(f"build + solve   {best['build'] + best['solve']:9.3f} s{ratio:9.2f} times bare")
    print(f"peak memory     {memory:9.2f} GB after build and solve, {peak_memory():.2f} GB after the whole tracker")


def _timed(best: dict[str, float], name: str, step: Callable[[], Result]) -> Result:
    start = time.perf_counter()
    result = step()
    best[name] = min(best[name], time.perf_counter() - start)
    return result


def _build(video: list[Detections], settings: FlowSettings) -> FlowGraph:
    """The network from the detections of all frames."""
    frames = np.repeat(np.arange(len(video)), [len(found) for found in video])
    boxes = np.concatenate([found.boxes for found in video])
    described = [found.features for found in video if found.features is not None]
    features = np.concatenate(described) if described else None
    observation = ObservationCost()(np.concatenate([found.scores for found in video]))
    pairs = priced_pairs(frames, boxes, features, settings.gate, HandSetCost(), settings.miss)
    return build_graph(observation, pairs, settings.entry, settings.exit)


def _bare_solve(graph: FlowGraph) -> float:
    """Seconds of OR-tools alone, once the arcs are in."""
    solver = min_cost_flow.SimpleMinCostFlow()
    add_arcs(solver, graph)
    start = time.perf_counter()
    solver.solve()
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
