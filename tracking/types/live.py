"""What happens while cameras run: people in a frame or on a floor, cameras that are away, and what each has given.

A live run gives these one by one, in the order in which they are certain. Whoever watches it is an `Observer`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from tsuiseki.tracking.types import BoolArray, FloatArray, Frame, IntArray, ShortRepr, Targets


@dataclass
class CameraState:
    """What one camera has given so far; its counts may be read from any thread.

    Attributes:
        name: for people to read.
        frames: pictures that were used.
        dropped: pictures that came while those before were worked on, and were left out.
        outages: how often it was away.
        away: whether it is away now.
        last: of its last picture, seconds since 1970; 0 before the first.
    """

    name: str
    frames: int = 0
    dropped: int = 0
    outages: int = 0
    away: bool = False
    last: float = 0.0


@dataclass(frozen=True)
class CameraOutage:
    """A camera is away from now on, or back.

    Attributes:
        camera: its number, from 0.
        name: for people to read.
        time: of the last picture before, or of the first after it; seconds since 1970.
        seconds: without a picture, where it is back; None where it is away from now on.
    """

    camera: int
    name: str
    time: float
    seconds: float | None = None


@dataclass(frozen=True, repr=False)
class PeopleInFrame(ShortRepr):
    """The people in a frame of a camera; final.

    Attributes:
        camera: its number, from 0.
        name: of the camera.
        time: at which the frame came, seconds since 1970; of a recording, since its beginning.
        frame: the picture with its number, and its seconds since the beginning.
        people: their ids are never given twice in one result.
    """

    camera: int
    name: str
    time: float
    frame: Frame
    people: Targets


@dataclass(frozen=True, repr=False)
class PeopleOnFloor(ShortRepr):
    """N people on a floor at one moment, through S cameras; final.

    Attributes:
        time: of the moment, seconds since 1970; of recordings, since their beginning.
        moment: its number, from 0.
        ids: ``(N,)``, never given twice in one result.
        places: ``(N, 2)`` metres.
        velocities: ``(N, 2)`` metres a second.
        covariances: ``(N, 4, 4)`` of ``x, vx, y, vy``.
        existence: ``(N,)`` in [0, 1].
        detected: ``(N, S)`` by which cameras.
        frames: of each camera; None where it has none at this moment.
        boxes: of each camera the people in its picture; None likewise.
    """

    time: float
    moment: int
    ids: IntArray
    places: FloatArray
    velocities: FloatArray
    covariances: FloatArray
    existence: FloatArray
    detected: BoolArray
    frames: tuple[Frame | None, ...]
    boxes: tuple[Targets | None, ...]


LiveEvent: TypeAlias = CameraOutage | PeopleInFrame | PeopleOnFloor
# Gets each event in the order of the run, and returns soon: the run waits for it.
Observer: TypeAlias = Callable[[LiveEvent], None]
