"""People on one floor a fixed time after each moment: the flow of `floor.tracker` over a window, and final answers.

When a moment has to be answered, all moments from `CONTEXT` seconds before it to the newest are solved together, and
the next few are settled with it, since one solution serves them all. What is settled is whose each detection is: it
goes into the next window as a certain name, which the flow keeps (`tracker._by_name`). So an id that was answered
stays, and nothing is asked of the future beyond the delay. What is kept is the window alone.

Somebody whom no camera sees for longer than the window gets the same id where the appearance says so: those who left
are remembered for `MEMORY` seconds by their mean feature, and who is new is compared with them, by the assignment of
the greatest sum over `LIKENESS`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from tsuiseki.tracking.cameras.camera_files import CameraOverFloor
from tsuiseki.tracking.cameras.multicamera import StandingPeople
from tsuiseki.tracking.floor.measured_floor import MeasuredFloor, SensorRates, measured_moments
from tsuiseki.tracking.floor.tracker import WINDOW, SolvedPeople, solved_people
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, ShortRepr
from tsuiseki.tracking.types.measurements import PersonOnFloor

# Seconds before the moment to answer that are solved again: a link's reach, and the run-up of its velocity.
CONTEXT = WINDOW + 1.0
# Decisions in one delay, as of `people.delayed_flow`.
DECISIONS = 4
# Seconds for which the appearance of somebody who left is remembered.
MEMORY = 60.0
# Cosine of two mean features from which on two tracks are one person, where no place says otherwise.
LIKENESS = 0.75
# By how much the best of several who are alike must be better.
BETTER = 0.05
# Speed of somebody who is not seen at most, m/s.
FASTEST = 3.0


def people_later(measured: MeasuredFloor, delay: float) -> list[PersonOnFloor]:
    """Everybody on the floor, each moment answered ``delay`` seconds after it, as while the cameras run."""
    solver = DelayedFloor([feed.placed for feed in measured.feeds], measured.floor, delay)
    answers = list[FloorAnswer]()
    for moment in measured.moments:
        frames = zip(measured.feeds, moment.frames, strict=True)
        answers += solver.add(moment.time, [None if n is None else feed.people[n] for feed, n in frames])
    answers += solver.rest()
    ids = np.concatenate([np.empty(0, np.int64), *(answer.ids for answer in answers)])
    scans = np.repeat([answer.moment.number for answer in answers], [len(answer.ids) for answer in answers])
    columns = [
        np.concatenate([getattr(answer, name) for answer in answers])
        for name in ("places", "velocities", "covariances", "existence", "detected")
    ]
    people = []
    for number in np.unique(ids).tolist():
        rows = np.flatnonzero(ids == number)
        places, velocities, covariances, existence, detected = (column[rows] for column in columns)
        at, none = scans[rows], np.empty((len(rows), 0))
        people.append(
            PersonOnFloor(number, at, measured.times[at], places, velocities, covariances, existence, none, detected)
        )
    return people


@dataclass(frozen=True, repr=False)
class FloorMoment(ShortRepr):
    """What cameras detect at one moment, and later whose it is.

    Attributes:
        number: from 0.
        time: seconds.
        people: of each camera; None of one that has no frame.
        names: of each camera the ids of its detections; -1 where not settled, or nobody's.
    """

    number: int
    time: float
    people: Sequence[StandingPeople | None]
    names: list[IntArray]


@dataclass(frozen=True, repr=False)
class FloorAnswer(ShortRepr):
    """N people at one moment; see `types.live.PeopleOnFloor`.

    Attributes:
        moment: with the ids of its detections.
        ids: ``(N,)``.
        places: ``(N, 2)``.
        velocities: ``(N, 2)``.
        covariances: ``(N, 4, 4)``.
        existence: ``(N,)``.
        detected: ``(N, S)``.
    """

    moment: FloorMoment
    ids: IntArray
    places: FloatArray
    velocities: FloatArray
    covariances: FloatArray
    existence: FloatArray
    detected: BoolArray


@dataclass
class Remembered:
    """Somebody who was on the floor: when and where last, and the mean of their features."""

    time: float
    place: FloatArray
    sum: FloatArray = field(default_factory=lambda: np.empty(0))

    def cosine(self, feature: FloatArray) -> float:
        length = float(np.linalg.norm(self.sum) * np.linalg.norm(feature)) if self.sum.shape == feature.shape else 0.0
        return float(self.sum @ feature) / length if length > 0 else -1.0


class DelayedFloor:
    """Answers every moment a fixed time later.

    Args:
        placed: S cameras.
        floor: ``(4,)`` of the plan, metres.
        delay: seconds.
        ids: the highest id of an earlier run.
    """

    def __init__(self, placed: Sequence[CameraOverFloor], floor: FloatArray, delay: float, ids: int = 0) -> None:
        self.placed, self.floor, self.delay, self.ids = placed, floor, delay, ids
        self._window: deque[FloorMoment] = deque()
        self._answers: deque[FloorAnswer] = deque()
        self._rates: SensorRates | None = None
        self._count = self._decided = 0
        self._memory: dict[int, Remembered] = {}

    def add(self, time: float, people: Sequence[StandingPeople | None]) -> Iterator[FloorAnswer]:
        """Take the next moment, later than those before; the moments that are answered by now."""
        names = [np.full(0 if standing is None else len(standing), -1) for standing in people]
        self._window.append(FloorMoment(self._count, time, people, names))
        self._count += 1
        while self._answers or self._decided < self._count:
            due = self._answers[0].moment if self._answers else self._window[self._decided - self._window[0].number]
            if time - due.time < self.delay:
                return
            if not self._answers:
                self._decide(due.time + self.delay / DECISIONS)
            yield self._answers.popleft()

    def rest(self) -> Iterator[FloorAnswer]:
        """The moments that are not answered, as they are where the videos end here."""
        if self._decided < self._count:
            self._decide(np.inf)
        yield from self._answers
        self._answers.clear()

    def _decide(self, end: float) -> None:
        """Solve the window, and settle its moments up to the time ``end``, the first that is open at least."""
        window = list(self._window)
        open_ = [moment for moment in window if moment.number >= self._decided]
        settled = [moment for moment in open_ if moment.time <= end or moment is open_[0]]
        measured = self._measured(window)
        solved = solved_people(measured, self._rates, self.ids + 1, goes_on=end < np.inf)
        self._rates = solved.rates
        first = window[0].number
        solved = self._named(measured, solved, settled[-1].number - first)
        self._settle(measured, solved, first, settled)
        self._answers.extend(self._answer(solved, moment, moment.number - first) for moment in settled)
        self._decided = settled[-1].number + 1
        while self._window[0].number < self._decided and self._window[0].time < settled[-1].time - CONTEXT:
            self._window.popleft()
        self._forget(settled[-1].time)

    def _measured(self, window: Sequence[FloorMoment]) -> MeasuredFloor:
        """The window on the floor; whose detections are settled is certain."""
        measured = measured_moments(self.placed, [m.time for m in window], [m.people for m in window], self.floor)
        points = measured.points
        names = np.full(len(points), -1)
        for row, (moment, sensor, place) in enumerate(
            zip(points.moment.tolist(), points.sensor.tolist(), points.row.tolist(), strict=True)
        ):
            names[row] = window[moment].names[sensor][place]
        return replace(measured, points=replace(points, names=names))

    def _named(self, measured: MeasuredFloor, solved: SolvedPeople, last: int) -> SolvedPeople:
        """Ids for those who are there up to the moment ``last`` of the window and have none: old ones, or the next."""
        before = self.ids
        new = [person for person in solved.people if person.id > before and person.scans[0] <= last]
        features = [self._feature(measured, np.flatnonzero(solved.owner == person.id)) for person in new]
        last_times = {person.id: float(person.times[-1]) for person in solved.people if person.id <= before}
        ids = self._again(new, features, last_times)
        for person in new:
            if person.id not in ids:
                self.ids += 1
                ids[person.id] = self.ids
        people = [replace(p, id=ids.get(p.id, p.id)) for p in solved.people if p.id <= before or p.id in ids]
        owner = np.where(solved.owner <= before, solved.owner, 0)
        for temporary, number in ids.items():
            owner[solved.owner == temporary] = number
        return replace(solved, people=people, owner=owner)

    def _again(
        self, new: Sequence[PersonOnFloor], features: Sequence[FloatArray], last_times: Mapping[int, float]
    ) -> dict[int, int]:
        """Of those who are new the ids that they had before, by what they look like and how far they can have gone.

        Whom a link of the flow can reach it has judged itself.
        """
        away = [*self._memory]
        likeness = np.full((len(new), len(away)), -1.0)
        for row, (person, feature) in enumerate(zip(new, features, strict=True)):
            for column, number in enumerate(away):
                memory = self._memory[number]
                seconds = float(person.times[0]) - last_times.get(number, memory.time)
                near = float(np.linalg.norm(person.positions[0] - memory.place)) <= FASTEST * seconds + 1.0
                likeness[row, column] = memory.cosine(feature) if seconds > WINDOW and near else -1.0
        rows, columns = linear_sum_assignment(likeness, maximize=True)
        return {
            new[row].id: away[column]
            for row, column in zip(rows.tolist(), columns.tolist(), strict=True)
            if likeness[row, column] >= LIKENESS
            and likeness[row, column] >= max([-1.0, *np.delete(likeness[row], column)]) + BETTER
        }

    def _feature(self, measured: MeasuredFloor, rows: IntArray) -> FloatArray:
        features = measured.points.features
        return np.empty(0) if features is None else np.asarray(features[rows].sum(axis=0))

    def _settle(
        self, measured: MeasuredFloor, solved: SolvedPeople, first: int, settled: Sequence[FloorMoment]
    ) -> None:
        points = measured.points
        low, high = settled[0].number - first, settled[-1].number - first
        rows = np.flatnonzero((points.moment >= low) & (points.moment <= high) & (solved.owner > 0))
        for row in rows.tolist():
            moment = self._window[int(points.moment[row])]
            moment.names[int(points.sensor[row])][int(points.row[row])] = solved.owner[row]
        for person in solved.people:
            inside = np.flatnonzero((person.scans >= low) & (person.scans <= high))
            if len(inside):
                ours = rows[solved.owner[rows] == person.id]
                memory = self._memory.setdefault(person.id, Remembered(0.0, person.positions[0]))
                memory.time, memory.place = float(person.times[inside[-1]]), person.positions[inside[-1]]
                added = self._feature(measured, ours)
                memory.sum = added if memory.sum.shape != added.shape else memory.sum + added

    def _forget(self, time: float) -> None:
        self._memory = {number: who for number, who in self._memory.items() if who.time >= time - MEMORY}

    def _answer(self, solved: SolvedPeople, moment: FloorMoment, number: int) -> FloorAnswer:
        """The people at one moment of the window, by id."""
        there = [(p, int(np.searchsorted(p.scans, number))) for p in sorted(solved.people, key=lambda p: p.id)]
        there = [(person, row) for person, row in there if row < len(person) and person.scans[row] == number]
        columns = ("positions", "velocities", "covariances", "existence", "detected")
        shapes = ((2,), (2,), (4, 4), (), (len(self.placed),))
        values = [
            np.array([getattr(person, name)[row] for person, row in there]).reshape(len(there), *shape)
            for name, shape in zip(columns, shapes, strict=True)
        ]
        ids = np.array([person.id for person, _ in there], dtype=np.int64)
        places, velocities, covariances, existence, detected = values
        return FloorAnswer(moment, ids, places, velocities, covariances, existence, detected.astype(np.bool_))
