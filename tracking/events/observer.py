"""Events of a run, live or recorded: what is certain goes in, and events go to their receiver."""

from __future__ import annotations

import itertools
import uuid
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.counts.scene import Scene
from tsuiseki.tracking.counts.settings import PERSON
from tsuiseki.tracking.events.camera_events import CameraEvents
from tsuiseki.tracking.events.delivery import Delivery
from tsuiseki.tracking.events.event import Event, public_name
from tsuiseki.tracking.events.receivers import receiver_of
from tsuiseki.tracking.types import Targets
from tsuiseki.tracking.types.live import CameraOutage, LiveEvent, PeopleInFrame, PeopleOnFloor

# Beside the result, as long as events wait; its dot keeps it out of the result.
SPOOL = ".events.sqlite"
# What events call the camera of people on a floor that several see.
FLOOR = "floor"


class EventMaker:
    """Turns what happens in a run into events.

    Args:
        scene: lines and zones; None for none.
        recorded: the run is of recordings, which do not say when they were.
    """

    def __init__(self, scene: Scene | None = None, recorded: bool = False) -> None:
        self._scene, self._recorded = scene, recorded
        # No two runs share one: 48 random bits.
        run, numbers = uuid.uuid4().hex[:12], itertools.count(1)
        self.new_id: Callable[[], str] = lambda: f"{run}-{next(numbers)}"
        self._cameras: dict[str, CameraEvents] = {}
        self._first: float | None = None

    def events(self, happening: LiveEvent) -> list[Event]:
        """The events that follow from the next frame, moment or outage."""
        time = None if self._recorded else happening.time
        if isinstance(happening, CameraOutage):
            # The seconds of a floor's cameras are those of the floor.
            last = None if self._first is None else max(0.0, happening.time - self._first)
            return self._of(happening.name).outage(happening.seconds, time, last)
        if isinstance(happening, PeopleInFrame):
            return self._of(happening.name).update(happening.people, happening.frame.time, time)
        if self._first is None:
            self._first = happening.time
            self._scene = None if self._scene is None else seen_from_above(self._scene)
        floor = self._cameras.setdefault(FLOOR, CameraEvents(FLOOR, self.new_id, self._scene or PLAN))
        return floor.update(on_plan(happening), happening.time - self._first, time)

    def close(self) -> list[Event]:
        """The events of the end."""
        return [event for camera in self._cameras.values() for event in camera.close()]

    def _of(self, name: str) -> CameraEvents:
        name = public_name(name)
        if name not in self._cameras:
            self._cameras[name] = CameraEvents(name, self.new_id, self._scene)
        return self._cameras[name]


# A floor without lines and zones.
PLAN = Scene(unit="metres", scale=1.0)


def seen_from_above(scene: Scene) -> Scene:
    """A scene in metres whose picture is the floor itself, a metre a pixel; lines keep their directions."""
    floor = scene.on_floor()
    lines = floor.lines
    if floor.right_is < 0:
        lines = [replace(line, directions=(line.directions[1], line.directions[0])) for line in lines]
    return replace(floor, lines=lines, scale=1.0, camera=None)


def on_plan(moment: PeopleOnFloor) -> Targets:
    """People on a floor as targets in its plan: boxes that stand at their places, metres."""
    x, y = moment.places.T
    boxes = np.column_stack([x, y - PERSON, x, y])
    status = np.where(moment.detected.any(axis=1), "tracking", "searching").astype("U9")
    return Targets(moment.moment, moment.ids, boxes, moment.existence, status)


class EventObserver:
    """An observer of a run that sends events.

    Args:
        maker: makes them.
        delivery: sends them.
    """

    def __init__(self, maker: EventMaker, delivery: Delivery) -> None:
        self._maker, self._delivery = maker, delivery

    @classmethod
    def open(
        cls,
        address: str,
        out: Path,
        complain: Callable[[str], object],
        scene: Scene | None = None,
        recorded: bool = False,
    ) -> EventObserver:
        """One that sends to ``address``; events that wait for it lie in the folder ``out``.

        Raises:
            RequestError: see `receiver_of`.
        """
        maker, receiver = EventMaker(scene, recorded), receiver_of(address)
        return cls(maker, Delivery(receiver, out / SPOOL, maker.new_id, complain))

    def __call__(self, happening: LiveEvent) -> None:
        self._delivery.put(self._maker.events(happening))

    def waiting(self) -> int:
        """How many events were not received yet."""
        return len(self._delivery.spool)

    def close(self) -> None:
        """The run ends: the last events go out, for a bounded time."""
        self._delivery.put(self._maker.close())
        self._delivery.close()
