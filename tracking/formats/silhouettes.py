"""Silhouettes of bodies, one 8-bit PNG a frame: bit ``id - 1`` of a pixel says that the body lies there.

Bits and not numbers, so that a body keeps its whole silhouette where another covers it.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray

FOLDER = "silhouettes"
MOST_BODIES = 8


def read_silhouettes(folder: Path) -> ImageArray:
    """Those of all frames of a clip, ``(T, H, W)`` uint8.

    Raises:
        RequestError: there are none, one cannot be decoded, or they differ in size.
    """
    paths = sorted((folder / FOLDER).glob("*.png"))
    if not paths:
        raise RequestError(f"expected silhouettes as PNG files in {folder / FOLDER}, found none")
    pictures: list[np.ndarray[tuple[int, ...], np.dtype[np.uint8]]] = []
    for path in paths:
        picture = cv2.imdecode(np.fromfile(path, dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
        if picture is None or (pictures and picture.shape != pictures[0].shape):
            raise RequestError(f"{path}: expected an image of the same size as the others, got something else")
        pictures.append(np.asarray(picture, dtype=np.uint8))
    return np.asarray(np.stack(pictures), dtype=np.uint8)


def silhouette_of(silhouettes: ImageArray, identity: int) -> BoolArray:
    """Where the body ``identity`` (from 1) lies, of any shape."""
    if not 1 <= identity <= MOST_BODIES:
        raise ValueError(f"expected an id from 1 to {MOST_BODIES}, got {identity}")
    return np.asarray((silhouettes >> (identity - 1)) & 1, dtype=np.bool_)


def centre_inside(silhouettes: ImageArray, identity: int, centres: FloatArray) -> BoolArray:
    """Whether each centre ``(T, 2)``, x and y in pixels, lies inside the silhouette of its frame; section 5.

    What is not finite or lies off the image is not inside.
    """
    frames, height, width = silhouettes.shape
    column, row = np.floor(np.nan_to_num(centres, nan=-1.0, posinf=-1.0, neginf=-1.0)).astype(np.int64).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    found = silhouettes[np.arange(frames), np.where(inside, row, 0), np.where(inside, column, 0)]
    return np.asarray(inside & silhouette_of(found, identity))
