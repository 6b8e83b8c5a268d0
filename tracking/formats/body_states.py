"""Bodies in each frame: their states as ``states.csv``, and their silhouettes as pictures.

A row of ``states.csv`` is ``frame,id,a,b,theta,...,score,status``. Frames count from 1 as in the other text files;
centres are pixels, angles radians. Silhouettes are one 8-bit PNG a frame, where bit ``id - 1`` of a pixel says that the
body lies there: bits and not numbers, so that a body keeps its whole silhouette where another covers it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import column_names, finite_number, read_named_rows, repeated, write_columns
from tsuiseki.tracking.formats.track_tables import table_of
from tsuiseki.tracking.formats.tracked_video import NONE
from tsuiseki.tracking.openers.images import decoded_image
from tsuiseki.tracking.types import STATUSES, BoolArray, FloatArray, ImageArray
from tsuiseki.tracking.types.tracks import BodyTrack, rows_of_each

LAST_COLUMNS = ("score", "status")


def write_states(path: Path, tracks: Iterable[BodyTrack], fields: Sequence[str]) -> None:
    """Writes tracks of bodies with state components ``fields``, by frame, then by id."""
    listed = [*tracks]
    table = table_of(listed, fields) if listed else dict.fromkeys(("frame", "id", *fields, *LAST_COLUMNS), NONE)
    write_columns(path, table | {"frame": table["frame"] + 1}, ".4f", score=".4g")


def read_fields(path: Path) -> tuple[str, ...]:
    """Names of the state's components in a file.

    Raises:
        RequestError: there is no file, or it begins with something else.
    """
    columns = column_names(path, "states")
    if columns[:2] != ["frame", "id"]:
        raise RequestError(f"{path}: expected the columns frame,id,… in its first line, got {','.join(columns)[:80]}")
    return tuple(name for name in columns[2:] if name not in LAST_COLUMNS)


def read_states(path: Path, fields: Sequence[str] | None = None) -> list[BodyTrack]:
    """The tracks in a file, by id; the columns score and status may be missing.

    It must have the components ``fields``; by default they are whatever stands between id and score.

    Raises:
        RequestError: it is no such file, a column is missing, or a value is not what it should be.
    """
    table = read_named_rows(path, "states")
    columns = list(fields) if fields else [name for name in table.names if name not in ("frame", "id", *LAST_COLUMNS)]
    table.need(("frame", "id", *(columns or ("a", "b", "theta"))))
    if not table.rows:
        raise RequestError(f"{path}: expected at least one state, got none")
    frames, ids = table.frames(), table.whole_numbers("id", 1)
    statuses = [row.get("status") or "tracking" for _, row in table.rows]
    for (line, _), status in zip(table.rows, statuses, strict=True):
        if status not in STATUSES:
            raise RequestError(f"{path}:{line}: expected a status of {', '.join(STATUSES)}, got {status!r}")
    if (row := repeated(ids, frames)) is not None:
        raise RequestError(
            f"{path}: expected an id once in a frame, got id {ids[row]} twice in frame {frames[row] + 1}"
        )
    scores = [finite_number(path, line, "score", cells.get("score") or "1") for line, cells in table.rows]
    states, score, every_status = table.numbers(columns), np.array(scores), np.array(statuses)
    rows = np.argsort(frames, kind="stable")
    parts = [rows[part] for part in rows_of_each(ids[rows])]
    return [BodyTrack(int(ids[p[0]]), frames[p], states[p], score[p], tuple(every_status[p].tolist())) for p in parts]


FOLDER = "silhouettes"
# Bits of a pixel, one a body.
MOST_BODIES = 8


def read_silhouettes(folder: Path) -> ImageArray:
    """Those of all frames of a clip, ``(T, H, W)`` uint8.

    Raises:
        RequestError: there are none, one cannot be decoded, or they differ in size.
    """
    paths = sorted((folder / FOLDER).glob("*.png"))
    if not paths:
        raise RequestError(f"expected silhouettes as PNG files in {folder / FOLDER}, found none")
    pictures: list[np.ndarray[tuple[int, ...], np.dtype[np.uint8]]] = []
    for path in paths:
        picture = decoded_image(path, cv2.IMREAD_GRAYSCALE)
        if picture is None or (pictures and picture.shape != pictures[0].shape):
            raise RequestError(f"{path}: expected an image of the same size as the others, got something else")
        pictures.append(np.asarray(picture, dtype=np.uint8))
    return np.asarray(np.stack(pictures), dtype=np.uint8)


def silhouette_of(silhouettes: ImageArray, identity: int) -> BoolArray:
    """Where the body ``identity`` (from 1) lies, of any shape."""
    if not 1 <= identity <= MOST_BODIES:
        raise ValueError(f"expected an id from 1 to {MOST_BODIES}, got {identity}")
    return np.asarray((silhouettes >> (identity - 1)) & 1, dtype=np.bool_)


def centre_inside(silhouettes: ImageArray, identity: int, centres: FloatArray) -> BoolArray:
    """Whether each centre ``(T, 2)``, x and y in pixels, lies inside the silhouette of its frame; section 5.

    What is not finite or lies off the image is not inside.
    """
    frames, height, width = silhouettes.shape
    column, row = np.floor(np.nan_to_num(centres, nan=-1.0, posinf=-1.0, neginf=-1.0)).astype(np.int64).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    pixels = silhouettes[np.arange(frames), np.where(inside, row, 0), np.where(inside, column, 0)]
    return np.asarray(inside & silhouette_of(pixels, identity))
