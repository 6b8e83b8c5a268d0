"""Points of animals as SLEAP and DeepLabCut write them, and as a ``states.csv`` with labelled points has them.

* SLEAP's analysis CSV: ``track,frame_idx,instance.score,head.x,head.y,head.score,…``, frames from 0. Its
  projects and analysis files are HDF5: `sleap_hdf5`.
* sleap-io's CSV with a line a frame: ``frame_idx,inst0.track,inst0.score,inst0.head.x,…``, or with the names of the
  animals instead: ``frame_idx,mouse1.head.x,…``.
* DeepLabCut's CSV: header lines scorer, (individuals,) bodyparts, coords; then a line a frame, from 0. In files of
  labels the frame is the number in the name of the image. The parts of the individual ``single``, which
  stands beside others, are landmarks of the scene and no animal.
* ours: ``frame,id,…,head_x,head_y,…``, frames from 1.

Points are in pixels; SLEAP and DeepLabCut take the centre of the first pixel as 0, 0. Half a pixel is not converted.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.rows import NamedRows, Rows, read_named_rows, read_rows, write_csv
from tsuiseki.tracking.formats.sleap_hdf5 import hdf5_installed, is_hdf5, read_sleap_hdf5, write_sleap_analysis
from tsuiseki.tracking.openers.text import refusing
from tsuiseki.tracking.types.tracks import PointTable

# Of all animals in a result.
POINTS_FILE = "points.sleap.csv"
DLC_FIRST = "scorer"
DLC_ROWS = ("individuals", "bodyparts", "coords")
DLC_LANDMARKS = "single"


def read_poses_file(path: Path) -> PointTable:
    """The points in a CSV file of SLEAP, DeepLabCut or ours, or in SLEAP's .slp or .h5.

    Raises:
        RequestError: it is none of them, is broken, or holds no point.
    """
    if not path.is_file():
        raise RequestError(f"expected points of animals at {path}, found no file")
    with refusing(f"{path}: expected points of animals, got a file that is broken: ", str):
        table = read_sleap_hdf5(path) if is_hdf5(path) else _text_table(path)
    labelled = np.isfinite(table.points).all(axis=2).sum(axis=1) > 0
    if not labelled.any():
        raise RequestError(f"{path}: expected at least one point, got none")
    tracks = tuple(name for name, has_points in zip(table.tracks, labelled, strict=True) if has_points)
    return PointTable(table.nodes, table.frames[labelled], tracks, table.points[labelled], table.scores[labelled])


def _text_table(path: Path) -> PointTable:
    rows = read_rows(path, "points of animals")
    first = rows.cells[0] if rows.cells else []
    if first[:1] == [DLC_FIRST]:
        return _deeplabcut(rows)
    if "frame_idx" in first:
        table = read_named_rows(path, "points of animals")
        if animals := _animals(table.names):
            return _by_frame(table, animals)
        return _named(table, (".x", ".y", ".score"), "track")
    if first[:2] == ["frame", "id"]:
        return _named(read_named_rows(path, "points of animals"), ("_x", "_y", "_score"), "id")
    raise RequestError(
        f"{path}: expected SLEAP's analysis CSV (track,frame_idx,…), DeepLabCut's (scorer,…) or frame,id,head_x,…, "
        f"got {','.join(first)[:60]}"
    )


def write_sleap(path: Path, table: PointTable) -> None:
    """Write SLEAP's analysis CSV; the score of an animal is the mean of its points'."""
    columns = [f"{node}.{part}" for node in table.nodes for part in ("x", "y", "score")]
    rows = []
    for n in sorted(range(len(table)), key=lambda n: (int(table.frames[n]), table.tracks[n])):
        values = np.concatenate([table.points[n], table.scores[n][:, None]], axis=1).ravel()
        finite = table.scores[n][np.isfinite(table.scores[n])]
        score = f"{finite.mean():.4f}" if len(finite) else ""
        rows.append([table.tracks[n], int(table.frames[n]), score, *map(_text, values)])
    write_csv(path, ["track", "frame_idx", "instance.score", *columns], rows)


def write_deeplabcut(path: Path, table: PointTable, length: int) -> None:
    """Write DeepLabCut's CSV of the individuals that ``tracks`` name, with a line for each of ``length`` frames."""
    names = list(dict.fromkeys(table.tracks))
    columns = [(name, node, part) for name in names for node in table.nodes for part in ("x", "y", "likelihood")]
    lines = np.full((length, len(names), len(table.nodes), 3), np.nan)
    for n in range(len(table)):
        lines[table.frames[n], names.index(table.tracks[n])] = np.concatenate(
            [table.points[n], table.scores[n][:, None]], axis=1
        )
    heads = ([head, *(column[place] for column in columns)] for place, head in enumerate(DLC_ROWS))
    rows = ([frame, *map(_text, line.ravel())] for frame, line in enumerate(lines))
    write_csv(path, [DLC_FIRST, *["tsuiseki"] * len(columns)], [*heads, *rows])


def _named(table: NamedRows, ends: tuple[str, str, str], track: str) -> PointTable:
    """From one line an animal in a frame; ``ends`` follow a node's name in the header."""
    nodes = [name.removesuffix(ends[0]) for name in table.names if name.endswith(ends[0])]
    nodes = [node for node in nodes if node + ends[1] in table.names]
    if not nodes:
        raise RequestError(
            f"{table.path}: expected columns such as head{ends[0]} and head{ends[1]}, got {','.join(table.names)[:80]}"
        )
    values = np.full((len(table.rows), len(nodes), 3), np.nan)
    for n, (line, row) in enumerate(table.rows):
        for k, node in enumerate(nodes):
            values[n, k] = [_number(table.path, line, row.get(node + end, "")) for end in ends]
    frames = table.frames()
    names = tuple(row.get(track, "") for _, row in table.rows)
    return PointTable(tuple(nodes), frames, names, values[:, :, :2], values[:, :, 2])


# What sleap-io calls the animals of a frame where their names do not matter.
ANONYMOUS = re.compile(r"inst\d+")
# Columns of files with a line for each animal.
OF_ANIMALS = ("track", "instance.score")


def _animals(names: Sequence[str]) -> dict[str, list[str]]:
    """By the name of an animal the nodes that it has columns of; empty where a line is of one animal."""
    animals = dict[str, list[str]]()
    for name in names:
        animal, _, node = name.removesuffix(".x").partition(".")
        if name.endswith(".x"):
            animals.setdefault(animal, []).append(node)
    # Nodes may have points in their names, too.
    alike = len({frozenset(nodes) for nodes in animals.values()}) == 1 and "" not in next(iter(animals.values()))
    described = all(len(nodes) > 1 or f"{animal}.score" in names for animal, nodes in animals.items())
    return animals if alike and described and not {*OF_ANIMALS} & {*names} else {}


def _by_frame(table: NamedRows, animals: Mapping[str, Sequence[str]]) -> PointTable:
    """From one line a frame; a column ``….track`` names the animal, or else the other columns do."""
    nodes = tuple(next(iter(animals.values())))
    values, tracks = np.full((len(table.rows), len(animals), len(nodes), 3), np.nan), list[str]()
    for n, (line, row) in enumerate(table.rows):
        for k, animal in enumerate(animals):
            cells = [[row.get(f"{animal}.{node}.{part}", "") for part in ("x", "y", "score")] for node in nodes]
            values[n, k] = [[_number(table.path, line, cell) for cell in point] for point in cells]
            tracks.append(row.get(f"{animal}.track", "" if ANONYMOUS.fullmatch(animal) else animal))
    points = values.reshape(-1, len(nodes), 3)
    return PointTable(nodes, np.repeat(table.frames(), len(animals)), tuple(tracks), points[..., :2], points[..., 2])


def _deeplabcut(table: Rows) -> PointTable:
    path, width = table.path, max(map(len, table.cells))
    rows = [row + [""] * (width - len(row)) for row in table.cells]
    heads = {row[0].strip(): row for row in rows[:4] if row[0].strip() in (DLC_FIRST, *DLC_ROWS)}
    if "bodyparts" not in heads or "coords" not in heads:
        raise RequestError(f"{path}: expected the lines scorer, bodyparts and coords at its beginning")
    parts, coords = heads["bodyparts"], heads["coords"]
    who = heads.get("individuals", [""] * len(parts))
    used = [n for n in range(1, len(coords)) if coords[n].strip() in ("x", "y", "likelihood")]
    names = list(dict.fromkeys(who[n].strip() for n in used))
    if DLC_LANDMARKS in names and len(names) > 1:
        landmarks = list(dict.fromkeys(parts[n].strip() for n in used if who[n].strip() == DLC_LANDMARKS))
        warnings.warn(f"{path}: {', '.join(landmarks)} are landmarks, no animal; left out", InputWarning, stacklevel=2)
        used = [n for n in used if who[n].strip() != DLC_LANDMARKS]
        names.remove(DLC_LANDMARKS)
    nodes = tuple(dict.fromkeys(parts[n].strip() for n in used))
    lines, numbers = rows[len(heads) :], table.lines[len(heads) :]
    values = np.full((len(lines), len(names), len(nodes), 3), np.nan)
    for n in used:
        place = names.index(who[n].strip()), nodes.index(parts[n].strip())
        part = ("x", "y", "likelihood").index(coords[n].strip())
        values[:, place[0], place[1], part] = [_number(path, i, row[n]) for i, row in zip(numbers, lines, strict=True)]
    # Labels name the image in one column or in three; predictions count frames.
    index = [next((cell for cell in reversed(row[: used[0]]) if cell.strip()), "") for row in lines]
    frames = np.array([_frame(path, i, text) for i, text in zip(numbers, index, strict=True)], dtype=np.int64)
    flat = values.reshape(-1, len(nodes), 3)
    return PointTable(nodes, np.repeat(frames, len(names)), tuple(names * len(lines)), flat[:, :, :2], flat[:, :, 2])


def _frame(path: Path, line: int, text: str) -> int:
    digits = re.findall(r"\d+", Path(text.strip()).stem)
    if not digits or len(digits[-1]) > 18:  # more are beyond 64 bits
        raise RequestError(f"{path}:{line}: expected the number of a frame, got {text!r:.60}")
    return int(digits[-1])


def _number(path: Path, line: int, text: str) -> float:
    try:
        return float(text) if text else np.nan
    except ValueError as error:
        raise RequestError(f"{path}:{line}: expected a number or nothing, got {text!r:.60}") from error


def _text(value: float) -> str:
    return "" if not np.isfinite(value) else f"{value:.3f}"


def point_files(points: PointTable, frames: int) -> dict[str, Callable[[Path, Path], object]]:
    """The points of all animals in the files of other programs, of so many ``frames``."""
    files: dict[str, Callable[[Path, Path], object]] = {
        POINTS_FILE: lambda path, _: write_sleap(path, points),
        "points.dlc.csv": lambda path, _: write_deeplabcut(path, points, frames),
    }
    if hdf5_installed():
        files["points.sleap.h5"] = lambda path, _: write_sleap_analysis(path, points, frames)
    return files
