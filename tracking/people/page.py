"""`report.html` of people in a video, without labels to compare with: who was followed when, and the video."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tsuiseki.tracking.evaluation.coverage import spans
from tsuiseki.tracking.report.page import BOXES_NOTE, embedded_overlay, html_page, listing, seconds_table, section
from tsuiseki.tracking.report.timeline import Bar, timeline
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import Track

PERSON = "person"


def people_page(result: Result[Track], folder: Path) -> str:
    """The page as HTML, self-contained; it shows the overlay that lies in ``folder``, where one does."""
    frames = result.frames["frame"]
    sections = [
        section("Tracks", embedded_overlay(folder, label="tracks", note=BOXES_NOTE)),
        section("Who was followed when", _timeline(result)),
        section("Time", seconds_table(result.seconds, len(frames))),
        section("How it was made", listing({name: str(result.settings[name]) for name in ("method", "source")})),
    ]
    introduction = f"{counted(result.tracks)} in {len(frames)} frames at {result.frame_rate:g} a second."
    return html_page(f"People in {result.name}", introduction, sections)


def counted(tracks: Sequence[Track]) -> str:
    """How many there are, by class where classes are told apart, such as ``4 x person, 2 x car``."""
    classes = Counter(class_of(track) for track in tracks)
    if classes.keys() <= {PERSON}:
        return f"{len(tracks)} {'person' if len(tracks) == 1 else 'people'}"
    return ", ".join(f"{count} x {name}" for name, count in sorted(classes.items()))


def class_of(track: Track) -> str:
    """Name of a track's class, or class and its number; ``person`` where neither is known."""
    return track.class_name or (f"class {track.class_id}" if track.class_id >= 0 else PERSON)


def _timeline(result: Result[Track]) -> str:
    """A row for each person."""
    if not result:
        return "<p>Nobody was followed.</p>"
    first, last = result.frames["frame"][0], result.frames["frame"][-1]
    note = "<p class=note>A bar is the time a person was followed, pale where no detection supports it.</p>"
    return timeline([followed(track) for track in result], first, last - first + 1, "timeline") + note


def followed(track: Track) -> tuple[str, list[Bar]]:
    """The row of a person: when they were followed, pale where no detection supports it."""
    name = f"{class_of(track)} {track.id}"
    return name, [
        Bar(span.first, span.last, name, track.id, pale=not span.value)
        for span in spans(track.frames, track.observed.astype(np.int64))
    ]
