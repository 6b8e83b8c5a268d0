"""How well a sphere's outline agrees with an image; the samples of section 2.2.2 of the sphere paper.

Each image is resampled in polar coordinates about the projected centre of every particle; the absolute first derivative
along r is weighted by a Gaussian around the radius r0 that the sphere has there, and summed (`outline_sums`). That sum
over all rays is the paper's likelihood (`views.PrintedContourLikelihood`). `outline_support` goes beyond the
paper: it divides each ray's sum by the sum without the Gaussian.

r0 follows the true, elliptic outline (`tracking.cameras.outline`), or a circle: samples lie on the rays from the
projected centre through the outline, at r / r0 from ``1 - reach`` to ``1 + reach``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.cameras.outline import Outlines, sphere_outlines
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray, ImageArray

# cv2.remap takes fewer than 32768 columns.
MOST_COLUMNS = 32000

OutlinesOf: TypeAlias = Callable[[PinholeCamera, FloatArray, float], Outlines]
"""Outlines of spheres of a radius at ``(N, 3)`` centres."""


@dataclass(frozen=True)
class ContourSettings:
    """What is sampled and how it counts.

    Attributes:
        angles: A rays around the centre.
        radii: R samples along each ray.
        reach: half the sampled range of r / r0.
        width: standard deviation of the Gaussian over r / r0.
        contrast: grey levels (summed over the three channels) of variation along a ray at which an edge counts half.
        steepness: log-likelihood of a perfect outline over none.
        clutter: support at which a view speaks neither for a particle nor against, [0, 1]; by default what strong and
            even texture gives, the mean of the Gaussian over the sampled range.
    """

    angles: int = 24
    radii: int = 16
    reach: float = 0.5
    width: float = 0.12
    contrast: float = 60.0
    steepness: float = 60.0
    clutter: float = 0.30

    def __post_init__(self) -> None:
        if self.angles < 4 or self.radii < 3:
            raise ValueError(f"expected at least 4 angles and 3 radii, got {self.angles} and {self.radii}")
        if not (0 < self.reach < 1 and self.width > 0 and self.contrast > 0 and self.steepness > 0):
            raise ValueError("expected a reach in (0, 1) and positive width, contrast and steepness")


@dataclass(frozen=True)
class PolarMaps:
    """Where `cv2.remap` samples one camera for N particles.

    Attributes:
        columns: ``(R, N * A)`` float32, the angle fastest.
        rows: likewise.
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
    """The polar samples around spheres at ``centres`` ``(N, 3)``.

    A sample is ``centre + s (outline(t) - centre)``. OpenCV counts pixels from the first one's centre, here it is 0.5.

    Args:
        camera: that took the image.
        centres: metres.
        radius: of the spheres, metres.
        settings: of the samples.
        outlines_of: the true ellipses, or the circles of `sphere_circles`.
    """
    outlines = outlines_of(camera, centres, radius)
    centre = outlines.centre - 0.5
    spokes = np.stack([outlines.middle - outlines.centre, outlines.first, outlines.second], axis=2)
    # A particle behind the camera has NaN here, which remap must not see.
    seen = np.isfinite(spokes).all(axis=(1, 2))
    centre[~seen], spokes[~seen] = -1e4, 0.0
    t = np.arange(settings.angles) * (2 * np.pi / settings.angles)
    around = np.stack([np.ones_like(t), np.cos(t), np.sin(t)]).astype(np.float32)
    shares = np.linspace(1 - settings.reach, 1 + settings.reach, settings.radii, dtype=np.float32)[:, None]
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
    response = peak / (plain + np.float32(settings.contrast))
    count = maps.inside.sum(axis=1)
    support = np.einsum("na,na->n", response, maps.inside.astype(np.float32)) / np.maximum(count, 1)
    return np.stack([support, count / settings.angles], axis=1).astype(np.float64)


def fetch(image: ImageArray, maps: PolarMaps) -> ImageArray:
    """The samples ``(R, N * A * channels)`` uint8 of ``image`` ``(H, W, 3)`` or ``(H, W)``."""
    parts = []
    for first in range(0, maps.columns.shape[1], MOST_COLUMNS):
        part = slice(first, first + MOST_COLUMNS)
        found = cv2.remap(
            image, maps.columns[:, part], maps.rows[:, part], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        parts.append(found.reshape(len(found), -1))
    return np.asarray(parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1), dtype=np.uint8)


@lru_cache
def _radial_weights(settings: ContourSettings) -> NDArray[np.float32]:
    """``(2, R - 1)``: the Gaussian around r0 at the middles between samples, and ones."""
    between = ((np.arange(settings.radii - 1) + 0.5) / (settings.radii - 1) * 2 - 1) * settings.reach
    return np.stack([np.exp(-0.5 * (between / settings.width) ** 2), np.ones(len(between))]).astype(np.float32)
