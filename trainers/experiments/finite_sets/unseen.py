"""Targets from a sensor's measurements on new scenarios, beside peers (`reproduce phd-unseen`)."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Literal

import numpy as np

from tsuiseki.tracking.points.measurement_tracker import Lag, MeasurementMethod, MeasurementTracker
from tsuiseki.tracking.types.measurements import SensingModel
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, Table, at_least_one
from tsuiseki.trainers.experiments.finite_sets.peer_choice import DEVELOPMENT, PACKAGES, PROGRAM, choose, run_peer
from tsuiseki.trainers.experiments.finite_sets.told_filter import told_filter
from tsuiseki.trainers.experiments.finite_sets.unseen_scenarios import KINDS, UnseenSettings, unseen_scenario
from tsuiseki.trainers.experiments.finite_sets.unseen_scores import UnseenRun, inside, scored
from tsuiseki.trainers.experiments.intervals import interval
from tsuiseki.trainers.experiments.peers import find_peer

TOLD = "told which measurement is whose"
METHODS: Mapping[str, tuple[MeasurementMethod, Lag]] = {
    "labelled": ("labelled", 0),
    "labelled, a scan later": ("labelled", 1),
    "phd": ("phd", 0),
}
TELLING: Mapping[Literal["unseen", "gone"], str] = {"unseen": "", "gone": ", told of exits"}
FIRST_SEED = 700
"""Of the scenarios: nothing was scored on them before."""


def reproduce(
    bench: Bench,
    seeds: int = 10,
    clutter: float = 10.0,
    particles: int = 1000,
    peer: str | None = None,
    seed: int = FIRST_SEED,
) -> Outcome:
    """The labelled and the PHD filter on new scenarios, births anywhere or at known places, beside peers.

    A target that leaves the region has ended. Every filter is run twice: not told so, and told. What any of them shows
    outside the region is dropped. The peers' thresholds are chosen first, on seeds of their own. DIR gets results.json
    and tables.md.

    Args:
        bench: where it works.
        seeds: scenarios of each kind.
        clutter: expected false measurements a scan.
        particles: of each target.
        peer: python of an environment with stonesoup and multisensor-lmb-filters-rs; by default this one, if it has
            them.
        seed: of the first scenario.

    Raises:
        RequestError: a number is below 1, or the environment named has not the packages.
    """
    at_least_one(seeds=seeds, particles=particles)
    found = find_peer(peer, PROGRAM, PACKAGES)
    chosen = {} if found is None else choose(bench, found)
    rows: dict[tuple[str, str], list[UnseenRun]] = {}
    jobs = [(kind, number) for number in range(seed, seed + seeds) for kind in KINDS]
    for kind, number in bench.watch.over(jobs, "scenarios", len(jobs)):
        plain = replace(KINDS[kind], clutter=clutter)
        for leave, suffix in TELLING.items():
            settings = replace(plain, leave=leave)
            for name, (method, lag) in METHODS.items():
                run = bench.store.recall(run_ours, settings, number, method, particles, lag)
                rows.setdefault((kind, name + suffix), []).append(run)
        rows.setdefault((kind, TOLD), []).append(bench.store.recall(run_told, plain, number))
    if found is not None:
        numbers = tuple(range(seed, seed + seeds))
        work = [(kind, leave, name) for kind in KINDS for leave in TELLING for name in chosen]
        for kind, leave, name in bench.watch.over(work, "peers", len(work)):
            settings = replace(KINDS[kind], clutter=clutter, leave=leave)
            runs = bench.store.recall(run_peer, found, name, chosen[name][0], settings, numbers)
            rows[kind, name + TELLING[leave]] = runs
    version = f"; peers: {found.version}" if found else ""
    note = f"{seeds} scenarios of each kind from seed {seed}, clutter {clutter:g}; ± is the standard error{version}."
    values = [
        {"births": kind, "filter": name, "runs": [asdict(run) for run in runs]} for (kind, name), runs in rows.items()
    ]
    tables = [_table(kind, rows) for kind in KINDS]
    if found is not None:
        tables.append(_differences(rows))
    notes = [note]
    for name, (tuned, usual, best) in chosen.items():
        if tuned:
            shown = ", ".join(f"{setting} {value:g}" for setting, value in tuned.items())
            seeds_ = f"{DEVELOPMENT[0]} to {DEVELOPMENT[-1]}"
            notes.append(f"{name}: OSPA {usual:.2f} as usual, {best:.2f} with {shown}, chosen on seeds {seeds_}")
    return Outcome(values, tables, notes=notes)


def run_ours(
    settings: UnseenSettings,
    seed: int,
    method: MeasurementMethod,
    particles: int,
    lag: Lag = 0,
    model: SensingModel | None = None,
) -> UnseenRun:
    """One of ours, as `track points` runs it; ``model`` is by default that of the settings."""
    scenario = unseen_scenario(settings, seed)
    tracker = MeasurementTracker(model or settings.model, method, particles, seed=0, lag=lag)
    seconds = []
    for scan in scenario.scans:
        begin = time.process_time()
        tracker.update(scan)
        seconds.append(time.process_time() - begin)
    rows = [
        (int(scan), track.id, *place)
        for track in tracker.tracks()
        for scan, place in zip(track.scans, track.positions, strict=True)
    ]
    return scored(scenario.truth, inside(settings, rows), [1e3 * each for each in seconds])


def run_told(settings: UnseenSettings, seed: int) -> UnseenRun:
    """The filter that is told which measurement is whose."""
    scenario = unseen_scenario(settings, seed)
    return scored(scenario.truth, told_filter(settings, scenario), [0.0] * len(scenario.scans))


def _table(kind: str, rows: Mapping[tuple[str, str], Sequence[UnseenRun]]) -> Table:
    columns = (f"births {kind}", "OSPA p=1", "OSPA(2)", "missed a scan", "false a scan", "switches", "ms a step")
    lines = []
    for (of, name), runs in rows.items():
        if of != kind:
            continue
        scores = [run.scores for run in runs]
        first = np.array([score.ospa1 for score in scores])
        error = first.std(ddof=1) / np.sqrt(len(first)) if len(first) > 1 else float("nan")
        means = [np.mean([getattr(s, field) for s in scores]) for field in ("ospa_tracks", "missed", "false")]
        switches, time_ = np.mean([s.switches for s in scores]), np.median([run.milliseconds for run in runs])
        lines.append(
            (name, f"{first.mean():.2f} ± {error:.2f}", *(f"{m:.2f}" for m in means), f"{switches:.1f}", f"{time_:.2f}")
        )
    return Table("", columns, lines)


def _differences(rows: Mapping[tuple[str, str], Sequence[UnseenRun]]) -> Table:
    """OSPA of the labelled filter less that of each peer that is told as much, paired by scenario."""
    suffixes = sorted(TELLING.values(), key=len, reverse=True)
    ours = {*(name + suffix for name in METHODS for suffix in suffixes), TOLD}
    lines = []
    for (kind, name), runs in rows.items():
        if name in ours:
            continue
        suffix = next(one for one in suffixes if name.endswith(one))
        gaps = [
            mine.scores.ospa1 - other.scores.ospa1
            for mine, other in zip(rows[kind, "labelled" + suffix], runs, strict=True)
        ]
        mean, low, high = interval(np.array(gaps)) if len(gaps) > 1 else (gaps[0], float("nan"), float("nan"))
        lines.append((f"births {kind}", name, f"{mean:+.2f} [{low:+.2f}, {high:+.2f}]"))
    return Table("Labelled less each peer that is told as much", ("", "peer", "OSPA p=1, 95 %"), lines)
