"""Each frame with the people in it, as late as a tracker answers."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tsuiseki.tracking.people.by_class import ByClass
from tsuiseki.tracking.people.contract import PeopleTracker, skipped
from tsuiseki.tracking.people.detections import PeopleInputs
from tsuiseki.tracking.people.motion_compensated import inner_tracker
from tsuiseki.tracking.types import Frame, Targets
from tsuiseki.tracking.types.tracks import targets_at


def answers_while_it_runs(tracker: PeopleTracker) -> bool:
    """One that may have a delay has one, or else it can forget; see `people.contract`."""
    inner = inner_tracker(tracker)
    if isinstance(inner, ByClass):
        return all(map(answers_while_it_runs, inner.trackers.values()))
    return inner.delay is not None if hasattr(inner, "delay") else hasattr(inner, "forget")


def followed(inputs: PeopleInputs, tracker: PeopleTracker) -> Iterator[tuple[Frame, Targets]]:
    """Each frame with the people in it, as late as the tracker answers."""
    forget = getattr(inner_tracker(tracker), "forget", None)
    waiting: deque[Frame] = deque()
    first, inferred = 0, inputs.inferred
    last = Targets.empty(0)
    for number, (frame, detections) in enumerate(inputs.with_frames()):
        first = frame.index - number
        waiting.append(frame)
        detects = inferred is None or inferred[frame.index : frame.index + 1].any()
        targets = tracker.update(detections) if detects else skipped(tracker)
        if targets is not None:
            while waiting[0].index - first < targets.frame:
                # With a delay, frames without inference are not answered by themselves.
                yield waiting[0], expected(last, waiting.popleft().index)
            last = replace(targets, frame=waiting[0].index)
            yield waiting.popleft(), last
        if forget is not None:
            forget()
    if waiting:
        tracks = tracker.tracks()
        yield from ((frame, targets_at(tracks, frame.index - first, frame.index)) for frame in waiting)


def expected(targets: Targets, frame: int) -> Targets:
    """The same people in a frame that nothing is known of."""
    people = targets.select(targets.status != "lost")
    nothing = np.column_stack([np.full(len(people), -1), people.classes])
    status = np.full(len(people), "searching")
    return replace(people, frame=frame, scores=np.zeros(len(people)), status=status, origin=nothing)
