"""Response maps of correlation filters over cyclic shifts, ``map[0, 0]`` being no shift.

Their maxima lie between cells, by parabolas.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import FloatArray, IntArray

Float32Array = NDArray[np.float32]


def _parabola_offset(before: float, at: float, after: float) -> float:
    """Where the parabola through three values has its maximum, in (-0.5, 0.5) around the middle one."""
    curvature = 2 * at - before - after
    return 0.5 * (after - before) / curvature if curvature > 1e-12 else 0.0


def signed_shift(index: FloatArray | float, length: int) -> FloatArray:
    """Cyclic map positions as shifts in [-length/2, length/2)."""
    return np.asarray((index + length / 2) % length - length / 2)


def peak(response: Float32Array) -> tuple[FloatArray, float]:
    """Shift ``(x, y)`` in cells of the greatest value of one map, to sub-cell precision, and the value."""
    row, column = divmod(int(np.argmax(response)), response.shape[1])
    return peak_near(response, np.array([column, row]))


def peak_near(response: Float32Array, cell: IntArray) -> tuple[FloatArray, float]:
    """Shift ``(x, y)`` of the maximum about the cell ``(x, y)`` of one map, to sub-cell precision, and its value."""
    rows, columns = response.shape
    column, row = int(cell[0]) % columns, int(cell[1]) % rows
    value = float(response[row, column])
    dx = _parabola_offset(float(response[row, column - 1]), value, float(response[row, (column + 1) % columns]))
    dy = _parabola_offset(float(response[row - 1, column]), value, float(response[(row + 1) % rows, column]))
    shift = np.array([float(signed_shift(column + dx, columns)), float(signed_shift(row + dy, rows))])
    return shift, value


def local_maxima(response: Float32Array, count: int) -> tuple[FloatArray, FloatArray]:
    """The ``count`` greatest local maxima of a cyclic map, greatest first; fewer come back where there are fewer.

    Returns:
        Shifts ``(M, 2)`` x, y in whole cells and values ``(M,)``.
    """
    _, shifts, values = maxima_of_each(response[None], count)
    return shifts, values


def maxima_of_each(responses: Float32Array, count: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """`local_maxima` of several maps at once.

    A cell is one when no neighbour of its eight is greater and one is smaller.

    Args:
        responses: ``(B, rows, columns)`` cyclic maps.
        count: of a map, at most.

    Returns:
        Which map ``(M,)``, ascending, shifts ``(M, 2)`` x, y in whole cells and values ``(M,)``, of a map the greatest
        first.
    """
    greatest = least = responses
    for axis in (-2, -1):
        greatest = np.maximum(np.maximum(greatest, np.roll(greatest, 1, axis)), np.roll(greatest, -1, axis))
        least = np.minimum(np.minimum(least, np.roll(least, 1, axis)), np.roll(least, -1, axis))
    which, row, column = np.nonzero((responses >= greatest) & (responses > least))
    values = responses[which, row, column]
    order = np.lexsort((-values, which))
    rank = np.arange(len(order)) - np.searchsorted(which, which)  # ``which`` is sorted: so many of its map before
    order = order[rank < count]
    which, row, column, values = which[order], row[order], column[order], values[order]
    rows, columns = responses.shape[1:]
    shifts = np.stack([signed_shift(column.astype(np.float64), columns), signed_shift(row.astype(np.float64), rows)], 1)
    return which, shifts, values.astype(np.float64)


@dataclass(frozen=True)
class ResponseMaps:
    """Responses of F filters in W windows of one frame.

    Attributes:
        maps: ``(W, F, rows, columns)`` float32 over cyclic shifts, as :func:`correlation.respond` gives them.
        centres: ``(W, 2)`` of the windows, pixels.
        cell: side of a cell, pixels.
    """

    maps: NDArray[np.float32]
    centres: FloatArray
    cell: float

    def at(self, places: FloatArray, filters: IntArray) -> FloatArray:
        """Response ``(N,)`` of one filter a place, equation (3.5), between cells by bilinear interpolation.

        Args:
            places: ``(N, 2)`` pixels.
            filters: ``(N,)`` index of a filter.

        A place is read in the window whose centre is nearest; outside every window the response is zero.
        """
        shift = (places[:, None] - self.centres[None]) / self.cell
        window = np.argmin((shift**2).sum(axis=2), axis=1)
        shift = shift[np.arange(len(places)), window]
        rows, columns = self.maps.shape[2:]
        x, y = shift[:, 0], shift[:, 1]
        x0, y0 = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        fx, fy = x - x0, y - y0
        total = np.zeros(len(places))
        for dy, wy in ((0, 1 - fy), (1, fy)):
            for dx, wx in ((0, 1 - fx), (1, fx)):
                total += wy * wx * self.maps[window, filters, (y0 + dy) % rows, (x0 + dx) % columns]
        inside = (np.abs(x) <= columns / 2) & (np.abs(y) <= rows / 2)
        return np.where(inside, total, 0.0)

    def climb(self, place: FloatArray, number: int) -> FloatArray:
        """``(2,)`` the local maximum of filter ``number`` that is uphill from ``place`` ``(2,)``, between cells by
        parabolas; ``place`` itself where it is more than a cell and a half away in x or y."""
        window = int(np.argmin(((place - self.centres) ** 2).sum(axis=1)))
        response = self.maps[window, number]
        rows, columns = response.shape
        start = np.round((place - self.centres[window]) / self.cell).astype(int)
        offsets = np.array([(x, y) for y in (-1, 0, 1) for x in (-1, 0, 1)])
        around = start + offsets
        values = response[around[:, 1] % rows, around[:, 0] % columns]
        shift, _ = peak_near(response, around[int(np.argmax(values))])
        found = self.centres[window] + shift * self.cell
        return np.asarray(found if (np.abs(found - place) <= 1.5 * self.cell).all() else place)
