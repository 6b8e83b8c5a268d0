"""Several cameras over one floor, refined together by the people whom two of them see.

Given where the cameras stand roughly, paths that stay near each other are matched one to one. Then all lenses, poses
and clocks are fitted at once: two cameras put a person at the same place, people are as high as people are, lenses are
as lenses are. Distances count in deviations, from the noise of boxes and the slope of the view. Matching and fitting
alternate while the tolerance falls.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import scipy

from tsuiseki.tracking.cameras.people_fit import (
    MOST_PEOPLE,
    least_robust,
    lens_priors,
    longest,
    noise_of_places,
    own_deviation,
)
from tsuiseki.tracking.cameras.people_views import (
    DRIFT,
    FEWEST,
    GAP,
    NUMBERS,
    OFFSET,
    PLACE,
    STEP,
    Alignment,
    PeopleView,
    on_floor,
    places_at,
)
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

# Root mean square distance below which two paths are one person's, metres, round by round.
TOLERANCES = (2.5, 1.5, 1.0, 0.8, 0.8)
# Ratio of an alignment's score to its rival's from which it is taken.
SURE = 1.25
# Places that must agree for that.
LEAST_SCORE = 12.0
# Places of two cameras that are compared at most.
MOST = 200
# Deviation of a foot from where the box shows it, metres.
FOOT = 0.1
# Weight of each place: those of one walk are not independent.
WEIGHT = 0.5
# Deviation of the drift of a clock, seconds a second.
DRIFTING = 1e-2
# Scales of `NUMBERS` in the fit, in their units.
SCALE = np.array([0.1, 20, 20, 0.05, 0.02, 0.1, 0.1, 1, 1, 0.2, 1e-3])
# Step of the numerical derivatives, in units of `SCALE`.
DIFFERENCE = 1e-5


def placed(cameras: FloatArray, names: Sequence[str], aligned: Mapping[tuple[int, int], Alignment]) -> FloatArray:
    """``(C, 11)`` the cameras over the floor of the first one, by the surest alignments of pairs.

    Raises:
        RequestError: a camera shares too few people with the others.
    """
    count, sure = len(cameras), np.zeros((len(cameras), len(cameras)))
    for pair, alignment in aligned.items():
        if alignment.score >= max(SURE * alignment.rival, LEAST_SCORE):
            sure[pair] = 1 / (alignment.score - alignment.rival)
    tree = scipy.sparse.csgraph.minimum_spanning_tree(sure)
    order, predecessor = scipy.sparse.csgraph.breadth_first_order(tree, 0, directed=False)
    if len(order) < count:
        alone = ", ".join(names[k] for k in range(count) if k not in order)
        raise RequestError(
            f"expected people who are seen by two cameras at a time, found too few for {alone}; give longer videos, "
            "clocks that differ by less than `reach`, or leave it out"
        )
    placed = cameras.copy()
    placed[:, 6:] = 0
    for k in order[1:].tolist():
        base = int(predecessor[k])
        alignment = aligned[min(base, k), max(base, k)]
        if base > k:
            back = complex(np.conj(alignment.turn))
            alignment = replace(alignment, offset=-alignment.offset, turn=back, shift=-back * alignment.shift)
        here, turned = placed[base], np.exp(1j * placed[base, 6])
        position = here[7] + 1j * here[8] + turned * alignment.shift
        placed[k, PLACE] = np.angle(turned * alignment.turn), position.real, position.imag
        placed[k, OFFSET] = here[OFFSET] + alignment.offset
    return placed


def refined(
    views: Sequence[PeopleView], cameras: FloatArray, height: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The cameras that explain best what they see together; the first one stays in its place.

    A drift of a clock is kept where it moves it by more than half a frame, and three times its deviation.

    Args:
        views: of C cameras.
        cameras: ``(C, 11)`` to begin with, see `people_views.NUMBERS`.
        height: of people on average, metres.

    Returns:
        The cameras, their ``(C, 11)`` standard deviations, and ``(C,)`` median metres between where a camera puts a
        person and where another does, each on average.
    """
    drifting = np.zeros(len(views), dtype=np.bool_)
    for tolerance in TOLERANCES:
        cameras = BundleAdjustment(views, cameras, height, tolerance, drifting).solved()[0]
    cameras, deviations = BundleAdjustment(views, cameras, height, TOLERANCES[-1], ~drifting).solved()
    length = np.array([np.ptp(view.times) for view in views])
    frame = 1 / min(view.frame_rate for view in views)
    drift = np.abs(cameras[:, DRIFT])
    drifting = (drift * length > 0.5 * frame) & (drift > 3 * deviations[:, DRIFT])
    cameras[~drifting, DRIFT] = 0
    cameras, deviations = BundleAdjustment(views, cameras, height, TOLERANCES[-1], drifting).solved()
    return cameras, deviations, _matched(views, cameras, height, TOLERANCES[-1]).errors(cameras, height)


def _matched(views: Sequence[PeopleView], cameras: FloatArray, height: float, tolerance: float) -> CrossViewPairs:
    """What each two cameras see together: paths of root mean square distance below ``tolerance``, one to one.

    Raises:
        RequestError: nobody is seen by two.
    """
    clocks = [_common_times(view.times, camera) for view, camera in zip(views, cameras, strict=True)]
    times = np.arange(min(c.min() for c in clocks), max(c.max() for c in clocks) + STEP, STEP)
    paths = []
    for view, camera in zip(views, cameras, strict=True):
        paths.append(places_at(view, on_floor(camera, view.boxes, height), _own_times(times, camera)))
    begin = np.cumsum([0, *(view.count for view in views)])
    parts = []
    for i, j in combinations(range(len(views)), 2):
        rows, k = _rows(views, cameras, i, j, _partners(paths[i], paths[j], tolerance))
        view, second = views[i], views[j]
        speed = (second.boxes[k + 1] - second.boxes[k]) / (second.times[k + 1] - second.times[k])[:, None]
        boxes = view.times[rows], view.boxes[rows], second.times[k], second.boxes[k], speed
        parts.append((np.full(len(k), i), np.full(len(k), j), *boxes, begin[i] + view.people[rows]))
    pairs = CrossViewPairs(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    if not len(pairs.first):
        raise RequestError("expected people who are seen by two cameras at a time, found none; give longer videos")
    return pairs


def _common_times(times: FloatArray, camera: FloatArray) -> FloatArray:
    """``(N,)`` seconds of the first camera's clock at ``times`` of a camera's, ``(11,)`` or ``(N, 11)``."""
    return np.asarray(times * (1 + camera[..., DRIFT]) + camera[..., OFFSET])


def _own_times(common: FloatArray, camera: FloatArray) -> FloatArray:
    return np.asarray((common - camera[..., OFFSET]) / (1 + camera[..., DRIFT]))


def _partners(first: FloatArray, second: FloatArray, tolerance: float) -> IntArray:
    """``(A,)`` number of the path in ``second`` that is the same person, -1 for none."""
    here, there = np.isfinite(first).astype(np.float64), np.isfinite(second).astype(np.float64)
    a, b = np.nan_to_num(first), np.nan_to_num(second)
    count = here @ there.T
    square = (np.abs(a) ** 2) @ there.T + here @ (np.abs(b) ** 2).T - 2 * (a @ b.conj().T).real
    gain = count - square / tolerance**2
    worth = (count >= FEWEST) & (gain > 0)
    rows, columns = scipy.optimize.linear_sum_assignment(np.where(worth, gain, 0.0), maximize=True)
    partner = np.full(len(first), -1)
    real = worth[rows, columns]
    partner[rows[real]] = columns[real]
    return partner


def _rows(
    views: Sequence[PeopleView], cameras: FloatArray, i: int, j: int, partner: IntArray
) -> tuple[IntArray, IntArray]:
    """Rows of one view, evenly thinned to `MOST`, and those of the other after which the same person is there then."""
    first, second = views[i], views[j]
    rows = np.flatnonzero(partner[first.people] >= 0)
    times = _own_times(_common_times(first.times[rows], cameras[i]), cameras[j])
    person = partner[first.people[rows]]
    key = second.people * 1e8 + second.times
    others = np.clip(np.searchsorted(key, person * 1e8 + times, side="right") - 1, 0, len(key) - 2)
    inside = (second.people[others] == person) & (second.people[others + 1] == person)
    inside &= (second.times[others] <= times) & (second.times[others + 1] - second.times[others] < GAP)
    rows, others = rows[inside], others[inside]
    sampled = (
        np.unique(np.linspace(0, len(rows) - 1, MOST).astype(np.int64)) if len(rows) > MOST else np.arange(len(rows))
    )
    return rows[sampled], others[sampled]


@dataclass(frozen=True)
class CrossViewPairs:
    """Boxes of the same people in two cameras each, of all pairs of cameras.

    Attributes:
        first: ``(M,)`` numbers of the first camera.
        second: ``(M,)`` of the second.
        times: ``(M,)`` of the first camera's clock, seconds.
        boxes: ``(M, 4)`` there.
        earlier: ``(M,)`` times of the second camera's box before that.
        others: ``(M, 4)`` that box.
        speed: ``(M, 4)`` pixels a second from there to the next.
        groups: ``(M,)`` people of the first camera, numbered through.
    """

    first: IntArray
    second: IntArray
    times: FloatArray
    boxes: FloatArray
    earlier: FloatArray
    others: FloatArray
    speed: FloatArray
    groups: IntArray

    def apart(self, first: FloatArray, second: FloatArray, height: float) -> FloatArray:
        """``(M,)`` complex metres from the second camera's places to the first's, by ``(M, 11)`` cameras of each."""
        place = on_floor(first, self.boxes, height)
        second_times = _own_times(_common_times(self.times, first), second)
        boxes = self.others + self.speed * (second_times - self.earlier)[:, None]
        return place - on_floor(second, boxes, height)

    def errors(self, cameras: FloatArray, height: float) -> FloatArray:
        """``(C,)`` see `refined`; NaN where a camera shares no person."""
        apart = self.apart(cameras[self.first], cameras[self.second], height)
        both = self.groups * len(cameras) + self.second
        tracks, first, person, counts = np.unique(both, return_index=True, return_inverse=True, return_counts=True)
        sums = [np.bincount(person, part, len(tracks)) for part in (apart.real, apart.imag)]
        away, who = np.hypot(*sums) / counts, (self.first[first], self.second[first])
        of_cameras = [away[(who[0] == k) | (who[1] == k)] for k in range(len(cameras))]
        return np.array([np.median(part) if len(part) else np.nan for part in of_cameras])

    def whitening(self, cameras: FloatArray, noises: FloatArray, height: float) -> FloatArray:
        """``(M, 2, 2)`` that make `apart` independent of deviation `WEIGHT`."""
        spread = np.tile(FOOT**2 * np.eye(2), (len(self.first), 1, 1))
        for numbers, boxes in ((self.first, self.boxes), (self.second, self.others)):
            noise = noises[numbers] * (boxes[:, 3] - boxes[:, 1]) + 1
            here = on_floor(cameras[numbers], boxes, height)
            for edge in ([1, 0, 1, 0], [0, 0, 0, 1]):
                moved = (on_floor(cameras[numbers], boxes + edge, height) - here) * noise
                slope = np.stack([moved.real, moved.imag], axis=1)
                spread += slope[:, :, None] * slope[:, None]
        return np.asarray(WEIGHT * np.linalg.inv(np.linalg.cholesky(spread)))


class BundleAdjustment:
    """What is made least in a round, as a function of the free numbers in units of `SCALE`: people are matched first.

    Args:
        views: of C cameras.
        cameras: ``(C, 11)`` to begin with.
        height: of people on average, metres.
        tolerance: see `_matched`.
        drifting: ``(C,)`` whose clocks may drift.
    """

    def __init__(
        self, views: Sequence[PeopleView], cameras: FloatArray, height: float, tolerance: float, drifting: BoolArray
    ) -> None:
        self.views = [longest(view, MOST_PEOPLE) for view in views]
        self.cameras, self.height = cameras, height
        self.pairs = _matched(views, cameras, height, tolerance)
        free = np.ones(cameras.shape, dtype=np.bool_)
        free[0, 6:] = False
        free[:, DRIFT] &= drifting
        self.free = free.ravel()
        self.noises = np.array([max(noise_of_places(view), 0.01) for view in views])
        self.whitening = self.pairs.whitening(cameras, self.noises, height)

    def moved(self, x: FloatArray) -> FloatArray:
        """``(C, 11)`` cameras."""
        step = np.zeros(self.cameras.size)
        step[self.free] = x
        return np.asarray(self.cameras + step.reshape(self.cameras.shape) * SCALE)

    def _apart(self, first: FloatArray, second: FloatArray) -> FloatArray:
        apart = self.pairs.apart(first, second, self.height)
        errors = np.einsum("nij,nj->ni", self.whitening, np.stack([apart.real, apart.imag], axis=1))
        return np.asarray(errors.ravel())

    def _alone(self, number: int, camera: FloatArray) -> FloatArray:
        """Heights and priors of one camera."""
        view = self.views[number]
        heights = own_deviation(camera, view, self.height, max(self.noises[number], 0.02))
        return np.concatenate([heights, lens_priors(camera, view), [camera[DRIFT] / DRIFTING]])

    def errors(self, x: FloatArray) -> FloatArray:
        """All residuals: places of pairs, then of each camera heights and priors."""
        cameras = self.moved(x)
        alone = [self._alone(k, camera) for k, camera in enumerate(cameras)]
        return np.concatenate([self._apart(cameras[self.pairs.first], cameras[self.pairs.second]), *alone])

    def slopes(self, x: FloatArray) -> FloatArray:
        """Their derivatives, by differences of one number of all cameras at a time."""
        cameras, pairs, width = self.moved(x), self.pairs, len(NUMBERS)
        first, second = cameras[pairs.first], cameras[pairs.second]
        apart, alone = self._apart(first, second), [self._alone(k, camera) for k, camera in enumerate(cameras)]
        edges = len(apart) + np.cumsum([0, *(len(part) for part in alone)])
        slopes, rows = np.zeros((edges[-1], cameras.size)), np.arange(len(apart))
        for k in range(width):
            step = np.zeros(width)
            step[k] = DIFFERENCE * SCALE[k]
            slopes[rows, np.repeat(pairs.first, 2) * width + k] = self._apart(first + step, second) - apart
            slopes[rows, np.repeat(pairs.second, 2) * width + k] = self._apart(first, second + step) - apart
            for c, camera in enumerate(cameras):
                slopes[edges[c] : edges[c + 1], c * width + k] = self._alone(c, camera + step) - alone[c]
        return np.asarray(slopes[:, self.free] / DIFFERENCE)

    def solved(self) -> tuple[FloatArray, FloatArray]:
        """``(C, 11)`` cameras and their standard deviations, 0 where a number is not free."""
        fit = least_robust(self.errors, self.slopes, np.zeros(self.free.sum()), 20, 1e-4)
        # The person that each residual belongs to, -1 for priors.
        begin = np.cumsum([0, *(view.count for view in self.views)])
        groups = [np.repeat(self.pairs.groups, 2)]
        for k, view in enumerate(self.views):
            groups += [begin[k] + view.people, np.full(5, -1)]
        deviations = np.zeros(self.cameras.size)
        units = np.tile(SCALE, len(self.cameras))[self.free]
        deviations[self.free] = np.sqrt(np.diag(fit.covariance(np.concatenate(groups)))) * units
        return self.moved(fit.x), deviations.reshape(self.cameras.shape)
