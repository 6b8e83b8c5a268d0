"""How likely steps of fish are under what was learnt, in nats: what a correlation is worth before any filter runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.bodies.motion import Steps, regression
from tsuiseki.trainers.experiments.goldfish.arms import LAG
from tsuiseki.trainers.experiments.intervals import interval


def learnt_densities(exact: Steps, wide: Steps, test: Sequence[Steps]) -> list[list[str]]:
    """Rows of a table: mean log-density of the test clips' steps, learnt from exact states and from a wide run.

    Args:
        exact: steps of the exact states of the learning clips.
        wide: of the wide run over the same clips.
        test: exact steps of each test clip.
    """
    rows = []
    for title, steps in (("exact states", exact), ("a wide run of 3000 particles", wide)):
        free, own, lagged = (
            np.array([density(steps, clip, correlated, lag) for clip in test])
            for correlated, lag in ((False, False), (True, False), (True, True))
        )
        correlation = np.asarray(np.corrcoef(steps.increments.T))[1, 3]
        rows.append([title, f"{correlation:+.2f}", _shown(free), _shown(own - free, "+"), _shown(lagged - own, "+")])
    return rows


def density(learnt: Steps, steps: Steps, correlated: bool, lag: bool) -> float:
    """Mean log-density of the increments ``steps`` under a Gaussian of the increments ``learnt``.

    Args:
        learnt: teaches mean and covariance.
        steps: are judged.
        correlated: False takes the variances alone.
        lag: the mean follows the last changes of heading and bend.
    """
    taught, judged = learnt.increments, steps.increments
    if lag:
        columns = list(LAG)
        gain, taught = regression(learnt.conditions[:, columns], taught)
        judged = judged - steps.conditions[:, columns] @ gain.T
    covariance = np.cov(taught.T)
    if not correlated:
        covariance = np.diag(np.diag(covariance))
    away = judged - taught.mean(axis=0)
    _, log_size = np.linalg.slogdet(2 * np.pi * covariance)
    return float(np.mean(-0.5 * np.einsum("nd,nd->n", away, np.linalg.solve(covariance, away.T).T) - 0.5 * log_size))


def _shown(values: FloatArray, sign: str = "") -> str:
    mean, low, high = (f"{one:{sign}.2f}" for one in interval(values))
    return f"{mean} [{low}, {high}]"
