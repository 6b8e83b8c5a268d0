"""Who acts in a gathering: each person's state, its steps from frame to frame, and what is remembered of it."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import numpy as np

from tsuiseki.datamodules.scenes.clip import ClipSettings
from tsuiseki.datamodules.scenes.people.activities import ACTIVITIES, STAND, WALK, Activity, Kind, Prop
from tsuiseki.datamodules.scenes.people.gait import stride_length
from tsuiseki.datamodules.scenes.people.person import Person, somebody
from tsuiseki.datamodules.scenes.people.posture import Pose, blend
from tsuiseki.tracking.formats.acting_tracks import CARRYING, PUSHING, RUNNING, SITTING
from tsuiseki.tracking.types import FloatArray

# Seconds from one pose to the next.
CHANGE = 0.45
# Metres that people keep between their middles.
SPACE = 0.8
# Fastest turn of somebody who walks, radians a second.
TURN_RATE = 3.5
# Most seconds on the way to somewhere, after which the errand is given up.
PATIENCE = 9.0
# Metres within which a place is reached.
ARRIVED = 0.12


@dataclass
class PlacedProp:
    """A thing on the ground: a bench, or what can be fetched; ``last`` is the frame it was taken in."""

    prop: Prop
    position: FloatArray
    yaw: float
    first: int = 0
    last: int = 1 << 30


@dataclass
class Errand:
    """What somebody is on the way to: an activity at a place, with a partner or a thing there."""

    activity: Activity
    spot: FloatArray
    heading: float
    deadline: int
    partner: int | None = None
    thing: PlacedProp | None = None


class Performer:
    """A person in the simulation: where it is, what it is doing since and until when, and what it is up to.

    ``states`` has copies of what it was like in every frame.
    """

    def __init__(self, person: Person, position: FloatArray, heading: float) -> None:
        self.person, self.position, self.heading = person, position, heading
        self.activity, self.target = STAND, np.zeros(2)
        self.pose = self.rest = self.before = Pose()
        self.began = self.until = 0
        self.phase, self.pace, self.hand = 0.0, 1.0, 1
        self.errand: Errand | None = None
        self.prop: Prop | None = None
        self.seat: PlacedProp | None = None
        self.states: list[Performer] = []


def facing(angle: float) -> FloatArray:
    """``(2,)`` unit vector at ``angle`` radians from the x axis."""
    return np.array([math.cos(angle), math.sin(angle)])


class Gathering:
    """People who act within an ellipse throughout a clip: ``performers`` with their states, and ``things`` about them.

    Args:
        rng: draws everything.
        clip: its length and frame rate.
        people: how many.
        arena: ``(2, 2)`` centre and half axes of the ellipse, metres.
        obstacles: ``(M, 3)`` x, y and radius of what people walk around, metres.
        look_alikes: probability of being dressed much like somebody else.
    """

    def __init__(
        self, rng: np.random.Generator, clip: ClipSettings, people: int, arena: FloatArray, obstacles: FloatArray,
        look_alikes: float = 0.3,
    ) -> None:  # fmt: skip
        self.rng, self.rate, self.arena, self.obstacles = rng, clip.frame_rate, arena, obstacles
        self.things = [self._put("bench", 0.9) for _ in range(int(rng.integers(1, 3)))]
        self.spent = dict.fromkeys(ACTIVITIES, 0.0)
        self.performers: list[Performer] = []
        for _ in range(people):
            person = somebody(rng, [performer.person for performer in self.performers], look_alikes)
            self.performers.append(Performer(person, self.somewhere(), float(rng.uniform(0, 2 * np.pi))))
        kinds: tuple[Kind, ...] = ("cart", "crate", "suitcase")
        self.things += [self._put(kind) for kind in kinds if rng.random() < 0.5]
        for index in range(people):
            if self.performers[index].until == 0:
                self.choose(index, 0, at_once=True)
        for frame in range(clip.frames):
            self.step(frame)

    def somewhere(self, reach: float = 1.0) -> FloatArray:
        """A place in the arena, an ellipse: ``(2, 2)`` centre and half axes."""
        angle, radius = self.rng.uniform(0, 2 * np.pi), reach * math.sqrt(self.rng.random())
        spot: FloatArray = self.arena[0] + radius * self.arena[1] * np.array([np.cos(angle), np.sin(angle)])
        return spot

    def _put(self, kind: Kind, reach: float = 1.0) -> PlacedProp:
        return PlacedProp(Prop(self.rng, kind), self.somewhere(reach), float(self.rng.uniform(0, 2 * np.pi)))

    def step(self, frame: int) -> None:
        """Let everybody live through one frame and remember it."""
        for index, actor in enumerate(self.performers):
            self.spent[actor.activity] += 1 / self.rate
            if actor.errand is not None:
                self._pursue(index, actor.errand, frame)
            elif frame >= actor.until:
                self.choose(index, frame)
        for actor in self.performers:
            if actor.activity.moving:
                self._move(actor)
            a, seconds = actor, (frame - actor.began) / self.rate
            a.pose = a.activity.pose(a.person, a.rest, seconds, a.phase, a.pace, a.hand, a.prop)
            if a.states and seconds < CHANGE:
                a.pose = blend(a.before, a.pose, 0.5 - 0.5 * math.cos(math.pi * seconds / CHANGE))
            a.states.append(copy.copy(a))

    def choose(self, index: int, frame: int, at_once: bool = False) -> None:
        """The next activity of somebody: what has been rare so far is likelier."""
        rng, actor = self.rng, self.performers[index]
        weights = np.array([a.weight / (0.5 + self.spent[a]) for a in ACTIVITIES])
        for activity in rng.choice(np.array(ACTIVITIES, dtype=object), 6, p=weights / weights.sum()):
            if activity.apart:
                if self._meet(index, activity, frame, at_once):
                    return
            elif activity.fetching and not (at_once or (actor.prop and actor.prop.kind in activity.kinds)):
                if self._fetch(index, activity, frame):
                    return
            elif activity.posture == SITTING and rng.random() < 0.6:
                if self._take_seat(index, activity, frame, at_once):
                    return
            else:
                self.begin(index, activity, frame)
                return
        self.begin(index, WALK, frame)

    def begin(self, index: int, activity: Activity, frame: int, errand: Errand | None = None) -> None:
        """Somebody starts an activity; what it does not need is put down."""
        rng, actor = self.rng, self.performers[index]
        actor.before = actor.pose
        same = actor.activity.fetching and actor.activity.act == activity.act
        if actor.prop and actor.activity.fetching and not same:
            place = actor.position + actor.prop.ahead * facing(actor.heading)
            self.things.append(PlacedProp(actor.prop, place, actor.heading, frame))
        if not same:
            actor.prop = None
            if errand is not None and errand.thing is not None and errand.thing.prop.ahead:
                actor.prop, errand.thing.last = errand.thing.prop, frame
            elif activity.kinds:
                actor.prop = Prop(rng, activity.kinds[int(rng.integers(len(activity.kinds)))])
        if actor.seat is not None and activity.posture != SITTING:
            actor.seat = None
        actor.activity, actor.errand, actor.began = activity, None, frame
        actor.hand = int(rng.integers(2))
        actor.rest = activity.resting_pose(rng, actor.person, actor.seat is not None)
        actor.until = frame + int(rng.uniform(*activity.seconds) * self.rate)
        actor.pace = float(rng.uniform(2.8, 4.0) if activity.posture == RUNNING else rng.normal(1.25, 0.15))
        if activity.act in (PUSHING, CARRYING):
            actor.pace *= 0.85
        actor.target = self.somewhere()

    def _send(
        self, index: int, frame: int, activity: Activity, spot: FloatArray, heading: float, partner: int | None = None,
        thing: PlacedProp | None = None,
    ) -> None:  # fmt: skip
        """Let somebody walk to an activity."""
        self.begin(index, WALK, frame)
        deadline = frame + int(PATIENCE * self.rate)
        self.performers[index].errand = Errand(activity, spot, heading, deadline, partner, thing)

    def _meet(self, index: int, activity: Activity, frame: int, at_once: bool) -> bool:
        """Arrange a meeting with the nearest free person; at once it begins there and then."""
        actor = self.performers[index]
        others = []
        for i, a in enumerate(self.performers):
            busy = a.errand or a.activity.act or a.seat or (a.prop and a.prop.ahead) or activity == a.activity
            if a is not actor and not busy and not (at_once and a.until):
                others.append(i)
        if not others:
            return False
        nearest = min(others, key=lambda i: float(np.linalg.norm(self.performers[i].position - actor.position)))
        partner = self.performers[nearest]
        middle = 0.5 * (actor.position + partner.position) if not at_once else actor.position
        angle = math.atan2(*(partner.position - actor.position)[::-1])
        half = 0.5 * activity.apart * facing(angle)
        places = (index, middle - half, angle, nearest), (nearest, middle + half, angle + math.pi, index)
        for i, spot, heading, with_whom in places:
            if at_once:
                self.performers[i].position, self.performers[i].heading = spot.copy(), heading
            else:
                self._send(i, frame, activity, spot, heading, with_whom)
        if at_once:
            self._begin_together((index, nearest), activity, frame)
        return True

    def _begin_together(self, pair: tuple[int, int], activity: Activity, frame: int) -> None:
        until = frame + int(self.rng.uniform(*activity.seconds) * self.rate)
        for i in pair:
            self.begin(i, activity, frame)
            self.performers[i].until = until

    def _fetch(self, index: int, activity: Activity, frame: int) -> bool:
        """Send somebody to the nearest thing on the ground that the activity needs."""
        actor = self.performers[index]
        reserved = [a.errand.thing for a in self.performers if a.errand is not None]
        there = [t for t in self.things if t.prop.kind in activity.kinds and t.last > frame and t not in reserved]
        if not there:
            return False
        thing = min(there, key=lambda t: float(np.linalg.norm(t.position - actor.position)))
        spot = thing.position - thing.prop.ahead * facing(thing.yaw)
        self._send(index, frame, activity, spot, thing.yaw, thing=thing)
        return True

    def _take_seat(self, index: int, activity: Activity, frame: int, at_once: bool) -> bool:
        """Send somebody to a free place on a bench."""
        actor = self.performers[index]
        for bench in (t for t in self.things if t.prop.kind == "bench"):
            across = np.array([-math.sin(bench.yaw), math.cos(bench.yaw)])
            for side in (-0.42, 0.42):
                spot = bench.position + side * across + 0.02 * facing(bench.yaw)
                claims = [a.errand.spot if a.errand else a.position for a in self.performers if a is not actor]
                if claims and np.linalg.norm(np.array(claims) - spot, axis=1).min() < 0.5:
                    continue
                if at_once:
                    actor.position, actor.heading, actor.seat = spot, bench.yaw, bench
                    self.begin(index, activity, frame)
                    return True
                self._send(index, frame, activity, spot, bench.yaw, thing=bench)
                return True
        return False

    def _pursue(self, index: int, errand: Errand, frame: int) -> None:
        """Go on with an errand: walk there, wait for the partner, begin."""
        actor = self.performers[index]
        partner = None if errand.partner is None else self.performers[errand.partner]
        if frame > errand.deadline or (partner is not None and partner.errand is None):
            self.begin(index, STAND, frame)
            return
        if np.linalg.norm(actor.position - errand.spot) > ARRIVED:
            actor.target = errand.spot
            return
        actor.position, actor.heading = errand.spot.copy(), errand.heading
        if partner is None or errand.partner is None:
            actor.seat = errand.thing if errand.activity.posture == SITTING else None
            self.begin(index, errand.activity, frame, errand)
            return
        assert partner.errand is not None
        if np.linalg.norm(partner.position - partner.errand.spot) <= ARRIVED:
            partner.position, partner.heading = partner.errand.spot.copy(), partner.errand.heading
            self._begin_together((index, errand.partner), errand.activity, frame)
        elif actor.activity.moving:
            self.begin(index, STAND, frame)
            actor.errand = errand

    def _move(self, actor: Performer) -> None:
        """One frame of walking or running towards the target, around others."""
        away = actor.target - actor.position
        if np.linalg.norm(away) < 0.5 and actor.errand is None:
            actor.target = self.somewhere(1.15)
        others = np.array([[*a.position, 0.0] for a in self.performers if a is not actor]).reshape(-1, 3)
        others = np.concatenate([others, self.obstacles])
        distance = float(np.linalg.norm(away))
        desired = away / max(distance, 1e-6)
        if actor.errand is None or distance > 1.5:
            gap = actor.position - others[:, :2]
            far = np.maximum(np.linalg.norm(gap, axis=1) - others[:, 2], 1e-3)
            push = np.clip((SPACE + 0.5 - far) / 0.5, 0, 1)[:, None] * gap / far[:, None]
            desired = desired + 1.6 * push.sum(axis=0)
        heading = math.atan2(desired[1], desired[0])
        turn = (heading - actor.heading + math.pi) % (2 * math.pi) - math.pi
        # Near its aim somebody turns on the spot instead of circling it.
        nimble = 4.0 if actor.errand is not None and distance < 1.0 else 1.0
        limit = nimble * TURN_RATE / self.rate
        actor.heading += float(np.clip(turn, -limit, limit))
        speed = actor.pace * (0.35 + 0.65 * max(math.cos(turn), 0.0))
        if actor.errand is not None:
            speed = min(speed, 0.25 + 1.5 * distance)
        actor.position = actor.position + facing(actor.heading) * min(
            speed / self.rate, distance if actor.errand else 1e6
        )
        stride = stride_length(actor.person.build, actor.person.manner, speed)
        # Strides a second.
        actor.phase += (1.25 + 0.06 * speed if actor.activity.posture == RUNNING else speed / stride) / self.rate
