"""How well boxes fit the response maps of correlation filters and the objects in the image; thesis 3.2.5."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.single.peaks import peak_near
from tsuiseki.tracking.types import FloatArray, IntArray

SMALLEST_LIKELIHOOD = 1e-6
"""Added to every likelihood, so that a place without any response is unlikely and not impossible."""


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


@dataclass(frozen=True)
class SizedResponseMaps:
    """Responses about one place at several sizes of the target.

    Attributes:
        levels: ``(S,)`` logarithms of the sizes relative to the present one, ascending, 0 in the middle.
        maps: of each size.
    """

    levels: FloatArray
    maps: Sequence[ResponseMaps]

    @property
    def middle(self) -> ResponseMaps:
        """At the present size."""
        return self.maps[len(self.maps) // 2]

    def at(self, places: FloatArray, filters: IntArray, log_sizes: FloatArray) -> FloatArray:
        """Response ``(N,)`` at ``places`` ``(N, 2)`` at the level nearest to each of ``log_sizes`` ``(N,)``."""
        level = np.argmin(np.abs(log_sizes[:, None] - self.levels[None]), axis=1)
        found = np.zeros(len(places))
        for k, maps in enumerate(self.maps):
            here = level == k
            found[here] = maps.at(places[here], filters[here])
        return found


def object_overlap(boxes: FloatArray, proposals: FloatArray) -> FloatArray:
    """``(N,)`` greatest overlap of each box with a box that looks like an object, equation (3.6); 0 with none."""
    if not len(proposals):
        return np.zeros(len(boxes))
    return np.asarray(iou_matrix(boxes, proposals).max(axis=1))


def log_likelihood(response: FloatArray, objectness: FloatArray, response_share: float) -> FloatArray:
    """Logarithm of ``alpha r + (1 - alpha) v``, equation (3.4), with a negative response taken as none.

    Args:
        response: ``(N,)`` r, of the correlation filters.
        objectness: ``(N,)`` v in [0, 1].
        response_share: alpha in [0, 1].
    """
    agreement = response_share * np.maximum(response, 0.0) + (1 - response_share) * objectness
    return np.asarray(np.log(agreement + SMALLEST_LIKELIHOOD))
