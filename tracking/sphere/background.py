"""The background difference of section 2.2.1 of the sphere paper, the baseline: whatever moves looks like the ball."""

from __future__ import annotations

import cv2
import numpy as np

from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.cameras.volume import in_sight
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray


def colour_difference(
    camera: PinholeCamera, image: ImageArray, background: ImageArray, points: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """How far the colour at each projected point lies from the background's.

    Args:
        camera: the camera.
        image: ``(H, W, 3)`` uint8.
        background: the same view without anything that moves.
        points: ``(N, 3)`` metres.

    Returns:
        ``(N,)`` Euclidean distance of the two colours, [0, 442], and ``(N,)`` bool whether the point is in the image;
        elsewhere the difference is zero.
    """
    pixels, _ = camera.project(points)
    inside = in_sight(camera, points)
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
