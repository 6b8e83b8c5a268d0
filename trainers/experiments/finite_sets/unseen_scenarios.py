"""Scenarios that no setting was chosen on: targets appear anywhere, at random, and go at random."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tsuiseki.tracking.evaluation.points import PointTracks
from tsuiseki.tracking.types import FloatArray, IntArray
from tsuiseki.tracking.types.measurements import (
    BirthPlace,
    BirthSettings,
    MotionSettings,
    Scan,
    SensingModel,
    SensorSettings,
)


@dataclass(frozen=True)
class UnseenSettings:
    """What is drawn, and what every filter is told.

    Attributes:
        clutter: expected false measurements a scan.
        steps: scans, a second apart.
        side: of the region, which is square and about the origin.
        first: targets at the start.
        births: expected new ones a second.
        survival, detection: probabilities.
        acceleration: standard deviation that the filters are told, constant over each step.
        bends: that of the true paths; 0 for straight ones.
        agile: deviation of the true acceleration of targets that manoeuvre; above 0 each is calm (``bends``) and
            agile by turns.
        switching: changes between the two a second.
        deviation: of a measured coordinate.
        speed: deviation of a new target's velocity.
        places: ``(x, y)`` where all new targets appear, known to the filters; by default anywhere.
        place_spread: their deviation about a place.
        leave: ``gone`` tells the filters that a target which leaves the region has ended, as it has.
    """

    clutter: float = 10.0
    steps: int = 100
    side: float = 2000.0
    first: int = 3
    births: float = 0.1
    survival: float = 0.99
    detection: float = 0.98
    acceleration: float = 5.0
    bends: float = 5.0
    agile: float = 0.0
    switching: float = 0.1
    deviation: float = 10.0
    speed: float = 10.0
    places: tuple[tuple[float, float], ...] = ()
    place_spread: float = 10.0
    leave: Literal["gone", "unseen"] = "unseen"

    @property
    def model(self) -> SensingModel:
        """For `tracking.trackers.measurements`."""
        half = 0.5 * self.side
        return SensingModel(
            SensorSettings("linear", (self.deviation,)), (MotionSettings("constant-velocity", self.acceleration),),
            detection=self.detection, survival=self.survival, clutter=self.clutter,
            region=((-half, half), (-half, half)), leave=self.leave,
            births=BirthSettings(self.births, self.speed, self._places()),
        )  # fmt: skip

    def _places(self) -> tuple[BirthPlace, ...]:
        spread = (self.place_spread, self.speed, self.place_spread, self.speed)
        rate = self.births / max(len(self.places), 1)
        return tuple(BirthPlace((x, 0.0, y, 0.0), spread, rate) for x, y in self.places)


STANDARD_PLACES = ((0.0, 0.0), (400.0, -600.0), (-800.0, -200.0), (-200.0, 800.0))
"""Those of the usual linear scenario of the literature."""
KINDS = {
    "anywhere": UnseenSettings(),
    "known places": UnseenSettings(first=0, births=0.12, places=STANDARD_PLACES),
    "known places, straight paths": UnseenSettings(first=0, births=0.12, places=STANDARD_PLACES, bends=0.0),
}


@dataclass(frozen=True)
class UnseenScenario:
    """What is there, and what is measured.

    Attributes:
        truth: the targets.
        scans: a second apart.
        sources: ``(M,)`` for each scan: the target of each measurement, 0 for a false one.
    """

    truth: PointTracks
    scans: list[Scan]
    sources: list[IntArray]


def unseen_scenario(settings: UnseenSettings, seed: int) -> UnseenScenario:
    """A scenario of its own for each seed. A target that leaves the region is gone."""
    rng, half = np.random.default_rng(seed), 0.5 * settings.side
    states, names, born = np.empty((0, 4)), np.empty(0, dtype=np.int64), 0
    agile = np.empty(0, dtype=np.bool_)
    change = 0.5 * (1 - np.exp(-2 * settings.switching))
    frames: list[IntArray] = []
    ids: list[IntArray] = []
    places: list[FloatArray] = []
    scans, sources = [], []
    for k in range(settings.steps):
        alive = rng.random(len(states)) < settings.survival
        states, names, agile = states[alive], names[alive], agile[alive]
        noise = rng.standard_normal((len(states), 2))
        if settings.agile:
            agile = agile ^ (rng.random(len(states)) < change)
        noise *= np.where(agile, settings.agile, settings.bends)[:, None]
        states = states + np.stack(
            [states[:, 1] + noise[:, 0] / 2, noise[:, 0], states[:, 3] + noise[:, 1] / 2, noise[:, 1]], axis=1
        )
        inside = (np.abs(states[:, [0, 2]]) < half).all(axis=1)
        count = settings.first if k == 0 else rng.poisson(settings.births)
        new = np.zeros((count, 4))
        new[:, [0, 2]] = _new_places(settings, count, rng)
        new[:, [1, 3]] = settings.speed * rng.standard_normal((count, 2))
        states = np.concatenate([states[inside], new])
        names = np.concatenate([names[inside], born + 1 + np.arange(count)])
        starts = rng.random(count) < 0.5 if settings.agile else np.zeros(count, dtype=np.bool_)
        agile = np.concatenate([agile[inside], starts])
        born += count
        frames.append(np.full(len(states), k, dtype=np.int64))
        ids.append(names)
        places.append(states[:, [0, 2]])
        detected = rng.random(len(states)) < settings.detection
        seen = places[-1][detected]
        false = rng.uniform(-half, half, (rng.poisson(settings.clutter), 2))
        measured = np.concatenate([seen + settings.deviation * rng.standard_normal(seen.shape), false])
        order = rng.permutation(len(measured))
        scans.append(Scan(float(k), measured[order]))
        sources.append(np.concatenate([names[detected], np.zeros(len(false), dtype=np.int64)])[order])
    return UnseenScenario(
        PointTracks(np.concatenate(frames), np.concatenate(ids), np.concatenate(places)), scans, sources
    )


def _new_places(settings: UnseenSettings, count: int, rng: np.random.Generator) -> FloatArray:
    """``(count, 2)`` where new targets appear."""
    if not settings.places:
        return rng.uniform(-0.5, 0.5, (count, 2)) * settings.side
    chosen = np.array(settings.places)[rng.integers(0, len(settings.places), count)]
    return np.asarray(chosen + settings.place_spread * rng.standard_normal((count, 2)))
