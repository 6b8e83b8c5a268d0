"""Points of animals as SLEAP and DeepLabCut write them, and as a ``states.csv`` with labelled points has them.

* SLEAP's analysis CSV: ``track,frame_idx,instance.score,head.x,head.y,head.score,…``, frames from 0. Its
  projects and analysis files are HDF5: `sleap_hdf5`.
* DeepLabCut's CSV: header lines scorer, (individuals,) bodyparts, coords; then a line a frame, from 0. In files of
  labels the frame is the number in the name of the image.
* ours: ``frame,id,…,head_x,head_y,…``, frames from 1.

Points are in pixels; SLEAP and DeepLabCut take the centre of the first pixel as 0, 0. Half a pixel is not converted.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.sleap_hdf5 import is_hdf5, read_sleap_hdf5
from tsuiseki.tracking.types.tracks import PointTable

DLC_FIRST = "scorer"
DLC_ROWS = ("individuals", "bodyparts", "coords")


def read_poses_file(path: Path) -> PointTable:
    """The points in a CSV file of SLEAP, DeepLabCut or ours, or in SLEAP's .slp or .h5.

    Raises:
        RequestError: it is none of them, is broken, or holds no point.
    """
    if not path.is_file():
        raise RequestError(f"expected points of animals at {path}, found no file")
    table = read_sleap_hdf5(path) if is_hdf5(path) else _text_table(path)
    seen = np.isfinite(table.points).all(axis=2).sum(axis=1) > 0
    if not seen.any():
        raise RequestError(f"{path}: expected at least one point, got none")
    tracks = tuple(name for name, one in zip(table.tracks, seen, strict=True) if one)
    return PointTable(table.nodes, table.frames[seen], tracks, table.points[seen], table.scores[seen])


def _text_table(path: Path) -> PointTable:
    """The points in a CSV file."""
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        rows = [row for row in csv.reader(file) if any(cell.strip() for cell in row)]
    first = [cell.strip() for cell in rows[0]] if rows else []
    if first[:1] == [DLC_FIRST]:
        return _deeplabcut(path, rows)
    if "frame_idx" in first:
        return _sleap(path, first, rows[1:])
    if first[:2] == ["frame", "id"]:
        return _ours(path, first, rows[1:])
    raise RequestError(
        f"{path}: expected SLEAP's analysis CSV (track,frame_idx,…), DeepLabCut's (scorer,…) or frame,id,head_x,…, "
        f"got {','.join(first)[:60]}"
    )


def write_sleap(path: Path, table: PointTable) -> None:
    """Write SLEAP's analysis CSV; the score of an animal is the mean of its points'."""
    columns = [f"{node}.{part}" for node in table.nodes for part in ("x", "y", "score")]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["track", "frame_idx", "instance.score", *columns])
        for n in _by_frame(table):
            values = np.concatenate([table.points[n], table.scores[n][:, None]], axis=1).ravel()
            known = table.scores[n][np.isfinite(table.scores[n])]
            score = f"{known.mean():.4f}" if len(known) else ""
            writer.writerow([table.tracks[n], int(table.frames[n]), score, *map(_text, values)])


def write_deeplabcut(path: Path, table: PointTable, length: int, scorer: str = "tsuiseki") -> None:
    """Write DeepLabCut's CSV of several animals.

    Args:
        path: file to write.
        table: its tracks name the individuals.
        length: frames of the video: each gets a line.
        scorer: who found the points.
    """
    names = list(dict.fromkeys(table.tracks))
    columns = [(name, node, part) for name in names for node in table.nodes for part in ("x", "y", "likelihood")]
    lines = np.full((length, len(names), len(table.nodes), 3), np.nan)
    for n in range(len(table)):
        lines[table.frames[n], names.index(table.tracks[n])] = np.concatenate(
            [table.points[n], table.scores[n][:, None]], axis=1
        )
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([DLC_FIRST, *[scorer] * len(columns)])
        for place, head in enumerate(DLC_ROWS):
            writer.writerow([head, *(column[place] for column in columns)])
        for frame, line in enumerate(lines):
            writer.writerow([frame, *map(_text, line.ravel())])


def _by_frame(table: PointTable) -> list[int]:
    return sorted(range(len(table)), key=lambda n: (int(table.frames[n]), table.tracks[n]))


def _sleap(path: Path, header: list[str], rows: Sequence[Sequence[str]]) -> PointTable:
    nodes = tuple(name[:-2] for name in header if name.endswith(".x"))
    frame = header.index("frame_idx")
    track = header.index("track") if "track" in header else None
    names = [str(row[track]).strip() if track is not None else "" for row in rows]
    return _table(path, nodes, header, rows, (".x", ".y", ".score"), [row[frame] for row in rows], names, 0)


def _ours(path: Path, header: list[str], rows: Sequence[Sequence[str]]) -> PointTable:
    nodes = tuple(name[:-2] for name in header if name.endswith("_x") and f"{name[:-2]}_y" in header)
    frames, names = [row[0] for row in rows], [row[1].strip() for row in rows]
    return _table(path, nodes, header, rows, ("_x", "_y", "_score"), frames, names, 1)


def _table(
    path: Path,
    nodes: tuple[str, ...],
    header: list[str],
    rows: Sequence[Sequence[str]],
    ends: tuple[str, str, str],
    frames: Sequence[str],
    names: Sequence[str],
    first: int,
) -> PointTable:
    """From one line an animal in a frame; ``ends`` follow a node's name in the header."""
    if not nodes:
        raise RequestError(
            f"{path}: expected columns such as head{ends[0]} and head{ends[1]}, got {','.join(header)[:80]}"
        )
    values = np.full((len(rows), len(nodes), 3), np.nan)
    for k, node in enumerate(nodes):
        for part, end in enumerate(ends):
            if f"{node}{end}" in header:
                column = header.index(f"{node}{end}")
                values[:, k, part] = [_number(path, n + 2, row, column) for n, row in enumerate(rows)]
    numbers = np.array([_frame(path, n + 2, text) for n, text in enumerate(frames)], dtype=np.int64) - first
    return PointTable(nodes, numbers, tuple(names), values[:, :, :2], values[:, :, 2])


def _deeplabcut(path: Path, rows: Sequence[Sequence[str]]) -> PointTable:
    heads = {row[0].strip(): row for row in rows[:4] if row[0].strip() in (DLC_FIRST, *DLC_ROWS)}
    if "bodyparts" not in heads or "coords" not in heads:
        raise RequestError(f"{path}: expected the lines scorer, bodyparts and coords at its beginning")
    parts, coords = heads["bodyparts"], heads["coords"]
    who = heads.get("individuals", [""] * len(parts))
    used = [n for n in range(1, len(coords)) if coords[n].strip() in ("x", "y", "likelihood")]
    nodes = tuple(dict.fromkeys(parts[n].strip() for n in used))
    names = list(dict.fromkeys(who[n].strip() for n in used))
    lines = rows[len(heads) :]
    values = np.full((len(lines), len(names), len(nodes), 3), np.nan)
    for n in used:
        place = names.index(who[n].strip()), nodes.index(parts[n].strip())
        part = ("x", "y", "likelihood").index(coords[n].strip())
        values[:, place[0], place[1], part] = [_number(path, i + len(heads) + 1, row, n) for i, row in enumerate(lines)]
    # Labels name the image in one column or in three; predictions count frames.
    index = [next((cell for cell in reversed(row[: used[0]]) if cell.strip()), "") for row in lines]
    frames = np.array([_frame(path, i + len(heads) + 1, text) for i, text in enumerate(index)], dtype=np.int64)
    flat = values.reshape(-1, len(nodes), 3)
    return PointTable(nodes, np.repeat(frames, len(names)), tuple(names * len(lines)), flat[:, :, :2], flat[:, :, 2])


def _frame(path: Path, line: int, text: str) -> int:
    digits = re.findall(r"\d+", Path(text.strip()).stem)
    if not digits:
        raise RequestError(f"{path}:{line}: expected the number of a frame, got {text!r}")
    return int(digits[-1])


def _number(path: Path, line: int, row: Sequence[str], column: int) -> float:
    text = row[column].strip() if column < len(row) else ""
    try:
        return float(text) if text else np.nan
    except ValueError as error:
        raise RequestError(f"{path}:{line}: expected a number or nothing, got {text!r}") from error


def _text(value: float) -> str:
    return "" if not np.isfinite(value) else f"{value:.3f}"
