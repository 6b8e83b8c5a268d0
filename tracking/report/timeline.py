"""Who was when: a row of bars for each person or action, as SVG in a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from tsuiseki.tracking.report.overlay import track_colour

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
    for frame in frame_ticks(first, length):
        x = left + (frame - first - 0.5) * scale
        marks.append(f'<path d="M{x:.1f} 0V{height}" stroke="currentColor" stroke-opacity="0.15"/>')
        marks.append(f'<text x="{x:.1f}" y="{height + 12}" text-anchor="middle">{frame}</text>')
    box = f"0 0 {left + WIDTH + RIGHT} {height + FOOT}"
    return (
        f'{WIDE}<svg class="plot" viewBox="{box}" role="img" aria-label="{escape(name)}" font-size="11" '
        f'fill="currentColor">{"".join(marks)}</svg></div>'
    )


def frame_ticks(first: int, length: int) -> range:
    """1-based numbers of frames to mark on an axis of ``length`` frames from the 0-based ``first`` on."""
    step = next((t for t in TICKS if length / t <= 10), TICKS[-1])
    return range((first // step + 1) * step, first + length + 1, step)
