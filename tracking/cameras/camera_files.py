"""`cameras.yaml`: the cameras of a run, projective or omnidirectional, and their floor.

It has a list ``cameras`` with one entry per source, in the order of the sources::

    cameras:
    - name: left
      model: projective
      image_size: [800, 600]        # width, height
      focal: [693.0, 693.0]         # pixels
      principal_point: [400, 300]   # pixels; the first pixel's centre lies at 0.5
      distortion: [0, 0, 0, 0, 0]   # optional: k1, k2, p1, p2, k3; or 8 or 12 coefficients as OpenCV orders them
      rotation: [[...], [...], [...]]  # directions of the world to right, down, forward
      position: [4.0, 0.0, 1.5]     # metres, z up
      floor: [0, 0, 8, 6]           # optional: x1, y1, x2, y2 of the plane z = 0 that people stand on, metres
      frame_rate: 15                # optional: frames/s, where the video does not tell
      offset: 0.0                   # optional: time of the first frame, seconds

An omnidirectional camera has, instead of ``focal``, ``principal_point`` and ``distortion``::

      model: omnidirectional
      direct: [320.1, 0, -8e-4, ...]   # Scaramuzza's polynomial F, low to high, in our axes: F(0) > 0
      inverse: [...]                   # optional: OCamCalib's inverse polynomial, low to high
      centre: [640.2, 481.7]           # pixels; the first pixel's centre lies at 0.5
      stretch: [[1, 0], [0, 1]]        # optional: sensor points to pixels about the centre
      field: 1.6                       # optional: largest angle to the axis, radians
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeAlias, TypeVar, cast

import numpy as np
import yaml

from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera, OmnidirectionalLens, Resize
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.openers.yaml_files import read_yaml
from tsuiseki.tracking.types import FloatArray

AnyCamera = PinholeCamera | OmnidirectionalCamera
CameraT = TypeVar("CameraT", bound=AnyCamera, covariant=True)


@dataclass(frozen=True)
class Placed(Generic[CameraT]):
    """One entry of `cameras.yaml`.

    Attributes:
        name: for people to read.
        camera: with its pose.
        frame_rate: frames/s; None where the video tells.
        offset: time of the first frame, seconds.
        floor: ``(4,)`` x1, y1, x2, y2, metres; None where the file does not say.
    """

    name: str
    camera: CameraT
    frame_rate: float | None = None
    offset: float = 0.0
    floor: FloatArray | None = None

    def resized(self, width: int, height: int, how: Resize = "cut") -> Placed[OmnidirectionalCamera]:
        """The same camera with images of another size, see `OmnidirectionalLens.resized`.

        Raises:
            RequestError: the camera is projective.
        """
        if not isinstance(self.camera, OmnidirectionalCamera):
            raise RequestError(
                f"{self.name}: only omnidirectional calibrations are scaled; calibrate at {width}x{height}"
            )
        camera = replace(self.camera, lens=self.camera.lens.resized(width, height, how))
        return Placed(self.name, camera, self.frame_rate, self.offset, self.floor)


PlacedCamera: TypeAlias = Placed[PinholeCamera]
CameraOverFloor: TypeAlias = Placed[AnyCamera]


def read_cameras(path: Path) -> list[CameraOverFloor]:
    """The cameras of a `cameras.yaml`, in order.

    Raises:
        RequestError: the file is missing or no YAML, an entry lacks a field or has a wrong one, which is named, or
            two cameras have different floors, or one has a floor and another none.
    """
    cameras = _read(path, MODELS)
    floors = [(c.name, c.floor) for c in cameras if c.floor is not None]
    bare = [c.name for c in cameras if c.floor is None]
    if floors and bare:
        raise RequestError(
            f"{path}: expected one floor for all cameras, got {floors[0][1].tolist()} of {floors[0][0]} and none of "
            f"{bare[0]}; give all of them the whole room's"
        )
    for name, floor in floors[1:]:
        if not np.allclose(floor, floors[0][1]):
            raise RequestError(
                f"{path}: expected one floor for all cameras, got {floors[0][1].tolist()} of {floors[0][0]} and "
                f"{floor.tolist()} of {name}; give all of them the whole room's"
            )
    return cameras


def read_projective_cameras(path: Path) -> list[PlacedCamera]:
    """The cameras of a `cameras.yaml`, all of which must be projective; see `read_cameras`."""
    return cast("list[PlacedCamera]", _read(path, {"projective": MODELS["projective"]}))


def _read(path: Path, models: Mapping[str, CameraModel]) -> list[CameraOverFloor]:
    """The cameras of a `cameras.yaml`, each of one of the ``models``; floors may differ."""
    content = read_yaml(path, "YAML of cameras, as tsuiseki calibrate writes it")
    entries = content.get("cameras") if isinstance(content, dict) else None
    if not isinstance(entries, list) or not entries:
        raise RequestError(f"{path}: expected a list named cameras with one entry per source, found none")
    return [_camera_of(entry, f"{path}: camera {k + 1}", k, models) for k, entry in enumerate(entries)]


def write_cameras(
    path: Path, cameras: Sequence[CameraOverFloor], beside: Sequence[Mapping[str, Any]] | None = None
) -> None:
    """Write `cameras.yaml`, overwriting ``path``; ``beside`` are fields of each that are for people to read."""
    entries = [
        _entry(camera) | dict(extra) for camera, extra in zip(cameras, beside or [{}] * len(cameras), strict=True)
    ]
    text = yaml.safe_dump({"cameras": entries}, sort_keys=False, default_flow_style=None, width=120)
    path.write_text(text, encoding="utf-8")


def _entry(placed: CameraOverFloor) -> dict[str, Any]:
    camera = placed.camera
    name, model = next((name, model) for name, model in MODELS.items() if isinstance(camera, model.kind))
    entry = {
        "name": placed.name,
        "model": name,
        "image_size": [camera.width, camera.height],
        **model.write(camera),
        "rotation": _plain(camera.rotation),
        "position": _plain(camera.position),
        "offset": float(placed.offset),
    }
    if placed.frame_rate is not None:
        entry["frame_rate"] = float(placed.frame_rate)
    if placed.floor is not None:
        entry["floor"] = _plain(placed.floor)
    return entry


def _camera_of(entry: Any, where: str, position: int, models: Mapping[str, CameraModel]) -> CameraOverFloor:
    """The camera of an ``entry`` of one of the ``models``; ``where`` and ``position`` name it in errors."""
    if not isinstance(entry, dict):
        raise RequestError(f"{where}: expected a mapping of fields, got {type(entry).__name__}")
    floor = None
    if entry.get("floor") is not None and "omnidirectional" in models:
        floor = _numbers(entry["floor"], (4,), f"{where}: floor")
        if floor[0] >= floor[2] or floor[1] >= floor[3]:
            raise RequestError(f"{where}: floor: expected x1 < x2 and y1 < y2, got {floor.tolist()}")
    chosen = entry.get("model", "projective")
    model = models.get(chosen) if isinstance(chosen, str) else None
    if model is None:
        raise RequestError(f"{where}: expected model {' or '.join(models)}, got {chosen!r}")
    missing = [name for name in ("image_size", *model.fields, "rotation", "position") if name not in entry]
    if missing:
        raise RequestError(f"{where}: expected the field {missing[0]}, found none")
    shapes = {"image_size": (2,), **model.fields, "rotation": (3, 3), "position": (3,)}
    values = {name: _numbers(entry[name], shape, f"{where}: {name}") for name, shape in shapes.items() if shape}
    try:
        camera = model.read(entry, where, values)
    except (TypeError, ValueError) as error:
        raise RequestError(f"{where}: {error}") from error
    rate, offset = entry.get("frame_rate"), entry.get("offset", 0.0)
    if rate is not None and not (isinstance(rate, int | float) and math.isfinite(rate) and rate > 0):
        raise RequestError(f"{where}: expected a frame_rate above 0, got {rate!r}")
    if not (isinstance(offset, int | float) and math.isfinite(offset)):
        raise RequestError(f"{where}: expected an offset in seconds, got {offset!r}")
    name = str(entry.get("name", f"camera{position + 1}"))
    return Placed(name, camera, None if rate is None else float(rate), float(offset), floor)


@dataclass(frozen=True)
class CameraModel:
    """How the cameras of one model are read and written.

    Attributes:
        kind: their class.
        fields: shapes of what an entry must say of the lens; an empty one is that of a list of any length.
        read: the camera of an entry; gets the entry, its name for errors, and the values of fields with a shape.
        write: what an entry says of the lens.
    """

    kind: type[AnyCamera]
    fields: Mapping[str, tuple[int, ...]]
    read: Callable[[Mapping[str, Any], str, Mapping[str, FloatArray]], AnyCamera]
    write: Callable[[Any], dict[str, Any]]


def _read_projective(entry: Mapping[str, Any], where: str, values: Mapping[str, FloatArray]) -> AnyCamera:
    lens = entry.get("distortion", [0.0] * 5)
    shape = (len(lens),) if isinstance(lens, list) and len(lens) in (8, 12) else (5,)
    distortion = _numbers(lens, shape, f"{where}: distortion")
    width, height = map(int, values["image_size"])
    fields = {name: value for name, value in values.items() if name != "image_size"}
    return PinholeCamera(width=width, height=height, distortion=distortion, **fields)


def _read_omnidirectional(entry: Mapping[str, Any], where: str, values: Mapping[str, FloatArray]) -> AnyCamera:
    width, height = map(int, values["image_size"])
    lens = OmnidirectionalLens(
        width,
        height,
        np.array(entry["direct"], dtype=np.float64),
        values["centre"],
        _numbers(entry.get("stretch", np.eye(2).tolist()), (2, 2), f"{where}: stretch"),
        np.array(entry.get("inverse", []), dtype=np.float64),
        entry.get("field"),
    )
    return OmnidirectionalCamera(lens, values["rotation"], values["position"])


def _write_omnidirectional(camera: OmnidirectionalCamera) -> dict[str, Any]:
    lens = camera.lens
    # Rounding would cost the high powers their digits.
    entry = {"direct": lens.direct.tolist(), "centre": _plain(lens.centre), "stretch": _plain(lens.stretch)}
    entry |= {"inverse": lens.inverse.tolist()} if len(lens.inverse) else {}
    return entry | ({} if lens.field is None else {"field": float(lens.field)})


def _numbers(value: Any, shape: tuple[int, ...], where: str) -> FloatArray:
    """``value`` as finite numbers of ``shape``; otherwise a `RequestError` that begins with ``where``."""
    try:
        array = np.asarray(value, dtype=np.float64)
        if any(isinstance(item, bool) for item in np.asarray(value, dtype=np.object_).flat):
            array = np.empty(0)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != shape or not np.isfinite(array).all():
        raise RequestError(f"{where}: expected {' x '.join(str(n) for n in shape)} finite numbers, got {value!r}")
    return array


def _plain(array: FloatArray) -> list[Any]:
    """``array`` as lists for a file, without the noise of its last digits."""
    rounded: list[Any] = np.round(array, 12).tolist()
    return rounded


# By the name in the file.
MODELS: Mapping[str, CameraModel] = {
    "projective": CameraModel(
        PinholeCamera,
        {"focal": (2,), "principal_point": (2,)},
        _read_projective,
        lambda camera: {name: _plain(getattr(camera, name)) for name in ("focal", "principal_point", "distortion")},
    ),
    "omnidirectional": CameraModel(
        OmnidirectionalCamera, {"direct": (), "centre": (2,)}, _read_omnidirectional, _write_omnidirectional
    ),
}
