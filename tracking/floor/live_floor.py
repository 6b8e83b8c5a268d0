"""People on one floor while the cameras run: frames in, events out, a fixed delay after each moment."""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.cameras.camera_files import CameraOverFloor
from tsuiseki.tracking.cameras.multicamera import StandingPeople
from tsuiseki.tracking.errors import InputWarning
from tsuiseki.tracking.features.exported import Describe, Detect
from tsuiseki.tracking.features.streaming import stream
from tsuiseki.tracking.floor.delayed_floor import DelayedFloor, FloorAnswer
from tsuiseki.tracking.floor.moments import ComingMoments, Together
from tsuiseki.tracking.types import Detections, Frame, ImageArray, IntArray, Targets
from tsuiseki.tracking.types.live import LiveEvent, PeopleOnFloor
from tsuiseki.tracking.video.frame_source import Source
from tsuiseki.tracking.video.several import Arrival, SeveralSources
from tsuiseki.tracking.video.source import check_size

# Share of the delay for which a moment waits for a camera that is late.
HELD = 0.5
# Different pictures that two cameras have in common, from which on they are one.
SAME = 5
# Last pictures of each camera that are compared, several seconds of it.
RECENT = 256
# Every so many pixels two pictures are compared.
SPARSE = 8


@dataclass(frozen=True)
class View:
    """A frame of one camera and who is in it; the time of day at which it came."""

    frame: Frame
    wall: float
    people: StandingPeople


class SameCameras:
    """Finds two names for one camera: pictures of both are equal.

    Streams of one camera run apart and lose different frames, so each picture is compared with the last ones of the
    other. One that does not change says nothing, for two screens may show the same.

    Args:
        names: of the cameras.

    Attributes:
        out: cameras that are left out.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names, self.out = names, set[int]()
        self._recent = [deque[int](maxlen=RECENT) for _ in names]

    def add(self, camera: int, image: ImageArray) -> None:
        """Take the next picture of a camera."""
        sparse = image[::SPARSE, ::SPARSE]
        if camera in self.out or int(sparse.max()) == int(sparse.min()):
            return
        picture = hash(sparse.tobytes())
        self._recent[camera].append(picture)
        for other, theirs in enumerate(self._recent):
            if other == camera or other in self.out or picture not in theirs:
                continue
            if len(set(theirs).intersection(self._recent[camera])) >= SAME:
                first, second = sorted((camera, other))
                self.out.add(second)
                warnings.warn(
                    f"{self.names[second]} gives the pictures of {self.names[first]}: it is left out",
                    InputWarning, stacklevel=2,
                )  # fmt: skip


class FloorLoop:
    """Follows people on a floor through several sources.

    Args:
        placed: the cameras, in the order of the sources.
        sources: that are read.
        videos: the same, opened.
        detect: one of each camera.
        describe: adds features, where given.
        solver: a fresh one.
        tolerance: seconds within which frames count as taken together.
        with_images: whether events have the pictures.
    """

    def __init__(
        self,
        placed: Sequence[CameraOverFloor],
        sources: SeveralSources,
        videos: Sequence[Source],
        detect: Sequence[Detect],
        describe: Describe | None,
        solver: DelayedFloor,
        tolerance: float,
        with_images: bool = False,
    ) -> None:
        self.placed, self.sources, self.videos = placed, sources, videos
        self.detect, self.describe, self.solver, self.with_images = detect, describe, solver, with_images
        hold = HELD * solver.delay if sources.live else np.inf
        self.moments = ComingMoments[View](len(placed), tolerance, hold)
        self.same = SameCameras([source.name for source in videos])
        self._views: dict[int, Together[View]] = {}
        self._count = 0
        self._told_late = set[int]()

    def events(self) -> Iterator[LiveEvent]:
        """What happens, in order; see `tsuiseki.tracking.types.live`.

        Raises:
            RequestError: a recording has not the size of its camera.
            RunError: a camera is given up, or a recording breaks off.
        """
        for batch in self.sources.batches():
            arrivals = [event for event in batch if isinstance(event, Arrival)]
            yield from (event for event in batch if not isinstance(event, Arrival))
            self._take([arrival for arrival in arrivals if self._wanted(arrival)])
            waited_for = self.sources.running - self.sources.away - self.same.out
            now = self.sources.now() if self.sources.live else -np.inf
            for moment in self.moments.ready(waited_for, now):
                yield from self._solved(moment)
        for moment in self.moments.ready((), np.inf):
            yield from self._solved(moment)
        yield from map(self._event, self.solver.rest())

    def _wanted(self, arrival: Arrival) -> bool:
        camera, image = self.placed[arrival.camera].camera, arrival.frame.image
        check_size(self.videos[arrival.camera].name, image, camera.width, camera.height)
        self.same.add(arrival.camera, image)
        return arrival.camera not in self.same.out

    def _take(self, arrivals: Sequence[Arrival]) -> None:
        """Detect in frames that came together; all of one network at once."""
        groups: dict[int, list[int]] = {}
        for row, arrival in enumerate(arrivals):
            groups.setdefault(id(self.detect[arrival.camera]), []).append(row)
        people: list[Detections] = [Detections.empty()] * len(arrivals)
        for rows in groups.values():
            frames, detect = [arrivals[row].frame for row in rows], self.detect[arrivals[rows[0]].camera]
            for row, (_, detections) in zip(rows, stream(frames, detect, self.describe, len(rows)), strict=True):
                people[row] = detections
        for arrival, detections in zip(arrivals, people, strict=True):
            self._add(arrival, StandingPeople.of(detections))

    def _add(self, arrival: Arrival, people: StandingPeople) -> None:
        camera, frame = arrival.camera, arrival.frame
        stamp, placed, source = frame.time, self.placed[camera], self.videos[camera]
        if not self.sources.live:
            stamp = placed.offset + stamp * source.frame_rate / (placed.frame_rate or source.frame_rate)
        wall = arrival.time - frame.time if self.sources.live else 0.0
        if not self.with_images:
            frame = Frame(frame.index, frame.time, frame.image[:1, :1], camera)
        in_time = self.moments.add(camera, stamp, View(frame, wall, people))
        if not in_time and camera not in self._told_late:
            self._told_late.add(camera)
            late = f"{source.name}: a frame came more than {self.moments.hold:g} s after those of the other cameras"
            warnings.warn(f"{late}; such frames are left out", InputWarning, stacklevel=2)

    def _solved(self, moment: Together[View]) -> Iterator[LiveEvent]:
        self._views[self._count] = moment
        self._count += 1
        people = [None if view is None else view.people for view in moment.views]
        yield from map(self._event, self.solver.add(moment.time, people))

    def _event(self, answer: FloorAnswer) -> PeopleOnFloor:
        moment = self._views.pop(answer.moment.number)
        wall = next(view.wall for view in moment.views if view is not None)
        boxes = [
            None if view is None else _in_picture(view, names)
            for view, names in zip(moment.views, answer.moment.names, strict=True)
        ]
        frames = tuple(None if view is None else view.frame for view in moment.views)
        return PeopleOnFloor(
            moment.time + wall, answer.moment.number, answer.ids, answer.places, answer.velocities,
            answer.covariances, answer.existence, answer.detected, frames, tuple(boxes),
        )  # fmt: skip


def _in_picture(view: View, names: IntArray) -> Targets:
    """The people whose detections are in a picture."""
    rows = np.flatnonzero(names > 0)
    detections = view.people.detections
    origin = np.column_stack([rows, np.full(len(rows), -1)])
    scores = np.nan_to_num(detections.scores[rows])
    return Targets(
        view.frame.index, names[rows], detections.boxes[rows], scores, np.full(len(rows), "tracking"), origin
    )
