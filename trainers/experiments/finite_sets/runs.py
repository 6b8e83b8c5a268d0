"""The finite-set filters on scenarios of point targets: scores, and how their time grows."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tsuiseki.tracking.evaluation.points import PointTracks, evaluate_points
from tsuiseki.tracking.filters.base import Filter, Running, SetInfo
from tsuiseki.tracking.filters.finite_sets.clusters import by_clusters, by_measurements
from tsuiseki.tracking.filters.finite_sets.labelled_multi_bernoulli import LabelledMultiBernoulliFilter
from tsuiseki.tracking.filters.finite_sets.phd import PhdFilter
from tsuiseki.tracking.filters.finite_sets.phd_identity import Identity
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.finite_sets.scenarios import (
    PointScenario,
    generated_scenario,
    printed_births,
    scenario_births,
    scenario_model,
)

PointFilter = Running[Any, FloatArray, SetInfo]
METHODS = ("phd-literal", "phd-printed", "phd-clusters", "phd", "labelled")
CUT_OFF = 100.0
BLOCK = 5
# OSPA p=1 of a plain SMC-PHD filter and of a labelled filter in MATLAB: by the seed of the scenario that they were
# measured on and by the clutter rate.
YARDSTICKS: dict[tuple[int, str], dict[float, float]] = {
    (20061, "phd"): {10: 14.5, 30: 17.0, 60: 19.8},
    (20061, "labelled"): {10: 10.2, 30: 11.3, 60: 12.8},
    (20091, "phd"): {10: 32.2, 30: 38.0, 60: 42.4},
}


@dataclass(frozen=True)
class ScenarioRow:
    """One line of the table: a scenario, a clutter rate and a method, means over the runs."""

    scenario: str
    clutter: float
    method: str
    ospa1: float
    ospa2: float
    ospa1_error: float
    ospa_tracks: float
    gospa: float
    cardinality_error: float
    switches: float
    milliseconds: float
    runs: int
    peer: float | None


def start_filter(method: str, settings: dict[str, Any], clutter: float, particles: int, seed: int) -> PointFilter:
    """A fresh filter at work on a scenario.

    ``phd`` reads targets off by measurements, ``phd-clusters`` by clusters. ``phd-literal`` is the paper's filter: the
    particles of (50) and (57) by weight alone, the labels of 5.2 as printed, nothing claimed or remembered, everything
    parted shown at once. ``phd-printed`` has claims and more particles at the places of birth besides. ``labelled`` is
    the multi-Bernoulli filter.
    """
    model = scenario_model(settings, clutter)
    births = scenario_births(settings, particles)
    plain = Identity(remember=False, confirm=False)
    filters: dict[str, Filter[Any, FloatArray, SetInfo]] = {
        "labelled": LabelledMultiBernoulliFilter(model, births, particles),
        "phd": PhdFilter(model, births, particles, extract=by_measurements),
        "phd-clusters": PhdFilter(model, births, particles, extract=by_clusters),
        "phd-printed": PhdFilter(model, births, particles, smallest_cluster=0, extract=by_clusters, identity=plain),
        "phd-literal": PhdFilter(
            model, printed_births(settings, particles), particles, smallest_cluster=0, extract=by_clusters,
            identity=replace(plain, claim=False, adopt=True),
        ),
    }  # fmt: skip
    columns = 4 if settings["kind"] == "linear" else 5
    chosen = filters[method]
    return Running(chosen, chosen.init(np.empty((0, columns))), np.random.default_rng(seed))


def run_filter(running: PointFilter, measurements: Iterable[FloatArray]) -> tuple[PointTracks, FloatArray]:
    """The tracks found, and the processor's seconds in each step."""
    frames, ids, positions, seconds = [], [], [np.empty((0, 2))], []
    for index, found in enumerate(measurements):
        begin = time.process_time()
        estimates = running.step(found).estimates
        seconds.append(time.process_time() - begin)
        frames.append(np.full(len(estimates), index))
        ids.append(estimates.ids)
        positions.append(estimates.states[:, [0, 2]])
    return PointTracks(np.concatenate(frames), np.concatenate(ids), np.concatenate(positions)), np.array(seconds)


def scenario_row(scenario: PointScenario, rate: int, method: str, particles: int, runs: int) -> ScenarioRow:
    """Scores of a method at one of the scenario's clutter rates over its first ``runs`` runs."""
    truth, settings = scenario.true_tracks(), scenario.settings
    clutter = settings["clutter_rates"][rate]
    scores, seconds = [], []
    for run in range(min(runs, settings["runs"])):
        running = start_filter(method, settings, clutter, particles, seed=run)
        found, took = run_filter(running, scenario.measurements[run, rate])
        scores.append(evaluate_points(truth, found, settings["K"], CUT_OFF))
        seconds.append(took)
    first = np.array([score.ospa1 for score in scores])
    return ScenarioRow(
        scenario.name,
        clutter,
        method,
        float(first.mean()),
        float(np.mean([s.ospa2 for s in scores])),
        float(first.std() / np.sqrt(len(first))),
        float(np.mean([s.ospa_tracks for s in scores])),
        float(np.mean([s.gospa for s in scores])),
        float(np.mean([s.cardinality_error for s in scores])),
        float(np.mean([s.switches for s in scores])),
        1e3 * float(np.median(np.concatenate(seconds))),
        len(scores),
        YARDSTICKS.get((settings.get("seed", 0), method), {}).get(clutter),
    )


@dataclass(frozen=True)
class Scaling:
    """How the time of a step grows.

    Attributes:
        method: of the filter.
        what: ``clutter`` or ``targets``.
        sizes: how many.
        milliseconds: median of a step.
        slope: of the logarithms.
    """

    method: str
    what: str
    sizes: list[int]
    milliseconds: list[float]
    slope: float


def scaling(method: str, what: str, sizes: list[int], particles: int = 1000, steps: int = 30) -> Scaling:
    """Times of a method over clutter rates (at 10 targets) or numbers of targets (at clutter 10).

    The sizes take turns, `BLOCK` steps each, so that other work on the machine falls on all of them alike.
    """
    running: dict[int, tuple[PointFilter, list[FloatArray]]] = {}
    for size in sizes:
        targets, clutter = (10, float(size)) if what == "clutter" else (size, 10.0)
        settings, measurements = generated_scenario(targets, clutter, steps, seed=size)
        running[size] = start_filter(method, settings, clutter, particles, seed=0), measurements
    seconds: dict[int, list[float]] = {size: [] for size in sizes}
    for first in range(0, steps, BLOCK):
        for size, (chosen, measurements) in running.items():
            _, took = run_filter(chosen, measurements[first : first + BLOCK])
            # The first steps have no targets yet.
            seconds[size] += [] if first == 0 else took.tolist()
    milliseconds = [1e3 * float(np.median(seconds[size])) for size in sizes]
    slope = float(np.polyfit(np.log(sizes), np.log(milliseconds), 1)[0])
    return Scaling(method, what, sizes, milliseconds, slope)
