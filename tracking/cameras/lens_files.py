"""Lenses on disk, as other programs write them.

Intrinsics of a pinhole camera are read from files of OpenCV, ROS and others (`read_intrinsics`). Calibrations of
omnidirectional cameras are (`read_lens`, `write_lens`):

===============  =======================================================================================================
ocam             OCamCalib's `calib_results.txt`: Scaramuzza's model, centre as row and column, scene at z < 0
py-ocam          py-OCamCalib's JSON: the same model in our axes, centre as x and y; the image size is not in the file
kalibr           Kalibr's camchain YAML: the unified ("omni") model, or a pinhole with equidistant distortion
opencv           OpenCV's fisheye K and D of four, or its omnidir (with xi), in a FileStorage; ROS's camera YAML
===============  =======================================================================================================

All count pixels from the first one's centre. Reading gives Scaramuzza's model in each case: of the last two it is
fitted (`lens_fitting`), and so are those to write.
"""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import yaml
from numpy.polynomial import Polynomial

from tsuiseki.tracking.cameras.calibration import HALF_PIXEL
from tsuiseki.tracking.cameras.lens_fitting import (
    EquidistantLens,
    UnifiedLens,
    distances,
    fit_inverse,
    fit_omnidirectional,
)
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalLens
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.openers.json_files import json_of
from tsuiseki.tracking.openers.text import read_text, refusing
from tsuiseki.tracking.openers.xml_files import xml_of
from tsuiseki.tracking.openers.yaml_files import yaml_of
from tsuiseki.tracking.types import FloatArray

# What programs call the same things.
MATRIX_NAMES = ("camera_matrix", "cameraMatrix", "K", "K-matrix", "mtx", "k")
DISTORTION_NAMES = ("distortion_coefficients", "distCoeffs", "dist_coeffs", "D", "distCoeff", "dist", "d")
WIDTH_NAMES = ("image_width", "width")
HEIGHT_NAMES = ("image_height", "height")
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
LensFormat = Literal["ocam", "py-ocam", "kalibr-omni", "kalibr-equidistant", "opencv"]
# A fit that worked needs about ten; one that failed had 1,574 zeros.
MOST_COEFFICIENTS = 40
OCAM_ROWS = ("direct polynomial", "inverse polynomial", "centre", "affine", "image size")
# From angles to the image plane, as OCamCalib counts them, to py-OCamCalib's, radians.
TURN = np.pi / 2


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
    intrinsics = read_lens_file(path, image_size)
    if intrinsics.model in ("fisheye", "omnidirectional"):
        raise RequestError(
            f"{path}: expected the intrinsics of a pinhole camera, got a calibration of the {intrinsics.model} model; "
            "give it to tsuiseki calibrate pose without --projective"
        )
    if abs(intrinsics.skew) > 1e-6 * intrinsics.focal[0]:
        raise RequestError(f"{path}: expected intrinsics without skew, got {intrinsics.skew:g}")
    coefficients = intrinsics.coefficients
    if len(coefficients) == 14 and not coefficients[12:].any():
        coefficients = coefficients[:12]
    if len(coefficients) not in (4, 5, 8, 12):
        raise RequestError(
            f"{path}: expected 4, 5, 8 or 12 distortion coefficients (k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4), "
            f"got {len(coefficients)}; calibrate without the tilted and fisheye models"
        )
    if intrinsics.model is None and np.abs(coefficients[2:]).max() > TANGENTIAL:
        raise RequestError(
            f"{path}: expected k1, k2, p1, p2, got {coefficients.tolist()}, whose last look like a fisheye's; add the "
            "line distortion_model: equidistant, or plumb_bob"
        )
    if intrinsics.model is None:
        warnings.warn(
            f"{path}: its four coefficients are taken as k1, k2, p1, p2; where they are a fisheye's, add the line "
            "distortion_model: equidistant",
            InputWarning,
            stacklevel=2,
        )
    distortion = np.pad(coefficients, (0, max(5 - len(coefficients), 0)))
    with refusing(f"{path}: expected the intrinsics of a camera, got others: ", str):
        return PinholeCamera(*intrinsics.size, intrinsics.focal, intrinsics.principal_point, distortion=distortion)


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
        pair = np.concatenate([width.ravel(), height.ravel()])
    if pair is None:
        raise RequestError(f"{path}: expected image_width and image_height, found none; give the image size")
    if pair.size != 2 or not (pair >= 1).all():
        raise RequestError(f"{path}: expected a width and height above 0, got {pair.tolist()}")
    return int(pair.ravel()[0]), int(pair.ravel()[1])


def write_intrinsics(path: Path, camera: PinholeCamera, error: float) -> None:
    """Write a lens as OpenCV's own calibration program does (YAML), with the root mean square error in pixels."""
    matrix = np.diag([*camera.focal, 1.0])
    matrix[:2, 2] = camera.principal_point - HALF_PIXEL
    # In memory first: OpenCV takes no names that are not UTF-8, and says nothing of a full disk.
    storage = cv2.FileStorage(".yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("image_width", camera.width)
    storage.write("image_height", camera.height)
    storage.write("camera_matrix", matrix)
    storage.write("distortion_coefficients", camera.distortion[None])
    storage.write("avg_reprojection_error", error)
    path.write_text(storage.releaseAndGetString(), encoding="utf-8")


def _first(path: Path, content: dict[str, Any], names: Sequence[str]) -> FloatArray | None:
    """The numbers under the first of the names that is there."""
    value = next((content[name] for name in names if content.get(name) is not None), None)
    if value is None:
        return None
    with refusing(f"{path}: expected numbers in matrix, coefficients and size, got something else"):
        return np.asarray(value["data"] if isinstance(value, dict) else value, dtype=np.float64)


def _content(path: Path) -> dict[str, Any]:
    """What a file has by name: numbers, words, and matrices as lists or as mappings with ``data``."""
    text = read_text(path, "camera intrinsics")
    if text.lstrip().startswith("<"):
        return _xml(path, text)
    # OpenCV's first line is no YAML, nor are its tags; JSON is YAML but for tabs.
    text = re.sub(r"\A\s*%YAML.*|!!opencv-\S+", "", text).replace("\t", " ")
    content = yaml_of(text, str(path), "YAML or JSON with camera intrinsics")
    if not isinstance(content, dict) or not all(isinstance(name, str) for name in content):
        raise RequestError(f"{path}: expected named intrinsics, got a {type(content).__name__}")
    return content


def _xml(path: Path, text: str) -> dict[str, Any]:
    root = xml_of(text, str(path), "an OpenCV file with camera intrinsics")
    names = [child.tag for child in root]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise RequestError(f"{path}: expected each name once, got {twice} twice")
    return {child.tag: _xml_value(child.findtext("data", child.text or "")) for child in root}


def _xml_value(text: str) -> str | float | list[float]:
    """A number, several of them, or words in quotes."""
    # OpenCV writes what is not finite with a dot: .Inf and .Nan.
    words = [word.lower().replace(".nan", "nan").replace(".inf", "inf") for word in text.split()]
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return text.strip().strip('"')
    return numbers[0] if len(numbers) == 1 else numbers


def read_lens(path: Path, image_size: tuple[int, int] | None = None) -> OmnidirectionalLens:
    """The lens in ``path``, see `read_lens_fitted`."""
    return read_lens_fitted(path, image_size)[0]


def read_lens_fitted(path: Path, image_size: tuple[int, int] | None = None) -> tuple[OmnidirectionalLens, FloatArray]:
    """The lens in ``path``, whose format is recognised by its content, and how far it is from the file's own model.

    Args:
        path: one of the formats of this module.
        image_size: width and height, where the file does not say; elsewhere the file's own is kept.

    Returns:
        The lens, and the ``(N,)`` pixels between where it and the file's model put the same rays, over the image: zeros
        where the file holds Scaramuzza's model.

    Raises:
        RequestError: no such file, another format, or a calibration that is cut short or has failed.
    """
    text = read_text(path, "a lens calibration")
    try:
        model = _read(path, text, image_size)
        if isinstance(model, OmnidirectionalLens):
            return model, np.zeros(1)
        lens = fit_omnidirectional(model)
        return lens, distances(lens, model)
    except RequestError as error:
        names_file = str(error).startswith(str(path))
        raise RequestError(str(error) if names_file else f"{path}: {error}") from error
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise RequestError(f"{path}: expected a lens calibration, got one that is broken ({error})") from error


def _read(path: Path, text: str, image_size: tuple[int, int] | None) -> OmnidirectionalLens | EquidistantLens:
    """The file's own model."""
    if path.suffix.lower() == ".txt":
        return _read_ocam(text)
    if '"taylor_coefficient"' in text:
        return _read_py_ocam(text, image_size)
    if re.search(r"\b(distortion_coeffs|camera_model|cam\d+)\b", text):
        return _read_kalibr(text)
    lens = read_lens_file(path, image_size)
    if lens.model == "pinhole":
        raise RequestError(
            "expected a fisheye or omnidirectional calibration, got a pinhole's of "
            f"{len(lens.coefficients)} coefficients; give it to tsuiseki calibrate pose with --projective"
        )
    if lens.coefficients.shape != (4,):
        raise RequestError(f"expected four coefficients of the {lens.model} model, got {len(lens.coefficients)}")
    place = (*lens.size, lens.focal, lens.principal_point)
    if lens.model == "omnidirectional":
        return UnifiedLens(*place, lens.coefficients, lens.skew, lens.xi)
    return EquidistantLens(*place, lens.coefficients, lens.skew)


def write_lens(path: Path, lens: OmnidirectionalLens, kind: LensFormat) -> FloatArray:
    """Write ``lens`` in a format, overwriting ``path``.

    Returns:
        ``(N,)`` pixels between where the lens and what was written put the same rays, over the image.
    """
    if kind in ("ocam", "py-ocam"):
        lens = lens if len(lens.inverse) else fit_inverse(lens)
        text = _ocam_text(lens) if kind == "ocam" else _py_ocam_text(lens)
        path.write_text(text, encoding="utf-8")
        return distances(lens, _read_ocam(text) if kind == "ocam" else _read_py_ocam(text, (lens.width, lens.height)))
    fitted, residuals = (UnifiedLens if kind == "kalibr-omni" else EquidistantLens).fitted(lens)
    text = _opencv_text(fitted, path.suffix.lower()) if kind == "opencv" else _kalibr_text(fitted)
    path.write_text(text, encoding="utf-8")
    return residuals


def _read_ocam(text: str) -> OmnidirectionalLens:
    lines = [line.strip() for line in text.splitlines()]
    rows = [line.split() for line in lines if line and not line.startswith("#")]
    if len(rows) < len(OCAM_ROWS):
        raise RequestError(
            f"expected {len(OCAM_ROWS)} rows of numbers, got {len(rows)}: the row of the {OCAM_ROWS[len(rows)]} is "
            "missing; is the file cut short?"
        )
    direct, inverse = (_polynomial(row, name) for row, name in zip(rows[:2], OCAM_ROWS[:2], strict=True))
    numbers = [_numbers(row, size, name) for row, size, name in zip(rows[2:5], (2, 3, 2), OCAM_ROWS[2:], strict=True)]
    (row, column), (c, d, e), (height, width) = (values.tolist() for values in numbers)
    if direct[0] >= 0:
        raise RequestError(f"expected a direct polynomial below 0 at 0, got {direct[0]:g}: the calibration has failed")
    return OmnidirectionalLens(
        int(width),
        int(height),
        -direct,
        np.array([column, row]) + HALF_PIXEL,
        np.array([[1.0, e], [d, c]]),
        inverse,
    )


def _polynomial(row: Sequence[str], name: str) -> FloatArray:
    values = _numbers(row, None, name)
    count = int(values[0]) if len(values) and values[0] == int(values[0]) else -1
    if count < 1 or count > MOST_COEFFICIENTS:
        raise RequestError(f"expected a {name} of 1 to {MOST_COEFFICIENTS} coefficients, got {values[0]:g}: the "
                           "calibration has failed; calibrate again")  # fmt: skip
    if len(values) != count + 1:
        raise RequestError(f"expected {count} coefficients in the {name}, got {len(values) - 1}: is the row cut short?")
    if not values[1:].any():
        raise RequestError(f"expected a {name} that is not all zero: the calibration has failed; calibrate again")
    return values[1:]


def _numbers(row: Sequence[str], size: int | None, name: str) -> FloatArray:
    try:
        values = np.array([float(word) for word in row])
    except ValueError as error:
        raise RequestError(f"expected numbers in the row of the {name}, got {' '.join(row[:4])[:60]}") from error
    if not np.isfinite(values).all() or len(values) == 0 or (size is not None and len(values) != size):
        raise RequestError(f"expected {size or 'some'} finite numbers in the row of the {name}, got {len(values)}")
    return values


def _ocam_text(lens: OmnidirectionalLens) -> str:
    # OCamCalib's affine map leaves columns alone: what else there is goes into the radius.
    lens = _rescaled(lens, float(lens.stretch[0, 0]))
    (_, e), (d, c) = lens.stretch.tolist()
    x, y = (lens.centre - HALF_PIXEL).tolist()

    def row(values: FloatArray) -> str:
        return f"{len(values)} " + " ".join(f"{v:.12e}" for v in values)

    parts = (
        ("polynomial coefficients for the DIRECT mapping function, low to high", row(-lens.direct)),
        ("polynomial coefficients for the inverse mapping function, low to high", row(lens.inverse)),
        ("center: row and column, starting from 0", f"{y:.9f} {x:.9f}"),
        ("affine parameters c, d, e", f"{c:.12f} {d:.12f} {e:.12f}"),
        ("image size: height and width", f"{lens.height} {lens.width}"),
    )
    return "".join(f"#{title}\n\n{values}\n\n" for title, values in parts)


def _rescaled(lens: OmnidirectionalLens, factor: float) -> OmnidirectionalLens:
    """The same lens with sensor points ``factor`` times as large."""
    powers = factor ** (1.0 - np.arange(len(lens.direct)))
    direct, stretch, inverse = lens.direct * powers, lens.stretch / factor, lens.inverse * factor
    return replace(lens, direct=direct, stretch=stretch, inverse=inverse)


def _read_py_ocam(text: str, image_size: tuple[int, int] | None) -> OmnidirectionalLens:
    content = json_of(text, "", "a calibration of py-OCamCalib")
    if image_size is None:
        raise RequestError("expected `image_size` WIDTH,HEIGHT, which py-OCamCalib's files do not hold")
    direct = np.array(content["taylor_coefficient"], dtype=np.float64)
    if len(direct) > MOST_COEFFICIENTS or not direct.size or direct[0] <= 0:
        raise RequestError("expected a taylor_coefficient above 0 at 0: the calibration has failed; calibrate again")
    by_angle = Polynomial(np.array(content.get("inverse_poly", [0.0]), dtype=np.float64)[::-1])
    inverse = np.asarray(by_angle(Polynomial([TURN, 1.0])).coef, dtype=np.float64)
    return OmnidirectionalLens(
        *image_size,
        direct,
        np.array(content["distortion_center"], dtype=np.float64) + HALF_PIXEL,
        np.array(content["stretch_matrix"], dtype=np.float64),
        inverse if "inverse_poly" in content else np.empty(0),
    )


def _py_ocam_text(lens: OmnidirectionalLens) -> str:
    # There the lower right entry is 1.
    lens = _rescaled(lens, float(lens.stretch[1, 1]))
    by_angle = Polynomial(lens.inverse)(Polynomial([-TURN, 1.0])).coef
    content = {
        "camera_name": "camera",
        "taylor_coefficient": lens.direct.tolist(),
        "distortion_center": (lens.centre - HALF_PIXEL).tolist(),
        "stretch_matrix": lens.stretch.tolist(),
        "inverse_poly": by_angle[::-1].tolist(),
    }
    return json.dumps(content, indent=1) + "\n"


def _read_kalibr(text: str) -> EquidistantLens:
    content = yaml_of(text, "", "a calibration of Kalibr")
    cameras = [name for name in content if re.fullmatch(r"cam\d+", str(name))]
    entry = content[cameras[0]] if cameras else content
    if len(cameras) > 1:
        raise RequestError(f"expected one camera, got {len(cameras)}; keep one cam entry in the file")
    width, height = (int(v) for v in entry["resolution"])
    values = np.array(entry["intrinsics"], dtype=np.float64)
    coefficients = np.array(entry["distortion_coeffs"], dtype=np.float64)
    model, distortion = entry.get("camera_model"), entry.get("distortion_model")
    if (model, distortion) == ("omni", "radtan") and values.shape == (5,) and coefficients.shape == (4,):
        return UnifiedLens(width, height, values[1:3], values[3:5] + HALF_PIXEL, coefficients, xi=float(values[0]))
    if (model, distortion) == ("pinhole", "equidistant") and values.shape == (4,) and coefficients.shape == (4,):
        return EquidistantLens(width, height, values[:2], values[2:] + HALF_PIXEL, coefficients)
    raise RequestError(
        "expected omni with radtan or pinhole with equidistant, each with its intrinsics and four coefficients, "
        f"got {model} with {distortion}"
    )


def _kalibr_text(lens: EquidistantLens) -> str:
    place = [*lens.focal.tolist(), *(lens.principal_point - HALF_PIXEL).tolist()]
    unified = isinstance(lens, UnifiedLens)
    entry = {
        "camera_model": "omni" if unified else "pinhole",
        "intrinsics": [lens.xi, *place] if isinstance(lens, UnifiedLens) else place,
        "distortion_model": "radtan" if unified else "equidistant",
        "distortion_coeffs": lens.distortion.tolist(),
        "resolution": [lens.width, lens.height],
    }
    return yaml.safe_dump({"cam0": entry}, sort_keys=False, default_flow_style=None)


def _opencv_text(lens: EquidistantLens, suffix: str) -> str:
    (fx, fy), (x, y) = lens.focal.tolist(), (lens.principal_point - HALF_PIXEL).tolist()
    kind = suffix if suffix in (".json", ".xml") else ".yaml"
    storage = cv2.FileStorage(kind, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("image_width", lens.width)
    storage.write("image_height", lens.height)
    storage.write("fisheye_model", 1)
    storage.write("K", np.array([[fx, 0.0, x], [0.0, fy, y], [0.0, 0.0, 1.0]]))
    storage.write("D", lens.distortion)
    return storage.releaseAndGetString()
