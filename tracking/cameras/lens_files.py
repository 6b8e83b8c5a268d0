"""Lens calibrations of omnidirectional cameras as other programs write them.

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
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import yaml
from numpy.polynomial import Polynomial

from tsuiseki.tracking.cameras.calibration import HALF_PIXEL
from tsuiseki.tracking.cameras.intrinsic_files import read_lens_file
from tsuiseki.tracking.cameras.lens_fitting import (
    EquidistantLens,
    UnifiedLens,
    distances,
    fit_inverse,
    fit_omnidirectional,
)
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalLens
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import read_text
from tsuiseki.tracking.types import FloatArray

LensFormat = Literal["ocam", "py-ocam", "kalibr-omni", "kalibr-equidistant", "opencv"]
# A fit that worked needs about ten; one that failed had 1,574 zeros.
MOST_COEFFICIENTS = 40
OCAM_ROWS = ("direct polynomial", "inverse polynomial", "centre", "affine", "image size")
TURN = np.pi / 2


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
        known = str(error).startswith(str(path))
        raise RequestError(str(error) if known else f"{path}: {error}") from error
    except (ValueError, KeyError, TypeError, IndexError, yaml.YAMLError) as error:
        raise RequestError(f"{path}: expected a lens calibration, got one that is broken ({error})") from error


def _read(path: Path, text: str, image_size: tuple[int, int] | None) -> OmnidirectionalLens | EquidistantLens:
    """The file's own model."""
    if path.suffix.lower() == ".txt":
        return _read_ocam(text)
    if '"taylor_coefficient"' in text:
        return _read_py_ocam(text, image_size)
    if re.search(r"\b(distortion_coeffs|camera_model|cam\d+)\b", text):
        return _read_kalibr(text)
    given = read_lens_file(path, image_size)
    if given.model == "pinhole":
        raise RequestError(
            "expected a fisheye or omnidirectional calibration, got a pinhole's of "
            f"{len(given.coefficients)} coefficients; give it to tsuiseki calibrate pose with --projective"
        )
    if given.coefficients.shape != (4,):
        raise RequestError(f"expected four coefficients of the {given.model} model, got {len(given.coefficients)}")
    place = (*given.size, given.focal, given.principal_point)
    if given.model == "omnidirectional":
        return UnifiedLens(*place, given.coefficients, given.skew, given.xi)
    return EquidistantLens(*place, given.coefficients, given.skew)


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
        raise RequestError(f"expected numbers in the row of the {name}, got {' '.join(row[:4])}") from error
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
    content = json.loads(text)
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
    content = yaml.safe_load(text)
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
