"""People cut out of a wide image and turned upright: the local panorama of thesis 4.2.2.2, eq. (4.2)-(4.4).

Eq. (4.2) turns the image about the centre of a rotated box until the feet are below. As printed its last column does
not keep that centre in place (the signs of ``beta y_r`` and ``beta x_r`` are those of a matrix turned the other way,
that of ``(1 - alpha) y_r`` is of neither); here it does. Turning and cutting out are one map for each box, from the
crop's pixels to the image's.
"""

from __future__ import annotations

import cv2
import numpy as np

from tsuiseki.tracking.cameras.person_model import FloorCamera, PersonModel
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


def standing_crops(
    image: ImageArray, camera: FloorCamera, places: FloatArray, person: PersonModel, height: int, width: int
) -> ImageArray:
    """``(N, height, width, 3)`` crops as if each person were painted on a screen that stands where it stands.

    The screen faces the camera's side, is as high as the person and twice the body's radius wide. It evens out how
    much nearer the head is than the feet, which turning the box does not; right under the camera it is seen edge on.

    Args:
        image: ``(H, W, 3)`` uint8.
        camera: with its pose.
        places: ``(N, 2)`` metres on the floor.
        person: its size.
        height: of the crops, pixels.
        width: of the crops, pixels.
    """
    away = places - camera.position[:2]
    distance = np.linalg.norm(away, axis=1, keepdims=True)
    away = np.where(distance > 1e-6, away / np.maximum(distance, 1e-6), [0.0, -1.0])
    right = np.column_stack([-away[:, 1], away[:, 0]])
    u = ((np.arange(width) + 0.5) / width - 0.5) * 2.4 * person.body_radius
    z = person.height * (1 - (np.arange(height) + 0.5) / height)
    # Seen from the camera's side, what is to the right of the person is on the camera's left-hand normal.
    flat = places[:, None, None] - u[None, None, :, None] * right[:, None, None]
    points = np.empty((len(places), height, width, 3))
    points[..., :2] = flat
    points[..., 2] = z[None, :, None]
    pixels, _ = camera.project(points.reshape(-1, 3))
    maps = np.nan_to_num(pixels - 0.5, nan=-1.0).astype(np.float32).reshape(len(places), height, width, 2)
    crops = np.empty((len(places), height, width, 3), dtype=np.uint8)
    for crop, each in zip(crops, maps, strict=True):
        x, y = np.ascontiguousarray(each[..., 0]), np.ascontiguousarray(each[..., 1])
        cv2.remap(image, x, y, cv2.INTER_LINEAR, dst=crop, borderMode=cv2.BORDER_REPLICATE)
    return crops
