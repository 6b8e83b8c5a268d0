"""One camera from the people in it: focal length, tilt, roll and height over the floor.

People of about one height are the higher in the picture the nearer they are, which gives the horizon and the camera's
height (Hoiem, Efros, Hebert, IJCV 80, 2008). Along the line of sight the floor is foreshortened by the focal length, so
that people walk as fast towards the camera as across only under the right one. Robust least squares weighs both:

* log heights of boxes, with a deviation of each person's own that is the prior of people's heights;
* log speeds over `WALK` seconds, with an own speed for each walker; what the noise of boxes adds is taken off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tsuiseki.tracking.cameras.people_views import CELL, LENS, NUMBERS, PeopleView, feet, height_errors
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, IntArray

# People that must be seen.
FEWEST_PEOPLE = 2
# Boxes that must be seen.
FEWEST_BOXES = 20
# People that are fitted, those of the longest tracks.
MOST_PEOPLE = 60
# Ratio of a person's heights in the picture from near to far that tells the horizon.
DEPTH = 1.15
# Time over which speeds are taken, seconds.
WALK = 4.0
# Usual speed of walkers, metres a second.
SPEED = 1.3
# Deviation of the log speed of all walkers of a video from that.
SPEED_OF_ALL = 0.25
# Deviation of the log speed of each walker from that of all.
SPEED_OF_ONE = 0.2
# Deviation of the log speed of a step from its walker's.
SPEED_OF_STEP = 0.3
# Speed in the picture from which somebody walks, heights of the box a second.
WALKING = 0.2
# Prior focal length, longer sides of the picture.
FOCAL = 1.0
# Deviation of its logarithm.
FOCAL_SPREAD = 0.35
# Deviation of the roll, radians.
ROLL_SPREAD = np.radians(3.0)
# Deviation of the principal point from the picture's middle, longer sides.
POINT_SPREAD = 0.04
# Standard deviation of the heights of people, metres.
HEIGHT_SPREAD = 0.1
# Deviation of log heights of one person's boxes, to begin with.
NOISE = 0.04
# Least such deviation that is fitted.
LEAST_NOISE = 0.01
# Largest such deviation that is fitted.
MOST_NOISE = 0.1
# Rounds of the fit, each with the noise of the one before.
ROUNDS = 3
# Steps of least squares at most.
STEPS = 40
# Step of the numerical derivatives.
DIFFERENCE = 1e-6
# A pixel down, of the lower edge of a box.
DOWN = np.array([0.0, 0.0, 0.0, 1.0])


def fit_view(view: PeopleView, height: float) -> tuple[FloatArray, FloatArray]:
    """`NUMBERS` of the camera at the origin, and their ``(11,)`` standard deviations.

    Args:
        view: the people in it.
        height: of people on average, metres.

    Raises:
        RequestError: there are too few people, or all stand at one distance.
    """
    _refuse_too_few(view)
    view = longest(view, MOST_PEOPLE)
    noise, starts = NOISE, _starts(view, height)
    for _ in range(ROUNDS):
        errors = _residuals(view, height, noise)
        fits = [least_robust(errors, partial(_differences, errors), start) for start in starts]
        best = min(fits, key=lambda fit: fit.cost)
        starts = [best.x]
        heights = height_errors(_camera(best.x, view), view, height)
        means = np.bincount(view.people, heights) / np.bincount(view.people)
        away = np.abs(heights - means[view.people])
        noise = float(np.clip(1.4826 * np.median(away), LEAST_NOISE, MOST_NOISE))
    deviations = np.zeros(len(NUMBERS))
    groups = np.concatenate([view.people, view.people[_steps(view)[0]], np.full(5, -1)])
    units = np.array([1, max(view.size), max(view.size), 1, 1, 1])
    deviations[LENS] = np.sqrt(np.diag(best.covariance(groups)[:6, :6] * units[:, None] * units))
    return _camera(best.x, view), deviations


def _refuse_too_few(view: PeopleView) -> None:
    if view.count < FEWEST_PEOPLE or len(view.boxes) < FEWEST_BOXES:
        raise RequestError(
            f"{view.name}: expected at least {FEWEST_PEOPLE} people seen whole for more than a second, got "
            f"{view.count}; give a longer video"
        )
    low, high = np.percentile(view.heights, [5, 95])
    if high < DEPTH * low:
        raise RequestError(
            f"{view.name}: expected people near and far, got all at one distance, {low:.0f} to {high:.0f} pixels high; "
            "give a video in which people come nearer"
        )


def _residuals(view: PeopleView, height: float, noise: float) -> Callable[[FloatArray], FloatArray]:
    """What `fit_view` makes least: heights of N boxes, speeds of steps, three priors; of log focal, tilt, roll, log
    height and log speed."""
    earlier, later = _steps(view)
    seconds = view.times[later] - view.times[earlier]
    place = noise_of_places(view) * view.heights

    def errors(x: FloatArray) -> FloatArray:
        camera = _camera(x, view)
        here = feet(camera, view.boxes, height)
        blur = np.square(np.abs(feet(camera, view.boxes + DOWN, height) - here) * place)
        square, added = np.square(np.abs(here[later] - here[earlier])), blur[earlier] + blur[later]
        speed = np.sqrt(np.maximum(square - added, 0.05 * square)) / seconds
        weight = np.sqrt(CELL / WALK / (1 + np.minimum(added / np.maximum(square, 1e-6), 4) / SPEED_OF_STEP**2))
        pace = np.log(np.maximum(speed, 1e-3) / SPEED) - x[6]
        priors = [*lens_priors(camera, view), x[6] / SPEED_OF_ALL]
        heights = own_deviation(camera, view, height, noise)
        paces = _whitened(pace, view.people[earlier], SPEED_OF_STEP, SPEED_OF_ONE)
        return np.concatenate([heights, weight * paces, priors])

    return errors


def longest(view: PeopleView, count: int) -> PeopleView:
    """The ``count`` people with the longest tracks."""
    counts = np.bincount(view.people)
    rows = np.isin(view.people, np.argsort(-counts, kind="stable")[:count])
    numbers = np.unique(view.people[rows], return_inverse=True)[1].astype(np.int64)
    return replace(view, times=view.times[rows], boxes=view.boxes[rows], people=numbers)


def lens_priors(camera: FloatArray, view: PeopleView) -> FloatArray:
    """``(4,)`` focal length, principal point and roll beside what is usual, in deviations."""
    side = max(view.size)
    point = (camera[1:3] - np.array(view.size) / 2) / side / POINT_SPREAD
    return np.array([(camera[0] - np.log(FOCAL * side)) / FOCAL_SPREAD, *point, camera[4] / ROLL_SPREAD])


def own_deviation(camera: FloatArray, view: PeopleView, height: float, noise: float) -> FloatArray:
    """``(N,)`` log heights of people, each with a height of their own, in units of the noise."""
    return _whitened(height_errors(camera, view, height), view.people, noise, HEIGHT_SPREAD / height)


def _whitened(errors: FloatArray, groups: IntArray, within: float, between: float) -> FloatArray:
    """``(N,)`` errors of which each group shares one of deviation ``between``, made independent of deviation 1."""
    counts = np.maximum(np.bincount(groups), 1)
    share = 1 - np.sqrt(within**2 / (within**2 + counts * between**2))
    return np.asarray((errors - (share * np.bincount(groups, errors) / counts)[groups]) / within)


def noise_of_places(view: PeopleView) -> float:
    """Deviation of the lower edges of boxes, in their heights, from how much they jump."""
    k = np.arange(1, len(view.times) - 1)
    even = (view.people[k - 1] == view.people[k + 1]) & (view.times[k + 1] - view.times[k - 1] < 4 * CELL)
    k = k[even]
    jumps = (view.boxes[k - 1, 3] - 2 * view.boxes[k, 3] + view.boxes[k + 1, 3]) / view.heights[k] / np.sqrt(6)
    return float(1.4826 * np.median(np.abs(jumps))) if len(k) else 0.5 * NOISE


@dataclass(frozen=True)
class RobustFit:
    """What makes the sum of ``2 (sqrt(1 + r²) - 1)`` over R residuals r least.

    Attributes:
        x: ``(D,)`` the numbers.
        errors: ``(R,)`` the residuals.
        slopes: ``(R, D)`` their derivatives.
    """

    x: FloatArray
    errors: FloatArray
    slopes: FloatArray

    @property
    def cost(self) -> float:
        """What the fit minimises: the residuals by the pseudo-Huber loss."""
        return float(2 * (np.sqrt(1 + np.square(self.errors)) - 1).sum())

    @property
    def pulls(self) -> FloatArray:
        """``(R, D)`` derivatives of the halved sum, by residual."""
        return np.asarray(self.slopes * (self.errors * self._weights)[:, None])

    @property
    def _weights(self) -> FloatArray:
        """``(R,)`` of the squares of residuals."""
        return np.asarray(1 / np.sqrt(1 + np.square(self.errors)))

    @property
    def information(self) -> FloatArray:
        """``(D, D)`` second derivatives of the halved sum after Gauss and Newton."""
        return np.asarray(self.slopes.T @ (self.slopes * self._weights[:, None]))

    def covariance(self, groups: IntArray) -> FloatArray:
        """``(D, D)``, where residuals of one of the ``(R,)`` groups depend on each other, and those of -1 do not.

        The sandwich of Huber and White; no deviation is smaller than the information says, for people are few.
        """
        inverse = np.linalg.pinv(self.information)
        order = np.argsort(groups, kind="stable")
        starts = np.flatnonzero(np.diff(groups[order], prepend=-1))
        sums = np.add.reduceat(self.pulls[order], starts, axis=0)
        sandwich = inverse @ (sums.T @ sums * len(sums) / max(len(sums) - 1, 1)) @ inverse
        larger = np.sqrt(np.maximum(np.diag(inverse) / np.maximum(np.diag(sandwich), 1e-30), 1.0))
        return np.asarray(sandwich * larger[:, None] * larger)


def least_robust(
    errors: Callable[[FloatArray], FloatArray],
    slopes: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    steps: int = STEPS,
    enough: float = 1e-6,
) -> RobustFit:
    """Reweighted least squares after Levenberg and Marquardt, by normal equations: rows are many, numbers few.

    Args:
        errors: residuals.
        slopes: their derivatives.
        start: ``(D,)``.
        steps: at most.
        enough: share of the sum by which a step must lower it.
    """
    best, damping = RobustFit(start, errors(start), slopes(start)), 1e-3
    for _ in range(steps):
        information = best.information
        shift = np.linalg.solve(information + np.diag(damping * np.diag(information) + 1e-12), best.pulls.sum(axis=0))
        tried = RobustFit(best.x - shift, errors(best.x - shift), best.slopes)
        if tried.cost >= best.cost:
            damping *= 10
            if damping > 1e8:
                break
            continue
        gain = best.cost - tried.cost
        best, damping = replace(tried, slopes=slopes(tried.x)), max(damping / 5, 1e-9)
        if gain < enough * best.cost:
            break
    return best


def _differences(errors: Callable[[FloatArray], FloatArray], x: FloatArray) -> FloatArray:
    here = errors(x)
    return np.stack([(errors(x + DIFFERENCE * axis) - here) / DIFFERENCE for axis in np.eye(len(x))], axis=1)


def _steps(view: PeopleView) -> tuple[IntArray, IntArray]:
    """Rows of the same walker `WALK` seconds apart."""
    key = view.people * 1e7 + view.times
    later = np.searchsorted(key, key + WALK - 0.05)
    earlier = np.flatnonzero(later < len(key))
    later = later[earlier]
    seconds = view.times[later] - view.times[earlier]
    same = (view.people[earlier] == view.people[later]) & (seconds < WALK + 1.1)
    foot = np.stack([(view.boxes[:, 0] + view.boxes[:, 2]) / 2, view.boxes[:, 3]], axis=1)
    moved = np.hypot(*(foot[later] - foot[earlier]).T) / view.heights[earlier]
    same &= moved > WALKING * np.where(same, seconds, 1.0)
    return earlier[same], later[same]


def _camera(x: FloatArray, view: PeopleView) -> FloatArray:
    camera = np.zeros(len(NUMBERS))
    camera[LENS] = x[:6]
    camera[1:3] = (np.array(view.size) / 2) + x[1:3] * max(view.size)
    return camera


def _starts(view: PeopleView, height: float) -> list[FloatArray]:
    """From the line of heights by row, under three focal lengths."""
    slope, level = np.polyfit(view.boxes[:, 3], view.heights, 1)
    horizon = -level / slope if slope > 1e-3 else -view.size[1]
    horizon = float(np.clip(horizon, -2 * view.size[1], 0.9 * view.size[1]))
    log_height = np.log(np.clip(height / max(slope, 0.05), 0.8, 30.0))
    focals = np.array([0.7, 1.0, 1.5]) * max(view.size)
    tilts = np.arctan((view.size[1] / 2 - horizon) / focals)
    return [np.array([np.log(f), 0.0, 0.0, tilt, 0.0, log_height, 0.0]) for f, tilt in zip(focals, tilts, strict=True)]
