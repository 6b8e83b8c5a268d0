"""``states.csv``: the state of each body in each frame, as ``frame,id,a,b,theta,...,score,status``.

Frames count from 1 as in the other text files; centres are pixels, angles radians.

Silhouettes of bodies, one 8-bit PNG a frame: bit ``id - 1`` of a pixel says that the body lies there.

Bits and not numbers, so that a body keeps its whole silhouette where another covers it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import (
    column_names,
    finite_number,
    read_named_rows,
    repeated,
    whole_number,
    write_csv,
)
from tsuiseki.tracking.types import STATUSES, BoolArray, FloatArray, ImageArray, Status
from tsuiseki.tracking.types.frame_range import LAST_FRAME
from tsuiseki.tracking.types.tracks import BodyTrack

LAST_COLUMNS = ("score", "status")


def write_states(path: Path, tracks: Iterable[BodyTrack], fields: Sequence[str]) -> None:
    """Writes tracks of bodies with state components ``fields``, by frame, then by id."""
    rows = [
        (int(frame) + 1, track.id, [*(f"{value:.4f}" for value in state), f"{score:.4g}", status])
        for track in tracks
        for frame, state, score, status in zip(track.frames, track.states, track.scores, track.statuses, strict=True)
    ]
    lines = ([frame, identity, *values] for frame, identity, values in sorted(rows))
    write_csv(path, ["frame", "id", *fields, *LAST_COLUMNS], lines)


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
    """The tracks in a file, by id.

    Args:
        path: the file; the columns score and status may be missing.
        fields: components that it must have; by default whatever stands between id and score.

    Raises:
        RequestError: it is no such file, a column is missing, or a value is not what it should be.
    """
    table = read_named_rows(path, "states")
    wanted = list(fields) if fields else [name for name in table.names if name not in ("frame", "id", *LAST_COLUMNS)]
    table.need(("frame", "id", *(wanted or ("a", "b", "theta"))))
    rows = [_row(path, line, row, wanted) for line, row in table.rows]
    if not rows:
        raise RequestError(f"{path}: expected at least one state, got none")
    return [_track(path, identity, rows) for identity in sorted({row[1] for row in rows})]


Row = tuple[int, int, list[float], float, Status]


def _track(path: Path, identity: int, rows: list[Row]) -> BodyTrack:
    own = sorted((row for row in rows if row[1] == identity), key=lambda row: row[0])
    frames = np.array([row[0] for row in own], dtype=np.int64)
    if (row := repeated(frames)) is not None:
        raise RequestError(
            f"{path}: expected an id once in a frame, got id {identity} twice in frame {frames[row] + 1}"
        )
    states = np.array([row[2] for row in own], dtype=np.float64)
    return BodyTrack(identity, frames, states, np.array([row[3] for row in own]), tuple(row[4] for row in own))


def _row(path: Path, line: int, row: dict[str, str], fields: Sequence[str]) -> Row:
    frame = whole_number(path, line, "frame", row["frame"], 1, LAST_FRAME)
    identity = whole_number(path, line, "id", row["id"], 1)
    status = row.get("status") or "tracking"
    if status not in STATUSES:
        raise RequestError(f"{path}:{line}: expected a status of {', '.join(STATUSES)}, got {status!r}")
    values = [finite_number(path, line, name, row[name]) for name in fields]
    score = finite_number(path, line, "score", row.get("score") or "1")
    return frame - 1, identity, values, score, status


FOLDER = "silhouettes"
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
        picture = cv2.imdecode(np.fromfile(path, dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
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
    found = silhouettes[np.arange(frames), np.where(inside, row, 0), np.where(inside, column, 0)]
    return np.asarray(inside & silhouette_of(found, identity))
