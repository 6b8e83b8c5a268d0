"""Intrinsics on disk, as OpenCV and others write them."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.tracking.cameras.calibration import Intrinsics
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray

# What programs call the same two things.
MATRIX_NAMES = ("camera_matrix", "cameraMatrix", "K", "K-matrix", "mtx")
DISTORTION_NAMES = ("distortion_coefficients", "distCoeffs", "dist_coeffs", "D", "distCoeff", "dist")
# OpenCV counts pixels from the first one's centre.
HALF_PIXEL = 0.5


def read_intrinsics(path: Path, image_size: tuple[int, int] | None = None) -> Intrinsics:
    """Intrinsics with distortion, from OpenCV's FileStorage (YAML, XML, JSON) or from plain JSON with the same names.

    Args:
        path: the file; it holds a 3x3 matrix and 4, 5, 8 or 12 coefficients k1, k2, p1, p2, k3, k4, k5, k6, s1 to s4.
        image_size: width and height, where the file does not say.

    Raises:
        RequestError: something is missing, or the lens model has other coefficients, as a tilted sensor's.
    """
    if not path.is_file():
        raise RequestError(f"{path}: expected a file with camera intrinsics, found none")
    matrix, coefficients, size = _plain_json(path) if path.suffix.lower() == ".json" else _file_storage(path)
    if matrix is None or matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise RequestError(f"{path}: expected a 3x3 matrix named one of {', '.join(MATRIX_NAMES)}, found none")
    if abs(matrix[0, 1]) > 1e-6 * matrix[0, 0]:
        raise RequestError(f"{path}: expected intrinsics without skew, got {matrix[0, 1]:g}")
    coefficients = np.zeros(5) if coefficients is None else coefficients.ravel()
    if len(coefficients) == 14 and not coefficients[12:].any():
        coefficients = coefficients[:12]
    if len(coefficients) not in (4, 5, 8, 12):
        raise RequestError(
            f"{path}: expected 4, 5, 8 or 12 distortion coefficients (k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4), "
            f"got {len(coefficients)}; calibrate without the tilted and fisheye models"
        )
    size = image_size or size
    if size is None:
        raise RequestError(f"{path}: expected image_width and image_height, found none; give the image size")
    return Intrinsics(
        size[0],
        size[1],
        matrix[[0, 1], [0, 1]],
        matrix[:2, 2] + HALF_PIXEL,
        np.pad(coefficients, (0, max(5 - len(coefficients), 0))),
    )


def write_intrinsics(path: Path, intrinsics: Intrinsics, error: float) -> None:
    """Intrinsics as OpenCV's own calibration program writes them (YAML), with the root mean square error in pixels."""
    matrix = np.diag([*intrinsics.focal, 1.0])
    matrix[:2, 2] = intrinsics.principal_point - HALF_PIXEL
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_FORMAT_YAML)
    storage.write("image_width", intrinsics.width)
    storage.write("image_height", intrinsics.height)
    storage.write("camera_matrix", matrix)
    storage.write("distortion_coefficients", intrinsics.distortion[None])
    storage.write("avg_reprojection_error", error)
    storage.release()


def _plain_json(path: Path) -> tuple[FloatArray | None, FloatArray | None, tuple[int, int] | None]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RequestError(f"{path}: expected JSON with camera intrinsics, got something else") from error
    if not isinstance(content, dict):
        raise RequestError(f"{path}: expected named intrinsics, got a {type(content).__name__}")
    if any(isinstance(content.get(name), dict) for name in MATRIX_NAMES):
        return _file_storage(path)
    try:
        matrix = next((np.asarray(content[name], dtype=np.float64) for name in MATRIX_NAMES if name in content), None)
        found = next(
            (np.asarray(content[name], dtype=np.float64) for name in DISTORTION_NAMES if name in content), None
        )
        size = content.get("resolution", content.get("image_size"))
        return matrix, found, None if size is None else (int(size[0]), int(size[1]))
    except (TypeError, ValueError, IndexError) as error:
        raise RequestError(f"{path}: expected numbers in matrix, coefficients and size, got something else") from error


def _file_storage(path: Path) -> tuple[FloatArray | None, FloatArray | None, tuple[int, int] | None]:
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    except cv2.error as error:
        raise RequestError(f"{path}: expected an OpenCV file with camera intrinsics, got something else") from error
    with_size = [storage.getNode(name) for name in ("image_width", "image_height")]
    size = None if any(n.empty() for n in with_size) else (int(with_size[0].real()), int(with_size[1].real()))
    found = []
    for names in (MATRIX_NAMES, DISTORTION_NAMES):
        nodes = [storage.getNode(name) for name in names]
        found.append(next((n.mat() for n in nodes if not n.empty() and n.isMap()), None))
    storage.release()
    matrix, coefficients = (None if f is None else np.asarray(f, dtype=np.float64) for f in found)
    return matrix, coefficients, size
