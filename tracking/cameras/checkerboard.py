"""Intrinsics from pictures of a checkerboard (Zhang, "A flexible new technique for camera calibration", 2000).

Finding the corners and the fit are OpenCV's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from tsuiseki.tracking.cameras.calibration import Intrinsics
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, ImageArray

Coefficients = Literal[5, 8, 12]
FEWEST = 4
"""Pictures below which focal length and lens are told by too little."""
SMALLEST_TILT = np.deg2rad(5.0)
UNFIXED = "expected pictures of the board from different sides, got some that do not fix the camera"
# OpenCV counts pixels from the first one's centre.
HALF_PIXEL = 0.5
FLAGS: dict[Coefficients, int] = {
    5: 0,
    8: cv2.CALIB_RATIONAL_MODEL,
    12: cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL,
}


@dataclass(frozen=True)
class CheckerboardFit:
    """What came of the pictures.

    Attributes:
        intrinsics: of the camera.
        errors: ``(P,)`` root mean square distance of the corners of each picture, pixels.
        focal_deviation: ``(2,)`` standard deviation of the focal lengths, pixels.
    """

    intrinsics: Intrinsics
    errors: FloatArray
    focal_deviation: FloatArray


def find_corners(image: ImageArray, corners: tuple[int, int]) -> FloatArray | None:
    """``(N, 2)`` pixels of the inner corners, row by row, as OpenCV counts them; None where the board is not whole.

    Args:
        image: ``(H, W, 3)`` uint8.
        corners: inner corners along a row and along a column.
    """
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    found, places = cv2.findChessboardCornersSB(grey, corners, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    return np.asarray(places, dtype=np.float64).reshape(-1, 2) if found else None


def fit_checkerboards(
    found: Sequence[FloatArray],
    corners: tuple[int, int],
    size: tuple[int, int],
    coefficients: Coefficients = 5,
) -> CheckerboardFit:
    """Intrinsics and distortion from the corners of several pictures.

    Args:
        found: ``(N, 2)`` of each picture, from `find_corners`.
        corners: inner corners along a row and along a column.
        size: width and height of the pictures.
        coefficients: of the lens model.

    Raises:
        RequestError: there are too few pictures, or they do not fix the camera.
    """
    if len(found) < FEWEST:
        raise RequestError(
            f"expected the whole board in at least {FEWEST} pictures, found it in {len(found)}; check the numbers of "
            "inner corners, and tilt the board"
        )
    board = np.zeros((corners[0] * corners[1], 3), dtype=np.float32)
    board[:, :2] = np.mgrid[: corners[0], : corners[1]].T.reshape(-1, 2)
    try:
        _, matrix, lens, turns, _, deviations, _, errors = cv2.calibrateCameraExtended(
            [board] * len(found), [each.astype(np.float32) for each in found], size, None, None,  # type: ignore[call-overload]
            flags=FLAGS[coefficients],
        )  # fmt: skip
    except cv2.error as error:
        raise RequestError(UNFIXED) from error
    lens = np.pad(lens.ravel(), (0, max(12 - lens.size, 0)))[:coefficients]
    focal, deviation = matrix[[0, 1], [0, 1]], deviations.ravel()[:2]
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    # Boards that all face one way leave focal length and distance open together.
    tilted = float((normals @ normals.T).min()) < np.cos(SMALLEST_TILT)
    if not (tilted and np.isfinite(lens).all() and (deviation < 0.5 * focal).all()):
        raise RequestError(UNFIXED)
    intrinsics = Intrinsics(size[0], size[1], focal, matrix[:2, 2] + HALF_PIXEL, lens)
    return CheckerboardFit(intrinsics, errors.ravel().astype(np.float64), deviation.astype(np.float64))
