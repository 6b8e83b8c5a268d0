"""The MOTChallenge folder layout: sequences, ground truth, detections and results.

A sequence folder holds ``seqinfo.ini``, ``img1/000001.jpg …``, ``gt/gt.txt`` and ``det/det.txt``. Text rows are
``frame, id, x, y, width, height, …`` with 1-based frames and pixels; they become 0-based here and nowhere else.

Two layouts of ground truth are told apart by their number of columns:

* 10 columns (MOT15): column 7 says whether the row counts, columns 8-10 are world coordinates or -1. Every row is a
  pedestrian; there is no class and no visibility.
* 9 columns (MOT16, 17, 20): column 7 says whether the row counts, column 8 is the class, column 9 the visibility.
  Only class 1 (pedestrian) is evaluated. A result on a person on a vehicle (2), a static person (7), a distractor (8)
  or a reflection (12), in MOT20 also on a vehicle (6), is neither right nor wrong.
"""

from __future__ import annotations

import configparser
import itertools
import re
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.frame_range import LAST_FRAME
from tsuiseki.tracking.geometry import corners_from_xywh, xywh_from_corners
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray, Track
from tsuiseki.tracking.types.labels import GroundTruth

PEDESTRIAN = 1
DISTRACTORS = (2, 7, 8, 12)
MOT20_DISTRACTORS = (2, 6, 7, 8, 12)
IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")


@dataclass(frozen=True)
class Sequence:
    """A sequence folder.

    Attributes:
        name: from ``seqinfo.ini``, or the folder's name.
        folder: where it lies.
        frame_rate: frames per second.
        length: number of frames; 0 where neither ``seqinfo.ini`` nor images tell.
        width: of the images, pixels; 0 where unknown.
        height: likewise.
        images: one path a frame, empty where the sequence is text only.
        rate_missing: ``seqinfo.ini`` does not say the frame rate, and 25 are taken.
    """

    name: str
    folder: Path
    frame_rate: float
    length: int
    width: int
    height: int
    images: tuple[Path, ...]
    rate_missing: bool = False

    @property
    def ground_truth_path(self) -> Path:
        """``gt/gt.txt``, whether it exists or not."""
        return self.folder / "gt" / "gt.txt"

    @property
    def detections_path(self) -> Path:
        """``det/det.txt``, whether it exists or not."""
        return self.folder / "det" / "det.txt"


def read_sequence(folder: str | Path) -> Sequence:
    """The sequence in ``folder``.

    Raises:
        RequestError: no such folder, nothing of a sequence in it, a broken ``seqinfo.ini``, or an image folder
            that leads out of it.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise RequestError(f"expected a sequence folder at {folder}, found none")
    if not is_sequence(folder):
        raise RequestError(f"{folder}: expected seqinfo.ini, img1/ or gt/gt.txt of a MOTChallenge sequence, found none")
    info = _read_info(folder / "seqinfo.ini")
    image_folder = info.get("imDir", "img1")
    if PurePosixPath(image_folder).is_absolute() or ".." in PurePosixPath(image_folder).parts:
        raise RequestError(f"{folder}/seqinfo.ini: imDir = {image_folder} leads out of the sequence folder")
    images = list_images(folder / image_folder)
    length = int(_number(info, "seqLength", len(images), folder))
    if images and len(images) < length:
        warnings.warn(
            f"{folder}: seqinfo.ini promises {length} frames, but {image_folder}/ has {len(images)} images; "
            "the sequence ends with them",
            InputWarning,
            stacklevel=2,
        )
        length = len(images)
    if images and len(images) != length:
        raise RequestError(
            f"{folder}: seqinfo.ini promises {length} frames, but {image_folder}/ has {len(images)} images"
        )
    return Sequence(
        name=info.get("name", folder.resolve().name),
        folder=folder,
        frame_rate=_frame_rate(info, folder),
        length=length,
        width=int(_number(info, "imWidth", 0, folder)),
        height=int(_number(info, "imHeight", 0, folder)),
        images=images,
        rate_missing="frameRate" not in info,
    )


def is_sequence(folder: Path) -> bool:
    """Whether anything in ``folder`` is of a MOTChallenge sequence."""
    return any((folder / part).exists() for part in ("seqinfo.ini", "img1", "gt/gt.txt"))


def find_sequences(folder: str | Path) -> list[Sequence]:
    """The sequence that ``folder`` is, or those one level below it, by name.

    Raises:
        RequestError: there is none.
    """
    folder = Path(folder)
    if folder.is_dir() and is_sequence(folder):
        return [read_sequence(folder)]
    found = [p for p in sorted(folder.iterdir()) if p.is_dir() and is_sequence(p)] if folder.is_dir() else []
    if not found:
        raise RequestError(f"expected a MOTChallenge sequence or a folder of sequences at {folder}, found none")
    return [read_sequence(p) for p in found]


def list_images(folder: Path) -> tuple[Path, ...]:
    """The image files of ``folder`` by name, ``9.jpg`` before ``10.jpg``; hidden files are passed over.

    There is none where ``folder`` is no folder.
    """
    if not folder.is_dir():
        return ()
    images = (p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES and not p.name.startswith("."))
    return tuple(sorted(images, key=_by_number))


def _by_number(path: Path) -> tuple[list[tuple[bool, int, str]], str]:
    """Orders names by the values of the numbers in them; the name itself settles what is left."""
    parts = re.findall(r"\d+|\D+", path.name)
    return [(False, int(part), "") if part.isdecimal() else (True, 0, part) for part in parts], path.name


def write_sequence_info(
    sequence_folder: Path, name: str, frame_rate: float, length: int, width: int, height: int
) -> None:
    """Write ``seqinfo.ini`` for images ``img1/000001.jpg …``."""
    lines = ["[Sequence]", f"name={name}", "imDir=img1", f"frameRate={frame_rate:g}", f"seqLength={length}"]
    lines += [f"imWidth={width}", f"imHeight={height}", "imExt=.jpg"]
    (sequence_folder / "seqinfo.ini").write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_ground_truth(path: str | Path) -> GroundTruth:
    """The labels in a ``gt.txt`` of MOT15, 16, 17 or 20, told apart by the number of columns.

    A sequence whose folder is named ``MOT20-…`` follows MOT20's list of distractors.

    Raises:
        RequestError: the file is missing, malformed, names an id twice in a frame, or has no box to evaluate.
    """
    path = Path(path)
    rows, lines = _read_rows(path, {9, 10}, "ground truth")
    frames, ids = rows[:, 0].astype(np.int64) - 1, rows[:, 1].astype(np.int64)
    _refuse_repeated(path, lines, frames, ids)
    active = rows[:, 6] != 0
    if rows.shape[1] == 10:
        evaluated, ignored, visibility = active, np.zeros(len(rows), dtype=np.bool_), np.ones(len(rows))
    else:
        is_mot20 = any(part.startswith("MOT20") for part in path.parts)
        classes = rows[:, 7].astype(np.int64)
        evaluated = active & (classes == PEDESTRIAN)
        ignored = np.isin(classes, MOT20_DISTRACTORS if is_mot20 else DISTRACTORS)
        visibility = np.where(rows[:, 8] < 0, 1.0, np.clip(rows[:, 8], 0, 1))
    if not evaluated.any():
        raise RequestError(_nothing_usable(path, rows, active))
    order = np.argsort(frames, kind="stable")
    return GroundTruth(frames, ids, _boxes(rows), evaluated, ignored, visibility).select(order)


def write_ground_truth(path: Path, truth: GroundTruth) -> None:
    """Write ``truth`` in the 9-column layout of MOT16; boxes that are not evaluated become distractors."""
    classes = np.where(truth.evaluated, PEDESTRIAN, DISTRACTORS[2])
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = zip(
        truth.frames + 1, truth.ids, _file_boxes(truth.boxes), truth.evaluated, classes, truth.visibility, strict=True
    )
    path.write_text(
        "".join(f"{f},{i},{b},{int(e)},{c},{v:.4f}\n" for f, i, b, e, c, v in columns),
        encoding="utf-8",
    )


def read_detections(
    path: str | Path, length: int | None = None, score_range: tuple[float, float] | None = None
) -> list[Detections]:
    """The detections in a ``det.txt``, one `Detections` a frame; frames without any are empty.

    What can be mended is, and an `InputWarning` says so: rows out of the order of the frames are sorted; a heading,
    boxes without an area, detections that stand in the file twice, and those after the end of the video are left out.

    Args:
        path: rows ``frame, -1, x, y, width, height, score, …``.
        length: number of frames of the video; by default up to the last frame that has a detection.
        score_range: smallest and largest score to expect; by default any finite number.

    Raises:
        RequestError: the file is missing or malformed, its rows are all beyond the video, or have a score outside the
            range.
    """
    return read_classed_detections(path, length, score_range)[0]


def read_classed_detections(
    path: str | Path, length: int | None = None, score_range: tuple[float, float] | None = None
) -> tuple[list[Detections], list[IntArray]]:
    """The detections in a ``det.txt``, and ``(N,)`` the classes in column 8 of those of each frame.

    The class is -1 where the file has no column 8 or nothing in it. Arguments and errors are those of
    `read_detections`.
    """
    path = Path(path)
    rows, lines = _read_rows(path, {7, 8, 9, 10}, "detections", flat=True)
    if np.any(np.diff(rows[:, 0]) < 0):
        warnings.warn(f"{path}: its rows are not in the order of the frames; sorted", InputWarning, stacklevel=3)
        order = np.argsort(rows[:, 0], kind="stable")
        rows, lines = rows[order], lines[order]
    if score_range is not None:
        _refuse_scores_outside(path, rows[:, 6], lines, score_range)
    rows = rows[_used(path, rows, lines, length)]
    frames, boxes, scores = rows[:, 0].astype(np.int64) - 1, _boxes(rows), rows[:, 6]
    classes = rows[:, 7].astype(np.int64) if rows.shape[1] > 7 else np.full(len(rows), -1)
    last = int(frames[-1]) + 1 if len(frames) else 0
    starts = np.searchsorted(frames, np.arange((last if length is None else length) + 1))
    spans, nothing = list(itertools.pairwise(starts)), Detections.empty()
    found = [Detections(boxes[a:b], scores[a:b]) if b > a else nothing for a, b in spans]
    return found, [classes[a:b] for a, b in spans]


def _refuse_scores_outside(path: Path, scores: FloatArray, lines: IntArray, score_range: tuple[float, float]) -> None:
    outside = np.flatnonzero((scores < score_range[0]) | (scores > score_range[1]))
    if outside.size:
        raise RequestError(
            f"{path}:{lines[outside[0]]}: expected a score in [{score_range[0]:g}, {score_range[1]:g}], got "
            f"{scores[outside[0]]:g}; give the detector's own range with `score_range`"
        )


def _used(path: Path, rows: FloatArray, lines: IntArray, length: int | None) -> BoolArray:
    """``(N,)`` the detections that are of use; what is left out is told."""
    if length is not None and rows[0, 0] > length:
        raise RequestError(
            f"{path}:{lines[0]}: detection for frame {rows[0, 0]:g}, but the video has {length} frames; "
            "are these the detections of another video?"
        )
    again = np.ones(len(rows), dtype=np.bool_)
    again[np.unique(np.column_stack([rows[:, 0], rows[:, 2:8]]), axis=0, return_index=True)[1]] = False
    flat = (rows[:, 4:6] == 0).any(axis=1)
    late = np.zeros(len(rows), np.bool_) if length is None else rows[:, 0] > length
    for which, what in (
        (flat, "without an area, the first in line {line},"),
        (again & ~flat, "repeated in the file, the first in line {line},"),
        (late, f"after the video's last frame, {length},"),
    ):
        if which.any():
            told = what.format(line=lines[np.argmax(which)])
            warnings.warn(f"{path}: {which.sum()} detection(s) {told} are left out", InputWarning, stacklevel=4)
    return np.asarray(~(again | flat | late), dtype=np.bool_)


def write_detections(path: Path, detections: Iterable[Detections]) -> None:
    """Write one `Detections` a frame as ``det.txt``; what no detector scored gets 0."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8") as file:
        for frame, found in enumerate(detections, start=1):
            for box, score in zip(_file_boxes(found.boxes), np.nan_to_num(found.scores), strict=True):
                file.write(f"{frame},-1,{box},{score:.6f},-1,-1,-1\n")


def read_tracks(path: str | Path) -> list[Track]:
    """The tracks of a result file ``frame, id, x, y, width, height, score, …``, by id; rows may be in any order.

    An empty file is a result without any track.

    Raises:
        RequestError: the file is missing or malformed, or names an id twice in a frame.
    """
    path = Path(path)
    if path.is_file() and not path.read_text(encoding="utf-8", errors="replace").strip():
        return []
    rows, lines = _read_rows(path, {6, 7, 8, 9, 10}, "tracks")
    frames, ids = rows[:, 0].astype(np.int64) - 1, rows[:, 1].astype(np.int64)
    if ids.min() < 0:
        raise RequestError(
            f"{path}:{lines[np.argmin(ids)]}: expected ids of tracks, got {ids.min()}; are these detections?"
        )
    _refuse_repeated(path, lines, frames, ids)
    ids = ids + (1 if ids.min() == 0 else 0)
    boxes = _boxes(rows)
    scores = rows[:, 6] if rows.shape[1] > 6 else np.ones(len(rows))
    order = np.lexsort([frames, ids])
    tracks = np.split(order, np.flatnonzero(np.diff(ids[order])) + 1)
    return [Track(int(ids[p[0]]), frames[p], boxes[p], scores[p]) for p in tracks]


def write_tracks(path: str | Path, tracks: Iterable[Track], class_of: Callable[[int], int] = lambda _: -1) -> None:
    """Write ``tracks`` as a result file, ordered by frame, then id; column 8 is the class of an id, -1 for none."""
    path = Path(path)
    rows = [
        (frame, track.id, box, score, class_of(track.id))
        for track in tracks
        for frame, box, score in zip(
            track.frames.tolist(), _file_boxes(track.boxes), track.scores.tolist(), strict=True
        )
    ]
    rows.sort(key=lambda row: row[:2])
    path.write_text("".join(f"{f + 1},{i},{b},{s:.4f},{c},-1,-1\n" for f, i, b, s, c in rows), encoding="utf-8")


def _read_info(path: Path) -> dict[str, str]:
    if not path.is_file():
        return {}
    parser = configparser.ConfigParser(interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]  # keys are written in camel case
    try:
        parser.read(path, encoding="utf-8")
        return dict(parser["Sequence"])
    except (configparser.Error, KeyError, UnicodeDecodeError) as error:
        raise RequestError(f"{path}: expected a section [Sequence] with name, seqLength, …: {error!r}") from error


def _number(info: dict[str, str], key: str, default: float, folder: Path) -> float:
    text = info.get(key)
    if text is None:
        return float(default)
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < 1e9:
        raise RequestError(f"{folder}/seqinfo.ini: expected {key} to be a number, got {text!r}")
    return value


def _frame_rate(info: dict[str, str], folder: Path) -> float:
    rate = _number(info, "frameRate", 25.0, folder)
    if rate == 0:
        raise RequestError(f"{folder}/seqinfo.ini: expected frameRate above 0, got {info['frameRate']!r}")
    return rate


def _read_rows(path: Path, columns: set[int], what: str, flat: bool = False) -> tuple[FloatArray, IntArray]:
    """The numbers of a text file, ``(N, columns)``, checked row by row, and the line ``(N,)`` that each stands in.

    With ``flat`` boxes may be without width or height.
    """
    if not path.is_file():
        raise RequestError(f"expected {what} at {path}, found no such file")
    try:
        # Some editors put a mark before the first character.
        text = path.read_text(encoding="utf-8-sig").rstrip().splitlines()
    except UnicodeDecodeError as error:
        raise RequestError(f"{path}: expected a text file of {what}, got something binary") from error
    first = 1
    if len(text) > 1 and _is_heading(text[0]):
        shown = text[0][:60]
        warnings.warn(f"{path}: the first line, {shown!r}, is a heading and left out", InputWarning, stacklevel=3)
        text, first = text[1:], 2
    if not text:
        raise RequestError(f"{path} is empty: expected rows of {what}")
    lines = np.arange(first, first + len(text))
    cells = [line.rstrip(", ").split(",") for line in text]
    width = len(cells[0])
    allowed = " or ".join(str(n) for n in sorted(columns))
    for number, row in zip(lines.tolist(), cells, strict=True):
        if len(row) != width or len(row) not in columns:
            raise RequestError(f"{path}:{number}: expected {allowed} numbers separated by commas, got {len(row)}")
    try:
        rows = np.array(cells, dtype=np.float64)
    except ValueError as error:
        raise RequestError(f"{path}: expected rows of numbers: {error}") from error
    _refuse_impossible(path, rows, lines, flat)
    return rows, lines


def _is_heading(line: str) -> bool:
    """Whether a line begins with a name, and not with a number, of which NaN is one."""
    return bool(re.match(r"[\s\"]*(?!nan\b|inf\b)[A-Za-z_]", line, re.IGNORECASE))


def _refuse_impossible(path: Path, rows: FloatArray, lines: IntArray, flat: bool) -> None:
    not_finite = ~np.isfinite(rows).all(axis=1)
    no_area = (rows[:, 4:6] < 0).any(axis=1) | (not flat) & (rows[:, 4:6] == 0).any(axis=1)
    no_frame = (rows[:, 0] < 1) | (rows[:, 0] != np.floor(rows[:, 0])) | (rows[:, 0] > LAST_FRAME)
    for bad, expected in (
        (not_finite, "finite numbers"),
        (no_frame, f"a whole frame number from 1 to {LAST_FRAME}"),
        (no_area, "a box with a positive width and height"),
    ):
        if bad.any():
            number = int(np.argmax(bad))
            values = ",".join(f"{value:g}" for value in rows[number, :6])
            raise RequestError(f"{path}:{lines[number]}: expected {expected}, got {values}")


def _refuse_repeated(path: Path, lines: IntArray, frames: IntArray, ids: IntArray) -> None:
    _, first = np.unique(np.column_stack([frames, ids]), axis=0, return_index=True)
    if len(first) < len(frames):
        row = int(np.setdiff1d(np.arange(len(frames)), first)[0])
        raise RequestError(f"{path}:{lines[row]}: id {ids[row]} stands twice in frame {frames[row] + 1}")


def _nothing_usable(path: Path, rows: FloatArray, active: BoolArray) -> str:
    if not active.any():
        return f"{path}: no usable box: column 7 marks every row as not to be considered"
    classes = ", ".join(f"{value:g}" for value in np.unique(rows[active, 7]))
    return f"{path}: no usable box: expected class {PEDESTRIAN} (pedestrian) in column 8, got only {classes}"


def _boxes(rows: FloatArray) -> FloatArray:
    xywh = rows[:, 2:6].copy()
    xywh[:, :2] -= 1
    return corners_from_xywh(xywh)


def _file_boxes(boxes: FloatArray) -> list[str]:
    return [f"{x + 1:.3f},{y + 1:.3f},{w:.3f},{h:.3f}" for x, y, w, h in xywh_from_corners(boxes).tolist()]
