"""`report.html` of people in a video, without labels to compare with: who was followed when, and the video."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.evaluation.coverage import spans
from tsuiseki.tracking.report.overlay import track_colour
from tsuiseki.tracking.report.page import (
    BOXES_NOTE,
    embedded_video,
    frame_ticks,
    html_page,
    listing,
    scrolling,
    seconds_table,
    section,
)
from tsuiseki.tracking.types import Track

ROW, LEFT, WIDTH = 15, 90, 810


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
    """A row for each person, as SVG."""
    if not report.tracks:
        return "<p>Nobody was followed.</p>"
    first, length = report.frames[0], report.frames[-1] - report.frames[0] + 1
    scale, height = WIDTH / length, ROW * len(report.tracks)
    marks = []
    for number, track in enumerate(report.tracks):
        y, paint = number * ROW, "rgb({},{},{})".format(*track_colour(track.id))
        marks.append(f'<text x="{LEFT - 6}" y="{y + 11}" text-anchor="end">person {track.id}</text>')
        for span in spans(track.frames, track.observed.astype(np.int64) + 1):
            x, size = LEFT + (span.first - first) * scale, (span.last - span.first + 1) * scale
            pale = ' fill-opacity="0.35"' if span.value == 1 else ""
            tip = f"<title>person {track.id}, frames {span.first + 1}-{span.last + 1}</title>"
            marks.append(
                f'<rect x="{x:.1f}" y="{y + 2}" width="{size:.1f}" height="{ROW - 4}" fill="{paint}"{pale}>{tip}</rect>'
            )
    for frame in frame_ticks(first, length):
        x = LEFT + (frame - first - 0.5) * scale
        marks.append(f'<path d="M{x:.1f} 0V{height}" stroke="currentColor" stroke-opacity="0.15"/>')
        marks.append(f'<text x="{x:.1f}" y="{height + 11}" text-anchor="middle">{frame}</text>')
    note = "<p class=note>A bar is the time a person was followed, pale where no detection supports it.</p>"
    svg = (
        f'<svg class="plot" viewBox="0 0 {LEFT + WIDTH + 20} {height + 20}" role="img" aria-label="timeline" '
        f'font-size="11" fill="currentColor">{"".join(marks)}</svg>'
    )
    return scrolling(svg) + note
