"""The contour likelihood of a sphere, section 2.2.2 of the sphere paper.

Each image is resampled in polar coordinates about the projected centre of every particle; the absolute first derivative
along r is weighted by a Gaussian around the radius r0 that the sphere has there, and summed. Here r0 follows the true,
elliptic outline (`tracking.cameras.outline`): samples lie on the rays from the projected centre through the outline, at
r / r0 from ``1 - reach`` to ``1 + reach``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.cameras.outline import sphere_outlines
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray, ImageArray

# cv2.remap takes fewer than 32768 rows.
MOST_ROWS = 32000


@dataclass(frozen=True)
class ContourSettings:
    """What is sampled and how it counts.

    Attributes:
        angles: A rays around the centre.
        radii: R samples along each ray.
        reach: half the sampled range of r / r0.
        width: standard deviation of the Gaussian over r / r0.
        contrast: grey levels (summed over the three channels) of variation along a ray at which an edge counts half;
            infinite would give the paper's plain sum, in which one strong edge outweighs a whole weak outline.
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
        columns: ``(N, R * A)`` float32, the angle fastest.
        rows: likewise.
        inside: ``(N, A)`` whether the whole ray lies in the image.
    """

    columns: NDArray[np.float32]
    rows: NDArray[np.float32]
    inside: NDArray[np.bool_]


def polar_maps(camera: PinholeCamera, centres: FloatArray, radius: float, settings: ContourSettings) -> PolarMaps:
    """The polar samples around spheres at ``centres`` ``(N, 3)``.

    A sample is ``centre + s (outline(t) - centre)``, linear in 1, s, s cos t and s sin t, so one matrix product gives
    all of them. OpenCV counts pixels from the first one's centre, which lies at 0.5 here.
    """
    outlines = sphere_outlines(camera, centres, radius)
    terms = np.stack(
        [outlines.centre - 0.5, outlines.middle - outlines.centre, outlines.first, outlines.second], axis=2
    )
    # A particle behind the camera has NaN here, which remap must not see.
    terms[~np.isfinite(terms).all(axis=(1, 2))] = -1e4
    basis = _polar_basis(settings)
    columns, rows = (terms[:, axis].astype(np.float32) @ basis for axis in (0, 1))
    last = slice(-settings.angles, None)
    inside = (columns[:, last] >= 0) & (columns[:, last] <= camera.width - 1)
    inside &= (rows[:, last] >= 0) & (rows[:, last] <= camera.height - 1)
    return PolarMaps(columns, rows, inside)


def outline_support(image: ImageArray, maps: PolarMaps, settings: ContourSettings) -> FloatArray:
    """``(N, 2)``: the support of each particle's outline in [0, 1], and the share of it that lies in the image."""
    channels = image.shape[2] if image.ndim == 3 else 1
    samples = fetch(image, maps)
    ring = settings.angles * channels
    steps = cv2.absdiff(samples[:, ring:], samples[:, :-ring])
    slopes = steps.reshape(len(samples), settings.radii - 1, ring).astype(np.float32)
    # One product gives the Gaussian sum of the paper and the plain sum that it is measured against.
    sums = (_radial_weights(settings) @ slopes).reshape(-1, 2, settings.angles, channels).sum(axis=3)
    response = sums[:, 0] / (sums[:, 1] + np.float32(settings.contrast))
    count = maps.inside.sum(axis=1)
    support = np.einsum("na,na->n", response, maps.inside.astype(np.float32)) / np.maximum(count, 1)
    return np.stack([support, count / settings.angles], axis=1).astype(np.float64)


def fetch(image: ImageArray, maps: PolarMaps) -> ImageArray:
    """The samples ``(N, R * A * channels)`` uint8 of ``image`` ``(H, W, 3)`` or ``(H, W)``."""
    if len(maps.columns) <= MOST_ROWS:
        fetched = cv2.remap(image, maps.columns, maps.rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(fetched.reshape(len(fetched), -1), dtype=np.uint8)
    parts = []
    for first in range(0, len(maps.columns), MOST_ROWS):
        part = slice(first, first + MOST_ROWS)
        parts.append(fetch(image, PolarMaps(maps.columns[part], maps.rows[part], maps.inside[part])))
    return np.concatenate(parts)


@lru_cache
def _polar_basis(settings: ContourSettings) -> NDArray[np.float32]:
    """``(4, R * A)``: 1, s, s cos t and s sin t of every sample."""
    s = np.linspace(1 - settings.reach, 1 + settings.reach, settings.radii)[:, None]
    t = np.arange(settings.angles)[None] * (2 * np.pi / settings.angles)
    terms = (np.ones_like(s + t), s + 0 * t, s * np.cos(t), s * np.sin(t))
    return np.stack([term.ravel() for term in terms]).astype(np.float32)


@lru_cache
def _radial_weights(settings: ContourSettings) -> NDArray[np.float32]:
    """``(2, R - 1)``: the Gaussian around r0 at the middles between samples, and ones."""
    between = ((np.arange(settings.radii - 1) + 0.5) / (settings.radii - 1) * 2 - 1) * settings.reach
    return np.stack([np.exp(-0.5 * (between / settings.width) ** 2), np.ones(len(between))]).astype(np.float32)
