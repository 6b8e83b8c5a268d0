"""Cameras on disk: `cameras.yaml`, and intrinsics as OpenCV and others write them.

`cameras.yaml` has a list ``cameras`` with one entry per source, in the order of the sources::

    cameras:
    - name: left
      model: projective
      image_size: [800, 600]        # width, height
      focal: [693.0, 693.0]         # pixels
      principal_point: [400, 300]   # pixels; the first pixel's centre lies at 0.5
      distortion: [0, 0, 0, 0, 0]   # optional: k1, k2, p1, p2, k3; or 8 or 12 coefficients as OpenCV orders them
      rotation: [[...], [...], [...]]  # directions of the world to right, down, forward
      position: [4.0, 0.0, 1.5]     # metres, z up
      frame_rate: 15                # optional: frames/s, where the video does not tell
      offset: 0.0                   # optional: time of the first frame, seconds
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from tsuiseki.tracking.cameras.calibration import Intrinsics
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray

FIELDS = {"image_size": (2,), "focal": (2,), "principal_point": (2,), "rotation": (3, 3), "position": (3,)}
# What programs call the same two things.
MATRIX_NAMES = ("camera_matrix", "cameraMatrix", "K", "K-matrix", "mtx")
DISTORTION_NAMES = ("distortion_coefficients", "distCoeffs", "dist_coeffs", "D", "distCoeff", "dist")
# OpenCV counts pixels from the first one's centre.
HALF_PIXEL = 0.5


@dataclass(frozen=True)
class PlacedCamera:
    """One entry of `cameras.yaml`.

    Attributes:
        name: for people to read.
        camera: the camera.
        frame_rate: frames/s; None where the video tells.
        offset: time of the first frame, seconds.
    """

    name: str
    camera: PinholeCamera
    frame_rate: float | None = None
    offset: float = 0.0


def read_cameras(path: Path) -> list[PlacedCamera]:
    """The cameras of a `cameras.yaml`, in order.

    Raises:
        RequestError: the file is missing or no YAML, or an entry lacks a field or has a wrong one, which is named.
    """
    return [camera_of(entry, f"{path}: camera {k + 1}", k) for k, entry in enumerate(read_entries(path))]


def read_entries(path: Path) -> list[Any]:
    """The list ``cameras`` of a `cameras.yaml`, its entries not yet checked.

    Raises:
        RequestError: the file is missing, no YAML, or has no such list.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RequestError(f"{path}: expected a camera file, found none ({error.strerror})") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise RequestError(f"{path}: expected YAML, got something else; write it with tsuiseki calibrate") from error
    entries = content.get("cameras") if isinstance(content, dict) else None
    if not isinstance(entries, list) or not entries:
        raise RequestError(f"{path}: expected a list named cameras with one entry per source, found none")
    return entries


def write_cameras(path: Path, cameras: list[PlacedCamera]) -> None:
    """Write `cameras.yaml`, overwriting ``path``."""
    entries = [camera_entry(placed) for placed in cameras]
    text = yaml.safe_dump({"cameras": entries}, sort_keys=False, default_flow_style=None, width=120)
    path.write_text(text, encoding="utf-8")


def camera_entry(placed: PlacedCamera) -> dict[str, Any]:
    """The entry of a camera, as `write_cameras` writes it."""
    camera = placed.camera
    entry: dict[str, Any] = {
        "name": placed.name,
        "model": "projective",
        "image_size": [camera.width, camera.height],
        "focal": plain_numbers(camera.focal),
        "principal_point": plain_numbers(camera.principal_point),
        "distortion": plain_numbers(camera.distortion),
        "rotation": plain_numbers(camera.rotation),
        "position": plain_numbers(camera.position),
        "offset": float(placed.offset),
    }
    if placed.frame_rate is not None:
        entry["frame_rate"] = float(placed.frame_rate)
    return entry


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


def camera_of(entry: Any, where: str, position: int, models: Sequence[str] = ("projective",)) -> PlacedCamera:
    """The projective camera of an ``entry``; ``where`` and ``position`` name it in errors, as do ``models``.

    Raises:
        RequestError: a field is missing or wrong, or the model is another.
    """
    if not isinstance(entry, dict):
        raise RequestError(f"{where}: expected a mapping of fields, got {type(entry).__name__}")
    model = entry.get("model", "projective")
    if model != "projective":
        raise RequestError(f"{where}: expected model {' or '.join(models)}, got {model!r}")
    missing = [name for name in FIELDS if name not in entry]
    if missing:
        raise RequestError(f"{where}: expected the field {missing[0]}, found none")
    values = {name: numbers(entry[name], shape, f"{where}: {name}") for name, shape in FIELDS.items()}
    lens = entry.get("distortion", [0.0] * 5)
    shape = (len(lens),) if isinstance(lens, list) and len(lens) in (8, 12) else (5,)
    distortion = numbers(lens, shape, f"{where}: distortion")
    width, height = (int(v) for v in values.pop("image_size"))
    try:
        camera = PinholeCamera(width=width, height=height, distortion=distortion, **values)
    except ValueError as error:
        raise RequestError(f"{where}: {error}") from error
    rate, offset = entry.get("frame_rate"), entry.get("offset", 0.0)
    if rate is not None and not (isinstance(rate, int | float) and math.isfinite(rate) and rate > 0):
        raise RequestError(f"{where}: expected a frame_rate above 0, got {rate!r}")
    if not (isinstance(offset, int | float) and math.isfinite(offset)):
        raise RequestError(f"{where}: expected an offset in seconds, got {offset!r}")
    name = str(entry.get("name", f"camera{position + 1}"))
    return PlacedCamera(name, camera, None if rate is None else float(rate), float(offset))


def numbers(value: Any, shape: tuple[int, ...], where: str) -> FloatArray:
    """``value`` as finite numbers of ``shape``; otherwise a `RequestError` that begins with ``where``."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != shape or not np.isfinite(array).all():
        raise RequestError(f"{where}: expected {' x '.join(str(n) for n in shape)} finite numbers, got {value!r}")
    return array


def plain_numbers(array: FloatArray) -> list[Any]:
    """``array`` as lists for a file, without the noise of its last digits."""
    rounded: list[Any] = np.round(array, 12).tolist()
    return rounded


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
