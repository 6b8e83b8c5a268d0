"""What waiting for later pixels is worth: the smoothed filter beside triangulated points through a low-pass.

Any low-pass takes acceleration away, so a calm path alone says nothing for a filter. The fair peer is the best local
fit to the triangulated points that sees as far ahead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.datamodules.readers.multiview_drone import DroneFlight
from tsuiseki.tracking.cameras.moving_target import TimedCamera
from tsuiseki.tracking.cameras.triangulation import triangulate
from tsuiseki.tracking.evaluation.space import acceleration
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.experiment import Table
from tsuiseki.trainers.experiments.sphere.flights import LAGS, STEP, half_of
from tsuiseki.trainers.experiments.sphere.multiview_filter import Course

WINDOWS = (0.12, 0.24, 0.48, 0.96)
"""Seconds behind that a local fit sees."""
DEGREES = (1, 2)


@dataclass(frozen=True)
class LookAhead:
    """Filter and local fit with the same look-ahead, against RTK where two cameras saw the drone.

    Attributes:
        cameras: how many.
        ahead: seconds that an estimate waits.
        filter_median, fit_median: of the distance, metres.
        filter_acceleration, fit_acceleration: root mean square, m/s².
        window, degree: of the fit, chosen on the first half.
    """

    cameras: int
    ahead: float
    filter_median: float
    filter_acceleration: float
    fit_median: float
    fit_acceleration: float
    window: float
    degree: int


def local_fit(points: FloatArray, behind: int, ahead: int, degree: int) -> FloatArray:
    """Each point by a polynomial in time through its neighbours, least squares (Savitzky and Golay, with gaps).

    Args:
        points: ``(T, 3)`` at even times, NaN where there is none; those stay NaN.
        behind, ahead: how many times before and after a point are seen.
        degree: of the polynomial. A point with too few neighbours stays as it is.
    """
    known = np.isfinite(points[:, 0])
    filled = np.where(known[:, None], points, 0.0)
    offsets = np.arange(-behind, ahead + 1)
    rows = np.arange(len(points))[:, None] + offsets
    inside = (rows >= 0) & (rows < len(points))
    rows = np.clip(rows, 0, len(points) - 1)
    weights = (known[rows] & inside).astype(np.float64)
    # Times from -1 to 1, so that the normal equations are well conditioned.
    basis = (offsets / max(behind, ahead, 1))[:, None] ** np.arange(degree + 1)
    moments = np.einsum("tk,kd,ke->tde", weights, basis, basis)
    right = np.einsum("tk,kd,tkc->tdc", weights, basis, filled[rows])
    enough = known & (weights.sum(axis=1) > degree)
    fitted = points.copy()
    fitted[enough] = np.linalg.solve(moments[enough], right[enough])[:, 0]
    return fitted


def look_ahead(
    flight: DroneFlight, cameras: Sequence[TimedCamera], course: Course, triangulated: FloatArray, truth: FloatArray
) -> list[LookAhead]:
    """A row for each look-ahead on the second half of the flight; the fits' windows are chosen on the first.

    Of the fits with at most half the acceleration of the plain points, as is asked of the filter, that of the least
    median; or of all, if there is none.

    Args:
        flight: all of it.
        cameras: that are used.
        course: of the filter over the second half.
        triangulated, truth: ``(T, 3)`` at the times of the course.
    """
    first = half_of(flight, cameras, first=True)
    plain, _ = triangulate([c.camera for c in cameras], first[1])
    rows = []
    for ahead in LAGS:
        tried = []
        for window in WINDOWS:
            for degree in DEGREES:
                fitted = local_fit(plain, round(window / STEP), round(ahead / STEP), degree)
                median, restless = _scored(first[0], fitted, first[2])
                calm = restless <= 0.5 * acceleration(first[0], plain, STEP)
                tried.append((not calm, median, window, degree))
        _, _, window, degree = min(tried)
        estimates = course.smoothed(ahead)
        estimates[~np.isfinite(triangulated[:, 0])] = np.nan
        fitted = local_fit(triangulated, round(window / STEP), round(ahead / STEP), degree)
        fitted[~np.isfinite(estimates[:, 0])] = np.nan
        scores = (*_scored(course.times, estimates, truth), *_scored(course.times, fitted, truth))
        rows.append(LookAhead(len(cameras), ahead, *scores, window, degree))
    return rows


def look_ahead_table(rows: Sequence[LookAhead]) -> Table:
    """A line for each number of cameras and look-ahead."""
    columns = (
        "cameras", "look-ahead, s", "median, m: filter", "smoothed triangulation",
        "rms acceleration, m/s²: filter", "smoothed triangulation", "its window behind, s", "degree",
    )  # fmt: skip
    lines = [
        (
            f"{row.cameras}", f"{row.ahead:g}", f"{row.filter_median:.4f}", f"{row.fit_median:.4f}",
            f"{row.filter_acceleration:.1f}", f"{row.fit_acceleration:.1f}", f"{row.window:g}", f"{row.degree}",
        )
        for row in rows
    ]  # fmt: skip
    return Table("Error against look-ahead, on the second half", columns, lines)


def _scored(times: FloatArray, points: FloatArray, truth: FloatArray) -> tuple[float, float]:
    """Median distance and root mean square acceleration."""
    away = np.sqrt(np.square(points - truth).sum(axis=1))
    return float(np.nanmedian(away)), acceleration(times, points, STEP)
