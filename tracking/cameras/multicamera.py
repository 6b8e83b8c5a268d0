"""People in several calibrated cameras over one floor: WILDTRACK, Shelf, and a plain CSV of boxes and feet.

* WILDTRACK: a folder with ``viewN_NAME.csv``, ``floor.csv`` and ``calibrations``; frames are numbered 0, 5, 10, … at
  10 frames/s, the world is in centimetres in the calibration and in metres on the floor.
* Shelf: a folder with ``cameraN_detections.csv``, ``truth.csv`` and ``calibration.json``; frames count from 1, their
  rate is not known and taken as 25/s.
* CSV: ``frame,x1,y1,x2,y2`` in pixels from 0 and optionally ``score``, and ``ankle_u,ankle_v``, the middle of both
  ankles; empty where they are not visible. Frames count from 1; in a column ``frame_idx`` instead, from 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.tracking.cameras.camera_files import CameraOverFloor, Placed
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import NamedRows, column_names, finite_number, read_named_rows
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.openers.text import refusing
from tsuiseki.tracking.openers.xml_files import read_xml
from tsuiseki.tracking.types import Detections, FloatArray, IntArray
from tsuiseki.tracking.types.frame_range import LAST_FRAME

CORNERS = ("x1", "y1", "x2", "y2")
ANKLES = ("ankle_u", "ankle_v")
# Width and height of WILDTRACK's pictures, pixels.
WILDTRACK_SIZE = (1920, 1080)
# Its labelled frames a second.
WILDTRACK_RATE = 2.0
# From the number of one labelled frame to the next.
WILDTRACK_STEP = 5
# x1, y1, x2, y2 of its floor, metres.
WILDTRACK_FLOOR = np.array([-3.0, -9.0, 9.0, 27.0])
# Frames a second of Shelf, assumed.
SHELF_RATE = 25.0


@dataclass(frozen=True)
class StandingPeople:
    """What one camera detected in one frame.

    Attributes:
        detections: boxes in the image.
        feet: ``(N, 2)`` pixels of the middle of both ankles; NaN where they are not known.
    """

    detections: Detections
    feet: FloatArray

    def __len__(self) -> int:
        return len(self.detections)

    @classmethod
    def of(cls, detections: Detections) -> StandingPeople:
        """Boxes alone."""
        return cls(detections, np.full((len(detections), 2), np.nan))


@dataclass(frozen=True)
class PlacedTruth:
    """Who is where, one row each.

    Attributes:
        times: ``(N,)`` seconds.
        ids: ``(N,)``.
        places: ``(N, 2)`` metres.
    """

    times: FloatArray
    ids: IntArray
    places: FloatArray


@dataclass(frozen=True)
class FloorFolder:
    """A data set of several cameras over one floor.

    Attributes:
        cameras: with poses, rates and floor.
        people: of each camera what is in each frame.
        truth: who is where.
    """

    cameras: list[CameraOverFloor]
    people: list[list[StandingPeople]]
    truth: PlacedTruth


def read_standing(
    path: Path, length: int | None = None, frames_of: Callable[[NamedRows], IntArray] = NamedRows.frames
) -> list[StandingPeople]:
    """The detections of one camera in a CSV.

    Args:
        path: of the file.
        length: number of frames; by default up to the last that has a detection.
        frames_of: gives the frames of its rows, from 0.

    Raises:
        RequestError: a column is missing, a value is no number, a box has no area, or a frame lies beyond the length.
    """
    table = read_named_rows(path, "a CSV of detections", CORNERS)
    frames = frames_of(table)
    last = int(frames.max(initial=-1)) + 1
    if length is not None and last > length:
        raise RequestError(f"{path}: expected frames up to {length}, got {last}; are these boxes of another video?")
    boxes = table.numbers(CORNERS)
    flat = np.flatnonzero((boxes[:, 2:] <= boxes[:, :2]).any(axis=1))
    if len(flat):
        raise RequestError(f"{path}:{table.rows[flat[0]][0]}: expected x1 < x2 and y1 < y2, got {boxes[flat[0]]}")
    scores = table.numbers(("score",))[:, 0] if "score" in table.names else np.ones(len(boxes))
    ankles = set(ANKLES) <= set(table.names)
    feet = _ankles(table) if ankles else np.full((len(boxes), 2), np.nan)
    of_frames = [frames == frame for frame in range(last if length is None else length)]
    return [StandingPeople(Detections(boxes[rows], scores[rows]), feet[rows]) for rows in of_frames]


def _labelled_frames(table: NamedRows) -> IntArray:
    """``(N,)`` frames of WILDTRACK, whose numbers are 0, 5, 10, …; raises RequestError for another number."""
    numbers = table.whole_numbers("frame", 0, WILDTRACK_STEP * LAST_FRAME)
    if len(odd := np.flatnonzero(numbers % WILDTRACK_STEP)):
        raise RequestError(f"{table.path}:{table.rows[odd[0]][0]}: expected frames 0, 5, 10, …, got {numbers[odd[0]]}")
    return np.asarray(numbers // WILDTRACK_STEP)


def _ankles(table: NamedRows) -> FloatArray:
    """``(N, 2)`` the ankles, NaN where there is nothing."""
    values = [
        [finite_number(table.path, line, name, row[name]) if row[name] else np.nan for name in ANKLES]
        for line, row in table.rows
    ]
    return np.array(values).reshape(-1, len(ANKLES))


def is_floor_folder(path: Path) -> bool:
    """Whether a folder is laid out as WILDTRACK or Shelf are here."""
    return (path / "floor.csv").is_file() or (path / "calibration.json").is_file()


def read_floor_folder(path: Path) -> FloorFolder:
    """A folder of WILDTRACK or Shelf.

    Raises:
        RequestError: it is neither, or a file of it is missing or broken.
    """
    if (path / "floor.csv").is_file():
        return _read_wildtrack(path)
    if (path / "calibration.json").is_file():
        return _read_shelf(path)
    raise RequestError(f"{path}: expected floor.csv (WILDTRACK) or calibration.json (Shelf), found neither")


def read_placed_truth(path: Path, empty: bool = False) -> PlacedTruth:
    """Labelled places: a folder of WILDTRACK or Shelf, or a CSV with ``time,id,x,y`` (seconds, metres).

    Args:
        path: of it; in a folder of another kind, truth.csv.
        empty: a file without rows is a result without people.

    Raises:
        RequestError: a column is missing, a value is no number, or an id stands twice at one time.
    """
    if path.is_dir():
        return read_floor_folder(path).truth if is_floor_folder(path) else read_placed_truth(path / "truth.csv")
    names = column_names(path, "a CSV of places")
    if "floor_x_m" in names:
        return _truth(path, "frame", "id", ("floor_x_m", "floor_y_m"), WILDTRACK_RATE * WILDTRACK_STEP)
    if {"frame", "person"} <= set(names):
        return _truth(path, "frame", "person", ("x", "y"), SHELF_RATE, first=1)
    return _truth(path, "time", "id", ("x", "y"), empty=empty)


def _truth(
    path: Path, when: str, who: str, where: tuple[str, str], rate: float = 1.0, first: int = 0,
    empty: bool = False,
) -> PlacedTruth:  # fmt: skip
    table = read_named_rows(path, "a CSV of places", (when, who, *where))
    if not table.rows and not empty:
        raise RequestError(f"{path}: expected rows of places, found none")
    moments = table.numbers((when,))[:, 0]
    if when == "frame":
        moments = (table.whole_numbers(when, first, LAST_FRAME) - first).astype(np.float64)
    times = moments / rate
    ids = table.whole_numbers(who)
    _, counts = np.unique(np.stack([times, ids.astype(np.float64)]), axis=1, return_counts=True)
    if (counts > 1).any():
        raise RequestError(f"{path}: expected each {who} once at a time, got one twice")
    return PlacedTruth(times, ids, table.numbers(where))


def _read_wildtrack(path: Path) -> FloorFolder:
    views = sorted(path.glob("view*_*.csv"))
    if not views:
        raise RequestError(f"{path}: expected viewN_NAME.csv beside floor.csv, found none")
    truth = read_placed_truth(path / "floor.csv")
    length = round(float(truth.times.max()) * WILDTRACK_RATE) + 1
    cameras = [_wildtrack_camera(path / "calibrations", view.stem.split("_", 1)[1]) for view in views]
    return FloorFolder(cameras, [read_standing(view, length, _labelled_frames) for view in views], truth)


def _wildtrack_camera(folder: Path, name: str) -> CameraOverFloor:
    def numbers(path: Path, tag: str, count: int) -> FloatArray:
        root = read_xml(path, "a calibration")
        values = (root.findtext(f".//{tag}/data") or root.findtext(f".//{tag}") or "").split()
        if len(values) != count:
            raise RequestError(f"{path}: expected {count} numbers in {tag}, got {len(values)}")
        with refusing(f"{path}: expected numbers in {tag}, got something else"):
            return np.array(values, dtype=np.float64)

    lens = numbers(folder / "intrinsic_zero" / f"intr_{name}.xml", "camera_matrix", 9).reshape(3, 3)
    pose = folder / "extrinsic" / f"extr_{name}.xml"
    rotation = np.asarray(cv2.Rodrigues(numbers(pose, "rvec", 3))[0], dtype=np.float64)
    position = -rotation.T @ numbers(pose, "tvec", 3) / 100
    return _placed(name, WILDTRACK_SIZE, lens, rotation, position, WILDTRACK_RATE, WILDTRACK_FLOOR)


def _placed(
    name: str, size: tuple[int, int], lens: FloatArray, rotation: FloatArray, position: FloatArray, rate: float,
    floor: FloatArray | None,
) -> CameraOverFloor:  # fmt: skip
    # Published rotations are rounded.
    left, _, right = np.linalg.svd(rotation)
    camera = PinholeCamera(*size, np.diag(lens)[:2], lens[:2, 2], left @ right, position)
    return Placed(name, camera, rate, 0.0, floor)


def _read_shelf(path: Path) -> FloorFolder:
    file = path / "calibration.json"
    truth = read_placed_truth(path / "truth.csv")
    cameras, people = [], []
    try:
        content = read_json(file, "a calibration")
        for name, entry in content.items():
            lens, pose = (np.array(entry[key], dtype=np.float64).reshape(3, -1) for key in ("K", "RT"))
            width, height = entry["imgSize"]
            place = np.asarray(-pose[:, :3].T @ pose[:, 3])
            cameras.append(_placed(f"camera{name}", (width, height), lens, pose[:, :3], place, SHELF_RATE, None))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise RequestError(f"{file}: expected K, RT and imgSize of each camera, got something else") from error
    length = 1
    for camera in cameras:
        people.append(read_standing(path / f"{camera.name}_detections.csv"))
        length = max(length, len(people[-1]))
    for frames in people:
        frames += [StandingPeople.of(Detections.empty())] * (length - len(frames))
    return FloorFolder(cameras, people, truth)
