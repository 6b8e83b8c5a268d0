"""Thresholds of the peers of `reproduce phd-unseen`, chosen on the scenarios on which ours were."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tsuiseki.trainers.experiments.experiment import Bench
from tsuiseki.trainers.experiments.finite_sets.unseen_scenarios import KINDS, UnseenSettings, unseen_scenario
from tsuiseki.trainers.experiments.finite_sets.unseen_scores import UnseenRun, inside, scored
from tsuiseki.trainers.experiments.peers import Peer

PROGRAM = Path(__file__).with_name("peer_program.py")
PACKAGES = "stonesoup and multisensor-lmb-filters-rs"
PeerSettings: TypeAlias = Mapping[str, float]
DEVELOPMENT = range(200, 206)
"""Seeds of the scenarios; on these the labelled filter's two settings were chosen, too."""
GRIDS: Mapping[str, Mapping[str, Sequence[float]]] = {
    "Stone Soup GM-PHD": {"shown": (0.5, 0.35, 0.65), "merge": (4.0, 2.0, 10.0), "prune": (1e-3, 1e-5)},
    "Stone Soup JPDA": {},
    "multisensor-lmb-filters-rs LMB": {
        "shown": (0.0, 0.4, 0.5, 0.55, 0.65),
        "components": (20, 5, 100),
        "existence": (1e-3, 1e-2, 1e-4),
        "cells": (4, 2, 8),
    },
}
"""Of each filter and setting, the usual value first; what they mean is said in `peer_program`."""


def choose(bench: Bench, peer: Peer) -> dict[str, tuple[PeerSettings, float, float]]:
    """Each filter's settings, and its mean OSPA on the development scenarios with the usual ones and with these.

    One setting after the other takes the value of the least mean OSPA (p = 1) over all scenarios and kinds of births,
    where no filter is told of exits.

    Args:
        bench: keeps what was computed.
        peer: environment with the filters.
    """

    def mean(name: str, settings: PeerSettings) -> float:
        kinds = [
            bench.store.recall(run_peer, peer, name, settings, kind, tuple(DEVELOPMENT)) for kind in KINDS.values()
        ]
        return float(np.mean([run.scores.ospa1 for runs in kinds for run in runs]))

    chosen: dict[str, tuple[PeerSettings, float, float]] = {}
    steps = [(name, setting) for name, grid in GRIDS.items() for setting in grid]
    best = {name: {setting: values[0] for setting, values in grid.items()} for name, grid in GRIDS.items()}
    least: dict[str, list[float]] = {}
    for name, setting in bench.watch.over(steps, "peers' settings", len(steps)):
        tried = [(mean(name, best[name] | {setting: value}), value) for value in GRIDS[name][setting]]
        least.setdefault(name, [tried[0][0]]).append(min(tried)[0])
        best[name][setting] = min(tried)[1]
    for name, settings in best.items():
        errors = least.get(name, [float("nan")])
        chosen[name] = (settings, errors[0], errors[-1])
    return chosen


def run_peer(
    peer: Peer,
    name: str,
    chosen: PeerSettings,
    settings: UnseenSettings,
    seeds: tuple[int, ...],
    program: Path = PROGRAM,
) -> list[UnseenRun]:
    """A filter of the peer's environment, on the scenarios of one kind.

    Args:
        peer: which environment.
        name: of the filter.
        chosen: its thresholds, see ``program``.
        settings: of the scenarios.
        seeds: of each.
        program: what runs there; its text belongs to the result.
    """
    scenarios = [unseen_scenario(settings, seed) for seed in seeds]
    runs = [
        {"model": asdict(settings), "scans": [scan.measurements.tolist() for scan in one.scans]} for one in scenarios
    ]
    answer = peer.answer(program, {"filter": name, "settings": dict(chosen), "runs": runs})
    return [
        scored(one.truth, inside(settings, found["rows"]), found["milliseconds"])
        for one, found in zip(scenarios, answer, strict=True)
    ]
