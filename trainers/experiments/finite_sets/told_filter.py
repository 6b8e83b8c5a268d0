"""A filter that is told which measurement is whose: what no filter that has to find it out can beat in the mean.

Every target is a Kalman filter with a probability of existence. Only two things are left to guess: where it is, and
whether it has ended or is missed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import norm

from tsuiseki.tracking.filters.kalman import Gaussians, predict, update
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.finite_sets.unseen_scenarios import UnseenScenario, UnseenSettings

TRANSITION: FloatArray = np.kron(np.eye(2), np.array([[1.0, 1.0], [0.0, 1.0]]))
SEES = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
REPORTED, PRUNED = 0.5, 1e-3


def told_filter(settings: UnseenSettings, scenario: UnseenScenario) -> list[tuple[int, int, float, float]]:
    """Rows scan, id, x, y of the targets that probably are there.

    A target begins with its first measurement, from the prior of the nearest place of birth, or of anywhere.
    """
    gain = settings.acceleration * np.kron(np.eye(2), [[0.5], [1.0]])
    noise, error = gain @ gain.T, np.eye(2) * settings.deviation**2
    targets: dict[int, tuple[Gaussians, float]] = {}
    rows: list[tuple[int, int, float, float]] = []
    for scan, (found, sources) in enumerate(zip(scenario.scans, scenario.sources, strict=True)):
        measured = {int(name): found.measurements[row] for row, name in enumerate(sources) if name > 0}
        after: dict[int, tuple[Gaussians, float]] = {}
        for name in targets.keys() | measured.keys():
            if name in targets:
                state = predict(targets[name][0], TRANSITION, noise)
                existence = settings.survival * targets[name][1] * _inside(state, 0.5 * settings.side)
            else:
                state, existence = _prior(settings, measured[name]), 1.0
            if name in measured:
                state, existence = update(state, measured[name][None], SEES, error)[0], 1.0
            else:
                existence *= (1 - settings.detection) / (1 - existence * settings.detection)
            if existence > PRUNED:
                after[name] = state, existence
        targets = after
        shown = sorted(name for name, (_, existence) in targets.items() if existence > REPORTED)
        rows += [(scan, name, *_place(targets[name][0])) for name in shown]
    return rows


def _prior(settings: UnseenSettings, measured: FloatArray) -> Gaussians:
    places: Sequence[tuple[float, float]] = settings.places or ((float(measured[0]), float(measured[1])),)
    # Far wider than the sensor where nothing is known of the place.
    width = settings.place_spread if settings.places else settings.side
    x, y = min(places, key=lambda place: float(np.linalg.norm(np.array(place) - measured)))
    spread = np.diag([width**2, settings.speed**2, width**2, settings.speed**2])
    return Gaussians(np.array([[x, 0.0, y, 0.0]]), spread[None])


def _inside(state: Gaussians, half: float) -> float:
    """Probability that it lies in the region, each axis by itself."""
    middle, deviation = state.mean[0, ::2], np.sqrt(np.diagonal(state.covariance[0])[::2])
    return float(np.prod(norm.cdf((half - middle) / deviation) - norm.cdf((-half - middle) / deviation)))


def _place(state: Gaussians) -> tuple[float, float]:
    return float(state.mean[0, 0]), float(state.mean[0, 2])
