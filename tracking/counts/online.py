"""Counting while people are tracked: crossings of lines and people in zones, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tsuiseki.tracking.bounds import as_settings
from tsuiseki.tracking.counts.borders import was_inside, zone_bands, zone_distances
from tsuiseki.tracking.counts.continued import matched, nearness
from tsuiseki.tracking.counts.crossings import line_distances, meets
from tsuiseki.tracking.counts.paths import anchored, counted
from tsuiseki.tracking.counts.polygons import border_meetings
from tsuiseki.tracking.counts.scene import Scene, read_scene
from tsuiseki.tracking.counts.settings import CountSettings
from tsuiseki.tracking.types import FloatArray, IntArray, Targets


@dataclass(frozen=True)
class Crossing:
    """Somebody crossed a line, or entered or left a zone.

    Attributes:
        frame: 0-based, in which the new side was settled.
        id: whose.
        name: of the line or zone.
        direction: of the line; ``entered`` or ``left`` of a zone.
    """

    frame: int
    id: int
    name: str
    direction: str


@dataclass
class _Person:
    """Where a person was last, and how they stand to each line and zone.

    Attributes:
        frame: when they were there last.
        box: ``(4,)`` then.
        step: ``(4,)`` by how much the box moved in a frame, then.
        point: ``(2,)`` in the unit of the scene, then.
        distances: ``(K,)`` signed, then.
        along: ``(K,)`` place along each line.
        sides: ``(K,)`` the settled side; 0 where none is yet.
        met: ``(K,)`` how often the way met the line since then, less how often back.
        entries: ``(2,)`` where they came last into each zone, by column.
    """

    frame: int
    box: FloatArray
    step: FloatArray
    point: FloatArray
    distances: FloatArray
    along: FloatArray
    sides: IntArray
    met: IntArray
    entries: dict[int, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True)
class _Places:
    """Where people are in a frame.

    Attributes:
        points: ``(N, 2)`` in the unit of the scene.
        heights: ``(N,)`` of the people, in the unit of the scene.
        distances: ``(N, K)`` signed, from each line and zone.
        along: ``(N, K)`` places along the lines.
        bands: ``(N, K)`` distances from which on a side is settled.
    """

    points: FloatArray
    heights: FloatArray
    distances: FloatArray
    along: FloatArray
    bands: FloatArray


@dataclass
class Counter:
    """Counts people as they come, by the rules of `count`.

    A crossing is reported once its new side is settled. A path that ends within the band of a line is not yet settled,
    so that the last crossings of a video may be missing here.

        counter = tsuiseki.Counter("scene.yaml")
        for frame, people in tsuiseki.follow_people(0, method="sort"):
            for crossing in counter.update(people):
                print(crossing.name, crossing.direction, counter.counts)

    Attributes:
        scene: lines and zones, or the file that has them, see `read_scene`.
        settings: how people are counted.
        patience: frames after which somebody who is gone is forgotten.
        counts: crossings so far by name and direction.
        occupancy: people in each zone in the last frame.
        renumbered: who goes on under a new id from the last frame on: the earlier id by the new one.

    Raises:
        RequestError: the scene is wrong, or an anchor does not fit it.
    """

    scene: Scene | str | Path
    settings: CountSettings = field(default_factory=CountSettings)
    patience: int = 1000

    def __post_init__(self) -> None:
        as_settings(self.settings, CountSettings)
        scene = self.scene if isinstance(self.scene, Scene) else read_scene(self.scene)
        self._scene = scene.on_floor() if self.settings.anchor == "floor" else scene
        anchored(np.empty((0, 4)), self._scene, self.settings.anchor)
        self._people: dict[int, _Person] = {}
        ways = [(line.name, line.directions) for line in self._scene.lines]
        self._ways = [*ways, *((zone.name, ("entered", "left")) for zone in self._scene.zones)]
        self._lines = len(ways)
        self._zones = [*enumerate(self._scene.zones, start=self._lines)]
        self.counts = {name: dict.fromkeys(directions, 0) for name, directions in self._ways}
        self.occupancy = dict.fromkeys((zone.name for zone in self._scene.zones), 0)
        self.renumbered: dict[int, int] = {}
        self._frame = -1

    def update(self, targets: Targets) -> list[Crossing]:
        """Count in the next frame; returns who crossed what in it.

        Args:
            targets: of a frame, as a tracker's ``update`` gives them; those that are lost are passed over.
        """
        targets = targets.select(targets.status != "lost")
        self._frame = targets.frame
        points, heights, _ = anchored(targets.boxes, self._scene, self.settings.anchor)
        here = np.isfinite(points).all(axis=1) & counted(points, self._scene)
        for number in targets.ids[~here].tolist():
            self._people.pop(number, None)
        places = self._places(points, heights)
        for column, zone in self._zones:
            self.occupancy[zone.name] = int((here & (places.distances[:, column] > 0)).sum())
        targets, places = targets.select(here), _Places(*(values[here] for values in vars(places).values()))
        self._go_on(targets)
        inside = self._been_inside(targets, places)
        crossings = list[Crossing]()
        for row, number in enumerate(targets.ids.tolist()):
            for column, side in self._step(number, row, targets, places, inside.get(row, ())):
                name, directions = self._ways[column]
                direction = directions[0 if side > 0 else 1]
                self.counts[name][direction] += 1
                crossings.append(Crossing(targets.frame, number, name, direction))
        if targets.frame % 100 == 0:
            self._people = {n: k for n, k in self._people.items() if targets.frame - k.frame <= self.patience}
        return crossings

    def inside(self) -> dict[str, list[int]]:
        """Who was in each zone in the last frame: the ids, by the sides that count for entering and leaving."""
        present = [(number, person) for number, person in self._people.items() if person.frame == self._frame]
        return {zone.name: [n for n, person in present if person.sides[column] > 0] for column, zone in self._zones}

    def _places(self, points: FloatArray, heights: FloatArray) -> _Places:
        """How people at ``(N, 2)`` points stand to each line and zone."""
        lines = [line_distances(points, self._scene, line) for line in self._scene.lines]
        borders = [zone_distances(points, zone) for _, zone in self._zones]
        none, band = np.zeros(len(points)), self.settings.band * heights
        bands = [zone_bands(points, d, zone, band) for d, (_, zone) in zip(borders, self._zones, strict=True)]
        distances = [*(distance for distance, _ in lines), *borders]
        along = [*(place for _, place in lines), *(none for _ in borders)]
        return _Places(
            points,
            heights,
            *(
                np.column_stack([none, *columns])[:, 1:]
                for columns in (distances, along, [*(band for _ in lines), *bands])
            ),
        )

    def _go_on(self, targets: Targets) -> None:
        """Give the people who vanished in the last frame to the new ids at their places."""
        present = set(targets.ids.tolist())
        new = [row for row, number in enumerate(targets.ids.tolist()) if number not in self._people]
        gone = [n for n, k in self._people.items() if k.frame == targets.frame - 1 and n not in present] if new else []
        self.renumbered = {}
        if gone:
            lasts, steps = (np.array([getattr(self._people[n], name) for n in gone]) for name in ("box", "step"))
            for earlier, later in matched(nearness(lasts, steps, targets.boxes[new])):
                number = int(targets.ids[new[later]])
                self._people[number], self.renumbered[number] = self._people.pop(gone[earlier]), gone[earlier]

    def _been_inside(self, targets: Targets, places: _Places) -> dict[int, list[int]]:
        """By row the columns of zones that people left in this frame, after they were inside beyond the band."""
        inside = dict[int, list[int]]()
        rows = [row for row, number in enumerate(targets.ids.tolist()) if number in self._people]
        people = [self._people[int(targets.ids[row])] for row in rows]
        if not rows:
            return inside
        starts, ends = np.array([person.point for person in people]), places.points[rows]
        for column, zone in self._zones:
            for way, share, inward in zip(*border_meetings(starts, ends, zone.corners), strict=True):
                point, row = starts[way] + share * (ends[way] - starts[way]), rows[way]
                entry = people[way].entries.pop(column, None)
                if inward:
                    people[way].entries[column] = point
                elif entry is not None:
                    band = np.array([self.settings.band * places.heights[row]])
                    if was_inside(entry[None], point[None], zone, band).all():
                        inside.setdefault(row, []).append(column)
        return inside

    def _step(
        self, number: int, row: int, targets: Targets, places: _Places, inside: Sequence[int]
    ) -> list[tuple[int, int]]:
        """Column and side of what the person of a row crossed; they passed through zones ``inside`` between frames."""
        distances, along = places.distances[row], places.along[row]
        sides, box = np.where(distances > 0, 1, -1), targets.boxes[row]
        person = self._people.get(number)
        if person is None:
            sides[distances == 0] = 0
            start = (np.zeros(4), places.points[row], distances, along, sides, np.zeros(len(sides), dtype=np.int64))
            self._people[number] = _Person(targets.frame, box, *start)
            return []
        entered = [column for column in inside if person.sides[column] < 0]
        person.sides[list(inside)] = 1
        met = person.met + np.where(meets(person.distances, distances, person.along, along), sides, 0)
        settled = np.abs(distances) > places.bands[row]
        changed = settled & (person.sides == -sides)
        changed[: self._lines] &= np.sign(met[: self._lines]) == sides[: self._lines]
        current = np.where(settled, sides, person.sides)
        step = (box - person.box) / max(targets.frame - person.frame, 1)
        place = (step, places.points[row], distances, along, current, np.where(settled, 0, met), person.entries)
        self._people[number] = _Person(targets.frame, box, *place)
        return [
            *((column, 1) for column in entered),
            *((column, int(sides[column])) for column in np.flatnonzero(changed).tolist()),
        ]
