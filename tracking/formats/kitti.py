"""KITTI tracking: ``label_02/0000.txt`` and, where there are pictures, ``image_02/0000/000000.png …``.

A row is ``frame track type truncated occluded alpha left top right bottom …`` with 0-based frames and 0-based pixels;
what follows, places in space and a score, is not read. Occlusion is 0 none, 1 part, 2 most, 3 not known.

How it is evaluated here: pedestrians count. A result on somebody who sits (``Person``, ``Person_sitting``) or on a
region ``DontCare`` is neither right nor wrong. A result on a cyclist or a vehicle is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.label_checks import NothingLabelledError, compare_with_picture, wanted_numbers
from tsuiseki.tracking.formats.mot_sequence import list_images
from tsuiseki.tracking.formats.rows import read_rows, whole_number
from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.types import FloatArray, IntArray
from tsuiseki.tracking.types.class_choice import PERSON_NAMES
from tsuiseki.tracking.types.frame_range import LAST_FRAME
from tsuiseki.tracking.types.labels import GroundTruth

LABELS, IMAGES = "label_02", "image_02"
COUNTED = "Pedestrian"
NAMES = dict(enumerate((COUNTED, "Cyclist", "Car", "Van", "Truck", "Tram", "Misc", "Person", "Person_sitting")))
# Results on them are neither right nor wrong, as KITTI itself scores.
ALIKE = {COUNTED: ("Person", "Person_sitting"), "Car": ("Van",)}
# By occlusion.
VISIBLE = np.array([1.0, 0.75, 0.25, 0.5])
# Height, width, length, place and turn of nothing.
NO_SPACE = "-1 -1 -1 -1000 -1000 -1000 -10"
EXPECTED = "frame track type truncated occluded alpha left top right bottom"


@dataclass(frozen=True)
class KittiSequence:
    """A drive: its name, its images by frame, none where there are labels alone, and its label file."""

    name: str
    images: tuple[Path, ...]
    labels: Path


def is_kitti(folder: Path) -> bool:
    """Whether ``folder`` has the layout."""
    return (folder / LABELS).is_dir()


def find_kitti(folder: str | Path) -> list[KittiSequence]:
    """The drives of ``folder`` by name.

    Raises:
        RequestError: there is no label file.
    """
    folder = Path(folder)
    labels = sorted((folder / LABELS).glob("*.txt"))
    if not labels:
        raise RequestError(f"expected label files 0000.txt of KITTI tracking in {folder / LABELS}, found none")
    found = []
    for path in labels:
        place = folder / IMAGES / path.stem
        found.append(KittiSequence(path.stem, list_images(place) if place.is_dir() else (), path))
    return found


def write_kitti(path: Path, video: TrackedVideo) -> None:
    """Write tracks as results; people are of the type ``Pedestrian``, and what is not known has KITTI's numbers."""
    rows, text = video.boxes, []
    for frame, number, box, score in zip(
        rows.frames.tolist(), rows.ids.tolist(), rows.boxes.tolist(), rows.scores.tolist(), strict=True
    ):
        kind = video.kind[number]
        name = COUNTED if kind.lower() in PERSON_NAMES else kind.title().replace(" ", "_")
        place = " ".join(f"{value:.2f}" for value in box)
        text.append(f"{frame} {number} {name} -1 -1 -10 {place} {NO_SPACE} {score:.4f}\n")
    path.write_text("".join(text), encoding="utf-8")


def read_kitti(path: str | Path, length: int | None = None, wanted: int | str | None = None) -> GroundTruth:
    """The labels in the file at ``path``, ordered by frame.

    Args:
        path: of the text file.
        length: frames of the drive, if known.
        wanted: name of the type that counts; by default pedestrians.

    Raises:
        RequestError: the file is missing, malformed, has no pedestrian, has one twice in a frame, or labels frames
            beyond the drive.
    """
    path = Path(path)
    given = read_rows(path, "KITTI tracking labels").without_heading(len(EXPECTED.split()))
    rows = np.empty((len(given.cells), 6))
    ids = np.empty(len(given.cells), dtype=np.int64)
    for k, (line, cells) in enumerate(zip(given.lines, given.cells, strict=True)):
        try:
            # Frame, occlusion, and the box.
            rows[k] = [float(cells[column]) for column in (0, 4, 6, 7, 8, 9)]
        except (ValueError, IndexError):
            raise given.error(k, EXPECTED) from None
        if not (0 <= rows[k, 0] < LAST_FRAME and rows[k, 0] == int(rows[k, 0])):
            raise given.error(k, f"a frame number from 0 to {LAST_FRAME - 1}")
        if not (rows[k, 4] > rows[k, 2] and rows[k, 5] > rows[k, 3]):
            raise given.error(k, "right beyond left and bottom below top")
        ids[k] = whole_number(path, line, "track", cells[1])
    (number,) = wanted_numbers(wanted, NAMES, (0,), path)
    return _truth(path, NAMES[number], [cells[2] for cells in given.cells], ids, rows, length)


def _truth(
    path: Path, wanted: str, kinds: list[str], ids: IntArray, rows: FloatArray, length: int | None
) -> GroundTruth:
    counted, ignored = (
        np.array([kind == wanted for kind in kinds]),
        np.isin(kinds, ("DontCare", *ALIKE.get(wanted, ()))),
    )
    if not counted.any():
        what = "pedestrians, of the type " if wanted == COUNTED else ""
        raise NothingLabelledError(f"{path}: no usable box: expected {what}{wanted}")
    frames = rows[:, 0].astype(np.int64)
    if length is not None and frames.max() >= length:
        raise RequestError(
            f"{path}: labels reach frame {frames.max()}, but the drive has {length} images, counted from 0; are these "
            "the labels of another drive?"
        )
    compare_with_picture(path, rows[:, 2:6])
    people, times = np.unique(np.column_stack([frames, ids])[counted], axis=0, return_counts=True)
    if (times > 1).any():
        frame, track = people[times > 1][0]
        raise RequestError(f"{path}: expected a {wanted} once a frame, got track {track} twice in frame {frame}")
    return GroundTruth(
        frames=frames,
        ids=ids,
        boxes=rows[:, 2:6],
        evaluated=counted,
        ignored=ignored,
        visibility=VISIBLE[np.clip(rows[:, 1], 0, 3).astype(np.int64)],
    ).select(np.argsort(frames, kind="stable"))
