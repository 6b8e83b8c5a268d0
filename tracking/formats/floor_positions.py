"""Positions that another sensor measured on a floor, as CSV: ``time,x,y`` and optionally ``sd`` and ``id``.

Seconds and metres; ``sd`` is the standard deviation along each axis. An ``id`` is certain: it names the person.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import finite_number, read_named_rows, whole_number
from tsuiseki.tracking.types import FloatArray, IntArray

DEVIATION = 0.2
SAME = 5.0


@dataclass(frozen=True)
class FloorPositions:
    """What a sensor measured, by time.

    Attributes:
        path: of the file.
        times: ``(N,)`` seconds.
        places: ``(N, 2)`` metres.
        deviations: ``(N,)`` metres.
        names: ``(N,)`` ids, -1 for none.
    """

    path: Path
    times: FloatArray
    places: FloatArray
    deviations: FloatArray
    names: IntArray


def read_floor_positions(path: Path) -> FloorPositions:
    """The positions in a file.

    Raises:
        RequestError: a column is missing, a value is no number, a deviation is not above 0, or an id is twice at once.
    """
    table = read_named_rows(path, "a CSV of positions", ("time", "x", "y"))
    if not table.rows:
        raise RequestError(f"{path}: expected rows of positions, found none")
    rows = []
    for line, row in table.rows:
        deviation = finite_number(path, line, "sd", row["sd"]) if row.get("sd") else DEVIATION
        if not deviation > 0:
            raise RequestError(f"{path}:{line}: expected an sd above 0 metres, got {deviation:g}")
        name = whole_number(path, line, "id", row["id"], 1) if row.get("id") else -1
        rows.append((*(finite_number(path, line, key, row[key]) for key in ("time", "x", "y")), deviation, name))
    values = np.array([row[:4] for row in rows], dtype=np.float64)
    names = np.array([row[4] for row in rows], dtype=np.int64)
    order = np.argsort(values[:, 0], kind="stable")
    values, names = values[order], names[order]
    known = np.flatnonzero(names >= 0)
    key = np.stack([values[known, 0], names[known].astype(np.float64)])
    if len(np.unique(key, axis=1).T) < len(known):
        raise RequestError(f"{path}: expected each id once at a time, got one twice")
    return FloorPositions(path, values[:, 0], values[:, 1:3], values[:, 3], names)


def check_names(sensors: list[FloorPositions], tolerance: float) -> None:
    """Refuse an id that two sensors give to different people at once.

    Raises:
        RequestError: two places of one id within the tolerance lie farther apart than their deviations allow.
    """
    for k, one in enumerate(sensors):
        for other in sensors[k + 1 :]:
            for row in np.flatnonzero(one.names >= 0):
                at = (other.names == one.names[row]) & (np.abs(other.times - one.times[row]) <= tolerance)
                for twin in np.flatnonzero(at):
                    apart = float(np.linalg.norm(one.places[row] - other.places[twin]))
                    if apart > SAME * np.hypot(one.deviations[row], other.deviations[twin]) + 1.0:
                        raise RequestError(
                            f"expected one place of id {one.names[row]} at {one.times[row]:g} s, got places "
                            f"{apart:.1f} m apart in {one.path} and {other.path}"
                        )
