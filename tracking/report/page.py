"""`report.html`: a result on one page, for light and dark screens.

Everything is inside the file: the overlay as base64 WebM, the plots as inline SVG; only a large overlay lies beside it.
Text from inputs is escaped.

Who was when: a row of bars for each person or action, as SVG in a page.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from html import escape
from pathlib import Path, PurePosixPath
from urllib.parse import quote

import cv2

from tsuiseki.tracking.evaluation.coverage import coverage, spans
from tsuiseki.tracking.evaluation.multi import PeopleEvaluation
from tsuiseki.tracking.evaluation.tables import COLUMNS, cells
from tsuiseki.tracking.report.overlay import track_colour
from tsuiseki.tracking.report.plots import comparison_figure, count_figure, inline_svg
from tsuiseki.tracking.types import ImageArray, Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.video.webm import video_type

ROW, WIDTH, RIGHT, FOOT = 16, 800, 20, 20
PALE = 0.35
WIDE = '<div class="wide" tabindex="0">'
"""Begins what scrolls sideways by itself, by the keyboard, too."""
TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000)


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


def timeline(rows: Sequence[tuple[str, Sequence[Bar]]], first: int, length: int, name: str, left: int = 90) -> str:
    """The rows over ``length`` frames from the 0-based ``first`` on; nothing where there is no row.

    Args:
        rows: the label of each, and its bars.
        first: frame at the left end.
        length: number of frames.
        name: of the picture, for who cannot see it.
        left: room for the labels, pixels.
    """
    if not rows:
        return ""
    scale, height = WIDTH / max(length, 1), ROW * len(rows)
    marks = []
    for number, (label, bars) in enumerate(rows):
        y = number * ROW
        marks.append(f'<text x="{left - 6}" y="{y + 12}" text-anchor="end">{escape(label)}</text>')
        for bar in bars:
            x, size = left + (bar.first - first) * scale, (bar.last - bar.first + 1) * scale
            paint = "currentColor" if bar.identity is None else "rgb({},{},{})".format(*track_colour(bar.identity))
            opacity = f' fill-opacity="{PALE}"' if bar.pale else ""
            tip = f"<title>{escape(bar.tip)}, frames {bar.first + 1}-{bar.last + 1}</title>"
            place = f'x="{x:.1f}" y="{y + 2}" width="{size:.1f}" height="{ROW - 4}"'
            marks.append(f'<rect {place} fill="{paint}"{opacity}>{tip}</rect>')
    step = next((t for t in TICKS if length / t <= 10), TICKS[-1])
    for frame in range((first // step + 1) * step, first + length + 1, step):
        x = left + (frame - first - 0.5) * scale
        marks.append(f'<path d="M{x:.1f} 0V{height}" stroke="currentColor" stroke-opacity="0.15"/>')
        marks.append(f'<text x="{x:.1f}" y="{height + 12}" text-anchor="middle">{frame}</text>')
    box = f"0 0 {left + WIDTH + RIGHT} {height + FOOT}"
    return (
        f'{WIDE}<svg class="plot" viewBox="{box}" role="img" aria-label="{escape(name)}" font-size="11" '
        f'fill="currentColor">{"".join(marks)}</svg></div>'
    )


MOST_EMBEDDED = 8_000_000
"""Bytes of the largest video inside a page."""
LOWER_IS_BETTER = {"id_switches", "false_positives", "false_negatives"}
BOXES_NOTE = "Each colour and number is one person. A dashed box is filled in: no detection supports it."
GLOSSARY = (
    "<p class=note>HOTA balances finding people (DetA) and keeping their ids (AssA). MOTA counts missed people "
    "(FN), false boxes (FP) and changes of id (IDSW); IDF1 is the share of boxes with the right id throughout. "
    "MOTP is the mean overlap of right boxes, Rcll and Prcn recall and precision. Boxes match from an overlap of "
    "0.5 on.</p>"
)
FOLLOWED_NOTE = (
    "<p class=note>A row is a person of the ground truth, a bar the time they are in view, its colour the id they "
    "were given: one colour from end to end is perfect, a change of colour an id switch, grey a miss.</p>"
)


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
        more: HTML of further sections, before those about time and origin.
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
    more: Sequence[str] = ()
    overlay_note: str = f"{BOXES_NOTE} Lines show where they walked."


def report_page(report: Report) -> str:
    """The page as HTML."""
    truth, tracks, length = report.truth, report.tracks, report.length
    overlay, heading = report.overlay, f"Tracks by {[*tracks][-1]}"
    sections = [
        section("Scores", _table(report.scores) + GLOSSARY),
        section(heading, embedded_video(overlay, heading, report.overlay_note)) if overlay is not None else "",
        section("Comparison", scrolling(inline_svg(partial(comparison_figure, report.scores), "comparison"))),
        section("Who was followed when", FOLLOWED_NOTE + "".join(_timeline(report, name) for name in tracks)),
        section("People in view", scrolling(inline_svg(partial(count_figure, truth, tracks, length), "counts"))),
        *report.more,
        section("Time", seconds_table(report.seconds, length)),
        section("How it was made", listing(report.facts)),
    ]
    return html_page(report.title, report.introduction, sections)


def html_page(title: str, introduction: str, sections: Iterable[str]) -> str:
    """A page that needs nothing else: title and introduction are text, sections HTML; empty ones are left out."""
    body = "\n".join(part for part in sections if part)
    return PAGE.format(title=escape(title), introduction=escape(introduction), style=STYLE, sections=body)


def scrolling(html: str) -> str:
    """A table or plot that scrolls sideways where the screen is too narrow for it."""
    return f"{WIDE}{html}</div>"


def section(heading: str, body: str) -> str:
    """HTML under a heading; nothing where there is no ``body``."""
    return f"<section><h2>{escape(heading)}</h2>{body}</section>" if body else ""


def listing(values: Mapping[str, str]) -> str:
    """Names with their values; nothing where there is none."""
    rows = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in values.items())
    return f"<dl>{rows}</dl>" if rows else ""


def html_table(
    head: Sequence[str], rows: Iterable[Sequence[str]], is_best: Callable[[int, int], bool] = lambda *_: False
) -> str:
    """A table with a heading for each column and row.

    Args:
        head: headings, the first of the names of the rows; none without a row of headings.
        rows: name, as text, and cells of each, as HTML.
        is_best: whether the cell of a row and column, counted from 0 without the names, is marked as the best.
    """
    lines = []
    for row, (name, *values) in enumerate(rows):
        marks = [' class="best"' if is_best(row, column) else "" for column in range(len(values))]
        shown = "".join(f"<td{mark}>{text}</td>" for mark, text in zip(marks, values, strict=True))
        lines.append(f"<tr><th scope=row>{escape(name)}</th>{shown}</tr>")
    headings = "".join(f"<th scope=col>{escape(heading)}</th>" for heading in head)
    headings = f"<thead><tr>{headings}</tr></thead>" if head else ""
    return scrolling(f"<table>{headings}<tbody>{''.join(lines)}</tbody></table>")


def _table(results: Mapping[str, PeopleEvaluation]) -> str:
    """The scores of each result, the best of several marked."""
    values = [[getattr(one.combined, field) for _, field, _ in COLUMNS] for one in results.values()]
    better = [min if field in LOWER_IS_BETTER else max for _, field, _ in COLUMNS]
    best = [choose(column) for choose, column in zip(better, zip(*values, strict=True), strict=True)]
    rows = [[name, *cells(one.combined)] for name, one in results.items()]
    head = ["Method", *(heading for heading, _, _ in COLUMNS)]
    return html_table(head, rows, lambda row, column: len(rows) > 1 and values[row][column] == best[column])


def embedded_image(image: ImageArray, alt: str = "") -> str:
    """HTML of an image ``(H, W, 3)`` uint8 RGB, which is in the page as JPEG; ``alt`` says what it shows."""
    data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()
    return f'<img alt="{escape(alt)}" src="data:image/jpeg;base64,{base64.b64encode(data).decode("ascii")}">'


def embedded_video(path: Path, label: str = "", note: str = "", inside: str = "") -> str:
    """HTML of a video that is in the page, or beside it where it is large.

    Args:
        path: of the video; one above `MOST_EMBEDDED` bytes is linked.
        label: what it shows.
        note: below it.
        inside: folder beside the page in which it lies; by default that of the page.
    """
    if path.stat().st_size > MOST_EMBEDDED:
        place = quote(str(PurePosixPath(inside, path.name)))
    else:
        place = f"data:{video_type(path)};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"
    named = f' aria-label="{escape(label)}"' if label else ""
    below = f"<p class=note>{escape(note)}</p>" if note else ""
    return f'<video controls loop muted playsinline{named} src="{place}"></video>{below}'


def embedded_overlay(folder: Path, name: str = "overlay", label: str = "", note: str = "", inside: str = "") -> str:
    """Likewise, of the video that a run has drawn into its folder; empty where none lies there."""
    drawn = sorted(folder.glob(f"{name}.*"))
    return embedded_video(drawn[0], label, note, inside) if drawn else ""


def _timeline(report: Report, method: str) -> str:
    rows = []
    for person in coverage(report.truth, report.tracks[method]):
        bars = [
            Bar(span.first, span.last, f"person {person.id}: id {span.value}", span.value)
            if span.value
            else Bar(span.first, span.last, f"person {person.id}: missed", pale=True)
            for span in spans(person.frames, person.track_ids)
        ]
        rows.append((str(person.id), bars))
    return f"<h3>{escape(method)}</h3>{timeline(rows, 0, report.length, method, left=44)}"


def seconds_table(seconds: Mapping[str, float], frames: int) -> str:
    """What each stage of a run took, altogether and a frame; nothing where no stage was measured."""
    if not seconds:
        return ""
    total = max(sum(seconds.values()), 1e-9)
    rows = "".join(
        f"<tr><th scope=row>{escape(stage)}</th><td>{value:.2f} s</td>"
        f"<td>{1000 * value / max(frames, 1):.1f} ms</td>"
        f'<td class="meter"><span style="width:{100 * value / total:.1f}%"></span></td></tr>'
        for stage, value in seconds.items()
    )
    head = "<thead><tr><th scope=col>Stage</th><th scope=col>All</th><th scope=col>A frame</th><th></th></tr></thead>"
    return scrolling(f"<table>{head}<tbody>{rows}</tbody></table>")


STYLE = """
:root { color-scheme: light dark; --ground: #fbfbfa; --card: #fff; --ink: #1c1f23; --soft: #5c6670; --line: #dfe3e6;
  --best: #0b6b50; --accent: #0072b2; }
@media (prefers-color-scheme: dark) { :root { --ground: #14171a; --card: #1c2024; --ink: #e7eaec; --soft: #9aa5ae;
  --line: #343b41; --best: #5fd3a8; --accent: #56b4e9; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }
main { max-width: 62rem; margin: 0 auto; padding: 2rem 1rem 4rem; }
h1 { font-size: 1.7rem; margin: 0 0 .3rem; } h2 { font-size: 1.15rem; margin: 0 0 .8rem; }
h3 { font-size: 1rem; margin: 1rem 0 .3rem; font-weight: 600; }
section { background: var(--card); border: 1px solid var(--line); border-radius: 8px; padding: 1.1rem 1.2rem;
  margin-top: 1.2rem; }
p { margin: .4rem 0; } .lead, .note { color: var(--soft); } .note { font-size: .88rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: .92rem; }
th, td { padding: .35rem .5rem; text-align: right; border-bottom: 1px solid var(--line); white-space: nowrap; }
th:first-child { text-align: left; } thead th { color: var(--soft); font-weight: 600; }
tbody tr:last-child > * { border-bottom: 0; } .best { color: var(--best); font-weight: 700; }
.meter { width: 40%; } .meter span { display: block; height: .7rem; background: var(--accent); border-radius: 2px; }
video, svg.plot, section > img { display: block; width: 100%; height: auto; }
video { border-radius: 4px; background: #000; }
svg.plot text { font-family: system-ui, sans-serif; }
@media (max-width: 44rem) { .wide svg.plot { min-width: 38rem; } }
.plans { display: flex; flex-wrap: wrap; gap: 1rem; margin: .8rem 0; }
.plans svg.plot { flex: 1 1 16rem; max-height: 32rem; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .2rem 1rem; margin: 0; font-size: .92rem; }
dt { color: var(--soft); } dd { margin: 0; overflow-wrap: anywhere; }
h1 { overflow-wrap: anywhere; } a { color: var(--accent); } :focus-visible { outline: 3px solid var(--accent); }
.crops { display: flex; gap: 3px; justify-content: flex-end; } .crops img { height: 56px; border-radius: 3px; }
@media print { video, .wide::-webkit-scrollbar { display: none; } section { break-inside: avoid; border: 0; }
  body { background: #fff; } .wide { overflow: visible; } }
"""

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<main>
<h1>{title}</h1>
<p class="lead">{introduction}</p>
{sections}
</main>
</body>
</html>
"""
