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

from tsuiseki.tracking.filters.particles.weights import logarithms
from tsuiseki.tracking.types import FloatArray, IntArray

LARGEST_LOG_RATIO = float(np.log(1e12))
"""Bound of the ratio's logarithm, so that one particle cannot stand for all."""


@dataclass(frozen=True)
class Regions:
    """What the update looks at.

    Attributes:
        log_weights: ``(N,)`` predicted.
        log_likelihood: ``(N,)`` logarithm of ``h = p (1 - q)``, NaN for a target hidden by others.
        starts: ``(G,)`` first particle of each cluster.
        background: ``b``, what ``h`` reaches on background.
        detection: ``pD``.
    """

    log_weights: FloatArray
    log_likelihood: FloatArray
    starts: IntArray
    background: float
    detection: float

    @property
    def weights(self) -> FloatArray:
        """``(N,)`` expected targets of each particle."""
        return np.asarray(np.exp(self.log_weights))

    @property
    def likelihood(self) -> FloatArray:
        """``(N,)`` ``h``, zero for a target hidden by others."""
        return np.asarray(np.nan_to_num(np.exp(self.log_likelihood)))

    def sums(self, values: FloatArray) -> FloatArray:
        """Sums ``(G,)`` over the clusters of values ``(N,)``."""
        return np.asarray(np.add.reduceat(values, self.starts)) if len(self.starts) else np.empty(0)

    def spread(self, values: FloatArray) -> FloatArray:
        """Values ``(G,)`` of the clusters at their particles ``(N,)``."""
        return np.repeat(values, np.diff(self.starts, append=len(self.log_weights)))


Update = Callable[[Regions], FloatArray]
"""The log-weights ``(N,)`` after the update."""


def as_printed(regions: Regions) -> FloatArray:
    """(45) with the likelihood (68) in the place of (46), as section 6.2 has it."""
    return logarithms(regions.weights * (1.0 - regions.detection + regions.detection * regions.likelihood))


@dataclass(frozen=True)
class Calibrated:
    """(45) with the ratio of the likelihood to its value on background, cluster by cluster; see the module.

    Attributes:
        sharpness: power of the ratio, > 0. Above 1 it makes up for ``p (1 - q)`` being flat about its top.
    """

    sharpness: float = 4.0

    def __call__(self, regions: Regions) -> FloatArray:
        log_ratio = np.minimum(
            self.sharpness * (regions.log_likelihood - np.log(regions.background)), LARGEST_LOG_RATIO
        )
        ratio = np.exp(np.where(np.isnan(log_ratio), 0.0, log_ratio))  # hidden: the image says nothing
        weights = regions.weights
        joint = weights * (1.0 - regions.detection + regions.detection * ratio)
        mass = np.minimum(regions.sums(weights), 1.0)
        total = 1.0 - mass + regions.sums(joint)
        return logarithms(joint / regions.spread(np.maximum(total, np.finfo(np.float64).tiny)))


calibrated = Calibrated()


def greatest(regions: Regions) -> FloatArray:
    """Greatest likelihood ``(G,)`` in each cluster, which the paper compares."""
    return np.asarray(np.maximum.reduceat(regions.likelihood, regions.starts))


def average(regions: Regions) -> FloatArray:
    """Mean likelihood ``(G,)`` in each cluster: once it is equal, no cluster gains weight on another.

    With equal greatest values a cluster that sits tighter about its top still does, step after step.
    """
    weights = regions.weights
    mass = np.maximum(regions.sums(weights), np.finfo(np.float64).tiny)
    return regions.sums(weights * regions.likelihood) / mass


@dataclass(frozen=True)
class Equalised:
    """Raises the likelihood of every target to the same level before the update, end of section 6.2.

    The log-likelihood of each cluster is raised by what its level lacks to the highest; without it the particles of a
    target of low likelihood die out.

    Attributes:
        update: what follows.
        level: :func:`greatest` as printed, or :func:`average`.
        visible: a cluster whose likelihood nowhere reaches this is not a target and stays as it is.
    """

    update: Update
    level: Callable[[Regions], FloatArray] = greatest
    visible: float = 0.1

    def __call__(self, regions: Regions) -> FloatArray:
        if len(regions.starts) == 0:
            return self.update(regions)
        seen = greatest(regions) >= self.visible
        level = np.maximum(self.level(regions), 1e-6)
        raised = np.where(seen, np.max(level[seen], initial=0.0) / level, 1.0)
        return self.update(replace(regions, log_likelihood=regions.log_likelihood + regions.spread(np.log(raised))))
