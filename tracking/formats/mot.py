"""MOTChallenge's text files: ground truth, detections and results.

Their rows are ``frame, id, x, y, width, height, …`` with 1-based frames and pixels; they become 0-based here
and nowhere else.

Two layouts of ground truth are distinguished by their number of columns:

* 10 columns (MOT15): column 7 says whether the row counts, columns 8-10 are world coordinates or -1. Every row is a
  pedestrian; there is no class and no visibility.
* 9 columns (MOT16, 17, 20): column 7 says whether the row counts, column 8 is the class, column 9 the visibility.
  Only class 1 (pedestrian) is evaluated. A result on a person on a vehicle (2), a static person (7), a distractor (8)
  or a reflection (12), in MOT20 also on a vehicle (6), is neither right nor wrong. A ``labels.txt`` beside the
  ``gt.txt``, as CVAT writes it, names other classes, one a line, from 1; people are those that are called so.
"""

from __future__ import annotations

import itertools
import re
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError, a_path
from tsuiseki.tracking.formats.label_checks import (
    MOST_UNUSABLE,
    WITHOUT_ID,
    NothingLabelledError,
    Sieve,
    compare_with_picture,
    wanted_numbers,
)
from tsuiseki.tracking.formats.rows import Rows, read_rows, repeated
from tsuiseki.tracking.formats.track_tables import CORNERS, tracks_of
from tsuiseki.tracking.formats.tracked_video import boxes_of_tracks
from tsuiseki.tracking.geometry import corners_from_xywh, xywh_from_corners
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.openers.text import read_text
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray, Track
from tsuiseki.tracking.types.class_choice import PERSON_NAMES
from tsuiseki.tracking.types.frame_range import LAST_FRAME
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.types.tracks import positive_ids

# Number of the class of people who stand or walk.
PEDESTRIAN = 1
NAMES = dict(
    enumerate(
        (
            *("pedestrian", "person on vehicle", "car", "bicycle", "motorbike", "non motorized vehicle"),
            *("static person", "distractor", "occluder", "occluder on the ground", "occluder full", "reflection"),
            "crowd",
        ),
        start=PEDESTRIAN,
    )
)
# Names the classes, in CVAT's and datumaro's files of this layout.
LABELS = "labels.txt"
# Numbers of the classes on which results are neither right nor wrong.
DISTRACTORS = (2, 7, 8, 12)
# The same in MOT20.
MOT20_DISTRACTORS = (2, 6, 7, 8, 12)
# Fewer scores tell no two scales apart.
FEWEST_OF_A_SCALE = 20


def read_ground_truth(path: str | Path, kind: int | str | None = None) -> GroundTruth:
    """The labels in a ``gt.txt`` of MOT15, 16, 17 or 20, distinguished by the number of columns.

    Boxes without an id have -1. A sequence whose folder is named ``MOT20-…`` follows MOT20's list of distractors.

    Args:
        path: of the file.
        kind: number or name of the class that counts; by default pedestrians. Where column 7 marks no row of another
            class, as in MOT16 to 20, all of its rows count.

    Raises:
        RequestError: the file is missing, malformed, names an id twice in a frame, or has no box to evaluate.
    """
    path = a_path(path)
    rows, ids, lines = _read(path, 9, "ground truth")
    if not len(rows):
        raise RequestError(f"{path} is empty: expected rows of ground truth")
    frames, ids = rows[:, 0].astype(np.int64) - 1, np.maximum(ids, -1)
    _refuse_repeated(path, lines[ids >= 0], frames[ids >= 0], ids[ids >= 0])
    compare_with_picture(path, boxes_of(rows))
    active = rows[:, 6] != 0
    if rows.shape[1] == 10:
        wanted_numbers(kind, {PEDESTRIAN: NAMES[PEDESTRIAN]}, (PEDESTRIAN,), path)
        evaluated, ignored, visibility = active, np.zeros(len(rows), dtype=np.bool_), np.ones(len(rows))
    else:
        classes, names = rows[:, 7].astype(np.int64), class_names(path)
        others = {number: str(number) for number in set(classes.tolist()) - names.keys()}
        numbers = wanted_numbers(kind, {**names, **others}, people_among(names), path)
        evaluated = active & np.isin(classes, numbers)
        ignored = np.isin(classes, _distractors(path, names))
        if not {*people_among(names)} & {*numbers}:
            ignored[:] = False
            evaluated = evaluated if evaluated.any() else np.isin(classes, numbers)
        visibility = np.where(rows[:, 8] < 0, 1.0, np.clip(rows[:, 8], 0, 1))
    if not evaluated.any():
        raise NothingLabelledError(_nothing_usable(path, rows, active, kind))
    order = np.argsort(frames, kind="stable")
    return GroundTruth(frames, ids, boxes_of(rows), evaluated, ignored, visibility).select(order)


def class_names(path: Path) -> dict[int, str]:
    """Names of the classes of a ``gt.txt`` by number: those in ``labels.txt`` beside it, or MOTChallenge's."""
    labels = path.with_name(LABELS)
    if path.name != "gt.txt" or not labels.is_file():
        return NAMES
    lines = read_text(labels, "names of classes, one a line").rstrip().splitlines()
    return {number: line.strip() for number, line in enumerate(lines, start=1)} or NAMES


def people_among(names: Mapping[int, str]) -> tuple[int, ...]:
    """Numbers of the classes that are called people, or of all where none is."""
    people = tuple(number for number, name in names.items() if name.lower() in PERSON_NAMES)
    return people or tuple(names)


def _distractors(path: Path, names: Mapping[int, str]) -> list[int]:
    """Numbers of the classes on which a result is neither right nor wrong."""
    is_mot20 = any(part.startswith("MOT20") for part in path.parts)
    called = {NAMES[number] for number in (MOT20_DISTRACTORS if is_mot20 else DISTRACTORS)}
    return [number for number, name in names.items() if name.lower().replace("_", " ") in called]


def write_ground_truth(path: Path, truth: GroundTruth) -> None:
    """Write ``truth`` in the 9-column layout of MOT16; boxes that are not evaluated become distractors."""
    classes = np.where(truth.evaluated, PEDESTRIAN, DISTRACTORS[2])
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = zip(
        truth.frames + 1, truth.ids, boxes_as_text(truth.boxes), truth.evaluated, classes, truth.visibility, strict=True
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
    Scores of two scales are taken as they are, with a warning.

    Args:
        path: rows ``frame, -1, x, y, width, height, score, class, …``; a score that is left out, empty or nan is not
            known, NaN; an empty file is a video in which nothing was detected, which is reported.
        length: number of frames of the video; by default up to the last frame that has a detection.
        score_range: smallest and largest score to expect; by default any finite number.

    Raises:
        RequestError: the file is missing or malformed, its rows are all beyond the video, or have a score outside the
            range.
    """
    path = a_path(path)
    rows, _, lines = _read(path, 6, "detections", detected=True)
    if rows.shape[1] == 6:  # boxes without scores
        rows = np.column_stack([rows, np.full(len(rows), np.nan)])
    if np.any(np.diff(rows[:, 0]) < 0):
        warnings.warn(f"{path}: its rows are not in the order of the frames; sorted", InputWarning, stacklevel=3)
        order = np.argsort(rows[:, 0], kind="stable")
        rows, lines = rows[order], lines[order]
    low, high = score_range or (-np.inf, np.inf)
    if (outside := np.flatnonzero((rows[:, 6] < low) | (rows[:, 6] > high))).size:
        raise RequestError(
            f"{path}:{lines[outside[0]]}: expected a score in [{low:g}, {high:g}], got {rows[outside[0], 6]:g}; "
            "give the detector's own range with `score_range`"
        )
    used = _used(path, rows, lines, length)
    sources = (np.arange(len(rows)) - np.searchsorted(rows[:, 0], rows[:, 0]))[used]
    rows = rows[used]
    compare_with_picture(path, boxes_of(rows))
    _warn_of_two_scales(path, rows[:, 6])
    frames, boxes, scores = rows[:, 0].astype(np.int64) - 1, boxes_of(rows), rows[:, 6]
    classes = _classes(rows)
    last = int(frames[-1]) + 1 if len(frames) else 0
    starts = np.searchsorted(frames, np.arange((last if length is None else length) + 1))
    nothing = Detections.empty()
    return [
        Detections(boxes[a:b], scores[a:b], None, None, None, None if classes is None else classes[a:b], sources[a:b])
        if b > a
        else nothing
        for a, b in itertools.pairwise(starts)
    ]


def _classes(rows: FloatArray) -> IntArray | None:
    """``(N,)`` numbers in column 8, -1 for none; None where they are places in the world, or all are missing."""
    if rows.shape[1] <= 7 or (rows[:, 7] != np.floor(rows[:, 7])).any() or (rows[:, 7] < 0).all():
        return None
    return np.maximum(rows[:, 7].astype(np.int64), -1)


def _warn_of_two_scales(path: Path, scores: FloatArray) -> None:
    """Warn of scores of which some are shares and others percentages, such as those of two detectors."""
    finite = scores[~np.isnan(scores)]
    if len(finite) < FEWEST_OF_A_SCALE or finite.min() < 0:
        return
    shares, percent = finite[(finite > 0.1) & (finite <= 1)], finite[finite >= 10]
    between = np.mean((finite > 1) & (finite < 5))
    if min(len(shares), len(percent)) > 0.05 * len(finite) and between < 0.01:
        warnings.warn(
            f"{path}: {len(shares)} scores in [0.1, 1] and {len(percent)} from 10 to {percent.max():g} look like two "
            "scales, and are compared as they are; bring them to one, or people of the lower one count for less",
            InputWarning,
            stacklevel=3,
        )


def _used(path: Path, rows: FloatArray, lines: IntArray, length: int | None) -> BoolArray:
    """``(N,)`` the detections that are of use; a warning names those left out."""
    if len(rows) == 0:
        return np.empty(0, dtype=np.bool_)
    if length is not None and rows[0, 0] > length:
        raise RequestError(
            f"{path}:{lines[0]}: detection for frame {rows[0, 0]:g}, but the video has {length} frames; "
            "are these the detections of another video?"
        )
    # All but the id; a score that is missing is missing in both.
    described = np.nan_to_num(np.delete(rows[:, :8], 1, axis=1))
    again = np.ones(len(rows), dtype=np.bool_)
    again[np.unique(described, axis=0, return_index=True)[1]] = False
    flat = (rows[:, 4:6] == 0).any(axis=1)
    late = np.zeros(len(rows), np.bool_) if length is None else rows[:, 0] > length
    for which, what in (
        (flat, "without an area, the first in line {line},"),
        (again & ~flat, "repeated in the file, the first in line {line},"),
        (late, f"after the video's last frame, {length},"),
    ):
        if which.any():
            reason = what.format(line=lines[np.argmax(which)])
            warnings.warn(f"{path}: {which.sum()} detection(s) {reason} are left out", InputWarning, stacklevel=4)
    return np.asarray(~(again | flat | late), dtype=np.bool_)


def write_detections(path: Path, detections: Iterable[Detections]) -> None:
    """Write one `Detections` a frame as ``det.txt``; what no detector scored gets 0."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8") as file:
        for frame, detected in enumerate(detections):
            file.write(detection_lines(frame, detected))


def detection_lines(frame: int, detections: Detections) -> str:
    """The lines of ``det.txt`` of a frame, whose number counts from 0."""
    classes = np.full(len(detections), -1) if detections.classes is None else detections.classes
    rows = zip(boxes_as_text(detections.boxes), np.nan_to_num(detections.scores), classes.tolist(), strict=True)
    return "".join(f"{frame + 1},-1,{box},{score:.6f},{number},-1,-1\n" for box, score, number in rows)


def read_tracks(path: str | Path) -> list[Track]:
    """The tracks of a result file ``frame, id, x, y, width, height, score, class, …``, by id, rows in any order.

    An empty file is a result without any track. Rows of a negative id are left out, with a warning.

    Raises:
        RequestError: the file is missing or malformed, names an id twice in a frame, or most rows have no id.
    """
    path = a_path(path)
    rows, ids, lines = _read(path, 6, "tracks")
    if not len(rows):
        return []
    frames, without = rows[:, 0].astype(np.int64) - 1, ids < 0
    if without.sum() > MOST_UNUSABLE * len(ids):
        raise RequestError(
            f"{path}:{lines[np.argmax(without)]}: expected ids of tracks, got {ids.min()}; are these detections?"
        )
    sieve = Sieve(path, "rows")
    usable = sieve.usable([f"in line {line}" for line in lines.tolist()], (without, WITHOUT_ID))
    sieve.tell()
    rows, ids, lines, frames = rows[usable], ids[usable], lines[usable], frames[usable]
    _refuse_repeated(path, lines, frames, ids)
    ids = positive_ids(ids)
    boxes = boxes_of(rows)
    compare_with_picture(path, boxes)
    scores = rows[:, 6] if rows.shape[1] > 6 else np.ones(len(rows))
    classes = _classes(rows)
    names = _names_beside(path) if classes is not None else {}
    table = {"frame": frames, "id": ids, **dict(zip(CORNERS, boxes.T, strict=True)), "score": scores}
    table |= {} if classes is None else {"detection_class": classes}
    return [replace(track, names=names) for track in tracks_of(table)]


def _names_beside(path: Path) -> dict[int, str]:
    """Names of classes by number that the run that wrote ``path`` keeps in its run.json; empty where it tells none."""
    try:
        record = read_json(path.with_name("run.json"), "the record of a run")
        return {int(n): str(x) for n, x in record["facts"]["classes"].items()}
    except (ValueError, KeyError, TypeError, AttributeError):
        return {}


def write_tracks(path: str | Path, tracks: Iterable[Track]) -> None:
    """Write ``tracks`` as a result file, ordered by frame, then id; column 8 is a track's class, -1 for none.

    Raises:
        RequestError: the name is that of another format.
    """
    path = a_path(path)
    if path.suffix.lower() in (".json", ".csv", ".parquet", ".xml", ".xlsx"):
        raise RequestError(f"{path}: expected the name of a text file, such as tracks.txt, got {path.suffix}")
    path.parent.mkdir(parents=True, exist_ok=True)
    listed = [*tracks]
    rows, kinds = boxes_of_tracks(listed), {track.id: track.class_id for track in listed}
    columns = zip(rows.frames + 1, rows.ids.tolist(), boxes_as_text(rows.boxes), rows.scores, strict=True)
    path.write_text("".join(f"{f},{i},{b},{s:.4f},{kinds[i]},-1,-1\n" for f, i, b, s in columns), encoding="utf-8")


def _refuse_repeated(path: Path, lines: IntArray, frames: IntArray, ids: IntArray) -> None:
    if (row := repeated(frames, ids)) is not None:
        raise RequestError(f"{path}:{lines[row]}: id {ids[row]} stands twice in frame {frames[row] + 1}")


def _nothing_usable(path: Path, rows: FloatArray, active: BoolArray, kind: int | str | None) -> str:
    if not active.any():
        return f"{path}: no usable box: column 7 marks every row as not to be considered"
    classes = ", ".join(f"{value:g}" for value in np.unique(rows[active, 7]))
    names = class_names(path)
    people = " or ".join(f"{number} ({names[number]})" for number in people_among(names)[:4])
    return f"{path}: no usable box: expected class {kind or people} in column 8, got only {classes}"


# Column of the score, counted from 0.
SCORE = 6
# Columns that are read.
MOST = 10
# What stands in the fifth column where boxes are written as corners.
CORNER = re.compile(r"(bb_?)?(x_?2|x_?max|right|x_?br)", re.IGNORECASE)


def _read(path: Path, fewest: int, what: str, detected: bool = False) -> tuple[FloatArray, IntArray, IntArray]:
    """The numbers of a text file, ``(N, columns)``, checked row by row, the ids ``(N,)``, and the lines ``(N,)``.

    Detections may be without width or height, without a score, which is NaN then, and none at all.
    """
    table = read_rows(path, what)
    rows = table.without_heading(fewest)
    if len(rows.cells) < len(table.cells):
        _check_heading(path, table.cells[0])
    if not rows.cells and detected:
        warnings.warn(f"{path} is empty: nothing was detected", InputWarning, stacklevel=3)
    if not rows.cells:
        return np.empty((0, fewest + 1)), np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    cells = _even(rows, fewest, detected)
    try:
        values = np.array(cells, dtype=np.float64)
    except ValueError:
        bad, k = next((cell, k) for k, row in enumerate(cells) for cell in row if not _is_number(cell))
        raise RequestError(
            f"{path}:{rows.lines[k]}: expected numbers separated by {rows.separator}, got {bad!r}"
        ) from None
    lines = np.array(rows.lines)
    _refuse_impossible(path, values, lines, detected)
    return values, rows.whole_numbers("id", 1), lines


def _check_heading(path: Path, names: list[str]) -> None:
    """Refuse a file whose heading says that its columns are others."""
    if "frame" in ",".join(names[1:]).lower() and "frame" not in names[0].lower():
        raise RequestError(f"{path}: expected the frame in the first column, got the heading {','.join(names)[:80]}")
    if len(names) > 4 and CORNER.fullmatch(names[4]):
        raise RequestError(
            f"{path}: expected x, y, width and height in columns 3 to 6, got corners by the heading "
            f"{','.join(names)[:80]}; subtract x1 and y1 from the last two"
        )


def _even(rows: Rows, fewest: int, detected: bool) -> list[list[str]]:
    """The cells of rows of one width, of which those after the tenth are left out, and a missing score is NaN."""
    cells, width = rows.cells, len(rows.cells[0])
    if detected and width > SCORE:
        for row in cells:
            if len(row) == SCORE and width == SCORE + 1:
                row.append("nan")
            elif len(row) > SCORE and not row[SCORE]:
                row[SCORE] = "nan"
    odd = next((k for k, row in enumerate(cells) if len(row) != width), 0)
    if len(cells[odd]) != width or width < fewest or (fewest == MOST - 1 and width > MOST):
        allowed = f"{fewest} or more" if fewest < MOST - 1 else f"{fewest} or {MOST}"
        raise RequestError(
            f"{rows.path}:{rows.lines[odd]}: expected {allowed} numbers separated by {rows.separator}, got "
            f"{len(cells[odd])}"
        )
    if width > MOST:
        text = f"{rows.path}: {width} columns; those after column {MOST} are left out"
        warnings.warn(text, InputWarning, stacklevel=4)
        cells = [row[:MOST] for row in cells]
    return cells


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _refuse_impossible(path: Path, rows: FloatArray, lines: IntArray, detected: bool) -> None:
    finite = np.isfinite(rows)
    if detected and rows.shape[1] > SCORE:
        finite[:, SCORE] |= np.isnan(rows[:, SCORE])
    not_finite = ~finite.all(axis=1)
    no_area = (rows[:, 4:6] < 0).any(axis=1) | (not detected) & (rows[:, 4:6] == 0).any(axis=1)
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


def boxes_of(rows: FloatArray) -> FloatArray:
    """``(N, 4)`` 0-based corners of the boxes in columns 3 to 6."""
    xywh = rows[:, 2:6].copy()
    xywh[:, :2] -= 1
    return corners_from_xywh(xywh)


def boxes_as_text(boxes: FloatArray) -> list[str]:
    """Columns 3 to 6 of ``(N, 4)`` corners, 1-based."""
    return [f"{x + 1:.3f},{y + 1:.3f},{w:.3f},{h:.3f}" for x, y, w, h in xywh_from_corners(boxes).tolist()]
