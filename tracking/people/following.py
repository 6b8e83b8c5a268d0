"""People frame by frame, while the video comes."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tsuiseki.tracking.people.inputs import PeopleInputs
from tsuiseki.tracking.people.methods import ByClass, inner_tracker
from tsuiseki.tracking.people.tracker import PeopleTracker, skipped
from tsuiseki.tracking.types import Frame, Targets
from tsuiseki.tracking.types.tracks import targets_at


def answers_while_it_runs(tracker: PeopleTracker) -> bool:
    """One that may have a delay has one, or else it can forget; see `people.tracker`."""
    inner = inner_tracker(tracker)
    if isinstance(inner, ByClass):
        return all(map(answers_while_it_runs, inner.trackers.values()))
    return inner.delay is not None if hasattr(inner, "delay") else hasattr(inner, "forget")


def followed(inputs: PeopleInputs, tracker: PeopleTracker) -> Iterator[tuple[Frame, Targets]]:
    """Each frame with the people in it, as late as the tracker answers."""
    forget = getattr(inner_tracker(tracker), "forget", None)
    waiting: deque[Frame] = deque()
    first, looked = 0, inputs.looked
    last = Targets.empty(0)
    for number, (frame, found) in enumerate(inputs.with_frames()):
        first = frame.index - number
        waiting.append(frame)
        seen = looked is None or looked[frame.index : frame.index + 1].any()
        targets = tracker.update(found) if seen else skipped(tracker)
        if targets is not None:
            while waiting[0].index - first < targets.frame:
                # With a delay, frames that nobody looked at are not answered by themselves.
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
    here = targets.select(targets.status != "lost")
    nothing = np.column_stack([np.full(len(here), -1), here.classes])
    status = np.full(len(here), "searching")
    return replace(here, frame=frame, scores=np.zeros(len(here)), status=status, origin=nothing)
