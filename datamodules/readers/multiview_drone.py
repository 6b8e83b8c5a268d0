"""The multi-view drone data set 3: where six cameras saw a flying drone, and where it was.

Positions come at 5 Hz from RTK; pixels are 0, 0 where a camera did not see the drone. The frame rates are those of the
calibration files, but camera 1 had its pixels remapped to 30 frames/s by the authors (Li et al., "Reconstruction of 3D
flight trajectories from ad-hoc camera networks", 2020).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.cameras.calibration import Intrinsics
from tsuiseki.tracking.cameras.intrinsic_files import read_intrinsics
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray

CALIBRATIONS = ("gopro3", "mate7", "mate10_1", "sony5n_1440x1080", "sony5100", "sonyG_1")
FRAME_RATES = (59.94006, 30.0, 29.727612, 25.0, 29.97003, 50.0)
TRUTH_RATE = 5.0


@dataclass(frozen=True)
class DroneView:
    """What one camera saw.

    Attributes:
        frames: ``(N,)`` numbers of the frames that show the drone.
        pixels: ``(N, 2)`` its centre.
        intrinsics: of the camera.
        frame_rate: nominal, frames/s.
    """

    frames: FloatArray
    pixels: FloatArray
    intrinsics: Intrinsics
    frame_rate: float


@dataclass(frozen=True)
class DroneFlight:
    """The whole data set.

    Attributes:
        times: ``(T,)`` seconds since the first RTK position.
        points: ``(T, 3)`` metres.
        views: of the six cameras.
    """

    times: FloatArray
    points: FloatArray
    views: tuple[DroneView, ...]


def read_drone_flight(folder: Path) -> DroneFlight:
    """The data set in ``folder``, whose neighbour ``calibration`` holds the intrinsics.

    Raises:
        RequestError: a file is missing or broken.
    """
    points = _table(folder / "trajectory" / "rtk.txt", 3, 0)
    views = []
    for k, (name, rate) in enumerate(zip(CALIBRATIONS, FRAME_RATES, strict=True)):
        rows = _table(folder / "detections" / f"cam{k}.txt", 3, 1)
        rows = rows[(rows[:, 1:] != 0).any(axis=1)]
        intrinsics = read_intrinsics(folder.parent / "calibration" / f"{name}.json")
        views.append(DroneView(rows[:, 0], rows[:, 1:], intrinsics, rate))
    return DroneFlight(np.arange(len(points)) / TRUTH_RATE, points, tuple(views))


def _table(path: Path, columns: int, skip: int) -> FloatArray:
    try:
        values = np.loadtxt(path, skiprows=skip, ndmin=2)
    except (OSError, ValueError) as error:
        raise RequestError(f"{path}: expected a table of {columns} columns of numbers, cannot read it") from error
    if values.shape[1] != columns:
        raise RequestError(f"{path}: expected {columns} columns, got {values.shape[1]}")
    return values
