"""`cameras.yaml` of cameras over a floor, projective or omnidirectional.

Beside the fields of `files`, an entry may have ``floor: [x1, y1, x2, y2]``, the part of the plane z = 0 that people
stand on, metres. An omnidirectional one has, instead of ``focal``, ``principal_point`` and ``distortion``::

    model: omnidirectional
    direct: [320.1, 0, -8e-4, ...]   # Scaramuzza's polynomial F, low to high, in our axes: F(0) > 0
    inverse: [...]                   # optional: OCamCalib's inverse polynomial, low to high
    centre: [640.2, 481.7]           # pixels; the first pixel's centre lies at 0.5
    stretch: [[1, 0], [0, 1]]        # optional: sensor points to pixels about the centre
    field: 1.6                       # optional: largest angle to the axis, radians
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tsuiseki.tracking.cameras.files import PlacedCamera, camera_entry, camera_of, numbers, plain_numbers, read_entries
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera, OmnidirectionalLens, Resize
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray


@dataclass(frozen=True)
class CameraOverFloor:
    """A camera and the floor that it looks at.

    Attributes:
        name: for people to read.
        camera: with its pose.
        floor: ``(4,)`` x1, y1, x2, y2, metres; None where the file does not say.
        frame_rate: frames/s; None where the video tells.
        offset: time of the first frame, seconds.
    """

    name: str
    camera: PinholeCamera | OmnidirectionalCamera
    floor: FloatArray | None = None
    frame_rate: float | None = None
    offset: float = 0.0

    def resized(self, width: int, height: int, how: Resize = "cut") -> CameraOverFloor:
        """The same camera with images of another size, see `OmnidirectionalLens.resized`.

        Raises:
            RequestError: the camera is projective.
        """
        if not isinstance(self.camera, OmnidirectionalCamera):
            raise RequestError(
                f"{self.name}: only omnidirectional calibrations are scaled; calibrate at {width}x{height}"
            )
        return replace(self, camera=replace(self.camera, lens=self.camera.lens.resized(width, height, how)))


def read_floor_cameras(path: Path) -> list[CameraOverFloor]:
    """The cameras of a `cameras.yaml`, in order.

    Raises:
        RequestError: the file is missing or no YAML, an entry lacks a field or has a wrong one, which is named, or
            two cameras have different floors, or one has a floor and another none.
    """
    cameras = [_entry_of(entry, f"{path}: camera {k + 1}", k) for k, entry in enumerate(read_entries(path))]
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


def write_floor_cameras(path: Path, cameras: list[CameraOverFloor]) -> None:
    """Write `cameras.yaml`, overwriting ``path``."""
    entries = []
    for placed in cameras:
        camera = placed.camera
        if isinstance(camera, PinholeCamera):
            entry = camera_entry(PlacedCamera(placed.name, camera, placed.frame_rate, placed.offset))
        else:
            entry = _omnidirectional_entry(placed, camera)
        if placed.floor is not None:
            entry["floor"] = plain_numbers(placed.floor)
        entries.append(entry)
    text = yaml.safe_dump({"cameras": entries}, sort_keys=False, default_flow_style=None, width=120)
    path.write_text(text, encoding="utf-8")


def _omnidirectional_entry(placed: CameraOverFloor, camera: OmnidirectionalCamera) -> dict[str, Any]:
    lens = camera.lens
    entry: dict[str, Any] = {
        "name": placed.name,
        "model": "omnidirectional",
        "image_size": [lens.width, lens.height],
        # Rounding would cost the high powers their digits.
        "direct": lens.direct.tolist(),
        "centre": plain_numbers(lens.centre),
        "stretch": plain_numbers(lens.stretch),
        "rotation": plain_numbers(camera.rotation),
        "position": plain_numbers(camera.position),
        "offset": float(placed.offset),
    }
    if len(lens.inverse):
        entry["inverse"] = lens.inverse.tolist()
    if lens.field is not None:
        entry["field"] = float(lens.field)
    if placed.frame_rate is not None:
        entry["frame_rate"] = float(placed.frame_rate)
    return entry


def _entry_of(entry: Any, where: str, position: int) -> CameraOverFloor:
    floor = None
    if isinstance(entry, dict) and entry.get("floor") is not None:
        floor = numbers(entry["floor"], (4,), f"{where}: floor")
        if floor[0] >= floor[2] or floor[1] >= floor[3]:
            raise RequestError(f"{where}: floor: expected x1 < x2 and y1 < y2, got {floor.tolist()}")
    if not isinstance(entry, dict) or entry.get("model") != "omnidirectional":
        placed = camera_of(entry, where, position, ("projective", "omnidirectional"))
        return CameraOverFloor(placed.name, placed.camera, floor, placed.frame_rate, placed.offset)
    # The fields that both models share are checked in one place, on an entry with a stand-in for the lens.
    stand_in = {**entry, "model": "projective", "focal": [1, 1], "principal_point": [0, 0], "distortion": [0] * 5}
    placed = camera_of(stand_in, where, position)
    missing = [name for name in ("direct", "centre") if name not in entry]
    if missing:
        raise RequestError(f"{where}: expected the field {missing[0]}, found none")
    try:
        lens = OmnidirectionalLens(
            placed.camera.width,
            placed.camera.height,
            np.array(entry["direct"], dtype=np.float64),
            numbers(entry["centre"], (2,), f"{where}: centre"),
            numbers(entry.get("stretch", np.eye(2).tolist()), (2, 2), f"{where}: stretch"),
            np.array(entry.get("inverse", []), dtype=np.float64),
            entry.get("field"),
        )
    except (TypeError, ValueError) as error:
        raise RequestError(f"{where}: {error}") from error
    camera = OmnidirectionalCamera(lens, placed.camera.rotation, placed.camera.position)
    return CameraOverFloor(placed.name, camera, floor, placed.frame_rate, placed.offset)
