"""How well each camera's view agrees with positions in space: by outline, background difference or measured pixel.

An outline's samples are those of section 2.2.2 of the sphere paper. Each image is resampled in polar coordinates about
the projected centre of every particle; the absolute first derivative along r is weighted by a Gaussian around the
radius r0 that the sphere has there, and summed (`outline_sums`). r0 follows the true, elliptic outline
(`tracking.cameras.outline`), or a circle: samples lie on the rays from the projected centre through the outline, at r /
r0 from ``1 - reach`` to ``1 + reach``.

`PrintedContourLikelihood` is the paper to the letter: the plain sum over all rays. Cameras are multiplied, as 2.2.1
says, and weights are divided by their sum. `SphereContourLikelihood` is ours: it divides each ray's sum by the sum
without the Gaussian (`outline_support`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Annotated, Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveFloat
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.cameras.outline import Outlines, sphere_circles, sphere_outlines
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.cameras.volume import in_view
from tsuiseki.tracking.filters.resampling import logarithms
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray

# cv2.remap takes fewer than 32768 columns.
MOST_COLUMNS = 32000
# Variation along a ray at which an edge counts half, grey levels summed over the three channels.
CONTRAST = 60.0
# Log-likelihood of a perfect outline over none.
STEEPNESS = 60.0
# Support of a view that changes no weight, in [0, 1]: that of strong and even texture, the mean of the Gaussian.
CLUTTER = 0.30
# Grey levels added to each difference from the background, so that one zero does not rule a particle out.
NOISE = 1.0
OutlinesOf: TypeAlias = Callable[[PinholeCamera, FloatArray, float], Outlines]
"""Outlines of spheres of a radius at ``(N, 3)`` centres."""


@pydantic_dataclass(frozen=True, config=SETTINGS)
class ContourSettings:
    """What is sampled.

    Attributes:
        angles: A, number of rays around the centre, from 4.
        radii: R, number of samples along each ray, from 3.
        reach: half the sampled range of r / r0, in (0, 1).
        width: standard deviation of the Gaussian over r / r0.
    """

    angles: Annotated[int, Field(ge=4, le=1000)] = 24
    radii: Annotated[int, Field(ge=3, le=1000)] = 16
    reach: Annotated[float, Field(gt=0, lt=1)] = 0.5
    width: PositiveFloat = 0.12


@dataclass(frozen=True)
class PolarMaps:
    """Where `cv2.remap` samples one camera for N particles.

    Attributes:
        columns: ``(R, N * A)`` float32, the angle fastest.
        rows: ``(R, N * A)`` float32, the angle fastest.
        inside: ``(N, A)`` whether the whole ray lies in the image.
    """

    columns: NDArray[np.float32]
    rows: NDArray[np.float32]
    inside: NDArray[np.bool_]


def polar_maps(
    camera: PinholeCamera,
    centres: FloatArray,
    radius: float,
    settings: ContourSettings,
    outlines_of: OutlinesOf = sphere_outlines,
) -> PolarMaps:
    """The polar samples around spheres at ``centres`` ``(N, 3)`` of a ``radius``, metres.

    A sample is ``centre + s (outline(t) - centre)``. OpenCV counts pixels from the first one's centre, here it is 0.5.
    Outlines are the true ellipses, or the circles of `sphere_circles`.
    """
    outlines = outlines_of(camera, centres, radius)
    centre = outlines.centre - 0.5
    spokes = np.stack([outlines.middle - outlines.centre, outlines.first, outlines.second], axis=2)
    # A particle behind the camera has NaN here, which remap must not see.
    visible = np.isfinite(spokes).all(axis=(1, 2))
    centre[~visible], spokes[~visible] = -1e4, 0.0
    around, shares = _polar_grid(settings)
    columns, rows = (
        # Long rows, for the angles alone would be short ones.
        np.repeat(centre[:, axis].astype(np.float32), settings.angles)
        + shares * (spokes[:, axis].astype(np.float32) @ around).ravel()
        for axis in (0, 1)
    )
    inside = (columns[-1] >= 0) & (columns[-1] <= camera.width - 1)
    inside &= (rows[-1] >= 0) & (rows[-1] <= camera.height - 1)
    return PolarMaps(columns, rows, inside.reshape(-1, settings.angles))


def outline_sums(
    image: ImageArray, maps: PolarMaps, settings: ContourSettings
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """``(N, A)`` each: the Gaussian sum of 2.2.2 along every ray, and the sum without the Gaussian; grey levels."""
    samples = fetch(image, maps)
    slopes = cv2.absdiff(samples[1:], samples[:-1]).reshape(settings.radii - 1, -1).astype(np.float32)
    # One product gives both.
    sums = (_radial_weights(settings) @ slopes).reshape(2, *maps.inside.shape, -1)
    peak, plain = sums if sums.shape[3] == 1 else sums[..., :1] + sums[..., 1:2] + sums[..., 2:]
    return peak[..., 0], plain[..., 0]


def outline_support(image: ImageArray, maps: PolarMaps, settings: ContourSettings) -> FloatArray:
    """``(N, 2)``: the support of each particle's outline in [0, 1], and the share of it that lies in the image."""
    peak, plain = outline_sums(image, maps, settings)
    response = peak / (plain + np.float32(CONTRAST))
    count = maps.inside.sum(axis=1)
    support = np.einsum("na,na->n", response, maps.inside.astype(np.float32)) / np.maximum(count, 1)
    return np.stack([support, count / settings.angles], axis=1).astype(np.float64)


def fetch(image: ImageArray, maps: PolarMaps) -> ImageArray:
    """The samples ``(R, N * A * channels)`` uint8 of ``image`` ``(H, W, 3)`` or ``(H, W)``."""
    parts = []
    for first in range(0, maps.columns.shape[1], MOST_COLUMNS):
        part = slice(first, first + MOST_COLUMNS)
        samples = cv2.remap(
            image, maps.columns[:, part], maps.rows[:, part], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        parts.append(samples.reshape(len(samples), -1))
    return np.asarray(parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1), dtype=np.uint8)


@cache
def _polar_grid(settings: ContourSettings) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """``(3, A)`` ones, cosines and sines of the angles, and ``(R, 1)`` the shares s of the radii."""
    t = np.arange(settings.angles) * (2 * np.pi / settings.angles)
    around = np.stack([np.ones_like(t), np.cos(t), np.sin(t)]).astype(np.float32)
    return around, np.linspace(1 - settings.reach, 1 + settings.reach, settings.radii, dtype=np.float32)[:, None]


@cache
def _radial_weights(settings: ContourSettings) -> NDArray[np.float32]:
    """``(2, R - 1)``: the Gaussian around r0 at the middles between samples, and ones."""
    between = ((np.arange(settings.radii - 1) + 0.5) / (settings.radii - 1) * 2 - 1) * settings.reach
    return np.stack([np.exp(-0.5 * (between / settings.width) ** 2), np.ones(len(between))]).astype(np.float32)


def colour_difference(
    camera: PinholeCamera, image: ImageArray, background: ImageArray, points: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """How far the colour at each projected point ``(N, 3)``, metres, lies from that of the empty scene.

    Returns:
        ``(N,)`` Euclidean distance of the two colours, [0, 442], and ``(N,)`` bool whether the point is in the image;
        elsewhere the difference is zero.
    """
    pixels, _ = camera.project(points)
    inside = in_view(camera, points)
    maps = np.where(inside[:, None], pixels - 0.5, 0.0).astype(np.float32)[:, None]
    colours = [
        cv2.remap(picture, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).reshape(-1, 3)
        for picture in (image, background)
    ]
    difference = np.sqrt(np.square(colours[0].astype(np.float64) - colours[1]).sum(axis=1))
    return np.where(inside, difference, 0.0), inside


def median_background(images: list[ImageArray]) -> ImageArray:
    """The median over time of each pixel: the background of a fixed camera if most of the time nothing covers it."""
    return np.asarray(np.median(np.stack(images), axis=0), dtype=np.uint8)


def _beside() -> FloatArray:
    """``(64, 3)`` places evenly spread over directions (a Fibonacci spiral), 2 to 5 from the origin in turns."""
    k = np.arange(64)
    z, turn = 1 - (2 * k + 1) / 64, k * np.pi * (3 - np.sqrt(5))
    directions = np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    # Golden steps, so that neighbours on the spiral differ.
    return np.asarray(directions * (2.0 + 3.0 * (k * 0.618034 % 1))[:, None])


Views: TypeAlias = Sequence[NDArray[Any] | None]
"""One image ``(H, W, 3)`` uint8, or one measured pixel ``(2,)``, a camera; None where it has nothing now."""

# Radius of an outline that is faint for being small, pixels.
SMALL = 6.0
BESIDE = _beside()
"""Where the support of what is no ball is measured: ``(64, 3)``, 2 to 5 radii from the particles' middle."""


@dataclass(frozen=True)
class ViewLikelihood(ABC):
    """How well each view agrees with positions; of one camera after the other.

    Attributes:
        cameras: C cameras.
    """

    cameras: Sequence[PinholeCamera]

    def __call__(self, positions: FloatArray, views: Views) -> FloatArray:
        """``(N, C)`` log-ratio of what each view shows given each position ``(N, 3)`` to what it would show anyway.

        Zero where a view says nothing: no frame, or the particle is out of its sight.
        """
        ratios = np.zeros((len(positions), len(self.cameras)))
        for k, view in enumerate(views):
            if view is not None:
                ratios[:, k] = self.weigh(k, positions, view)
        return ratios

    @abstractmethod
    def weigh(self, k: int, positions: FloatArray, view: NDArray[Any]) -> FloatArray:
        """``(N,)`` log-ratios by the view of camera ``k``."""


@dataclass(frozen=True)
class SphereContourLikelihood(ViewLikelihood):
    """Section 2.2.2 with support instead of sums; see the module.

    Small and blurred outlines have less support than sharp ones, and so has all else in such an image. Where an outline
    is faint the support that says nothing is the mean of that beside the particles, at most `CLUTTER`.

    Attributes:
        radius: of the sphere, metres.
        settings: of the samples.
        faint: whether outlines are; by default those of a radius below `SMALL` pixels.
    """

    radius: float
    settings: ContourSettings = field(default_factory=ContourSettings)
    faint: bool | None = None

    def weigh(self, k: int, positions: FloatArray, view: ImageArray) -> FloatArray:
        maps = polar_maps(self.cameras[k], positions, self.radius, self.settings)
        support, share = outline_support(view, maps, self.settings).T
        clutter = self._clutter(self.cameras[k], view, np.median(positions, axis=0)) if len(positions) else 0.0
        return np.asarray(STEEPNESS * share * (support - clutter))

    def _clutter(self, camera: PinholeCamera, image: ImageArray, middle: FloatArray) -> float:
        """The support that says nothing about ``middle`` ``(3,)``, metres."""
        depth = float(camera.to_camera(middle[None])[0, 2])
        small = depth > 0 and camera.focal.mean() * self.radius < SMALL * depth
        if not (small if self.faint is None else self.faint):
            return CLUTTER
        maps = polar_maps(camera, middle + self.radius * BESIDE, self.radius, self.settings)
        support, share = outline_support(image, maps, self.settings).T
        visible = support[share > 0]
        return min(CLUTTER, float(visible.mean())) if len(visible) else CLUTTER

    def broad(self) -> SphereContourLikelihood:
        """One that notices a ball from farther off, at a third of the cost: for searching."""
        return replace(self, settings=replace(self.settings, angles=12, radii=10, width=0.2))


@dataclass(frozen=True)
class BackgroundLikelihood(ViewLikelihood):
    """Section 2.2.1: the colour differences from C images of the empty scene, multiplied over the cameras."""

    backgrounds: Sequence[ImageArray]

    def weigh(self, k: int, positions: FloatArray, view: ImageArray) -> FloatArray:
        difference, inside = colour_difference(self.cameras[k], view, self.backgrounds[k], positions)
        return np.asarray(np.where(inside, np.log(difference + NOISE), np.log(NOISE)))


@dataclass(frozen=True)
class PointLikelihood(ViewLikelihood):
    """Measured pixels of the target's centre: Gaussian with a share of false ones spread over the image.

    Attributes:
        sigma: ``(C,)`` standard deviation along x and y, pixels.
    """

    sigma: FloatArray

    def weigh(self, k: int, positions: FloatArray, view: FloatArray) -> FloatArray:
        camera, variance = self.cameras[k], self.sigma[k] ** 2
        square = np.square(camera.project(positions)[0] - view).sum(axis=1) / variance
        density = camera.width * camera.height / (2 * np.pi * variance)
        return np.asarray(np.maximum(np.log(density) - 0.5 * np.nan_to_num(square, nan=1e4), -500.0))


@dataclass(frozen=True)
class PrintedContourLikelihood(ViewLikelihood):
    """The logarithm of the plain sum, 2.2.2; rays that leave the image add nothing.

    Attributes:
        radius: of the sphere, metres.
        settings: of the samples and the Gaussian.
        power: of the likelihood; 1 as printed.
    """

    radius: float
    settings: ContourSettings = field(default_factory=ContourSettings)
    power: float = 1.0

    def weigh(self, k: int, positions: FloatArray, view: ImageArray) -> FloatArray:
        maps = polar_maps(self.cameras[k], positions, self.radius, self.settings, sphere_circles)
        total = np.where(maps.inside, outline_sums(view, maps, self.settings)[0], 0.0).sum(axis=1, dtype=np.float64)
        return np.asarray(self.power * logarithms(total))
