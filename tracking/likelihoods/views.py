"""How well each camera's view agrees with positions in space: by outline, background difference or measured pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.likelihoods.background import colour_difference
from tsuiseki.tracking.likelihoods.sphere import ContourSettings, outline_support, polar_maps
from tsuiseki.tracking.types import FloatArray, ImageArray

Views: TypeAlias = Sequence[NDArray[Any] | None]
"""One image ``(H, W, 3)`` uint8, or one measured pixel ``(2,)``, a camera; None where it has nothing now."""


class ViewLikelihood(Protocol):
    """``(N, C)`` log-ratio of what each view shows given each position ``(N, 3)`` to what it would show anyway.

    Zero where a view says nothing: no frame, or the particle is out of its sight.
    """

    def __call__(self, positions: FloatArray, views: Views) -> FloatArray: ...


@dataclass(frozen=True)
class ContourLikelihood:
    """Section 2.2.2; see `tracking.likelihoods.sphere`."""

    cameras: Sequence[PinholeCamera]
    radius: float
    settings: ContourSettings = field(default_factory=ContourSettings)

    def __call__(self, positions: FloatArray, views: Views) -> FloatArray:
        ratios = np.zeros((len(positions), len(self.cameras)))
        for k, (camera, image) in enumerate(zip(self.cameras, views, strict=True)):
            if image is None:
                continue
            maps = polar_maps(camera, positions, self.radius, self.settings)
            support, share = outline_support(image, maps, self.settings).T
            ratios[:, k] = self.settings.steepness * share * (support - self.settings.clutter)
        return ratios

    def broad(self) -> ContourLikelihood:
        """One that notices a ball from farther off, at a third of the cost: for searching."""
        return replace(self, settings=replace(self.settings, angles=12, radii=10, width=0.2))


@dataclass(frozen=True)
class BackgroundLikelihood:
    """Section 2.2.1: the colour differences from the background, multiplied over the cameras.

    Attributes:
        cameras: C cameras.
        backgrounds: C images of the empty scene.
        noise: grey levels added to each difference, so that one zero does not rule a particle out.
    """

    cameras: Sequence[PinholeCamera]
    backgrounds: Sequence[ImageArray]
    noise: float = 1.0

    def __call__(self, positions: FloatArray, views: Views) -> FloatArray:
        ratios = np.zeros((len(positions), len(self.cameras)))
        for k, (camera, image) in enumerate(zip(self.cameras, views, strict=True)):
            if image is not None:
                difference, inside = colour_difference(camera, image, self.backgrounds[k], positions)
                ratios[:, k] = np.where(inside, np.log(difference + self.noise), np.log(self.noise))
        return ratios


@dataclass(frozen=True)
class PointLikelihood:
    """Measured pixels of the target's centre: Gaussian with a share of false ones spread over the image.

    Attributes:
        cameras: C cameras.
        sigma: ``(C,)`` standard deviation along x and y, pixels.
    """

    cameras: Sequence[PinholeCamera]
    sigma: FloatArray

    def __call__(self, positions: FloatArray, views: Views) -> FloatArray:
        ratios = np.zeros((len(positions), len(self.cameras)))
        for k, (camera, pixel) in enumerate(zip(self.cameras, views, strict=True)):
            if pixel is None:
                continue
            projected, _ = camera.project(positions)
            square = np.square(projected - pixel).sum(axis=1) / self.sigma[k] ** 2
            density = camera.width * camera.height / (2 * np.pi * self.sigma[k] ** 2)
            ratios[:, k] = np.log(density) - 0.5 * np.nan_to_num(square, nan=1e4)
        return np.maximum(ratios, -500.0)
