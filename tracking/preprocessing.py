"""From images to the input of a network: fitting, cropping, normalising. Training and inference share it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.tracking.types import FloatArray, ImageArray

# Pixels around an image that the crop of a box may span: what detectors say of real people needs far fewer.
MOST_PIXELS = 2**24
# Coordinate beyond which boxes are cut off, pixels, so that their corners are whole numbers of 64 bits.
FARTHEST = 2.0**40


def check_images(images: Sequence[ImageArray]) -> int:
    """How many images there are.

    Raises:
        RequestError: they are no images ``(H, W, 3)`` uint8, or one of them alone.
    """
    for image in images:
        if (
            not isinstance(image, np.ndarray)
            or image.dtype != np.uint8
            or image.ndim != 3
            or image.shape[2] != 3
            or not image.size
        ):
            got = f"{image.dtype} {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
            raise RequestError(f"expected a list of images (H, W, 3) uint8, got one entry of {got}; is it one image?")
    return len(images)


def fit_image(image: ImageArray, card: ModelCard) -> tuple[ImageArray, tuple[float, float]]:
    """``image`` at the network's input size, and the scales from image to input pixels in x and y.

    ``letterbox`` keeps the aspect ratio and fills the right and lower rest with the mean colour.
    """
    if card.resize == "stretch":
        return stretched(image, card.input_height, card.input_width)
    red, green, blue = np.round(255 * np.asarray(card.mean)).tolist()
    return letterbox(image, card.input_height, card.input_width, (red, green, blue))


def stretched(image: ImageArray, height: int, width: int) -> tuple[ImageArray, tuple[float, float]]:
    """``image`` at ``height`` times ``width`` pixels, whatever its shape, and the scales in x and y."""
    return _resize(image, width, height), (width / image.shape[1], height / image.shape[0])


def letterbox(
    image: ImageArray, height: int, width: int, fill: tuple[float, float, float]
) -> tuple[ImageArray, tuple[float, float]]:
    """``image`` with its aspect ratio kept, the right and lower rest of ``fill``, and the scales in x and y."""
    rows, columns = image.shape[:2]
    ratio = min(width / columns, height / rows)
    new_width, new_height = max(1, round(columns * ratio)), max(1, round(rows * ratio))
    resized = _resize(image, new_width, new_height)
    if (new_height, new_width) == (height, width):
        return resized, (ratio, ratio)
    padded = cv2.copyMakeBorder(
        resized, 0, height - new_height, 0, width - new_width, cv2.BORDER_CONSTANT, value=list(fill)
    )
    return np.asarray(padded, dtype=np.uint8), (new_width / columns, new_height / rows)


def enlarged(image: ImageArray, height: int, width: int) -> ImageArray:
    """``image`` at ``height`` times ``width`` pixels, bicubic: less coarse than what networks get of small images."""
    if image.shape[:2] == (height, width):
        return image
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_CUBIC), dtype=np.uint8)


def crop_boxes(image: ImageArray, boxes: FloatArray, height: int, width: int) -> ImageArray:
    """``(N, height, width, 3)`` crops of ``(N, 4)`` boxes, stretched; outside the image its border is repeated."""
    crops = np.empty((len(boxes), height, width, 3), dtype=np.uint8)
    rows, columns = image.shape[:2]
    corners = np.stack([np.floor(boxes[:, :2]), np.ceil(boxes[:, 2:])], axis=1).reshape(-1, 4)
    corners = np.clip(corners, -FARTHEST, FARTHEST).astype(int)
    for crop, (x1, y1, x2, y2) in zip(crops, corners.tolist(), strict=True):
        if (max(x2, columns) - min(x1, 0)) * (max(y2, rows) - min(y1, 0)) > MOST_PIXELS + rows * columns:
            crop[:] = _sampled(image, (x1, y1, x2, y2), height, width)
            continue
        inner: NDArray[Any] = image[np.clip(y1, 0, rows - 1) : max(y2, 1), np.clip(x1, 0, columns - 1) : max(x2, 1)]
        before_x, before_y = max(-x1, 0), max(-y1, 0)
        after_x, after_y = max(x2 - columns, 0), max(y2 - rows, 0)
        if before_x or before_y or after_x or after_y:
            inner = cv2.copyMakeBorder(inner, before_y, after_y, before_x, after_x, cv2.BORDER_REPLICATE)
        cv2.resize(inner, (width, height), dst=crop, interpolation=_interpolation(inner, width))
    return crops


def _sampled(image: ImageArray, box: tuple[int, int, int, int], height: int, width: int) -> ImageArray:
    """The crop of a box too large, or too far outside, to be made in full: the nearest pixel at each place."""
    x1, y1, x2, y2 = box
    x = x1 + (np.arange(width) + 0.5) * ((x2 - x1) / width)
    y = y1 + (np.arange(height) + 0.5) * ((y2 - y1) / height)
    columns, rows = (
        np.clip(np.floor(at), 0, end - 1).astype(int) for at, end in ((x, image.shape[1]), (y, image.shape[0]))
    )
    return np.asarray(image[rows[:, None], columns])


def normalise(images: Sequence[ImageArray] | ImageArray, card: ModelCard) -> NDArray[np.float32]:
    """``(N, H, W, 3)`` uint8 RGB, N > 0, to the ``(N, 3, H, W)`` float32 that the model of ``card`` takes."""
    return standardised(images, 255.0, card.mean, card.std)


def standardised(
    images: Sequence[ImageArray] | ImageArray, largest: float, mean: Sequence[float], std: Sequence[float]
) -> NDArray[np.float32]:
    """``(N, 3, H, W)`` float32 of ``(N, H, W, 3)`` uint8, N > 0: divided by ``largest``, less ``mean``, by ``std``."""
    levels = np.arange(256, dtype=np.float64)[:, None] / largest
    tables = ((levels - np.asarray(mean)) / np.asarray(std)).astype(np.float32)
    height, width, channels = images[0].shape
    planes = np.empty((len(images), channels, height, width), dtype=np.float32)
    # A table look-up per channel writes the planes at once: several times faster than arithmetic and a transpose.
    if isinstance(images, np.ndarray):
        # Small pictures, one below the other, cost as few calls as one.
        for channel, tall in enumerate(cv2.split(images.reshape(-1, width, channels))):
            planes[:, channel] = cv2.LUT(tall, tables[:, channel]).reshape(-1, height, width)
        return planes
    for image, target in zip(images, planes, strict=True):
        for channel, plane in enumerate(cv2.split(image)):
            cv2.LUT(plane, tables[:, channel], dst=target[channel])
    return planes


def _interpolation(image: NDArray[Any], width: int) -> int:
    # Area averaging avoids aliasing when shrinking; bilinear when enlarging.
    return cv2.INTER_AREA if image.shape[1] > width else cv2.INTER_LINEAR


def _resize(image: ImageArray, width: int, height: int) -> ImageArray:
    if image.shape[:2] == (height, width):
        return image
    # Up to half the size bilinear still takes every pixel, in a fifth of the time.
    halved = image.shape[1] > 2 * width or image.shape[0] > 2 * height
    how = _interpolation(image, width) if halved else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, (width, height), interpolation=how), dtype=np.uint8)
