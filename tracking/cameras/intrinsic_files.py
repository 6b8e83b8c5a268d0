"""Intrinsics on disk, as OpenCV, ROS and others write them."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import yaml

from tsuiseki.tracking.cameras.calibration import HALF_PIXEL
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.rows import read_text
from tsuiseki.tracking.types import FloatArray

# What programs call the same things.
MATRIX_NAMES = ("camera_matrix", "cameraMatrix", "K", "K-matrix", "mtx", "k")
DISTORTION_NAMES = ("distortion_coefficients", "distCoeffs", "dist_coeffs", "D", "distCoeff", "dist", "d")
WIDTH_NAMES, HEIGHT_NAMES = ("image_width", "width"), ("image_height", "height")
LensModel = Literal["pinhole", "fisheye", "omnidirectional"]
# ROS's and Kalibr's words for the distortion.
MODELS: dict[str, LensModel] = {
    "plumb_bob": "pinhole",
    "radtan": "pinhole",
    "rational_polynomial": "pinhole",
    "thin_prism": "pinhole",
    "equidistant": "fisheye",
    "fisheye": "fisheye",
}
FISHEYE = re.compile("fish.?eye|equidistant|kannala", re.IGNORECASE)
# Beyond this p1 and p2 are no lens's. A fisheye's k3 and k4 often are.
TANGENTIAL = 0.03


@dataclass(frozen=True)
class LensFile:
    """What a file says of a lens.

    Attributes:
        size: width and height of the image, pixels.
        focal: ``(2,)`` pixels.
        principal_point: ``(2,)`` pixels, where the first pixel's centre lies at 0.5.
        skew: pixels.
        coefficients: of the distortion.
        model: that they belong to; None where the file does not say and they may be of two.
        xi: of the omnidirectional model's mirror.
    """

    size: tuple[int, int]
    focal: FloatArray
    principal_point: FloatArray
    skew: float
    coefficients: FloatArray
    model: LensModel | None
    xi: float


def read_intrinsics(path: Path, image_size: tuple[int, int] | None = None) -> PinholeCamera:
    """A camera at the origin from a file of OpenCV's FileStorage (YAML, XML, JSON), ROS's YAML or plain JSON.

    Four coefficients of a model that the file does not name are taken as k1, k2, p1, p2, with a warning.

    Args:
        path: the file; it holds a 3x3 matrix and 4, 5, 8 or 12 coefficients k1, k2, p1, p2, k3, k4, k5, k6, s1 to s4.
        image_size: width and height, where the file does not say.

    Raises:
        RequestError: something is missing, or the lens is another, as a fisheye or a tilted sensor's.
    """
    given = read_lens_file(path, image_size)
    if given.model in ("fisheye", "omnidirectional"):
        raise RequestError(
            f"{path}: expected the intrinsics of a pinhole camera, got a calibration of the {given.model} model; give "
            "it to tsuiseki calibrate pose without --projective"
        )
    if abs(given.skew) > 1e-6 * given.focal[0]:
        raise RequestError(f"{path}: expected intrinsics without skew, got {given.skew:g}")
    coefficients = given.coefficients
    if len(coefficients) == 14 and not coefficients[12:].any():
        coefficients = coefficients[:12]
    if len(coefficients) not in (4, 5, 8, 12):
        raise RequestError(
            f"{path}: expected 4, 5, 8 or 12 distortion coefficients (k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4), "
            f"got {len(coefficients)}; calibrate without the tilted and fisheye models"
        )
    if given.model is None and np.abs(coefficients[2:]).max() > TANGENTIAL:
        raise RequestError(
            f"{path}: expected k1, k2, p1, p2, got {coefficients.tolist()}, whose last look like a fisheye's; add the "
            "line distortion_model: equidistant, or plumb_bob"
        )
    if given.model is None:
        warnings.warn(
            f"{path}: its four coefficients are taken as k1, k2, p1, p2; where they are a fisheye's, add the line "
            "distortion_model: equidistant",
            InputWarning,
            stacklevel=2,
        )
    lens = np.pad(coefficients, (0, max(5 - len(coefficients), 0)))
    return PinholeCamera(*given.size, given.focal, given.principal_point, distortion=lens)


def read_lens_file(path: Path, image_size: tuple[int, int] | None = None) -> LensFile:
    """What a file says of a lens of any of `LensModel`.

    Args:
        path: see `read_intrinsics`; with ``xi`` it is of OpenCV's omnidir.
        image_size: width and height, where the file does not say.

    Raises:
        RequestError: something is missing, or the model is unknown.
    """
    content = _content(path)
    matrix = _first(path, content, MATRIX_NAMES)
    if matrix is None or matrix.size != 9 or not np.isfinite(matrix).all():
        raise RequestError(f"{path}: expected a 3x3 matrix named one of {', '.join(MATRIX_NAMES)}, found none")
    matrix = matrix.reshape(3, 3)
    coefficients = _first(path, content, DISTORTION_NAMES)
    coefficients = np.zeros(5) if coefficients is None or not coefficients.size else coefficients.ravel()
    xi = _first(path, content, ("xi", "Xi"))
    size = image_size or _size(path, content)
    return LensFile(
        size,
        matrix[[0, 1], [0, 1]],
        matrix[:2, 2] + HALF_PIXEL,
        float(matrix[0, 1]),
        coefficients,
        "omnidirectional" if xi is not None else _model(path, content, len(coefficients)),
        0.0 if xi is None else float(xi.ravel()[0]),
    )


def _model(path: Path, content: dict[str, Any], count: int) -> LensModel | None:
    name = str(content.get("distortion_model") or "").lower()
    if name and name not in MODELS:
        raise RequestError(f"{path}: expected a distortion_model of {', '.join(MODELS)}, got {name!r}")
    if name:
        return MODELS[name]
    words = {key: value if isinstance(value, str) else "" for key, value in content.items()}
    marks = [content[key] for key, word in words.items() if FISHEYE.search(f"{key} {word}")]
    if marks:
        return "pinhole" if all(str(mark).lower() in ("0", "0.0", "false", "no") for mark in marks) else "fisheye"
    if count != 4:
        return "pinhole"
    # What OpenCV's fisheye calibration calls its result.
    return "fisheye" if ("K" in content and "D" in content) or FISHEYE.search(path.stem) else None


def _size(path: Path, content: dict[str, Any]) -> tuple[int, int]:
    width, height = (_first(path, content, names) for names in (WIDTH_NAMES, HEIGHT_NAMES))
    pair = _first(path, content, ("resolution", "image_size"))
    if pair is None and width is not None and height is not None:
        pair = np.array([width, height])
    if pair is None:
        raise RequestError(f"{path}: expected image_width and image_height, found none; give the image size")
    if pair.size != 2 or not (pair >= 1).all():
        raise RequestError(f"{path}: expected a width and height above 0, got {pair.tolist()}")
    return int(pair.ravel()[0]), int(pair.ravel()[1])


def write_intrinsics(path: Path, camera: PinholeCamera, error: float) -> None:
    """Write a lens as OpenCV's own calibration program does (YAML), with the root mean square error in pixels."""
    matrix = np.diag([*camera.focal, 1.0])
    matrix[:2, 2] = camera.principal_point - HALF_PIXEL
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_FORMAT_YAML)
    storage.write("image_width", camera.width)
    storage.write("image_height", camera.height)
    storage.write("camera_matrix", matrix)
    storage.write("distortion_coefficients", camera.distortion[None])
    storage.write("avg_reprojection_error", error)
    storage.release()


def _first(path: Path, content: dict[str, Any], names: Sequence[str]) -> FloatArray | None:
    """The numbers under the first of the names that is there."""
    value = next((content[name] for name in names if content.get(name) is not None), None)
    if value is None:
        return None
    try:
        numbers = np.asarray(value["data"] if isinstance(value, dict) else value, dtype=np.float64)
    except (TypeError, ValueError, KeyError) as error:
        raise RequestError(f"{path}: expected numbers in matrix, coefficients and size, got something else") from error
    return numbers


def _content(path: Path) -> dict[str, Any]:
    """What a file has by name: numbers, words, and matrices as lists or as mappings with ``data``."""
    text = read_text(path, "camera intrinsics")
    if text.lstrip().startswith("<"):
        return _xml(path, text)
    # OpenCV's first line is no YAML, nor are its tags; JSON is YAML but for tabs.
    text = re.sub(r"\A\s*%YAML.*|!!opencv-\S+", "", text).replace("\t", " ")
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise RequestError(f"{path}: expected YAML or JSON with camera intrinsics, got something else") from error
    if not isinstance(content, dict):
        raise RequestError(f"{path}: expected named intrinsics, got a {type(content).__name__}")
    return content


def _xml(path: Path, text: str) -> dict[str, Any]:
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except cv2.error as error:
        raise RequestError(f"{path}: expected an OpenCV file with camera intrinsics, got something else") from error
    names = storage.root().keys()
    nodes = {name: storage.getNode(name) for name in names}
    content = {
        name: node.mat() if node.isMap() else node.string() if node.isString() else node.real()
        for name, node in nodes.items()
        if node.isMap() or node.isString() or node.isReal() or node.isInt()
    }
    storage.release()
    return content
