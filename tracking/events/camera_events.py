"""The events of one camera: what its people do from frame to frame.

People come frame by frame as a tracker answers them. With a delay an answer is final. What turns out to be wrong all
the same is corrected by an event of its own, which names the earlier one: somebody who was lost comes back, or goes on
under another id. Lines and zones are crossed by the rules of `Counter`, so that events and `tsuiseki count` agree.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tsuiseki.tracking.counts.online import Counter
from tsuiseki.tracking.counts.paths import anchored, counted
from tsuiseki.tracking.counts.scene import Scene
from tsuiseki.tracking.events.event import Event, EventType
from tsuiseki.tracking.geometry import shared_with_all
from tsuiseki.tracking.types import FloatArray, Targets

# Seconds without a box after which a person is lost: as long as most gaps that a tracker fills.
LOST_AFTER = 1.0
# Seconds for which somebody who is lost is known again by the id: longer than any tracker here keeps an id.
REMEMBERED = 60.0
# Share of the height by which somebody has to move for an event; a box jitters by less.
STIRS = 0.1
# Seconds for which somebody who comes up on the boxes of others may be nobody.
NEW = 0.5
# Share of a box that others cover from which it lies on them.
ON_OTHERS = 0.8
# Seconds by which times are rounded.
INSTANT = 1e-6


@dataclass
class _Presence:
    """Somebody who is there, or was there shortly before.

    Attributes:
        appeared: id of the event that said so.
        about: what an event says of the person, of the last frame.
        since: time of the first frame.
        seconds: time of the last frame.
        reported: time of the last event that said where the person is.
        place: ``(2,)`` of that event, in the unit of the scene.
        lost: id of the event that said that the person is lost; empty while present.
        zones: by name when the person came in.
        stayed: zones of which an event said that the person stays.
    """

    appeared: str
    about: dict[str, Any]
    since: float
    seconds: float
    reported: float
    place: FloatArray
    lost: str = ""
    zones: dict[str, float] = field(default_factory=dict)
    stayed: set[str] = field(default_factory=set)


@dataclass
class _Interval:
    """Counts of an interval: its first second, frames, people summed, most at a time, crossings, people in zones."""

    start: float
    frames: int = 0
    people: int = 0
    most: int = 0
    crossings: dict[str, dict[str, int]] = field(default_factory=dict)
    zones: dict[str, int] = field(default_factory=dict)


class CameraEvents:
    """Turns the people of each frame into events.

    Args:
        camera: its name.
        new_id: gives the id of the next event.
        scene: lines and zones, and how often events come; by default none, and the usual intervals.
    """

    def __init__(self, camera: str, new_id: Callable[[], str], scene: Scene | None = None) -> None:
        self.camera, self._new_id = camera, new_id
        self._scene = scene or Scene()
        self._counter = Counter(self._scene)
        self._stays = {zone.name: zone.stay for zone in self._scene.zones if zone.stay is not None}
        self._people: dict[int, _Presence] = {}
        self._interval: _Interval | None = None
        self._events: list[Event] = []
        self._seconds, self._time = 0.0, None  # type: float, float | None

    def update(self, people: Targets, seconds: float, time: float | None = None) -> list[Event]:
        """The events of the next frame.

        Args:
            people: of the frame; those that are lost are passed over.
            seconds: of the frame, since the first one.
            time: of the frame, seconds since 1970; None where that is not known.
        """
        self._events, self._seconds, self._time = [], seconds, time
        crossings = self._counter.update(people)
        people = people.select(people.status != "lost")
        places, heights, metres = anchored(people.boxes, self._scene)
        here = np.isfinite(places).all(axis=1) & counted(places, self._scene)
        self._begin_interval()
        self._renumber()
        doubtful = np.array([self._is_new(number) for number in people.ids.tolist()], dtype=np.bool_)
        if doubtful.any():
            others = ~np.eye(len(people), dtype=np.bool_)
            doubtful &= shared_with_all(people.boxes, people.boxes, others) >= ON_OTHERS
        for row in np.flatnonzero(here).tolist():
            about = _about(people, row, metres, bool(doubtful[row]))
            self._see(int(people.ids[row]), about, places[row], float(heights[row]))
        for crossing in crossings:
            self._cross(crossing.id, crossing.name, crossing.direction)
        self._watch_stays()
        self._lose()
        self._add_to_interval(int(here.sum()))
        return self._events

    def outage(self, seconds: float | None, time: float | None = None, last: float | None = None) -> list[Event]:
        """The camera is away from now on, or is back after so many seconds; ``last``: of its last frame, see `update`.

        By default that is the last frame of which there were people.
        """
        self._events, self._time = [], time
        if seconds is None:
            self._tell("camera_lost", {"seconds": round(self._seconds if last is None else last, 3)})
        else:
            self._tell("camera_back", {"gap": round(seconds, 3)})
        return self._events

    def close(self) -> list[Event]:
        """The events of the end: the counts of the interval that was not over."""
        self._events = []
        if self._interval is not None and self._interval.frames:
            self._count(self._seconds)
        self._interval = None
        return self._events

    def _tell(self, kind: EventType, data: Mapping[str, Any]) -> str:
        event = Event(self._new_id(), self.camera, kind, data, self._time)
        self._events.append(event)
        return event.id

    def _renumber(self) -> None:
        """Correct the ids of people who go on under another one."""
        for number, earlier in self._counter.renumbered.items():
            if (person := self._people.pop(earlier, None)) is not None:
                self._people[number] = person
                self._tell("correction", {"corrects": person.appeared, "person": number, "was": earlier})

    def _is_new(self, number: int) -> bool:
        """Whether somebody came less than `NEW` seconds ago, after the first frame."""
        person = self._people.get(number)
        return self._seconds > 0 and (person is None or 0 < person.since > self._seconds - NEW)

    def _see(self, number: int, about: dict[str, Any], place: FloatArray, height: float) -> None:
        """A person is there."""
        about = {"frame": about.pop("frame"), "seconds": round(self._seconds, 3), "person": number, **about}
        person = self._people.get(number)
        if person is None:
            appeared = self._tell("appeared", about)
            self._people[number] = _Presence(appeared, about, self._seconds, self._seconds, self._seconds, place)
            return
        if person.lost:
            self._tell("correction", {"corrects": person.lost, "person": number, "withdrawn": True})
        person.lost, person.about, person.seconds = "", about, self._seconds
        late = self._seconds - person.reported >= self._scene.events.moves - INSTANT
        if late and np.hypot(*(place - person.place)) >= STIRS * height:
            self._tell("moved", about)
            person.reported, person.place = self._seconds, place

    def _cross(self, number: int, name: str, direction: str) -> None:
        """A person crossed a line, or entered or left a zone."""
        if self._interval is not None:
            ways = self._interval.crossings.setdefault(name, {})
            ways[direction] = ways.get(direction, 0) + 1
        about = self._people[number].about
        if name not in self._counter.occupancy:
            self._tell("crossed", {**about, "line": name, "direction": direction})
        elif direction == "entered":
            self._tell("entered", {**about, "zone": name})
        else:
            self._tell("left", {**about, "zone": name})

    def _watch_stays(self) -> None:
        """Say who has been in a zone for as long as it asks for."""
        for name, ids in self._counter.inside().items() if self._stays else ():
            for number, person in self._people.items():
                if number not in ids and not person.lost and person.seconds == self._seconds:
                    person.zones.pop(name, None)
                    person.stayed.discard(name)
            for number in ids if name in self._stays else ():
                person = self._people[number]
                stay = self._seconds - person.zones.setdefault(name, self._seconds)
                if stay >= self._stays[name] - INSTANT and name not in person.stayed:
                    person.stayed.add(name)
                    self._tell("stayed", {**person.about, "zone": name, "stay": round(stay, 3)})

    def _lose(self) -> None:
        """Say who is gone, and forget who has been gone for long."""
        for number, person in [*self._people.items()]:
            gone = self._seconds - person.seconds
            if gone > LOST_AFTER and not person.lost:
                person.lost = self._tell("lost", person.about)
            elif gone > REMEMBERED:
                del self._people[number]

    def _begin_interval(self) -> None:
        """Close the interval that is over; those without a frame are left out."""
        length, interval = self._scene.events.counts, self._interval
        if interval is not None and self._seconds < interval.start + length - INSTANT:
            return
        if interval is not None:
            self._count(interval.start + length)
        self._interval = _Interval(np.floor((self._seconds + INSTANT) / length) * length)

    def _add_to_interval(self, people: int) -> None:
        interval = self._interval
        assert interval is not None
        interval.frames, interval.people = interval.frames + 1, interval.people + people
        interval.most = max(interval.most, people)
        for name, count in self._counter.occupancy.items():
            interval.zones[name] = interval.zones.get(name, 0) + count

    def _count(self, end: float) -> None:
        interval = self._interval
        assert interval is not None
        frames, counts = interval.frames, interval.crossings
        self._tell(
            "counted",
            {
                "start": round(float(interval.start), 3),
                "end": round(float(end), 3),
                "frames": frames,
                "people": round(interval.people / frames, 3),
                "most": interval.most,
                "lines": {
                    line.name: {way: counts.get(line.name, {}).get(way, 0) for way in line.directions}
                    for line in self._scene.lines
                },
                "zones": {
                    name: {way: counts.get(name, {}).get(way, 0) for way in ("entered", "left")}
                    | {"people": round(total / frames, 3)}
                    for name, total in interval.zones.items()
                },
            },
        )


def _about(people: Targets, row: int, metres: FloatArray | None, doubtful: bool) -> dict[str, Any]:
    """What an event says of a person in a frame, beside the id and the time; observed goes without saying."""
    about: dict[str, Any] = {"frame": people.frame + 1, "box": people.boxes[row].round(1).tolist()}
    if name := people.names.get(int(people.classes[row]), ""):
        about["class"] = name
    if metres is not None and np.isfinite(metres[row]).all():
        about["metres"] = metres[row].round(3).tolist()
    if doubtful or people.status[row] != "tracking":
        about["support"] = "doubtful" if doubtful else "filled"
    return about
