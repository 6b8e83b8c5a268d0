"""`report.html` of several ways to track the people of a clip, and rows of bars that any page may have.

A page is whole in itself, for light and dark screens: the overlay as base64 WebM, the plots as inline SVG; only a large
overlay lies beside it. What it looks like is in ``templates``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from tsuiseki.tracking.evaluation.coverage import coverage, spans
from tsuiseki.tracking.evaluation.multi import PeopleEvaluation
from tsuiseki.tracking.evaluation.tables import COLUMNS, cells
from tsuiseki.tracking.report.overlay import track_colour
from tsuiseki.tracking.report.plots import comparison_figure, count_figure
from tsuiseki.tracking.report.rendering import render
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.labels import GroundTruth

# Frames or seconds between two numbers of a timeline, the first with which there are at most `MOST_TICKS`.
TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 21600)
MOST_TICKS = 6  # numbers that stay apart on a narrow screen
LOWER_IS_BETTER = {"id_switches", "false_positives", "false_negatives"}
BOXES_NOTE = "Each colour and number is one person. A dashed box is filled in: no detection supports it."


@dataclass(frozen=True)
class Bar:
    """A segment of consecutive frames.

    Attributes:
        first: 0-based frame.
        last: 0-based frame, included.
        tip: text shown under the pointer, before its time.
        identity: whose colour it has; None takes the colour of the text.
        pale: drawn faintly.
    """

    first: int
    last: int
    tip: str
    identity: int | None = None
    pale: bool = False

    @property
    def colour(self) -> str:
        """Of the bar, for CSS."""
        return "currentColor" if self.identity is None else "rgb({},{},{})".format(*track_colour(self.identity))


@dataclass(frozen=True)
class Timeline:
    """Rows of bars over time: the macro ``timeline`` draws them.

    Attributes:
        rows: the label of each, and its bars.
        first: 0-based frame at the left end.
        length: number of frames.
        rate: frames a second, for seconds since frame 0; 0 for the numbers of frames.
    """

    rows: Sequence[tuple[str, Sequence[Bar]]]
    first: int
    length: int
    rate: float = 0.0

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """What is written below: the place of each, percent of the width, and its text."""
        rate, begin = (self.rate, self.first) if self.rate else (1.0, self.first + 1)
        extent, start = max(self.length, 1) / rate, begin / rate
        step = next((t for t in TICKS if (self.rate or t >= 1) and extent / t <= MOST_TICKS), extent / MOST_TICKS)
        numbers = step * np.arange(np.ceil(start / step), np.floor((start + extent) / step) + 1)
        return [(float(100 * (n - start) / extent), f"{n:g}{' s' if self.rate else ''}") for n in numbers.round(6)]

    def when(self, bar: Bar) -> str:
        """The begin and end of a bar, in seconds, or in frames from 1 where no rate is known."""
        if self.rate:
            return f"{bar.first / self.rate:.1f} to {(bar.last + 1) / self.rate:.1f} s"
        return f"frames {bar.first + 1}-{bar.last + 1}"


@dataclass(frozen=True)
class Report:
    """Several ways to track the people of a clip, compared with its truth on a page.

    Attributes:
        title: heading of the page.
        introduction: a sentence or two under it.
        truth: the labels of the clip.
        tracks: the result by name of the method, the best last.
        scores: likewise, against the truth.
        length: number of frames.
        overlay: WebM video of the last method's tracks; None leaves it out.
        seconds: per stage of the run.
        facts: names and values for the foot of the page: models, versions, seed.
        sections: HTML of further sections, before those about time and origin.
        overlay_note: what is drawn in the overlay.
    """

    title: str
    introduction: str
    truth: GroundTruth
    tracks: Mapping[str, list[Track]]
    scores: Mapping[str, PeopleEvaluation]
    length: int
    overlay: Path | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    facts: Mapping[str, str] = field(default_factory=dict)
    sections: Sequence[str] = ()
    overlay_note: str = f"{BOXES_NOTE} Lines show where they walked."


def report_page(report: Report) -> str:
    """The page as HTML; of several methods the best scores are marked."""
    values = [[getattr(scores.combined, name) for _, name, _ in COLUMNS] for scores in report.scores.values()]
    choices = [min if name in LOWER_IS_BETTER else max for _, name, _ in COLUMNS]
    best = [choose(column) for choose, column in zip(choices, zip(*values, strict=True), strict=True)]
    return render(
        "comparison.html.j2",
        title=report.title,
        introduction=report.introduction,
        report=report,
        head=["Method", *(heading for heading, _, _ in COLUMNS)],
        rows=[[name, *cells(scores.combined)] for name, scores in report.scores.items()],
        is_best=lambda row, column: len(values) > 1 and values[row][column] == best[column],
        methods=[*report.tracks],
        timelines={method: _timeline(report, method) for method in report.tracks},
        comparison=partial(comparison_figure, report.scores),
        counts=partial(count_figure, report.truth, report.tracks, report.length),
    )


def _timeline(report: Report, method: str) -> Timeline:
    rows = []
    for person in coverage(report.truth, report.tracks[method]):
        bars = [
            Bar(span.first, span.last, f"person {person.id}: id {span.value}", span.value)
            if span.value
            else Bar(span.first, span.last, f"person {person.id}: missed", pale=True)
            for span in spans(person.frames, person.track_ids)
        ]
        rows.append((str(person.id), bars))
    return Timeline(rows, 0, report.length)
