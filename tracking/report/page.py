"""`report.html` of several ways to track the people of a clip, and rows of bars that any page may have.

A page is whole in itself, for light and dark screens: the overlay as base64 WebM, the plots as inline SVG; only a large
overlay lies beside it. What it looks like is in ``templates``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from tsuiseki.tracking.evaluation.coverage import coverage, spans
from tsuiseki.tracking.evaluation.multi import PeopleEvaluation
from tsuiseki.tracking.evaluation.tables import COLUMNS, cells
from tsuiseki.tracking.report.overlay import track_colour
from tsuiseki.tracking.report.plots import comparison_figure, count_figure
from tsuiseki.tracking.report.rendering import render
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.labels import GroundTruth

# Width of all frames of a timeline, pixels.
TIMELINE = 800
# Frames between two numbers of a timeline, the first with which there are at most `MOST_TICKS`.
TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000)
MOST_TICKS = 10  # numbers that stay apart on a narrow screen
LOWER_IS_BETTER = {"id_switches", "false_positives", "false_negatives"}
BOXES_NOTE = "Each colour and number is one person. A dashed box is filled in: no detection supports it."


@dataclass(frozen=True)
class Bar:
    """A segment of consecutive frames.

    Attributes:
        first: 0-based frame.
        last: 0-based frame, included.
        tip: text shown under the pointer, before the frames.
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
    """Rows of bars over numbered frames: the macro ``timeline`` draws them.

    Attributes:
        rows: the label of each, and its bars.
        first: 0-based frame at the left end.
        length: number of frames.
        left: room for the labels, pixels.
        width: of all frames, pixels.
    """

    rows: Sequence[tuple[str, Sequence[Bar]]]
    first: int
    length: int
    left: int = 90
    width: int = TIMELINE

    @property
    def scale(self) -> float:
        """Pixels a frame."""
        return self.width / max(self.length, 1)

    def at(self, frame: float) -> float:
        """Where a 0-based frame begins, pixels from the left."""
        return self.left + (frame - self.first) * self.scale

    @property
    def ticks(self) -> range:
        """The frames whose numbers, from 1, are written below."""
        step = next((tick for tick in TICKS if self.length / tick <= MOST_TICKS), TICKS[-1])
        return range((self.first // step + 1) * step, self.first + self.length + 1, step)


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
    return Timeline(rows, 0, report.length, left=44)
