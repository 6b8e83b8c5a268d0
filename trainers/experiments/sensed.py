"""Targets from a sensor's measurements on scenarios that nothing was tuned on, with peers (`reproduce phd-unseen`)."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tsuiseki.tracking.evaluation.points import PointTracks, evaluate_points
from tsuiseki.tracking.points.settings import Lag, SetMethod
from tsuiseki.tracking.points.tracker import MeasurementTracker
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.measurements import (
    BirthPlace,
    BirthSettings,
    MotionSettings,
    Scan,
    SensingModel,
    SensorSettings,
)
from tsuiseki.trainers.experiments.peers import Peer, find_peer
from tsuiseki.trainers.experiments.study import (
    Bench,
    Column,
    Outcome,
    Study,
    at_least_one,
    median_only,
    tabulated,
    values_of,
    with_error,
    with_interval,
)

PROGRAM = Path(__file__).with_name("sensed_peers.py")
PEERS = ("Stone Soup GM-PHD", "multisensor-lmb-filters-rs LMB")
CUT_OFF = 100.0
FIRST_SEED = 700
"""Of the scenarios: nothing was tuned on them."""


@dataclass(frozen=True)
class Scenarios:
    """What is drawn, and what every filter knows.

    Attributes:
        first: targets at the start.
        births: expected new ones a scan.
        places: ``(x, y)`` where all new targets appear, known to the filters; by default anywhere.
        bends: standard deviation of the true acceleration; 0 for straight paths.
        acceleration: the one that the filters assume, constant over each step.
        clutter: expected false measurements a scan.
        side: of the region, which is square and about the origin.
        survival, detection: probabilities.
        deviation: of a measured coordinate.
        speed: deviation of a new target's velocity.
        place_spread: deviation of a new target about its place.
        steps: scans, a second apart.
    """

    first: int = 3
    births: float = 0.1
    places: tuple[tuple[float, float], ...] = ()
    bends: float = 5.0
    acceleration: float = 5.0
    clutter: float = 10.0
    side: float = 2000.0
    survival: float = 0.99
    detection: float = 0.98
    deviation: float = 10.0
    speed: float = 10.0
    place_spread: float = 10.0
    steps: int = 100

    @property
    def model(self) -> SensingModel:
        """For `MeasurementTracker`."""
        half, rate = 0.5 * self.side, self.births / max(len(self.places), 1)
        spread = (self.place_spread, self.speed, self.place_spread, self.speed)
        places = tuple(BirthPlace((x, 0.0, y, 0.0), spread, rate) for x, y in self.places)
        return SensingModel(
            SensorSettings("linear", (self.deviation,)), (MotionSettings("constant-velocity", self.acceleration),),
            detection=self.detection, survival=self.survival, clutter=self.clutter,
            region=((-half, half), (-half, half)), births=BirthSettings(self.births, self.speed, places),
        )  # fmt: skip


STANDARD_PLACES = ((0.0, 0.0), (400.0, -600.0), (-800.0, -200.0), (-200.0, 800.0))
"""Those of the usual linear scenario of the literature."""
KINDS: Mapping[str, Scenarios] = {
    "anywhere": Scenarios(),
    "known places": Scenarios(0, 0.12, STANDARD_PLACES),
    "known places, straight paths": Scenarios(0, 0.12, STANDARD_PLACES, bends=0.0),
}


Row: TypeAlias = tuple[Scenarios, SetMethod, Lag, int] | tuple[Scenarios, Peer, Path, str]
"""Scenarios and a filter: ours with its lag and particles of each target, or one of a peer's program by name."""


def reproduce(
    bench: Bench, seeds: int = 10, particles: int = 1000, peer: str | None = None, seed: int = FIRST_SEED
) -> Outcome:
    """The labelled and the PHD filter on new scenarios, births anywhere or at known places, beside peers.

    A target that leaves the region has ended, which no filter is told; what any of them reports outside is dropped. DIR
    gets results.json and tables.md.

    Args:
        bench: where it works.
        seeds: scenarios of each kind.
        particles: of each target.
        peer: python of an environment with stonesoup and multisensor-lmb-filters-rs; by default this one, if it has
            them.
        seed: of the first scenario.

    Raises:
        RequestError: a number is below 1, or the environment named has not the packages.
    """
    at_least_one(seeds=seeds, particles=particles)
    environment = find_peer(peer, PROGRAM, "stonesoup and multisensor-lmb-filters-rs")
    rows: dict[tuple[str, ...], Row] = {}
    for kind, scenarios in KINDS.items():
        rows[kind, "labelled"] = (scenarios, "labelled", 0, particles)
        rows[kind, "labelled, `--lag 1`"] = (scenarios, "labelled", 1, particles)
        rows[kind, "PHD"] = (scenarios, "phd", 0, particles)
        rows |= {(kind, name): (scenarios, environment, PROGRAM, name) for name in PEERS if environment}
    found = Study(rows, range(seed, seed + seeds), run_filter, "scenarios").run(bench)
    fields = {"OSPA(2)": "ospa_tracks", "missed a scan": "missed", "false a scan": "false", "switches": "switches"}
    columns = [
        Column("OSPA p=1", "ospa1", show=with_error, gain=with_interval),
        *(Column(heading, name) for heading, name in fields.items()),
        Column("ms a step", "milliseconds", show=median_only),
    ]
    table = tabulated(found, columns, ("births", "filter"), base=lambda name: (name[0], "labelled"))
    peers = f"; peers: {environment.version}" if environment else ""
    note = (
        f"{seeds} scenarios of each kind from seed {seed}; ± is the standard error, differences over labelled{peers}."
    )
    return Outcome(values_of(found, ("births", "filter")), [table], notes=[note])


def run_filter(row: Row, seed: int) -> dict[str, float]:
    """Scores of one filter on one scenario, and the median milliseconds of processor time of a step."""
    settings = row[0]
    truth, scans = drawn_scenario(settings, seed)
    if isinstance(row[1], Peer):
        job = {"filter": row[3], "model": asdict(settings), "scans": [one.measurements.tolist() for one in scans]}
        answer = row[1].answer(Path(row[2]), job)
        return scored(settings, truth, answer["rows"], answer["milliseconds"])
    _, method, lag, particles = row
    tracker = MeasurementTracker(settings.model, method, particles, seed=0, lag=lag)
    milliseconds = []
    for scan in scans:
        begin = time.process_time()
        tracker.update(scan)
        milliseconds.append(1e3 * (time.process_time() - begin))
    rows = [
        (int(scan), track.id, *place)
        for track in tracker.tracks()
        for scan, place in zip(track.scans, track.positions, strict=True)
    ]
    return scored(settings, truth, rows, milliseconds)


def scored(
    settings: Scenarios, truth: PointTracks, rows: Sequence[Sequence[float]], milliseconds: Sequence[float]
) -> dict[str, float]:
    """Scores of the rows scan, id, x, y that lie in the region."""
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    table = table[np.abs(table[:, 2:]).max(axis=1, initial=0.0) <= 0.5 * settings.side]
    # A mixture may name two components alike: the first counts.
    _, first = np.unique(table[:, :2], axis=0, return_index=True)
    table = table[np.sort(first)]
    found = PointTracks(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:])
    scores = asdict(evaluate_points(truth, found, settings.steps, CUT_OFF))
    return {**scores, "milliseconds": float(np.median(milliseconds))}


def drawn_scenario(settings: Scenarios, seed: int) -> tuple[PointTracks, list[Scan]]:
    """The targets of a seed, which go when they leave the region, and what is measured of them."""
    rng, half = np.random.default_rng(seed), 0.5 * settings.side
    states, names, born = np.empty((0, 4)), np.empty(0, dtype=np.int64), 0
    frames, ids, places, scans = [], [], [], []
    for k in range(settings.steps):
        alive = rng.random(len(states)) < settings.survival
        states, names = states[alive], names[alive]
        x, y = settings.bends * rng.standard_normal((len(states), 2)).T
        states = states + np.stack([states[:, 1] + x / 2, x, states[:, 3] + y / 2, y], axis=1)
        inside = (np.abs(states[:, [0, 2]]) < half).all(axis=1)
        count = settings.first if k == 0 else rng.poisson(settings.births)
        new = np.zeros((count, 4))
        new[:, [0, 2]] = _new_places(settings, count, rng)
        new[:, [1, 3]] = settings.speed * rng.standard_normal((count, 2))
        states = np.concatenate([states[inside], new])
        names = np.concatenate([names[inside], born + 1 + np.arange(count)])
        born += count
        frames.append(np.full(len(states), k, dtype=np.int64))
        ids.append(names)
        places.append(states[:, [0, 2]])
        detected = places[-1][rng.random(len(states)) < settings.detection]
        false = rng.uniform(-half, half, (rng.poisson(settings.clutter), 2))
        measured = np.concatenate([detected + settings.deviation * rng.standard_normal(detected.shape), false])
        scans.append(Scan(float(k), measured[rng.permutation(len(measured))]))
    return PointTracks(np.concatenate(frames), np.concatenate(ids), np.concatenate(places)), scans


def _new_places(settings: Scenarios, count: int, rng: np.random.Generator) -> FloatArray:
    """``(count, 2)`` where new targets appear."""
    if not settings.places:
        return rng.uniform(-0.5, 0.5, (count, 2)) * settings.side
    chosen = np.array(settings.places)[rng.integers(0, len(settings.places), count)]
    return np.asarray(chosen + settings.place_spread * rng.standard_normal((count, 2)))
