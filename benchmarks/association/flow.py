"""Seconds and memory of the flow: preparing detections, computing link costs, solving, and the whole tracker.

    python -m benchmarks.association.flow [--frames 1000] [--people 10] [--repeat 5] [--features]
        [--decide_every 20] [--delay 1]

``build`` makes the links, their costs and the first network, ``solve`` is our call, and ``bare`` is what the peer,
OR-tools' cost-scaling push-relabel (`pip install ortools`), takes for the same network once it has it. With
``--features`` the detections carry 128 appearance features. With ``--delay`` the tracker that answers so many seconds
after each frame is timed, too, up to frame 400, half way and to the end, its answers forgotten as they come. Steps
take turns, and the best turn of each counts, in seconds of the processor. Use one thread: ``OMP_NUM_THREADS=1``.
"""

from __future__ import annotations

import argparse
import pickle
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np
from ortools.graph.python import min_cost_flow

from benchmarks.machine import machine, peak_memory
from benchmarks.walkers import walking_people
from tsuiseki.tracking.association.detection_tables import DetectionTable
from tsuiseki.tracking.association.flow_window import FlowWindow
from tsuiseki.tracking.association.inference_times import InferenceTimes
from tsuiseki.tracking.association.network_flow import FlowGraph, scaled
from tsuiseki.tracking.association.sliding_flow import solve_in_windows
from tsuiseki.tracking.people.contract import run_tracker
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.flow_input import FlowInput, FlowSettings
from tsuiseki.tracking.types import Detections, FloatArray

Result = TypeVar("Result")
FRAME_RATE = 30.0


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--people", type=int, default=10)
    parser.add_argument("--decide_every", type=float, default=FlowSettings().decide_every)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--features", action="store_true")
    parser.add_argument("--delay", type=float)
    arguments = parser.parse_args()
    video = walking_people(arguments.frames, arguments.people, feature_length=128 if arguments.features else 0)
    settings = replace(FlowSettings(), decide_every=arguments.decide_every)
    best = dict.fromkeys(("prepare", "build", "solve", "bare", "whole tracker"), float("inf"))
    for _ in range(arguments.repeat):
        given = FlowInput(settings.input, InferenceTimes(FRAME_RATE), None)
        table, scores, _ = _timed(best, "prepare", partial(given.rows, video))
        observation = given.costs(scores)
        graph = _timed(best, "build", partial(_build, table, observation, settings))
        _timed(best, "solve", partial(solve_in_windows, graph))
        best["bare"] = min(best["bare"], _bare_solve(graph))
    memory = peak_memory()
    tracks = _timed(best, "whole tracker", lambda: run_tracker(video, FlowTracker(settings, frame_rate=FRAME_RATE)))
    delay = arguments.delay
    late = {} if delay is None else _followed(video, FlowTracker(frame_rate=FRAME_RATE, delay=delay))
    print(machine("numpy", "scipy", "ortools"))
    print(f"{len(video)} frames, {len(graph)} detections, {len(graph.tail)} transitions, {len(tracks)} tracks")
    for name, seconds in best.items():
        print(f"{name:16s}{seconds:9.3f} s{seconds / best['bare']:9.2f} times bare")
    ratio = (best["build"] + best["solve"]) / best["bare"]
    print(f"build + solve   {best['build'] + best['solve']:9.3f} s{ratio:9.2f} times bare")
    print(f"peak memory     {memory:9.2f} GB after build and solve, {peak_memory():.2f} GB after the whole tracker")
    for number, (time_a_frame, size) in late.items():
        print(f"delay {delay:g} s, to frame {number}: {time_a_frame:.1f} ms a frame, state {size / 1e6:.2f} MB")


def _followed(video: list[Detections], tracker: FlowTracker) -> dict[int, tuple[float, int]]:
    """Milliseconds a frame since the mark before, and bytes of the tracker's state, at 400, half way and at the end."""
    found, last = dict[int, tuple[float, int]](), 0
    start = time.process_time()
    for number, detections in enumerate(video, start=1):
        tracker.update(detections)
        tracker.forget()
        if number in (400, len(video) // 2, len(video)):
            now = time.process_time()
            found[number] = (1000 * (now - start) / (number - last), len(pickle.dumps(tracker)))
            start, last = time.process_time(), number
    return found


def _timed(best: dict[str, float], name: str, step: Callable[[], Result]) -> Result:
    start = time.process_time()
    result = step()
    best[name] = min(best[name], time.process_time() - start)
    return result


def _build(table: DetectionTable, observation: FloatArray, settings: FlowSettings) -> FlowGraph:
    """The network of the first round."""
    window = FlowWindow(settings.costs, FRAME_RATE, None)
    window.add(table)
    return window.graph(observation)


def _bare_solve(graph: FlowGraph) -> float:
    """Seconds of OR-tools alone, once the arcs are in."""
    solver = network_of(graph)
    start = time.process_time()
    solver.solve()
    return time.process_time() - start


def network_of(graph: FlowGraph) -> min_cost_flow.SimpleMinCostFlow:
    """OR-tools' solver with all arcs in; node 2i is u_i, node 2i + 1 is v_i, then source and sink."""
    solver = min_cost_flow.SimpleMinCostFlow()
    count = len(graph)
    u = np.arange(0, 2 * count, 2, dtype=np.int32)
    source, sink = np.full(count, 2 * count, np.int32), np.full(count, 2 * count + 1, np.int32)
    tails = np.concatenate([u, u + 1, 2 * graph.tail.astype(np.int32) + 1, source])
    heads = np.concatenate([u + 1, sink, 2 * graph.head.astype(np.int32), u])
    costs = scaled(np.concatenate([graph.observation, graph.exit, graph.transition, graph.entry]))
    solver.add_arcs_with_capacity_and_unit_cost(tails, heads, np.ones(len(tails), dtype=np.int64), costs)
    solver.add_arc_with_capacity_and_unit_cost(2 * count + 1, 2 * count, count, 0)
    return solver


if __name__ == "__main__":
    main()
