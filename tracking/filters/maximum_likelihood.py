"""Settings of a model by maximum likelihood, equation (11) of the finite-sets paper, with intervals by profile.

A filter estimates the log evidence with particles. With common random numbers, one seed for all settings, it is a
function of the settings, but a rough one. So it is climbed without derivatives (COBYQA; Ragonneau and Zhang 2024). Then
a quadratic surface is fitted to it around the best settings. Its maximum is the estimate, and its profile gives the
intervals, which allow for the roughness too (Ionides, Breto, Park, Smith and King, "Monte Carlo profile confidence
intervals for dynamic systems", 2017).

Settings are positive. Their logarithm is fitted, and of a probability the logarithm of its odds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import yaml
from scipy.optimize import minimize
from scipy.special import expit, logit

from tsuiseki.tracking.types import FloatArray

LogEvidence: TypeAlias = Callable[[Mapping[str, float]], float]
"""Logarithm of (11) of a recording, with settings by their names."""
# First step of the climb, in logarithms.
FIRST_STEP = 0.5
# Last step of the climb, in logarithms.
LAST_STEP = 0.05
# Evaluations of the climb for each setting.
CLIMB = 20
# The surface is fitted about where each setting alone lowers the log evidence by this.
DROP = 3.0
# Deviations of its roughness that it is lowered by besides.
ABOVE = 4.0
# Evaluations that tell the roughness.
PROBES = 8
# Distance of these from each other, in logarithms.
HAIR = 1e-4
# Rounds in which the surface is fitted, and twice as many in which its widths are sought.
ROUNDS = 3
# Settings drawn for each coefficient of the surface.
DRAWS = 1.5
# Deviations of an interval of 95 %.
NORMAL_95 = 1.96
# How much lower its ends are than the maximum of the profile: half of the square.
CUT = 1.92
# Widest step along one setting, in logarithms.
WIDEST = 1.0
# A setting is sought up to so many times from where it starts, both ways, where its finder says nothing else.
FARTHEST = 30.0
# Least curvature along one setting, in units of its width.
FLAT = 1e-6
# Least curvature along any direction, in curvatures of the settings.
LEAST = 0.05
# Standard deviation of a curvature about the expected one, in curvatures.
HELD = 0.3


@dataclass(frozen=True)
class Range:
    """Where a setting is sought.

    Attributes:
        start: first value, in (low, high).
        low, high: bounds, > 0; of a probability < 1.
        probability: whether it is one.
    """

    start: float
    low: float
    high: float
    probability: bool = False

    @classmethod
    def about(cls, start: float, times: float = FARTHEST) -> Range:
        """Up to so many ``times`` from ``start``, both ways."""
        return cls(start, start / times, start * times)

    def scaled(self, value: float) -> float:
        """The value on the scale of the search."""
        return float(logit(value) if self.probability else np.log(value))

    def value(self, scaled: float) -> float:
        """The value of a place on that scale, within the bounds."""
        bounded = np.clip(scaled, self.scaled(self.low), self.scaled(self.high))
        return float(expit(bounded) if self.probability else np.exp(bounded))


@dataclass(frozen=True)
class FittedSetting:
    """The most likely value of a setting, and its interval of 95 % by profile."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class _Surface:
    """``c - (x - centre)' curvature (x - centre)``, in the scale of the search.

    Attributes:
        centre: ``(P,)`` its maximum.
        curvature: ``(P, P)`` positive definite.
        roughness: ``(P,)`` standard error of the maximum that comes of the particles.
    """

    centre: FloatArray
    curvature: FloatArray
    roughness: FloatArray

    def moved(self, centre: FloatArray, widths: FloatArray) -> _Surface:
        """The same in another scale, whose origin and unit were ``centre`` and ``widths`` ``(P,)``."""
        curvature = self.curvature / np.outer(widths, widths)
        return _Surface(centre + widths * self.centre, curvature, widths * self.roughness)

    @property
    def deviation(self) -> FloatArray:
        """``(P,)`` half the width, over `NORMAL_95`, in which the profile of each setting is above its cut-off."""
        return np.asarray(np.sqrt(0.5 * np.diag(np.linalg.inv(self.curvature)) + self.roughness**2))


def fitted_text(fitted: Mapping[str, FittedSetting], options: Mapping[str, object]) -> str:
    """Options as YAML for ``--config``, or a model, beneath what was fitted and its intervals as comments."""
    heads = [f"# {name}: {s.value:.4g}, 95 % from {s.low:.4g} to {s.high:.4g}\n" for name, s in fitted.items()]
    return "".join(heads) + yaml.safe_dump(dict(options), sort_keys=False, default_flow_style=None)


def fit_settings(log_evidence: LogEvidence, ranges: Mapping[str, Range], seed: int = 0) -> dict[str, FittedSetting]:
    """The settings by name that make a recording most likely.

    Args:
        log_evidence: must give the same for the same settings.
        ranges: of the settings to fit.
        seed: of the settings tried around the maximum.
    """
    bounds = np.array([[r.scaled(r.low), r.scaled(r.high)] for r in ranges.values()])

    def lowered(place: FloatArray) -> float:
        """What to minimise, at a place on the scale of the search, moved into the bounds."""
        names = zip(ranges.items(), np.clip(place, *bounds.T).tolist(), strict=True)
        return -log_evidence({name: bounded.value(x) for (name, bounded), x in names})

    start = np.array([bounded.scaled(bounded.start) for bounded in ranges.values()])
    steps = {"initial_tr_radius": FIRST_STEP, "final_tr_radius": LAST_STEP, "maxfev": CLIMB * len(start)}
    best = minimize(lowered, start, method="COBYQA", bounds=bounds, options=steps).x
    surface = _surface(lowered, best, bounds, np.random.default_rng(seed))
    reach = NORMAL_95 * surface.deviation
    lines = zip(ranges.items(), surface.centre, surface.centre - reach, surface.centre + reach, strict=True)
    return {name: FittedSetting(*(bounded.value(float(x)) for x in places)) for (name, bounded), *places in lines}


def _surface(
    lowered: Callable[[FloatArray], float], best: FloatArray, bounds: FloatArray, rng: np.random.Generator
) -> _Surface:
    """The surface by all settings drawn about the best ones, and then about its maximum where that is better."""
    probes = [lowered(best + HAIR * rng.standard_normal(len(best))) for _ in range(PROBES)]
    (widths, drops), centre = (
        _widths(lowered, best, float(np.median(probes)), DROP + ABOVE * float(np.std(probes))),
        best,
    )
    count = round(DRAWS * (1 + len(best)) * (2 + len(best)) / 2)
    places, heights = np.empty((0, len(best))), np.empty(0)
    surface = _Surface(best, np.diag(drops / widths**2), np.zeros(len(best)))
    for _ in range(ROUNDS):
        drawn = np.clip(centre + widths * rng.uniform(-1.0, 1.0, (count, len(best))), *bounds.T)
        places = np.concatenate([places, drawn])
        heights = np.concatenate([heights, [-lowered(place) for place in drawn]])
        surface = _fitted((places - centre) / widths, heights, drops).moved(centre, widths)
        surface = replace(surface, centre=np.clip(surface.centre, *bounds.T))
        centre = surface.centre
    return surface


def _widths(
    lowered: Callable[[FloatArray], float], best: FloatArray, least: float, wanted: float
) -> tuple[FloatArray, FloatArray]:
    """How far each setting alone moves ``(P,)`` until the log evidence is some ``wanted`` lower, and how much it is."""
    widths, drops = np.full(len(best), 0.15), np.full(len(best), wanted)
    for column in range(len(best)):
        for _ in range(2 * ROUNDS):
            aside = np.zeros(len(best))
            aside[column] = widths[column]
            drop = 0.5 * (lowered(best + aside) + lowered(best - aside)) - least
            drops[column] = max(drop, FLAT)
            if wanted / 3 < drop < 3 * wanted or (drop < wanted and widths[column] == WIDEST):
                break
            widths[column] = min(widths[column] * np.clip(np.sqrt(wanted / drops[column]), 0.25, 4.0), WIDEST)
    return widths, drops


def _fitted(places: FloatArray, heights: FloatArray, drops: FloatArray) -> _Surface:
    """The surface over heights ``(N,)`` at places ``(N, P)`` about the origin, by least squares.

    It is held near one that is `drops` ``(P,)`` lower a unit away along each axis: a rough one could rise elsewhere.
    """
    count, size = places.shape
    rows, columns = np.triu_indices(size)
    design = np.column_stack([np.ones(count), places, places[:, rows] * places[:, columns]])
    expected = np.concatenate([np.zeros(1 + size), np.where(rows == columns, -drops[rows], 0.0)])
    firmness = np.concatenate([np.zeros(1 + size), 1.0 / (HELD**2 * drops[rows] * drops[columns])])
    weights = np.ones(count)
    for _ in range(ROUNDS):
        # Huber's weights: a target lost by chance lowers the log evidence far more than usual.
        plain, *_ = np.linalg.lstsq(np.sqrt(weights)[:, None] * design, np.sqrt(weights) * heights, rcond=None)
        away = np.abs(heights - design @ plain)
        error = max(float(np.sum(weights * away**2)) / (count - design.shape[1]), FLAT)
        weights = np.minimum(1.0, 1.5 * np.sqrt(error) / np.maximum(away, FLAT))
    weighted = design.T * (weights / error)
    spread = np.linalg.inv(weighted @ design + np.diag(firmness))
    coefficients = spread @ (weighted @ heights + firmness * expected)
    slopes, curvature = slice(1, 1 + size), np.zeros((size, size))
    curvature[rows, columns] = -coefficients[1 + size :]
    unit = np.sqrt(np.outer(drops, drops))
    values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T) / unit)
    inverse = vectors / np.maximum(values, LEAST) @ vectors.T / unit
    maximum = np.clip(0.5 * inverse @ coefficients[slopes], -2.0, 2.0)
    roughness = np.sqrt(np.diag(0.25 * inverse @ spread[slopes, slopes] @ inverse))
    return _Surface(maximum, np.linalg.inv(inverse), roughness)
