"""What a frame does to the weights of coloured regions: alternatives for (46), where nothing was measured as a point.

* :func:`as_printed`: the likelihood ``h = p (1 - q)`` itself. Since ``h <= 1`` the expected count can only shrink,
  whatever the image shows: the weights rank particles, and their sum means nothing.
* :func:`calibrated`: the likelihood over its value ``b`` on background. Take (46) for one cluster of weight ``m`` and
  the part of the image under it as the one measurement ``y`` there. If no target is there, ``y`` is background, with
  density proportional to ``b``; this takes the place of the clutter ``mu_C p_C(y)`` and is weighed by the probability
  ``1 - m`` that the cluster is nothing. (45) then reads ``D'(x) = {(1 - pD) + pD h(x)/b} D(x) / {(1 - m) + m <(1 - pD)
  + pD h/b>}``: the posterior of a target that is there or not. A cluster seen well above the background weighs about
  one however pure its colour, one seen at the level of the background keeps its weight, one not seen loses it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.types import FloatArray, IntArray


@dataclass(frozen=True)
class Regions:
    """What the update looks at.

    Attributes:
        weights: ``(N,)`` predicted.
        likelihood: ``(N,)`` ``h = p (1 - q)``, NaN for a target hidden by others.
        starts: ``(G,)`` first particle of each cluster.
        background: ``b``, what the likelihood reaches on background.
        detection: ``pD``.
    """

    weights: FloatArray
    likelihood: FloatArray
    starts: IntArray
    background: float
    detection: float

    def sums(self, values: FloatArray) -> FloatArray:
        """Sums ``(G,)`` over the clusters of values ``(N,)``."""
        return np.asarray(np.add.reduceat(values, self.starts)) if len(self.starts) else np.empty(0)

    def spread(self, values: FloatArray) -> FloatArray:
        """Values ``(G,)`` of the clusters at their particles ``(N,)``."""
        return np.repeat(values, np.diff(np.append(self.starts, len(self.weights))))


Update = Callable[[Regions], FloatArray]
"""The weights ``(N,)`` after the update."""


def as_printed(regions: Regions) -> FloatArray:
    """(45) with the likelihood (68) in the place of (46), as section 6.2 has it."""
    return regions.weights * (1.0 - regions.detection + regions.detection * np.nan_to_num(regions.likelihood))


@dataclass(frozen=True)
class Calibrated:
    """(45) with the ratio of the likelihood to its value on background, cluster by cluster; see the module.

    Attributes:
        sharpness: power of the ratio, > 0. Above 1 it makes up for ``p (1 - q)`` being flat about its top.
    """

    sharpness: float = 4.0

    def __call__(self, regions: Regions) -> FloatArray:
        ratio = np.minimum(regions.likelihood / regions.background, 1e12 ** (1.0 / self.sharpness)) ** self.sharpness
        ratio = np.where(np.isnan(ratio), 1.0, ratio)  # hidden: the image says nothing
        joint = regions.weights * (1.0 - regions.detection + regions.detection * ratio)
        mass = np.minimum(regions.sums(regions.weights), 1.0)
        total = 1.0 - mass + regions.sums(joint)
        return joint / regions.spread(np.maximum(total, np.finfo(np.float64).tiny))


calibrated = Calibrated()


def greatest(regions: Regions) -> FloatArray:
    """Greatest likelihood ``(G,)`` in each cluster, which the paper compares."""
    return np.nan_to_num(np.fmax.reduceat(regions.likelihood, regions.starts))


def average(regions: Regions) -> FloatArray:
    """Mean likelihood ``(G,)`` in each cluster: once it is equal, no cluster gains weight on another.

    With equal greatest values a cluster that sits tighter about its top still does, step after step.
    """
    mass = np.maximum(regions.sums(regions.weights), np.finfo(np.float64).tiny)
    return regions.sums(regions.weights * np.nan_to_num(regions.likelihood)) / mass


@dataclass(frozen=True)
class Equalised:
    """Raises the likelihood of every target to the same level before the update, end of section 6.2.

    The log-likelihood of each cluster is raised by what its level lacks to the highest; without it the particles of a
    target of low likelihood die out.

    Attributes:
        update: what follows.
        level: :func:`greatest` as printed, or :func:`average`.
        least: a cluster whose likelihood nowhere reaches this is not a target and stays as it is.
    """

    update: Update
    level: Callable[[Regions], FloatArray] = greatest
    least: float = 0.1

    def __call__(self, regions: Regions) -> FloatArray:
        if len(regions.starts) == 0:
            return self.update(regions)
        seen = greatest(regions) >= self.least
        level = np.maximum(self.level(regions), 1e-6)
        raised = np.where(seen, np.max(level[seen], initial=0.0) / level, 1.0)
        return self.update(replace(regions, likelihood=regions.likelihood * regions.spread(raised)))
