"""VisDrone-MOT: ``annotations/NAME.txt`` and ``sequences/NAME/0000001.jpg …``.

A row is ``frame,id,left,top,width,height,score,category,truncation,occlusion`` with 1-based frames and 0-based pixels.
Categories are 0 ignored region, 1 pedestrian (standing or walking), 2 people (in other postures), 3 and on vehicles.
Truncation is 0 none or 1 up to half. Occlusion is 0 none, 1 up to half, 2 more.

How it is evaluated here: pedestrians and people with score 1 count, both as one class. A result on an ignored region,
or on any row with score 0, is neither right nor wrong. A result on a vehicle is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.label_checks import NothingLabelledError, compare_with_picture, wanted_numbers
from tsuiseki.tracking.formats.mot_sequence import list_images
from tsuiseki.tracking.formats.rows import Rows, read_rows, whole_number
from tsuiseki.tracking.geometry import corners_from_xywh
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.tracking.types.frame_range import LAST_FRAME
from tsuiseki.tracking.types.labels import GroundTruth

COLUMNS = "frame,id,left,top,width,height,score,category,truncation,occlusion"
IGNORED_REGION, PEDESTRIAN, PEOPLE, MOST = 0, 1, 2, 11
_COUNTED = ("pedestrian", "people", "bicycle", "car", "van", "truck", "tricycle", "awning-tricycle", "bus", "motor")
NAMES = dict(enumerate(_COUNTED, start=PEDESTRIAN))
VISIBLE = np.array([1.0, 0.75, 0.25])


@dataclass(frozen=True)
class VisDroneSequence:
    """A clip: its name, its images by frame and its label file."""

    name: str
    images: tuple[Path, ...]
    labels: Path


def is_visdrone(folder: Path) -> bool:
    """Whether ``folder`` has the layout."""
    return (folder / "annotations").is_dir() and (folder / "sequences").is_dir()


def find_visdrone(folder: str | Path) -> list[VisDroneSequence]:
    """The clips of ``folder`` by name.

    Raises:
        RequestError: the layout is another, a clip has no images, or more frames are labelled than there are.
    """
    folder = Path(folder)
    if not is_visdrone(folder):
        raise RequestError(f"expected annotations/ and sequences/ of VisDrone-MOT in {folder}, found neither or one")
    found = []
    for labels in sorted((folder / "annotations").glob("*.txt")):
        place = folder / "sequences" / labels.stem
        images = list_images(place)
        if not images:
            raise RequestError(f"{labels}: expected images in {place}, found none")
        found.append(VisDroneSequence(labels.stem, images, labels))
    if not found:
        raise RequestError(f"expected label files NAME.txt in {folder}/annotations, found none")
    return found


def read_visdrone(path: str | Path, length: int | None = None, wanted: int | str | None = None) -> GroundTruth:
    """The labels in the file at ``path``, ordered by frame.

    Args:
        path: of the text file.
        length: frames of the clip, if known.
        wanted: number or name of the category that counts; by default pedestrians and people.

    Raises:
        RequestError: the file is missing, malformed, has no such category or none of it to
            evaluate, or labels frames beyond the clip.
    """
    path = Path(path)
    given = read_rows(path, "VisDrone-MOT labels").without_heading(10)
    rows = given.numbers(COLUMNS)
    # Crowds are fenced in by regions that may be as thin as a line.
    wide = (rows[:, 4] > 0) & (rows[:, 5] > 0)
    numbers = wanted_numbers(wanted, NAMES, (PEDESTRIAN, PEOPLE), path)
    _check(given, rows, wide, length, numbers)
    ids = [whole_number(path, line, "id", cells[1]) for line, cells in zip(given.lines, given.cells, strict=True)]
    rows = rows[wide]
    people = np.isin(rows[:, 7], numbers)
    counted = people & (rows[:, 6] != 0)
    if not counted.any():
        expected = "pedestrians (1) or people (2)" if wanted is None else f"labels of {wanted}"
        raise NothingLabelledError(f"{path}: no usable box: expected {expected} with score 1")
    ignored = (rows[:, 7] == IGNORED_REGION) | (rows[:, 6] == 0)
    boxes = corners_from_xywh(rows[:, 2:6])
    compare_with_picture(path, boxes)
    order = np.argsort(rows[:, 0], kind="stable")
    occlusion = np.clip(rows[:, 9], 0, 2).astype(np.int64)
    return GroundTruth(
        frames=rows[:, 0].astype(np.int64) - 1,
        ids=np.array(ids, dtype=np.int64)[wide],
        boxes=boxes,
        evaluated=counted,
        ignored=ignored,
        visibility=VISIBLE[occlusion],
    ).select(order)


def _check(given: Rows, rows: FloatArray, wide: BoolArray, length: int | None, numbers: tuple[int, ...]) -> None:
    framed = (rows[:, 0] >= 1) & (rows[:, 0] <= LAST_FRAME) & (rows[:, 0] % 1 == 0)
    counts = np.isin(rows[:, 7], numbers) & (rows[:, 6] != 0)
    for bad, expected in (
        (~framed, f"a frame number from 1 to {LAST_FRAME}"),
        (~np.isin(rows[:, 7], np.arange(MOST + 1)), f"a category of 0-{MOST}"),
        (counts & ~wide, "a positive width and height"),
    ):
        if bad.any():
            raise given.error(int(np.argmax(bad)), expected)
    if length is not None and len(rows) and rows[:, 0].max() > length:
        raise RequestError(
            f"{given.path}: labels reach frame {rows[:, 0].max():g}, but the clip has {length} images; "
            "are these the labels of another clip?"
        )
