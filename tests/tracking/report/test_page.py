"""The report is one page that needs nothing else, and shows text from inputs as text."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from tsuiseki.tracking.evaluation.coverage import coverage, spans
from tsuiseki.tracking.evaluation.multi import PeopleEvaluation, SequencePair, evaluate_sequences
from tsuiseki.tracking.report import rendering
from tsuiseki.tracking.report.page import Bar, Report, Timeline, report_page
from tsuiseki.tracking.report.plots import NARROW, comparison_figure, inline_svg
from tsuiseki.tracking.report.rendering import section, video_place, words
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.labels import GroundTruth

NASTY = "<script>alert('x')</script> & \"q\" $a$ {b}"
LENGTH = 20


def walk(identity: int, frames: range, x: float) -> Track:
    numbers = np.array(frames)
    boxes = np.column_stack([x + numbers, 0 * numbers + 5.0, x + numbers + 10, 0 * numbers + 35.0])
    return Track(identity, numbers, boxes, np.ones(len(numbers)))


def truth_of(*tracks: Track) -> GroundTruth:
    frames = np.concatenate([t.frames for t in tracks])
    ids = np.concatenate([np.full(len(t), t.id) for t in tracks])
    every = np.ones(len(frames), dtype=bool)
    boxes = np.concatenate([t.boxes for t in tracks])
    return GroundTruth(frames, ids, boxes, every, ~every, every.astype(float)).select(np.argsort(frames, kind="stable"))


def scored(truth: GroundTruth, results: dict[str, list[Track]]) -> dict[str, PeopleEvaluation]:
    return {name: evaluate_sequences([SequencePair("", truth, one, LENGTH)]) for name, one in results.items()}


def make_report(tmp_path: Path) -> Report:
    truth = truth_of(walk(1, range(LENGTH), 0), walk(2, range(5, 15), 100))
    video = tmp_path / "o.webm"
    video.write_bytes(b"video bytes")
    results = {"good": [walk(8, range(LENGTH), 0)], NASTY: [walk(3, range(10), 0), walk(4, range(10, 20), 0)]}
    return Report(NASTY, NASTY, truth, results, scored(truth, results), LENGTH, video, {NASTY: 1.0}, {NASTY: NASTY})


class Page(HTMLParser):
    """What a browser would see: elements in order, whether they close, and the text."""

    VOID = frozenset({"meta", "br", "img", "use", "path", "rect"})

    def __init__(self, page: str) -> None:
        super().__init__()
        self.seen: list[str] = []
        self.open: list[str] = []
        self.links: list[str] = []
        self.text = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def test_the_page_is_whole_and_needs_nothing_else(tmp_path: Path) -> None:
    text = report_page(make_report(tmp_path))
    page = Page(text)
    assert page.open == []
    assert {"table", "video", "svg"} <= set(page.seen)
    outside = [link for link in page.links if not link.startswith(("#", "data:"))]
    assert outside == []
    assert not re.search(r"@import|url\((?!#)", text)
    assert base64.b64encode(b"video bytes").decode() in text


def test_every_table_and_plot_scrolls_by_itself_or_fits(tmp_path: Path) -> None:
    text = report_page(make_report(tmp_path))
    tables, plots = re.findall(r"<table", text), re.findall(r'<svg class="plot"', text)
    inside = re.findall(r'<div class="wide" tabindex="0"><(?:table|svg class="plot")', text)
    assert len(inside) == len(tables) + len(plots) == 2
    assert len(re.findall(r'<svg class="plot on-(?:wide|narrow)"', text)) == 4


def test_a_timeline_says_seconds_where_the_rate_is_known() -> None:
    bar = Bar(10, 19, "person 1", 1)
    line = Timeline([("person 1", [bar])], 5, 30, 10.0)
    # From 0.5 to 3.5 seconds.
    assert line.ticks == [(pytest.approx(100 * (n - 0.5) / 3), f"{n:g} s") for n in (0.5, 1, 1.5, 2, 2.5, 3, 3.5)]
    assert line.when(bar) == "1.0 to 2.0 s"
    frames = Timeline([("1", [bar])], 0, 20)
    assert [text for _, text in frames.ticks] == ["5", "10", "15", "20"]
    assert frames.when(bar) == "frames 11-20"


def test_settings_read_as_people_write_them() -> None:
    values = {"a": None, "b": [], "on": True, "view": [1, 2], "flow": {"delay": None, "min_time": 0.5}}
    assert words(values) == "on on, view 1, 2, flow min time 0.5"
    page = section("{% import 'parts.html.j2' as parts %}{{ parts.listing(values) }}", values=values)
    assert "None" not in page
    assert "[" not in page
    assert page.count("<dt>") == 3


def test_text_from_inputs_stays_text(tmp_path: Path) -> None:
    page = Page(report_page(make_report(tmp_path)))
    assert "script" not in page.seen
    assert page.text.count(NASTY) >= 8


def test_light_and_dark_screens_take_the_ink_of_the_page(tmp_path: Path) -> None:
    text = report_page(make_report(tmp_path))
    assert "prefers-color-scheme: dark" in text
    assert "currentColor" in text
    assert "#010203" not in text


@pytest.mark.slow
def test_the_page_is_the_same_every_time(tmp_path: Path) -> None:
    assert report_page(make_report(tmp_path)) == report_page(make_report(tmp_path))


@pytest.mark.parametrize("tracks", [[], [walk(1, range(3), 500)]])
def test_results_that_find_nobody_have_a_page_too(tracks: list[Track]) -> None:
    truth = truth_of(walk(1, range(LENGTH), 0))
    report = Report("t", "i", truth, {"m": tracks}, scored(truth, {"m": tracks}), LENGTH)
    assert Page(report_page(report)).open == []


def test_coverage_says_who_followed_whom() -> None:
    truth = truth_of(walk(7, range(10), 0), walk(3, range(4, 8), 100))
    tracks = [walk(1, range(2, 6), 0), walk(2, range(6, 9), 1), walk(5, range(4, 6), 100), walk(6, range(10), 300)]
    first, second = coverage(truth, tracks)
    assert (first.id, first.track_ids.tolist()) == (7, [0, 0, 1, 1, 1, 1, 2, 2, 2, 0])
    assert (second.id, second.frames.tolist(), second.track_ids.tolist()) == (3, [4, 5, 6, 7], [5, 5, 0, 0])
    assert [(s.first, s.last, s.value) for s in spans(first.frames, first.track_ids)] == [
        (0, 1, 0),
        (2, 5, 1),
        (6, 8, 2),
        (9, 9, 0),
    ]


def test_a_large_video_lies_beside_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "over lay.webm").write_bytes(b"video")
    assert video_place(tmp_path / "over lay.webm") == "data:video/webm;base64,dmlkZW8="
    monkeypatch.setattr(rendering, "MOST_EMBEDDED", 4)
    assert video_place(tmp_path / "over lay.webm") == "over%20lay.webm"
    assert video_place(tmp_path / "over lay.webm", inside="left") == "left/over%20lay.webm"


def test_a_section_of_nothing_leaves_no_trace() -> None:
    text = (
        '{% import "parts.html.j2" as parts %}{% call parts.section(head) %}{{ parts.table(["a"], rows) }}{% endcall %}'
    )
    assert section(text, head="a", rows=[]).strip() == ""
    assert "<h2>&lt;b&gt;</h2>" in section(text, head="<b>", rows=[("1",)])


def test_the_panels_of_a_figure_lie_below_each_other_on_a_telephone(tmp_path: Path) -> None:
    report = make_report(tmp_path)
    drawn: list[Figure] = []

    def draw(ink: str) -> Figure:
        drawn.append(comparison_figure(report.scores, ink))
        return drawn[-1]

    inline_svg(draw, "name", narrow=True)
    (figure,) = drawn
    figure.draw_without_rendering()
    above, below = (axes.get_position() for axes in figure.axes)
    assert figure.get_figwidth() == NARROW
    assert above.y0 > below.y1
    assert min(above.width, below.width) > 0.7
    assert not [text for axes in figure.axes for text in axes.texts], "numbers would lie on each other"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_comparison_fits_a_telephone(tmp_path: Path, browser: Any, scheme: str) -> None:
    (tmp_path / "report.html").write_text(report_page(make_report(tmp_path)), encoding="utf-8")
    page = browser.new_page(viewport={"width": 390, "height": 800}, color_scheme=scheme)
    page.goto((tmp_path / "report.html").as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    hidden = "[...document.querySelectorAll('.wide')].filter(part => part.scrollWidth > part.clientWidth)"
    assert page.evaluate(f"{hidden}.length") == 0
    texts = "[...document.querySelectorAll('dd, .on-narrow')].map(part => part.getBoundingClientRect().width)"
    assert min(page.evaluate(texts)) > 250, "what was made how, and the plots, take the width of the screen"
