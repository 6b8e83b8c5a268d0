"""`report.html` of people in a video, without labels to compare with: who was followed when, and the video."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.evaluation.coverage import spans
from tsuiseki.tracking.report.page import BOXES_NOTE, embedded_video, html_page, listing, seconds_table, section
from tsuiseki.tracking.report.timeline import Bar, timeline
from tsuiseki.tracking.types import Track


@dataclass(frozen=True)
class PeopleReport:
    """What the page shows.

    Attributes:
        name: of the video.
        tracks: the result.
        frames: 0-based numbers of the frames that were looked at.
        frame_rate: frames per second.
        overlay: the video with the tracks, where there is one.
        seconds: per stage of the run.
        facts: names and values for the foot of the page.
    """

    name: str
    tracks: Sequence[Track]
    frames: Sequence[int]
    frame_rate: float
    overlay: Path | None = None
    seconds: Mapping[str, float] | None = None
    facts: Mapping[str, str] | None = None


def people_page(report: PeopleReport) -> str:
    """The page as HTML, self-contained."""
    video = "" if report.overlay is None else embedded_video(report.overlay, "tracks", BOXES_NOTE)
    sections = [
        section("Tracks", video),
        section("Who was followed when", _timeline(report)),
        section("Time", seconds_table(report.seconds or {}, len(report.frames))),
        section("How it was made", listing(report.facts or {})),
    ]
    count = f"{len(report.tracks)} {'person' if len(report.tracks) == 1 else 'people'}"
    introduction = f"{count} in {len(report.frames)} frames at {report.frame_rate:g} a second."
    return html_page(f"People in {report.name}", introduction, sections)


def _timeline(report: PeopleReport) -> str:
    """A row for each person."""
    if not report.tracks:
        return "<p>Nobody was followed.</p>"
    first, length = report.frames[0], report.frames[-1] - report.frames[0] + 1
    note = "<p class=note>A bar is the time a person was followed, pale where no detection supports it.</p>"
    return timeline([followed(track) for track in report.tracks], first, length, "timeline") + note


def followed(track: Track) -> tuple[str, list[Bar]]:
    """The row of a person: when they were followed, pale where no detection supports it."""
    name = f"person {track.id}"
    return name, [
        Bar(span.first, span.last, name, track.id, pale=not span.value)
        for span in spans(track.frames, track.observed.astype(np.int64))
    ]
