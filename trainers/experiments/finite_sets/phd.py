"""The finite-set filters on the standard scenarios, on real detections, and how their time grows (`reproduce phd`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from itertools import product
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.multi import PeopleScores, evaluate_sequence
from tsuiseki.tracking.formats.mot import read_detections, read_ground_truth
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.people.tracker import PeopleTracker, run_tracker
from tsuiseki.tracking.points.tracker import PointSettings, PointTracker
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, Table, at_least_one
from tsuiseki.trainers.experiments.finite_sets.plots import plot_ospa, plot_scaling
from tsuiseki.trainers.experiments.finite_sets.runs import METHODS, ScenarioRow, scaling, scenario_row
from tsuiseki.trainers.experiments.finite_sets.scenarios import read_scenario

GROWN = (("clutter", [10, 20, 40, 80, 160]), ("targets", [5, 10, 20, 40, 80]))


def reproduce(bench: Bench, data: Path = Path("../shared/data"), particles: int = 1000, runs: int = 10) -> Outcome:
    """The finite-set filters on the standard scenarios and on real detections: OSPA, identities, time.

    DIR gets results.json, tables.md, ospa.png and scaling.png.

    Args:
        bench: where it works.
        data: folder that holds phd/phd_scenario_*.json and, for the real rows, mot/PETS09-S2L1-first.
        particles: of each target.
        runs: Monte-Carlo runs of each scenario; at most as many as it has.

    Raises:
        RequestError: no scenario, or a number below 1.
    """
    paths = sorted((data / "phd").glob("phd_scenario_*.json"))
    if not paths:
        raise RequestError(f"`data`: expected phd/phd_scenario_*.json in {data}, found none; give its folder")
    at_least_one(particles=particles, runs=runs)
    scenarios = [read_scenario(path) for path in paths]
    cells = [(s, n, m) for s in scenarios for n, m in product(range(len(s.settings["clutter_rates"])), METHODS)]
    watched = bench.watch.over(cells, "scenarios", len(cells))
    rows = [bench.store.recall(scenario_row, *cell, particles, runs) for cell in watched]
    grown = [bench.store.recall(scaling, method, what, n) for method in ("phd", "labelled") for what, n in GROWN]
    sequence = data / "mot" / "PETS09-S2L1-first"
    real = bench.store.recall(real_rows, sequence) if sequence.is_dir() else {}
    return Outcome(
        {
            "scenarios": [asdict(row) for row in rows],
            "scaling": [asdict(one) for one in grown],
            "real": {name: asdict(scores) for name, scores in real.items()},
        },
        [_scenario_table(rows), _real_table(real)],
        {"ospa": plot_ospa(rows), "scaling": plot_scaling(grown)},
        notes=[f"{one.method}: log-log slope over {one.what} {one.slope:.2f}" for one in grown],
    )


def real_rows(folder: Path, seed: int = 0) -> dict[str, PeopleScores]:
    """MOTA, IDF1 and HOTA of SORT, the PHD and the labelled filter on the given detections of a MOT sequence."""
    sequence = read_sequence(folder)
    truth = read_ground_truth(sequence.ground_truth_path)
    detections = read_detections(sequence.detections_path, sequence.length, (-np.inf, np.inf))
    extent = (float(sequence.width or 640), float(sequence.height or 480))
    trackers: dict[str, PeopleTracker] = {
        "SORT": Sort(),
        "SMC-PHD": PointTracker(PointSettings(method="phd"), extent, seed),
        "labelled multi-Bernoulli": PointTracker(PointSettings(method="labelled"), extent, seed),
    }
    return {
        name: evaluate_sequence(truth, run_tracker(detections, tracker), sequence.length)
        for name, tracker in trackers.items()
    }


def _scenario_table(rows: Sequence[ScenarioRow]) -> Table:
    columns = ("scenario", "clutter", "method", "OSPA p=1", "p=2", "OSPA(2)", "count error", "switches", "ms/step")
    return Table(
        "",
        (*columns, "peer p=1"),
        [
            (
                row.scenario, f"{row.clutter:g}", row.method, f"{row.ospa1:.2f} ± {row.ospa1_error:.2f}",
                f"{row.ospa2:.2f}", f"{row.ospa_tracks:.2f}", f"{row.cardinality_error:.3f}", f"{row.switches:.1f}",
                f"{row.milliseconds:.2f}", "" if row.peer is None else f"{row.peer:.1f}",
            )
            for row in rows
        ],
    )  # fmt: skip


def _real_table(real: dict[str, PeopleScores]) -> Table:
    return Table(
        "",
        ("PETS09-S2L1-first", "MOTA", "IDF1", "HOTA", "switches"),
        [(name, f"{s.mota:.3f}", f"{s.idf1:.3f}", f"{s.hota:.3f}", str(s.id_switches)) for name, s in real.items()],
    )
