"""People cut out of a wide image and turned upright: the local panorama of thesis 4.2.2.2, eq. (4.2)-(4.4).

Eq. (4.2) turns the image about the centre of a rotated box until the feet are below. As printed its last column does
not keep that centre in place (the signs of ``beta y_r`` and ``beta x_r`` are those of a matrix turned the other way,
that of ``(1 - alpha) y_r`` is of neither); here it does. Turning and cutting out are one map for each box, from the
crop's pixels to the image's.
"""

from __future__ import annotations

import cv2
import numpy as np

from tsuiseki.tracking.types import FloatArray, ImageArray

# Beyond this many pixels of the image in one of the crop, the crop is drawn finer and shrunk.
COARSEST = 1.5


def upright_crops(image: ImageArray, rotated: FloatArray, height: int, width: int) -> ImageArray:
    """``(N, height, width, 3)`` crops of ``(N, 5)`` rotated boxes, heads up, stretched to the crop.

    Args:
        image: ``(H, W, 3)`` uint8.
        rotated: boxes as `person_model` has them; outside the image its border is repeated.
        height: of the crops, pixels.
        width: of the crops, pixels.
    """
    crops = np.empty((len(rotated), height, width, 3), dtype=np.uint8)
    for crop, matrix, scale in zip(crops, *_maps(rotated, height, width), strict=True):
        _sample(image, matrix, int(scale), crop)
    return crops


def _maps(rotated: FloatArray, height: int, width: int) -> tuple[FloatArray, FloatArray]:
    """``(N, 2, 3)`` from pixel centres of the crop to those of the image, and ``(N,)`` how much finer to sample."""
    scale = rotated[:, 2:4] / [width, height]
    finer = np.maximum(np.ceil(scale.max(axis=1) / COARSEST), 1)
    step = scale / finer[:, None]
    cos, sin = np.cos(rotated[:, 4]), np.sin(rotated[:, 4])
    matrix = np.empty((len(rotated), 2, 3))
    matrix[:, 0, 0], matrix[:, 0, 1] = cos * step[:, 0], -sin * step[:, 1]
    matrix[:, 1, 0], matrix[:, 1, 1] = sin * step[:, 0], cos * step[:, 1]
    middle = np.stack([width * finer, height * finer], axis=1) / 2 - 0.5
    matrix[:, :, 2] = rotated[:, :2] - 0.5 - np.einsum("nij,nj->ni", matrix[:, :, :2], middle)
    return matrix, finer


def _sample(image: ImageArray, matrix: FloatArray, finer: int, crop: ImageArray) -> None:
    height, width = crop.shape[:2]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = (width * finer, height * finer)
    if finer == 1:
        cv2.warpAffine(image, matrix, size, dst=crop, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        return
    fine = cv2.warpAffine(image, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    cv2.resize(fine, (width, height), dst=crop, interpolation=cv2.INTER_AREA)
