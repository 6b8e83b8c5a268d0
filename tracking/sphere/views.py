"""How well each camera's view agrees with positions in space: by outline, background difference or measured pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.sphere.background import colour_difference
from tsuiseki.tracking.sphere.likelihood import ContourSettings, outline_support, polar_maps
from tsuiseki.tracking.types import FloatArray, ImageArray


def beside(count: int = 64, nearest: float = 2.0, farthest: float = 5.0) -> FloatArray:
    """``(count, 3)`` places evenly spread over directions (a Fibonacci spiral), their distances taking turns."""
    k = np.arange(count)
    z, turn = 1 - (2 * k + 1) / count, k * np.pi * (3 - np.sqrt(5))
    directions = np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    # Golden steps, so that neighbours on the spiral differ.
    return np.asarray(directions * (nearest + (farthest - nearest) * (k * 0.618034 % 1))[:, None])


Views: TypeAlias = Sequence[NDArray[Any] | None]
"""One image ``(H, W, 3)`` uint8, or one measured pixel ``(2,)``, a camera; None where it has nothing now."""

SMALL = 6.0
"""Radius of an outline that is faint for being small, pixels."""
BESIDE = beside()
"""Where the support of what is no ball is measured: ``(64, 3)``, 2 to 5 radii from the particles' middle."""


class ViewLikelihood(Protocol):
    """``(N, C)`` log-ratio of what each view shows given each position ``(N, 3)`` to what it would show anyway.

    Zero where a view says nothing: no frame, or the particle is out of its sight.
    """

    def __call__(self, positions: FloatArray, views: Views) -> FloatArray: ...


@dataclass(frozen=True)
class ContourLikelihood:
    """Section 2.2.2; see `tracking.likelihoods.sphere`.

    Small and blurred outlines have less support than sharp ones, and so has all else in such an image. Where an outline
    is faint the support that says nothing is the mean of that beside the particles, at most ``settings.clutter``.

    Attributes:
        cameras: C cameras.
        radius: of the sphere, metres.
        settings: of the samples, and how they count.
        faint: whether outlines are; by default those of a radius below `SMALL` pixels.
    """

    cameras: Sequence[PinholeCamera]
    radius: float
    settings: ContourSettings = field(default_factory=ContourSettings)
    faint: bool | None = None

    def __call__(self, positions: FloatArray, views: Views) -> FloatArray:
        ratios = np.zeros((len(positions), len(self.cameras)))
        for k, (camera, image) in enumerate(zip(self.cameras, views, strict=True)):
            if image is None:
                continue
            maps = polar_maps(camera, positions, self.radius, self.settings)
            support, share = outline_support(image, maps, self.settings).T
            clutter = self._clutter(camera, image, np.median(positions, axis=0)) if len(positions) else 0.0
            ratios[:, k] = self.settings.steepness * share * (support - clutter)
        return ratios

    def _clutter(self, camera: PinholeCamera, image: ImageArray, middle: FloatArray) -> float:
        """The support that says nothing about ``middle`` ``(3,)``, metres."""
        most, depth = self.settings.clutter, float(camera.to_camera(middle[None])[0, 2])
        small = depth > 0 and camera.focal.mean() * self.radius < SMALL * depth
        if not (small if self.faint is None else self.faint):
            return most
        maps = polar_maps(camera, middle + self.radius * BESIDE, self.radius, self.settings)
        support, share = outline_support(image, maps, self.settings).T
        seen = support[share > 0]
        return min(most, float(seen.mean())) if len(seen) else most

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
