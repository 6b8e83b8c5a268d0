"""Counting while people are tracked: crossings of lines and people in zones, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tsuiseki.tracking.bounds import as_settings
from tsuiseki.tracking.counts.crossings import line_distances, meets, zone_distances
from tsuiseki.tracking.counts.paths import anchored, counted
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
        distances: ``(K,)`` signed, then.
        along: ``(K,)`` place along each line.
        sides: ``(K,)`` the settled side; 0 where none is yet.
        met: ``(K,)`` how often the way met the line since then, less how often back.
    """

    frame: int
    distances: FloatArray
    along: FloatArray
    sides: IntArray
    met: IntArray


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
        self.counts = {name: dict.fromkeys(directions, 0) for name, directions in self._ways}
        self.occupancy = dict.fromkeys((zone.name for zone in self._scene.zones), 0)

    def update(self, targets: Targets) -> list[Crossing]:
        """Count in the next frame; returns who crossed what in it.

        Args:
            targets: of a frame, as a tracker's ``update`` gives them; those that are lost are passed over.
        """
        targets = targets.select(targets.status != "lost")
        points, heights, _ = anchored(targets.boxes, self._scene, self.settings.anchor)
        here = np.isfinite(points).all(axis=1) & counted(points, self._scene)
        for number in targets.ids[~here].tolist():
            self._people.pop(number, None)
        distances, along = self._places(points)
        for column, zone in enumerate(self._scene.zones, start=self._lines):
            self.occupancy[zone.name] = int((here & (distances[:, column] > 0)).sum())
        crossings = list[Crossing]()
        for row in np.flatnonzero(here).tolist():
            number, band = int(targets.ids[row]), self.settings.band * heights[row]
            crossed = self._step(number, targets.frame, distances[row], along[row], band)
            for column, side in crossed:
                name, directions = self._ways[column]
                direction = directions[0 if side > 0 else 1]
                self.counts[name][direction] += 1
                crossings.append(Crossing(targets.frame, number, name, direction))
        if targets.frame % 100 == 0:
            self._people = {n: k for n, k in self._people.items() if targets.frame - k.frame <= self.patience}
        return crossings

    def _places(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """``(N, K)`` distances from each line and zone, and places along the lines."""
        lines = [line_distances(points, self._scene, line) for line in self._scene.lines]
        borders = [zone_distances(points, zone) for zone in self._scene.zones]
        none = np.zeros(len(points))
        distances = np.column_stack([none, *(distance for distance, _ in lines), *borders])[:, 1:]
        return distances, np.column_stack([none, *(place for _, place in lines), *(none for _ in borders)])[:, 1:]

    def _step(
        self, number: int, frame: int, distances: FloatArray, along: FloatArray, band: float
    ) -> list[tuple[int, int]]:
        """Column and side of what one person crossed."""
        sides = np.where(distances > 0, 1, -1)
        person = self._people.get(number)
        if person is None:
            sides[distances == 0] = 0
            self._people[number] = _Person(frame, distances, along, sides, np.zeros(len(sides), dtype=np.int64))
            return []
        met = person.met + np.where(meets(person.distances, distances, person.along, along), sides, 0)
        settled = np.abs(distances) > band
        changed = settled & (person.sides == -sides)
        changed[: self._lines] &= np.sign(met[: self._lines]) == sides[: self._lines]
        current = np.where(settled, sides, person.sides)
        self._people[number] = _Person(frame, distances, along, current, np.where(settled, 0, met))
        return [(column, int(sides[column])) for column in np.flatnonzero(changed).tolist()]
