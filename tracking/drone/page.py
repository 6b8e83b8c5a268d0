"""What people do, for people to read: captions for the overlay, and a timeline for each person."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.evaluation.coverage import spans
from tsuiseki.tracking.report.page import Bar, Timeline
from tsuiseki.tracking.report.rendering import render
from tsuiseki.tracking.report.track_bars import followed
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types.tracks import ActingTrack

# Actions that a caption names at most.
MOST_NAMED = 3


def captions_of(people: Sequence[ActingTrack], names: Sequence[str], threshold: float) -> dict[int, list[str]]:
    """By track id, the named actions of each of its boxes, the likeliest first, `MOST_NAMED` at the most."""
    captions = {}
    for person in people:
        if person.multi is None:
            continue
        order = np.argsort(-person.multi, axis=1, kind="stable")
        captions[person.track.id] = [
            ", ".join(names[a] for a in ranked[:MOST_NAMED].tolist() if probabilities[a] > threshold)
            for ranked, probabilities in zip(order, person.multi, strict=True)
        ]
    return captions


def action_timelines(result: Result[ActingTrack], threshold: float) -> str:
    """A section with a block for each person: when they were followed, and what they did."""
    from markupsafe import Markup

    people = {person.track.id: _timeline(person, result, threshold) for person in result}
    return Markup(render("actions.html.j2", people=people, threshold=threshold))


def _timeline(person: ActingTrack, result: Result[ActingTrack], threshold: float) -> Timeline:
    track, frames = person.track, result.frames["frame"]
    rows = [followed(track)]
    if person.multi is not None:
        called = person.multi > threshold
        for a in np.flatnonzero(called.any(axis=0)).tolist():
            acting = spans(track.frames, called[:, a].astype(np.int64))
            name = result.names[a]
            rows.append((name, [Bar(span.first, span.last, name, track.id) for span in acting if span.value]))
    return Timeline(rows, frames[0], frames[-1] - frames[0] + 1, result.frame_rate)
