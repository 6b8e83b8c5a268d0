"""Each frame with the people in it, as late as a tracker answers."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.people.by_class import ByClass
from tsuiseki.tracking.people.contract import PeopleTracker, skipped
from tsuiseki.tracking.people.detections import PeopleInputs
from tsuiseki.tracking.people.motion_compensated import inner_tracker
from tsuiseki.tracking.people.opening import OpenedPeople
from tsuiseki.tracking.types import Detections, Frame, Targets
from tsuiseki.tracking.types.inference_frames import ALL_INFERRED, InferenceFrames
from tsuiseki.tracking.types.tracks import targets_at


def answers_while_it_runs(tracker: PeopleTracker) -> bool:
    """One that may have a delay has one, or else it can forget; see `people.contract`."""
    inner = inner_tracker(tracker)
    if isinstance(inner, ByClass):
        return all(map(answers_while_it_runs, inner.trackers.values()))
    return inner.delay is not None if hasattr(inner, "delay") else hasattr(inner, "forget")


def check_followed(opened: OpenedPeople) -> None:
    """Refuse what cannot be followed frame by frame; raises RequestError."""
    source = opened.inputs.source
    if not source.has_images:
        raise RequestError(f"{source.name} has no images to follow people in; use track_people")
    if not answers_while_it_runs(opened.tracker):
        raise RequestError(
            "expected a method that answers while it runs, such as sort, or flow with a `delay`, got one that decides "
            "at the end; use track_people"
        )


class Following:
    """Gives each frame with the people in it, as late as a tracker answers.

    Args:
        tracker: a fresh one.
        inferred: frames that a detector runs on.
        longest: frames that are missing between two count as frames without inference, where they are fewer than this;
            or else as empty ones, over which nobody is linked. By default frames are taken to follow each other.
    """

    def __init__(
        self, tracker: PeopleTracker, inferred: InferenceFrames = ALL_INFERRED, longest: int | None = None
    ) -> None:
        self.tracker, self._inferred, self._longest = tracker, inferred, longest
        self._forget = getattr(inner_tracker(tracker), "forget", None)
        self._waiting: deque[Frame] = deque()
        self._first, self._count, self._last = 0, 0, Targets.empty(0)

    def push(self, frame: Frame, detections: Detections) -> Iterator[tuple[Frame, Targets]]:
        """Take the next frame; the frames that are answered by now."""
        if self._longest is not None and self._count:
            missing = frame.index - self._first - self._count
            for _ in range(missing):
                empty = missing >= self._longest
                yield from self._answered(self.tracker.update(Detections.empty()) if empty else skipped(self.tracker))
        self._first = frame.index - self._count
        self._waiting.append(frame)
        detects = self._inferred.at(frame.index)
        yield from self._answered(self.tracker.update(detections) if detects else skipped(self.tracker))
        if self._forget is not None:
            self._forget()

    def _answered(self, targets: Targets | None) -> Iterator[tuple[Frame, Targets]]:
        self._count += 1
        if targets is None:
            return
        while self._waiting and self._waiting[0].index - self._first < targets.frame:
            # With a delay, frames without inference are not answered by themselves.
            yield self._waiting[0], expected(self._last, self._waiting.popleft().index)
        if self._waiting and self._waiting[0].index - self._first == targets.frame:
            self._last = replace(targets, frame=self._waiting[0].index)
            yield self._waiting.popleft(), self._last

    def rest(self) -> Iterator[tuple[Frame, Targets]]:
        """The frames that are not answered, as they are where the video ends here."""
        if self._waiting:
            tracks = self.tracker.tracks()
            yield from ((frame, targets_at(tracks, frame.index - self._first, frame.index)) for frame in self._waiting)


def followed(inputs: PeopleInputs, tracker: PeopleTracker) -> Iterator[tuple[Frame, Targets]]:
    """Each frame with the people in it, as late as the tracker answers."""
    following = Following(tracker, inputs.inferred)
    for frame, detections in inputs.with_frames():
        yield from following.push(frame, detections)
    yield from following.rest()


def expected(targets: Targets, frame: int) -> Targets:
    """The same people in a frame that nothing is known of."""
    people = targets.select(targets.status != "lost")
    nothing = np.column_stack([np.full(len(people), -1), people.classes])
    status = np.full(len(people), "searching")
    return replace(people, frame=frame, scores=np.zeros(len(people)), status=status, origin=nothing)
