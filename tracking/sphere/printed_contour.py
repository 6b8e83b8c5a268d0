"""Section 2.2.2 of the sphere paper as it is printed, and the steps from there to `views.ContourLikelihood`.

The likelihood of a particle in one camera is the plain sum, over all angles and radii of the polar image around it, of
the absolute derivative along r, weighted by a Gaussian around r0. Cameras are multiplied, as 2.2.1 says. The weights
are "normalised to 0 to 1": either divided by their sum, or scaled from least to greatest (`MinMaxWeights`); the paper
does not say which.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tsuiseki.tracking.cameras.outline import sphere_circles
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.sphere.likelihood import ContourSettings, OutlinesOf, outline_sums, outline_support, polar_maps
from tsuiseki.tracking.sphere.views import ViewLikelihood, Views
from tsuiseki.tracking.types import FloatArray


@dataclass(frozen=True)
class PrintedContourLikelihood:
    """The logarithm of the plain sum, 2.2.2; rays that leave the image add nothing.

    Attributes:
        cameras: C cameras.
        radius: of the sphere, metres.
        settings: of the samples and the Gaussian; `contrast`, `steepness` and `clutter` are not used.
        outlines_of: where r0 lies: a circle, as printed, or the true ellipse (`sphere_outlines`).
        power: of the likelihood; 1 as printed.
    """

    cameras: Sequence[PinholeCamera]
    radius: float
    settings: ContourSettings = field(default_factory=ContourSettings)
    outlines_of: OutlinesOf = sphere_circles
    power: float = 1.0

    def __call__(self, positions: FloatArray, views: Views) -> FloatArray:
        ratios = np.zeros((len(positions), len(self.cameras)))
        for k, (camera, image) in enumerate(zip(self.cameras, views, strict=True)):
            if image is not None:
                maps = polar_maps(camera, positions, self.radius, self.settings, self.outlines_of)
                peak, _ = outline_sums(image, maps, self.settings)
                total = np.where(maps.inside, peak, 0.0).sum(axis=1, dtype=np.float64)
                ratios[:, k] = self.power * _logarithms(total)
        return ratios


@dataclass(frozen=True)
class DividedContourLikelihood:
    """The logarithm of the sum over the rays, each ray's sum divided by that without the Gaussian, plus `contrast`.

    One strong edge weighs no more than a whole weak outline then. Not in the paper; without the exponential of
    `views.ContourLikelihood`.

    Attributes:
        cameras: C cameras.
        radius: of the sphere, metres.
        settings: of the samples, the Gaussian and the contrast.
        outlines_of: where r0 lies.
    """

    cameras: Sequence[PinholeCamera]
    radius: float
    settings: ContourSettings = field(default_factory=ContourSettings)
    outlines_of: OutlinesOf = sphere_circles

    def __call__(self, positions: FloatArray, views: Views) -> FloatArray:
        ratios = np.zeros((len(positions), len(self.cameras)))
        for k, (camera, image) in enumerate(zip(self.cameras, views, strict=True)):
            if image is not None:
                maps = polar_maps(camera, positions, self.radius, self.settings, self.outlines_of)
                support, share = outline_support(image, maps, self.settings).T
                ratios[:, k] = _logarithms(support * share)
        return ratios


@dataclass(frozen=True)
class MinMaxWeights:
    """The product over the cameras scaled so that the least of the particles' weights is 0 and the greatest 1.

    Attributes:
        likelihood: whose product is scaled.
    """

    likelihood: ViewLikelihood

    def __call__(self, positions: FloatArray, views: Views) -> FloatArray:
        ratios = self.likelihood(positions, views)
        product = np.exp(ratios.sum(axis=1) - ratios.sum(axis=1).max(initial=-700.0))
        least, greatest = float(product.min(initial=1.0)), float(product.max(initial=0.0))
        scaled = np.zeros_like(ratios)
        # Equal weights stay equal.
        scaled[:, 0] = _logarithms((product - least) / (greatest - least)) if greatest > least else 0.0
        return scaled


def _logarithms(values: FloatArray) -> FloatArray:
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(values))
