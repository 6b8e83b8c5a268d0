"""Plain charts as SVG and as PNG, without a plot library, which takes longer to load than many frames to track."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from tsuiseki.tracking.types import FloatArray

COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9")
"""Readable on white and on black, and for the colour-blind: Okabe and Ito's set without yellow and black."""
INK = ""
"""Colour of text and axes: black in a picture, on a page that of its text."""
SIZE, LETTER = 13, 7.5
"""Of text: height and mean width of a letter, pixels."""
_SHARP = 2  # Pixels of a picture for one of the chart.
_ANCHORS = {"start": "lm", "middle": "mm", "end": "rm"}
Anchor = Literal["start", "middle", "end"]


@dataclass
class Chart:
    """Lines, boxes and text, from the upper left, in pixels.

    Attributes:
        width: of all.
        height: likewise.
    """

    width: float
    height: float
    _marks: list[tuple[str, tuple[Any, ...]]] = field(default_factory=list)

    def line(self, points: FloatArray, colour: str = INK, width: float = 1.5, dashed: bool = False) -> None:
        """Through ``(N, 2)`` points."""
        self._marks.append(("line", (np.round(points, 1), colour, width, dashed)))

    def box(self, x: float, y: float, wide: float, high: float, colour: str) -> None:
        """A filled one, whose upper left corner is given."""
        self._marks.append(("box", (x, y, wide, high, colour)))

    def text(self, x: float, y: float, words: str, anchor: Anchor = "middle", colour: str = INK) -> None:
        """Words about the height ``y`` that start, end or have their middle at ``x``."""
        self._marks.append(("text", (x, y, words, anchor, colour)))

    def svg(self, name: str) -> str:
        """For a page, whose text colour it takes; ``name`` says what is shown."""
        shape = f'viewBox="0 0 {self.width:g} {self.height:g}" width="{self.width:g}" height="{self.height:g}"'
        parts = [getattr(self, f"_svg_{kind}")(*mark) for kind, mark in self._marks]
        head = f'<svg class="plot" role="img" aria-label="{escape(name)}" xmlns="http://www.w3.org/2000/svg" {shape} '
        return f'{head}font-family="sans-serif" font-size="{SIZE}">{"".join(parts)}</svg>'

    def save(self, path: Path) -> None:
        """Write it as the picture that the suffix of ``path`` names."""
        image = Image.new("RGB", (round(_SHARP * self.width), round(_SHARP * self.height)), "white")
        pen = ImageDraw.Draw(image)
        for kind, mark in self._marks:
            getattr(self, f"_draw_{kind}")(pen, *mark)
        image.save(path)

    @staticmethod
    def _svg_line(points: FloatArray, colour: str, width: float, dashed: bool) -> str:
        way = " ".join(f"{x:g},{y:g}" for x, y in points.tolist())
        dashes = ' stroke-dasharray="6 3"' if dashed else ""
        return (
            f'<polyline points="{way}" fill="none" stroke="{colour or "currentColor"}" stroke-width="{width}"{dashes}/>'
        )

    @staticmethod
    def _svg_box(x: float, y: float, wide: float, high: float, colour: str) -> str:
        return f'<rect x="{x:g}" y="{y:g}" width="{wide:g}" height="{high:g}" fill="{colour}"/>'

    @staticmethod
    def _svg_text(x: float, y: float, words: str, anchor: Anchor, colour: str) -> str:
        where = f'x="{x:.1f}" y="{y + 0.35 * SIZE:.1f}" text-anchor="{anchor}"'
        return f'<text {where} fill="{colour or "currentColor"}">{escape(words)}</text>'

    @staticmethod
    def _draw_line(pen: ImageDraw.ImageDraw, points: FloatArray, colour: str, width: float, dashed: bool) -> None:
        for way in _dashes(points) if dashed else [points]:
            flat = (_SHARP * way).ravel().tolist()
            pen.line(flat, fill=colour or "black", width=round(_SHARP * width), joint="curve")

    @staticmethod
    def _draw_box(pen: ImageDraw.ImageDraw, x: float, y: float, wide: float, high: float, colour: str) -> None:
        pen.rectangle([_SHARP * one for one in (x, y, x + wide, y + high)], fill=colour)

    @staticmethod
    def _draw_text(pen: ImageDraw.ImageDraw, x: float, y: float, words: str, anchor: Anchor, colour: str) -> None:
        pen.text((_SHARP * x, _SHARP * y), words, fill=colour or "black", font=_font(), anchor=_ANCHORS[anchor])


def _dashes(points: FloatArray, on: float = 6, off: float = 3) -> list[FloatArray]:
    """The pieces of a line that are drawn."""
    along = np.append(0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    starts = np.arange(0, along[-1], on + off)
    pieces = []
    for start in starts.tolist():
        at = np.concatenate([[start], along[(along > start) & (along < start + on)], [min(start + on, along[-1])]])
        pieces.append(np.stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)], axis=1))
    return pieces


def _font() -> ImageFont.FreeTypeFont:
    """The letters that come with matplotlib, which need not be loaded for it."""
    found = importlib.util.find_spec("matplotlib")
    assert found is not None
    assert found.submodule_search_locations is not None
    file = Path(found.submodule_search_locations[0], "mpl-data", "fonts", "ttf", "DejaVuSans.ttf")
    return ImageFont.truetype(str(file), _SHARP * SIZE)


def ticks(end: float, most: int, whole: bool = False) -> FloatArray:
    """Round numbers from 0 to ``end``, at most about so many; whole ones where that is asked."""
    least = max(end / most, 1e-9)
    power = 10.0 ** np.floor(np.log10(least))
    step = next(float(power * one) for one in (1, 2, 5, 10) if power * one >= least * (1 - 1e-9))
    step = max(step, 1.0) if whole else step
    return np.arange(0, end * (1 + 1e-9), step)


def steps_chart(across: str, up: str, lines: Sequence[tuple[str, FloatArray, FloatArray, str, bool]]) -> Chart:
    """Step functions from 0.

    Args:
        across: what the horizontal axis has.
        up: what the vertical axis has.
        lines: name, ``(N,)`` where each value begins, ``(N,)`` values, colour, and whether it is dashed.
    """
    names = max((len(name) for name, *_ in lines), default=0)
    chart = Chart(1000, 320)
    left, right, top, bottom = 56.0, 985 - (names and 34 + LETTER * names), 24.0, 272.0
    end = max([0.0, *(float(times[-1]) for _, times, *_ in lines)]) or 1.0
    high = max([1.0, *(float(values.max(initial=0)) for _, _, values, *_ in lines)]) * 1.05
    for at in ticks(end, 10):
        x = left + at / end * (right - left)
        chart.line(np.array([[x, bottom], [x, bottom + 4]]), width=1)
        chart.text(x, bottom + 14, f"{at:g}")
    for at in ticks(high, 6, whole=True):
        y = bottom - at / high * (bottom - top)
        chart.line(np.array([[left - 4, y], [left, y]]), width=1)
        chart.text(left - 8, y, f"{at:g}", "end")
    chart.line(np.array([[left, top], [left, bottom], [right, bottom]]), width=1)
    chart.text((left + right) / 2, bottom + 36, across)
    chart.text(left - 8, 10, up, "start")
    for number, (name, times, values, colour, dashed) in enumerate(lines):
        x, y = left + times / end * (right - left), bottom - values / high * (bottom - top)
        chart.line(np.stack([np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]], axis=1), colour, dashed=dashed)
        if names:
            key = top + 8 + 20 * number
            chart.line(np.array([[right + 10, key], [right + 34, key]]), colour, dashed=dashed)
            chart.text(right + 40, key, name, "start")
    return chart


def table_chart(rows: Sequence[str], columns: Sequence[str], values: FloatArray) -> Chart:
    """Numbers ``(R, C)`` in boxes, the darker the larger; rows are what they go from, columns to."""
    left = 30 + LETTER * max(map(len, ["from", *rows]))
    wide = max([90.0, *(LETTER * len(column) + 12 for column in columns)])
    chart = Chart(left + wide * len(columns) + 12, 60.0 + 44 * len(rows))
    chart.text(left - 10, 14, "from", "end")
    chart.text(left + wide * len(columns) / 2, 14, "to")
    most = float(values.max(initial=0)) or 1.0
    for k, column in enumerate(columns):
        chart.text(left + wide * (k + 0.5), 36, column)
    for j, row in enumerate(rows):
        y = 50.0 + 44 * j
        chart.text(left - 10, y + 22, row, "end")
        for k in range(len(columns)):
            share = float(values[j, k]) / most
            shade = np.array([247, 251, 255]) + share * (np.array([8, 48, 107]) - [247, 251, 255])
            chart.box(left + wide * k, y, wide, 44, "#{:02x}{:02x}{:02x}".format(*shade.round().astype(int).tolist()))
            colour = "white" if share > 0.5 else "black"
            chart.text(left + wide * (k + 0.5), y + 22, f"{values[j, k]:g}", colour=colour)
    return chart
