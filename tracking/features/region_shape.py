"""What tells the region of one body from that of two that touch, whatever their size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import FloatArray

# Regions of so many usual areas, and of so many pixels, tell the usual shape.
LONE = (0.5, 1.6)
FEWEST = 20


@dataclass(frozen=True)
class Shape:
    """A region, but for its place, direction and size.

    Attributes:
        aspect: deviation of its pixels along its longer axis over that across, at least 1.
        fill: its area over that of the ellipse with the same deviations: 1 for an ellipse, less for what bends or has
            gaps.
    """

    aspect: float
    fill: float


def shape_of(pixels: FloatArray) -> Shape:
    """The shape of a region.

    Args:
        pixels: ``(P, 2)`` centres of all its pixels, in either order of the columns.
    """
    # A pixel is a square with a deviation of its own, so that a single row has one across.
    low, high = np.linalg.eigvalsh(np.cov(pixels.T) + np.eye(2) / 12)
    return Shape(float(np.sqrt(high / low)), float(len(pixels) / (4 * np.pi * np.sqrt(low * high))))


def usual_shape(masks: Sequence[NDArray[np.bool_]], area: float) -> Shape | None:
    """The median shape of the regions that have about the usual area; None without any.

    Args:
        masks: ``(H, W)`` each.
        area: usual pixels of one body.
    """
    found = []
    for mask in masks:
        count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
        for n in range(1, count):
            if max(LONE[0] * area, FEWEST) <= stats[n, cv2.CC_STAT_AREA] <= LONE[1] * area:
                shape = shape_of(np.argwhere(np.asarray(labels) == n).astype(np.float64))
                found.append((shape.aspect, shape.fill))
    return Shape(*np.median(found, axis=0).tolist()) if found else None
