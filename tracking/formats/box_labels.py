"""Labelled boxes of KITTI tracking, VisDrone-MOT and BDD100K.

KITTI: ``label_02/0000.txt`` and, where there are pictures, ``image_02/0000/000000.png …``. A row is ``frame track type
truncated occluded alpha left top right bottom …`` with 0-based frames and 0-based pixels; what follows, places in space
and a score, is not read. Occlusion is 0 none, 1 part, 2 most, 3 not known. Pedestrians count. A result on somebody who
sits (``Person``, ``Person_sitting``) or on a region ``DontCare`` is neither right nor wrong. A result on a cyclist or a
vehicle is wrong.

VisDrone: ``annotations/NAME.txt`` and, where there are pictures, ``sequences/NAME/0000001.jpg …``, also without the
folder ``sequences``. A row is ``frame,id,left,top,width,height,
score,category,truncation,occlusion`` with 1-based frames and 0-based pixels. Categories are 0 ignored region, 1
pedestrian (standing or walking), 2 people (in other postures), 3 and on vehicles. Occlusion is 0 none, 1 up to half, 2
more. Pedestrians and people with score 1 count, both as one class. A result on an ignored region, or on any row with
score 0, is neither right nor wrong. A result on a vehicle is wrong.

BDD100K: a JSON a video, ``labels/box_track_20/val/NAME.json``, also without the folders above. A file is a list of
frames with ``frameIndex`` from 0 and ``labels`` of ``id``, ``category`` and ``box2d`` (x1, y1, x2, y2, pixels), maybe
with ``attributes``. A result on a crowd, or on ``other person``, ``other vehicle`` or ``trailer``, is neither right nor
wrong; one on another class is wrong. Pictures are found in ``images/track/*/NAME``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.label_checks import (
    LabelFile,
    NothingLabelledError,
    Sieve,
    UnusableError,
    compare_with_picture,
    wanted_numbers,
)
from tsuiseki.tracking.formats.labelled_boxes import LabelledBox, finite, labelled_video, with_area
from tsuiseki.tracking.formats.mot_sequence import list_images
from tsuiseki.tracking.formats.rows import Rows, finite_number, read_rows, repeated, whole
from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.geometry import corners_from_xywh
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.openers.text import refusing
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.tracking.types.class_choice import PERSON_NAMES
from tsuiseki.tracking.types.frame_range import LAST_FRAME
from tsuiseki.tracking.types.labels import GroundTruth

LABELS = "label_02"
ANNOTATIONS = "annotations"
COUNTED = "Pedestrian"
KITTI_NAMES = dict(enumerate((COUNTED, "Cyclist", "Car", "Van", "Truck", "Tram", "Misc", "Person", "Person_sitting")))
# Type of a region in which results are neither right nor wrong.
REGION = "DontCare"
# Results on them are neither right nor wrong, as KITTI itself scores.
ALIKE = {COUNTED: ("Person", "Person_sitting"), "Car": ("Van",)}
# Visible share of a person by KITTI's number of occlusion.
KITTI_VISIBLE = np.array([1.0, 0.75, 0.25, 0.5])
# The same by VisDrone's.
VISDRONE_VISIBLE = np.array([1.0, 0.75, 0.25])
# Height, width, length, place and turn of nothing.
NO_SPACE = "-1 -1 -1 -1000 -1000 -1000 -10"
KITTI_ROW = "frame track type truncated occluded alpha left top right bottom"
VISDRONE_ROW = "frame,id,left,top,width,height,score,category,truncation,occlusion"
# VisDrone's number of a region in which results are neither right nor wrong.
IGNORED_REGION = 0
# VisDrone's number of people who stand or walk.
PEDESTRIAN = 1
# VisDrone's number of people in other postures.
PEOPLE = 2
# VisDrone's highest number of a category.
MOST = 11
# Corners that span something.
SQUARE = np.array([0.0, 0.0, 1.0, 1.0])
_KINDS = ("pedestrian", "people", "bicycle", "car", "van", "truck", "tricycle", "awning-tricycle", "bus", "motor")
VISDRONE_NAMES = dict(enumerate(_KINDS, start=PEDESTRIAN))
BDD_NAMES = dict(enumerate(("pedestrian", "rider", "car", "truck", "bus", "train", "motorcycle", "bicycle")))
# As older files call them.
OLDER = {"person": "pedestrian", "motor": "motorcycle", "bike": "bicycle"}
BDD_IGNORED = ("other person", "other vehicle", "trailer")


def find_kitti(folder: Path) -> list[LabelFile]:
    """The drives of ``folder`` by name; raises RequestError where there is no label file."""
    labels = sorted((folder / LABELS).glob("*.txt"))
    if not labels:
        raise RequestError(f"expected label files 0000.txt of KITTI tracking in {folder / LABELS}, found none")
    return [LabelFile(path.stem, list_images(folder / "image_02" / path.stem), path) for path in labels]


def write_kitti(path: Path, video: TrackedVideo) -> None:
    """Write tracks as results; people are of the type ``Pedestrian``, and what is not known has KITTI's numbers."""
    text = []
    for frame, number, box, score, *_ in video.boxes.listed():
        kind = video.kind[number]
        name = COUNTED if kind.lower() in PERSON_NAMES else kind.title().replace(" ", "_")
        place = " ".join(f"{value:.2f}" for value in box)
        text.append(f"{frame} {number} {name} -1 -1 -10 {place} {NO_SPACE} {score:.4f}\n")
    path.write_text("".join(text), encoding="utf-8")


def read_kitti(path: Path, length: int | None = None, kind: int | str | None = None) -> GroundTruth:
    """KITTI's labels of a drive of ``length`` frames, if known, by frame; of a type, by default pedestrians.

    Raises:
        RequestError: the file is missing, malformed, has no pedestrian, has one twice in a frame, or labels frames
            beyond the drive.
    """
    table = read_rows(path, "KITTI tracking labels").without_heading(len(KITTI_ROW.split()))
    # Frame, occlusion, and the box.
    rows = table.numbers(KITTI_ROW, (0, 4, 6, 7, 8, 9))
    framed = (rows[:, 0] >= 0) & (rows[:, 0] < LAST_FRAME) & (rows[:, 0] % 1 == 0)
    table.refuse(
        (~framed, f"a frame number from 0 to {LAST_FRAME - 1}"),
        (~np.isfinite(rows[:, 1]), "a finite number of occlusion"),
    )
    usable = _usable(path, table, rows[:, 2:6])
    ids, kinds = table.whole_numbers("track", 1), np.array([cells[2] for cells in table.cells], dtype=np.str_)
    rows, ids, kinds = rows[usable], ids[usable], kinds[usable]
    (number,) = wanted_numbers(kind, KITTI_NAMES, (0,), path)
    name = KITTI_NAMES[number]
    frames, counted = rows[:, 0].astype(np.int64), kinds == name
    if not counted.any():
        what = "pedestrians, of the type " if name == COUNTED else ""
        raise NothingLabelledError(f"{path}: no usable box: expected {what}{name}")
    if length is not None and frames.max() >= length:
        raise RequestError(
            f"{path}: labels reach frame {frames.max()}, but the drive has {length} images, counted from 0; are these "
            "the labels of another drive?"
        )
    if (row := repeated(frames[counted], ids[counted])) is not None:
        twice = f"track {ids[counted][row]} twice in frame {frames[counted][row]}"
        raise RequestError(f"{path}: expected a {name} once a frame, got {twice}")
    ignored = np.isin(kinds, (REGION, *ALIKE.get(name, ())))
    visible = KITTI_VISIBLE[np.clip(rows[:, 1], 0, 3).astype(np.int64)]
    return _in_order(path, GroundTruth(frames, ids, rows[:, 2:6], counted, ignored, visible))


# Column of the score in results.
KITTI_SCORE = 17


def read_kitti_video(path: Path) -> TrackedVideo:
    """All boxes of a file of KITTI, labels or a result; regions ``DontCare`` are crowds.

    Raises:
        RequestError: the file is missing or malformed, most boxes have no area, or an id stands twice in a frame.
    """
    table = read_rows(path, "KITTI tracking").without_heading(len(KITTI_ROW.split()))
    numbers = {name: number for number, name in KITTI_NAMES.items()}
    corners = table.numbers(KITTI_ROW, (6, 7, 8, 9)).tolist()
    kinds = [(numbers.setdefault(cells[2], len(numbers)), cells[2]) for cells in table.cells]
    ids = table.whole_numbers("track", 1).tolist()
    frames = table.whole_numbers("frame", 0, 0, LAST_FRAME - 1).tolist()
    cells_of_scores = [cells[KITTI_SCORE] if len(cells) > KITTI_SCORE else "1" for cells in table.cells]
    scores = [finite_number(path, line, "score", cell) for line, cell in zip(table.lines, cells_of_scores, strict=True)]
    boxes = [
        LabelledBox(frame, number if number >= 0 else None, kind, box, kind[1] == REGION, score)
        for frame, number, kind, box, score in zip(frames, ids, kinds, corners, scores, strict=True)
    ]
    sieve = Sieve(path, "boxes")
    named = zip((f"in line {line}" for line in table.lines), boxes, strict=True)
    usable = sieve.read(named, lambda _, box: box._replace(corners=with_area(box.corners)))
    return replace(labelled_video(path, usable, sieve), name=path.stem)


def _usable(path: Path, table: Rows, corners: FloatArray) -> BoolArray:
    """``(N,)`` the rows of a table that can be used: whose ``(N, 4)`` corners span something; warns of others."""
    infinite: BoolArray = np.asarray(~np.isfinite(corners).all(axis=1))
    flat: BoolArray = np.asarray(~(corners[:, 2:] > corners[:, :2]).all(axis=1))
    sieve = Sieve(path, "rows")
    names = [f"line {line}" for line in table.lines]
    usable = sieve.usable(names, (infinite, "without finite corners"), (flat, "without an area"))
    sieve.tell()
    return usable


def _beginning(path: Path) -> list[str]:
    """The first lines of a text file, but for empty ones."""
    with path.open(encoding="utf-8", errors="replace") as file:
        return [line for line in islice(file, 100) if line.strip()]


def is_kitti_file(path: Path) -> bool:
    """By its rows, whose third cell is a word."""
    cells = [line.split() for line in _beginning(path)]
    return bool(cells) and all(len(row) >= len(KITTI_ROW.split()) and row[2][0].isalpha() for row in cells)


def _is_visdrone_file(path: Path) -> bool:
    """By its rows of ten whole numbers, the last three of which are a category, truncation and occlusion."""
    row = rf"(-?[0-9]+,){{7}}([0-9]|1[0-{MOST - 10}]),[01],[012],?"
    lines = _beginning(path)
    return path.name != "gt.txt" and bool(lines) and all(re.fullmatch(row, line.strip()) for line in lines)


def is_visdrone(folder: Path) -> bool:
    """Whether ``folder`` has VisDrone's layout."""
    if not (folder / ANNOTATIONS).is_dir() or (folder / "sequences").is_dir():
        return (folder / ANNOTATIONS).is_dir()
    files = (read_rows(text, "labels").cells for text in sorted((folder / ANNOTATIONS).glob("*.txt")))
    first = next((cells[0] for cells in files if cells), list[str]())
    # Rows of MOTChallenge have -1 or a place in the world there.
    return len(first) == len(VISDRONE_ROW.split(",")) and first[7].isdigit()


def find_visdrone(folder: Path) -> list[LabelFile]:
    """The clips of ``folder`` by name.

    Raises:
        RequestError: a clip has no images in ``sequences``, or there is none.
    """
    labels, pictures = sorted((folder / ANNOTATIONS).glob("*.txt")), folder / "sequences"
    place = pictures if pictures.is_dir() else folder
    clips = [LabelFile(path.stem, list_images(place / path.stem), path) for path in labels]
    bare = next((clip for clip in clips if not clip.images), None)
    if bare is not None and place == pictures:
        raise RequestError(f"{bare.labels}: expected images in {pictures / bare.name}, found none")
    if not clips:
        raise RequestError(f"expected label files NAME.txt in {folder}/{ANNOTATIONS}, found none")
    return clips


def read_visdrone(path: Path, length: int | None = None, kind: int | str | None = None) -> GroundTruth:
    """VisDrone's labels of a clip of ``length`` frames, if known, by frame.

    The category ``kind`` counts, by number or name; by default pedestrians and people.

    Raises:
        RequestError: the file is missing, malformed, has no such category or none of it to evaluate, or labels frames
            beyond the clip.
    """
    table = read_rows(path, "VisDrone-MOT labels").without_heading(10)
    rows = table.numbers(VISDRONE_ROW)
    # Crowds are fenced in by regions that may be as thin as a line.
    wide = (rows[:, 4] > 0) & (rows[:, 5] > 0)
    numbers = wanted_numbers(kind, VISDRONE_NAMES, (PEDESTRIAN, PEOPLE), path)
    counted = np.isin(rows[:, 7], numbers) & (rows[:, 6] != 0)
    infinite = np.asarray(~np.isfinite(np.delete(rows, range(2, 6), axis=1)).all(axis=1))
    framed = (rows[:, 0] >= 1) & (rows[:, 0] <= LAST_FRAME) & (rows[:, 0] % 1 == 0)
    # Rows that do not count may span nothing.
    corners = corners_from_xywh(rows[:, 2:6])
    corners = np.where((counted | ~np.isfinite(corners).all(axis=1))[:, None], corners, SQUARE)
    table.refuse(
        (~framed, f"a frame number from 1 to {LAST_FRAME}"),
        (infinite, "finite numbers"),
        (~np.isin(rows[:, 7], np.arange(MOST + 1)), f"a category of 0-{MOST}"),
    )
    usable = _usable(path, table, corners)
    ids = table.whole_numbers("id", 1)[usable]
    rows, wide, counted = rows[usable], wide[usable], counted[usable]
    if length is not None and len(rows) and rows[:, 0].max() > length:
        raise RequestError(
            f"{path}: labels reach frame {rows[:, 0].max():g}, but the clip has {length} images; "
            "are these the labels of another clip?"
        )
    if not counted.any():
        what = "pedestrians (1) or people (2)" if kind is None else f"labels of {kind}"
        raise NothingLabelledError(f"{path}: no usable box: expected {what} with score 1")
    visible = VISDRONE_VISIBLE[np.clip(rows[:, 9], 0, 2).astype(np.int64)]
    ignored = (rows[:, 7] == IGNORED_REGION) | (rows[:, 6] == 0)
    frames, boxes = rows[:, 0].astype(np.int64) - 1, corners_from_xywh(rows[:, 2:6])
    truth = GroundTruth(frames, ids, boxes, counted, ignored, visible)
    return _in_order(path, truth.select(wide))


def is_bdd100k(path: Path) -> bool:
    """Whether a file, or the first JSON under a folder, is BDD100K's."""
    first = path if path.is_file() else next(iter(_bdd_files(path)), path)
    if first.suffix != ".json" or not first.is_file():
        return False
    with first.open(encoding="utf-8", errors="replace") as file:
        head = file.read(100_000)
    return head.lstrip().startswith("[") and '"frameIndex"' in head and '"labels"' in head


def _bdd_files(folder: Path) -> list[Path]:
    places = ("*.json", "labels/box_track_20/*/*.json", "box_track_20/*/*.json", "labels/*.json")
    return next((files for place in places if (files := sorted(folder.glob(place)))), [])


def find_bdd100k(path: Path) -> list[LabelFile]:
    """The video of a label file, or those in a folder by name, with pictures where the data set's folders lie above."""
    videos = []
    for labels in [path] if path.is_file() else _bdd_files(path):
        above = labels.resolve().parents[:5]
        places = (place for folder in above for place in sorted(folder.glob(f"images/track/*/{labels.stem}")))
        images = next((images for place in places if (images := list_images(place))), ())
        videos.append(LabelFile(labels.stem, images, labels))
    return videos


def read_bdd100k(path: Path, _: int | None = None, kind: int | str | None = None) -> GroundTruth:
    """BDD100K's labels in a file, by frame; of a class by its name, by default people: pedestrians.

    Raises:
        RequestError: the file is missing or malformed, has no such class, or none of it is labelled.
    """
    sieve = Sieve(path, "labels")
    with refusing(f"{path}: expected a list of frames with frameIndex and labels, got something else"):
        frames = read_json(path, "labels of BDD100K")
        if len(videos := {str(frame.get("videoName")) for frame in frames}) > 1:
            raise RequestError(f"{path}: expected the frames of one video, got those of {len(videos)}")
        numbered = [(frame["frameIndex"], label) for frame in frames for label in frame.get("labels") or []]
        named = [(f"{label.get('id')!r} in frame {n}", (n, label)) for n, label in numbered if label.get("box2d")]
        rows = [*sieve.read(named, _bdd_row)]
    sieve.tell()
    numbers = np.array([row.frame for row in rows], dtype=np.int64)
    boxes = np.array([row.corners for row in rows]).reshape(-1, 4)
    kinds = np.array([row.kind for row in rows], dtype=np.str_)
    ids = np.unique([row.id for row in rows], return_inverse=True)[1].astype(np.int64) + 1
    visible = np.array([0.5 if row.occluded else 1.0 for row in rows])
    crowd = np.array([row.crowd for row in rows], dtype=np.bool_)
    counted = np.isin(kinds, [BDD_NAMES[n] for n in wanted_numbers(kind, BDD_NAMES, (0,), path)]) & ~crowd
    if not counted.any():
        raise NothingLabelledError(f"{path}: no usable box: expected labels of {kind or BDD_NAMES[0]}, got none")
    if (row := repeated(numbers[counted], ids[counted])) is not None:
        raise RequestError(f"{path}: expected each id once a frame, got one twice in frame {numbers[counted][row]}")
    return _in_order(path, GroundTruth(numbers, ids, boxes, counted, np.isin(kinds, BDD_IGNORED) | crowd, visible))


class _BddRow(NamedTuple):
    frame: int
    id: str
    kind: str
    corners: Sequence[float]
    occluded: bool
    crowd: bool


def _bdd_row(_: str, entry: tuple[Any, dict[str, Any]]) -> _BddRow:
    """A label in its frame; raises UnusableError, see `Sieve`."""
    number, label = whole(str(entry[0])), entry[1]
    if number is None or not 0 <= number < LAST_FRAME:
        raise UnusableError(f"without a frameIndex from 0 to {LAST_FRAME - 1}")
    if not isinstance(label.get("category"), str):
        raise UnusableError("without a category")
    if label.get("id") is None:
        raise UnusableError("without an id")
    box = label["box2d"] if isinstance(label["box2d"], dict) else {}
    corners = with_area([finite(box.get(corner), corner) for corner in ("x1", "y1", "x2", "y2")])
    kind = OLDER.get(label["category"], label["category"])
    return _BddRow(number, str(label["id"]), kind, corners, _attribute(label, "occluded"), _attribute(label, "crowd"))


def _attribute(label: dict[str, Any], name: str) -> bool:
    return bool((label.get("attributes") or {}).get(name, False))


def _in_order(path: Path, truth: GroundTruth) -> GroundTruth:
    compare_with_picture(path, truth.boxes)
    return truth.select(np.argsort(truth.frames, kind="stable"))


@dataclass(frozen=True)
class BoxLayout:
    """A layout of labelled boxes.

    Attributes:
        fits: whether a folder has it.
        inside: name of the folder in it that has the label files; empty where a label file needs none.
        find: the videos of a folder.
        read: the labels in a file of so many frames, if that is known, of a class.
        names: of the classes by the numbers that results bear, where the layout has numbers.
        alone: whether the rows of a label file that lies elsewhere are of it.
    """

    fits: Callable[[Path], bool]
    inside: str
    find: Callable[[Path], list[LabelFile]]
    read: Callable[[Path, int | None, int | str | None], GroundTruth]
    names: Mapping[int, str] = field(default_factory=dict)
    alone: Callable[[Path], bool] = lambda _: False

    def at(self, path: Path) -> list[LabelFile]:
        """The videos of a folder or of one label file; none where it is of another layout."""
        if path.is_dir() or not self.inside:
            return self.find(path) if self.fits(path) else []
        folder = path.parent.parent
        if not (path.is_file() and path.suffix == ".txt"):
            return []
        if path.parent.name == self.inside and self.fits(folder):
            return [video for video in self.find(folder) if video.labels.name == path.name]
        return [LabelFile(path.stem, (), path)] if self.alone(path) else []


BOX_LAYOUTS = (
    BoxLayout(is_visdrone, ANNOTATIONS, find_visdrone, read_visdrone, VISDRONE_NAMES, _is_visdrone_file),
    BoxLayout(lambda folder: (folder / LABELS).is_dir(), LABELS, find_kitti, read_kitti, {}, is_kitti_file),
    BoxLayout(is_bdd100k, "", find_bdd100k, read_bdd100k),
)
