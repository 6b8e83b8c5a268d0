"""The people in live cameras, written down while they run; see `runs.rolling`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from tsuiseki.tracking.people.following import check_followed
from tsuiseki.tracking.people.opening import OpenedPeople
from tsuiseki.tracking.people.several import people_in_sources
from tsuiseki.tracking.runs.options import Output
from tsuiseki.tracking.runs.rolling import RollingFolder, Watch, unwatched
from tsuiseki.tracking.types import Targets
from tsuiseki.tracking.types.live import CameraOutage, PeopleInFrame
from tsuiseki.tracking.video.several import SeveralSources

COLUMNS = (
    "frame", "time", "id", "x1", "y1", "x2", "y2", "score", "observed", "class_id", "class_name", "detection_class",
)  # fmt: skip
# Hours of each part where nothing is said.
HOURS = 1.0
NO_FACTS: Mapping[str, object] = {}


def people_rows(number: int, seconds: float, people: Targets) -> list[list[object]]:
    """The rows of ``tracks.csv`` for one frame, whose number there counts from 1."""
    names = {n: str(name).replace(",", " ") for n, name in people.names.items()}
    return [
        [number, f"{seconds:.3f}", person, *(f"{v:.2f}" for v in box), f"{score:.4f}", int(status == "tracking"),
         vote, names.get(vote, ""), vote]
        for person, box, score, status, (_, vote) in zip(
            people.ids.tolist(), people.boxes.tolist(), people.scores.tolist(), people.status.tolist(),
            people.origin.tolist(), strict=True)
        if status != "lost"
    ]  # fmt: skip


def people_live(
    output: Output,
    opened: OpenedPeople,
    hours: float = HOURS,
    watch: Watch = unwatched,
    facts: Mapping[str, object] = NO_FACTS,
) -> int:
    """Follow the people in a video until it or the user ends it; the rows of each frame are written at once.

    Args:
        output: where to.
        opened: the video, and what follows people in it.
        hours: of each part of the result.
        watch: gives who gets each event after it was written.
        facts: for ``run.json``.

    Returns:
        The number of people.

    Raises:
        RequestError: the method answers at the end only; or see `RollingFolder.opened`.
        RunError: the camera is given up, or the video breaks off.
    """
    check_followed(opened)
    source = opened.inputs.source
    about = {"source": source.address, "frame_rate": source.frame_rate, "size": source.size}
    folder = RollingFolder(output, hours, ("tracks.csv", COLUMNS), source.frame_rate, about)
    folder.facts |= facts
    sources = SeveralSources([source], folder.stopped)
    folder.states = sources.states
    with folder.opened(), watch(sources.states) as observers:
        earlier = folder.ids
        for event in people_in_sources([opened], sources):
            if sources.live:
                folder.check_clock(sources.clock.wall(), sources.clock.monotonic())
            if isinstance(event, PeopleInFrame):
                event = replace(event, people=replace(event.people, ids=event.people.ids + earlier))
                _write(folder, event)
            elif isinstance(event, CameraOutage):
                folder.camera_outage(event)
            for observe in observers:
                observe(event)
        return folder.ids


def _write(folder: RollingFolder, event: PeopleInFrame) -> None:
    present = event.people.select(event.people.status != "lost")
    folder.add(
        event.time, event.frame.index, np.unique(present.ids).tolist(),
        lambda number: people_rows(number, event.time, present),
    )  # fmt: skip
