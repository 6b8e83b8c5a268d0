"""What people do, for people to read: captions for the overlay, and a page with a timeline for each person."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.evaluation.coverage import spans
from tsuiseki.tracking.people.page import followed
from tsuiseki.tracking.report.page import BOXES_NOTE, embedded_video, html_page, seconds_table, section
from tsuiseki.tracking.report.timeline import Bar, timeline
from tsuiseki.tracking.types.tracks import ActingTrack

MOST_NAMED = 3


@dataclass(frozen=True)
class ActionReport:
    """What the page shows.

    Attributes:
        name: of the video.
        people: with their actions.
        names: of the actions.
        frames: 0-based numbers of the frames that were looked at.
        threshold: an action is named where its probability is above.
        frame_rate: frames per second.
    """

    name: str
    people: Sequence[ActingTrack]
    names: Sequence[str]
    frames: Sequence[int]
    threshold: float
    frame_rate: float


def captions_of(people: Sequence[ActingTrack], names: Sequence[str], threshold: float) -> dict[int, list[str]]:
    """By track id, the named actions of each of its boxes, the likeliest first, `MOST_NAMED` at the most."""
    captions = {}
    for person in people:
        if person.multi is None:
            continue
        order = np.argsort(-person.multi, axis=1, kind="stable")
        captions[person.track.id] = [
            ", ".join(names[a] for a in ranked[:MOST_NAMED].tolist() if said[a] > threshold)
            for ranked, said in zip(order, person.multi, strict=True)
        ]
    return captions


def action_page(report: ActionReport, video: Path | None, seconds: Mapping[str, float]) -> str:
    """The page as HTML, self-contained."""
    time = section("Time", seconds_table(seconds, len(report.frames)))
    people = f"{len(report.people)} {'person' if len(report.people) == 1 else 'people'}"
    introduction = f"{people} in {len(report.frames)} frames at {report.frame_rate:g} a second."
    return html_page(f"People in {report.name}", introduction, [_video(video), action_timelines(report), time])


def _video(path: Path | None) -> str:
    return section("Tracks and actions", "" if path is None else embedded_video(path, note=BOXES_NOTE))


def action_timelines(report: ActionReport) -> str:
    note = (
        "<p class=note>A block is a person. Its first row is the time they were followed, pale where no detection "
        "supports it; each other row is an action, drawn where its probability over the window exceeds "
        f"{report.threshold:g}. Numbers count frames.</p>"
    )
    blocks = "".join(_timeline(person, report) for person in report.people)
    return section("Who does what when", note + (blocks or "<p>Nobody was followed.</p>"))


def _timeline(person: ActingTrack, report: ActionReport) -> str:
    track = person.track
    first, length = report.frames[0], report.frames[-1] - report.frames[0] + 1
    rows = [followed(track)]
    if person.multi is not None:
        called = person.multi > report.threshold
        for a in np.flatnonzero(called.any(axis=0)).tolist():
            found = spans(track.frames, called[:, a].astype(np.int64))
            name = report.names[a]
            rows.append((name, [Bar(span.first, span.last, name, track.id) for span in found if span.value]))
    return timeline(rows, first, length, f"person {track.id}", left=150)
