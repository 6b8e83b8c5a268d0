"""People through several videos at once, each with a tracker of its own, while the videos come.

All that waits goes through the detector together. Ids are apart: those of one camera say nothing of another.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.features.streaming import stream
from tsuiseki.tracking.people.detections import PeopleInputs
from tsuiseki.tracking.people.following import Following
from tsuiseki.tracking.people.opening import OpenedPeople
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, Frame, Targets
from tsuiseki.tracking.types.live import LiveEvent, PeopleInFrame
from tsuiseki.tracking.video.live import SKIPPED
from tsuiseki.tracking.video.several import Arrival, SeveralSources


class FollowedCamera:
    """One camera: what is detected goes in, and the people of earlier frames come out."""

    def __init__(self, opened: OpenedPeople, live: bool) -> None:
        self.inputs = opened.inputs
        longest = max(1, round(SKIPPED * self.inputs.source.frame_rate) - 1) if live else None
        self._following = Following(opened.tracker, opened.inputs.inferred, longest)
        self._coming: deque[tuple[Frame, Detections]] = deque()
        self._ready = self.inputs.in_order(self._pushed(), StageTimes())
        # When the frames came that are not answered yet.
        self._times: deque[float] = deque()

    def _pushed(self) -> Iterator[tuple[Frame, Detections]]:
        while self._coming:
            yield self._coming.popleft()

    def push(self, arrival: Arrival, detections: Detections) -> Iterator[PeopleInFrame]:
        """Take the next frame; the frames that are answered by now."""
        self._coming.append((arrival.frame, detections))
        self._times.append(arrival.time)
        frame, ready = next(self._ready)
        yield from self._events(arrival.camera, self._following.push(frame, ready))

    def rest(self, camera: int) -> Iterator[PeopleInFrame]:
        """The frames that are not answered, as they are where the video ends here."""
        for _ in self._ready:
            pass
        yield from self._events(camera, self._following.rest())

    def _events(self, camera: int, answers: Iterable[tuple[Frame, Targets]]) -> Iterator[PeopleInFrame]:
        for frame, people in answers:
            yield PeopleInFrame(camera, self.inputs.source.name, self._times.popleft(), frame, people)


def together(opened: Sequence[OpenedPeople]) -> list[OpenedPeople]:
    """The same, with one detector and one appearance network for all that would have one of their own."""
    first = opened[0].inputs
    shared = {name: getattr(first, name) for name in ("detect", "describe") if isinstance(first.detect, Detector)}
    return [
        replace(one, inputs=replace(one.inputs, **shared)) if isinstance(one.inputs.detect, Detector) else one
        for one in opened
    ]


def people_in_sources(opened: Sequence[OpenedPeople], sources: SeveralSources) -> Iterator[LiveEvent]:
    """What happens in several videos, see `tsuiseki.tracking.types.live`.

    Args:
        opened: one of each video.
        sources: the same videos, which are read.

    Raises:
        RunError: a camera is given up, or a video breaks off.
    """
    opened = together(opened)
    cameras = [FollowedCamera(one, sources.live) for one in opened]
    for batch in sources.batches():
        arrivals = [event for event in batch if isinstance(event, Arrival)]
        yield from (event for event in batch if not isinstance(event, Arrival))
        found = detected([cameras[arrival.camera].inputs for arrival in arrivals], [a.frame for a in arrivals])
        for arrival, detections in zip(arrivals, found, strict=True):
            yield from cameras[arrival.camera].push(arrival, detections)
    for number, camera in enumerate(cameras):
        yield from camera.rest(number)


def detected(inputs: Sequence[PeopleInputs], frames: Sequence[Frame]) -> list[Detections]:
    """What is detected and described in a frame of each of these; those of one network go through it together."""
    result: list[Detections] = [Detections.empty()] * len(frames)
    groups: dict[int, list[int]] = {}
    for row, one in enumerate(inputs):
        if not one.inferred.at(frames[row].index):
            continue
        groups.setdefault(id(one.detect) if isinstance(one.detect, Detector) else -1 - row, []).append(row)
    for rows in groups.values():
        first = inputs[rows[0]]
        answers = stream([frames[row] for row in rows], first.detect, first.describe, len(rows))
        for row, (_, detections) in zip(rows, answers, strict=True):
            result[row] = detections
    return result
