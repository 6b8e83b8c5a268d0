"""`report.html` of tracks, the same for all that is followed: who was where and when, in pictures, plots and tables.

Beside the page lies each plot as PNG, and its numbers as CSV.
"""

from __future__ import annotations

import csv
import json
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from html import escape
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np

from tsuiseki.tracking.counts.answer_plots import FIGURES, heat_table, heat_values, matrix, path_table
from tsuiseki.tracking.counts.counting import Answers, Table, count
from tsuiseki.tracking.counts.scene import Scene
from tsuiseki.tracking.counts.settings import CountSettings
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.report.page import (
    BOXES_NOTE,
    embedded_image,
    embedded_overlay,
    html_page,
    html_table,
    listing,
    scrolling,
    seconds_table,
    section,
    timeline,
)
from tsuiseki.tracking.report.pictures import Pictures, frames_to_show, heat_picture, paths_picture, pictures_of
from tsuiseki.tracking.report.plots import inline_svg
from tsuiseki.tracking.report.track_bars import counted, followed
from tsuiseki.tracking.result import PageContent, Result, Writer
from tsuiseki.tracking.types import FloatArray, ImageArray, Track
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.types.tracks import boxes_about
from tsuiseki.tracking.video.source import open_source, some_frames

AnyResult = TypeVar("AnyResult", bound=Result[Any])
MOST = 100
"""Rows of a table on the page, and tracks with crops; the files have all."""
UNITS = {"first": "first in view, s", "last": "last in view, s", "seconds": "in view, s", "path": "path, px",
         "metres": "path, m", "speed": "speed, m/s"}  # fmt: skip
INTERVAL = "<p class=note>low and high are the ends of an interval that holds the true number in 9 of 10 cases.</p>"
BARS = "<p class=note>A bar is the time of a track, pale where no detection supports it.</p>"


def with_page(result: AnyResult) -> AnyResult:
    """A result that also writes ``report.html``, with its plots and numbers in ``report/``; see `PageContent`."""
    return replace(result, files={**result.files, **TrackedPage(result).files()})


class TrackedPage:
    """The page of a result, and the files beside it.

    Args:
        result: with boxes, or of animals.
        answers: to show and write; by default those without lines and zones, whose files lie in ``report/``.
    """

    def __init__(self, result: Result[Any], answers: Answers | None = None) -> None:
        self.result, self.content = result, result.page or PageContent()
        self.nouns, self.hide = self.content.nouns, self.content.hide
        self.inside = "report/" if answers is None else ""
        self._given = answers

    @cached_property
    def answers(self) -> Answers:
        """What is shown."""
        rate = self.result.frame_rate or 1.0
        scene, settings = Scene(scale=self.content.scale), CountSettings(anchor=self.content.anchor)
        return self._given or count(self.result, scene, settings, frame_rate=rate)

    @cached_property
    def tracks(self) -> list[Track]:
        """Those that the page shows: the longest, by id."""
        longest = sorted(boxes_about(self.result, self.result.names), key=lambda track: -len(track))[:MOST]
        return sorted(longest, key=lambda track: track.id)

    @cached_property
    def pictures(self) -> Pictures:
        """Of the video; none where it is not at hand, or people are hidden in the result and nothing hides them."""
        place, numbers = self.result.source, frames_to_show(self.tracks)
        clear = self.result.settings.get("hide") and self.hide is None
        if clear or not numbers or not place or not Path(place).exists():
            return Pictures()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                source = open_source(place, FrameRange(numbers[0], numbers[-1]))
                frames = some_frames(source, numbers) if source.has_images else iter(())
                return pictures_of(self.hide(frames) if self.hide else frames, self.tracks)
            except (RequestError, RunError):  # it is another video now
                return Pictures()

    @cached_property
    def _pixels(self) -> FloatArray:
        return self.answers.scene.pixels(self.answers.paths.points)

    @cached_property
    def _drawn(self) -> dict[str, ImageArray]:
        """The pictures of paths and of places."""
        answers, view, ids = self.answers, self.pictures.view, self.answers.paths.ids
        edges = np.flatnonzero(np.diff(ids, prepend=-1))
        ways = dict(zip(ids[edges].tolist(), np.split(self._pixels, edges[1:]), strict=True)) if len(ids) else {}
        places = {name: answers.scene.pixels(points) for name, points in answers.scene.places()}
        return {
            "paths": paths_picture(view, answers.size, ways, places),
            "places": heat_picture(view, answers.size, *heat_values(answers, self._pixels), places),
        }

    def files(self) -> dict[str, Writer]:
        """What writes each file, as for `Result.files`."""
        names = self._given.tables if self._given else ("people", "counts", "sides")
        tables: dict[str, Callable[[], Table]] = {
            **{self._file(name): partial(self.answers.tables.__getitem__, name) for name in names},
            "paths": lambda: path_table(self.answers, self._pixels),
            "places": lambda: heat_table(self.answers, self._pixels),
        }
        writers: dict[str, Callable[[Path], object]] = {
            **{f"{name}.csv": partial(write_csv, table) for name, table in tables.items()},
            **{f"{name}.png": partial(self._plot, name) for name in FIGURES if name in tables},
            **{f"{name}.png": partial(self._picture, name) for name in ("paths", "places")},
            **({} if self._given is None else {"answers.json": self._write_json}),
        }
        files: dict[str, Writer] = {f"{self.inside}{name}": partial(_alone, write) for name, write in writers.items()}
        files["report.html"] = lambda path, folder: path.write_text(self.html(folder), encoding="utf-8")
        return files

    def _file(self, table: str) -> str:
        return self.nouns[1] if table == "people" and self._given is None else table

    def _plot(self, name: str, path: Path) -> None:
        FIGURES[name](self.answers, "black").savefig(path, facecolor="white")

    def _picture(self, name: str, path: Path) -> None:
        path.write_bytes(cv2.imencode(".png", self._drawn[name][..., ::-1])[1].tobytes())

    def _write_json(self, path: Path) -> None:
        path.write_text(json.dumps(self.answers.tables, indent=1) + "\n", encoding="utf-8")

    def html(self, folder: Path) -> str:
        """The page, self-contained; it shows the overlay that lies in ``folder``, where one does."""
        result, several, rate = self.result, self.nouns[1], self.answers.frame_rate
        numbers = result.frames.get("frame", ()) or range(self.answers.length)
        first, length = (numbers[0], numbers[-1] - numbers[0] + 1) if len(numbers) else (0, 0)
        bars = timeline([followed(track, self.nouns[0]) for track in self.tracks], first, length, "timeline")
        boxes = all(isinstance(getattr(one, "track", one), Track) for one in result)
        note = BOXES_NOTE.replace("person", self.nouns[0]) if boxes else ""
        made = {name: str(result.settings[name]) for name in ("method", "source") if name in result.settings}
        sections = [
            section("Tracks", embedded_overlay(folder, label="tracks", note=note)),
            section("Crossings of lines", self._table("lines", INTERVAL, "crossings")),
            section("Zones", self._table("zones", INTERVAL, "occupancy")),
            section(several.capitalize(), self._everybody() or f"<p>No {several} were followed.</p>"),
            section("How many at a time", self._svg("counts")),
            section("All paths", self._image("paths", "All paths, each with its number at its end.")),
            section("Where they were", self._image("places", "The brighter, the more time was spent there.")),
            section("From line to line", self._ways("turns")),
            section("From side to side of the picture", self._ways("sides")),
            section("Gatherings", self._table("gatherings") if self._given else ""),
            section("Who was followed when", bars and bars + BARS),
            *self.content.more(),
            section("Time", seconds_table(result.seconds, len(numbers))),
            section("How it was made", listing(made)),
        ]
        who = counted(boxes_about(result, result.names), self.nouns)
        introduction = f"{who} in {len(numbers)} frames at {rate:g} a second: {len(numbers) / rate:.1f} seconds."
        return html_page(f"{several.capitalize()} in {result.name}", introduction, sections)

    def _everybody(self) -> str:
        """A row for each track that is shown: crops, times, path, and time in zones."""
        table, stays = self.answers.tables["people"], self.answers.tables["stays"]
        within = Counter[tuple[int, str]]()
        for who, zone, seconds in zip(*(stays[name] for name in ("id", "zone", "seconds")), strict=True):
            within[who, zone] += seconds
        names = [name for name in table if name not in ("id", "class") or (name == "class" and any(table[name]))]
        zones, crops = [zone.name for zone in self.answers.scene.zones], self.pictures.crops
        rows, shown = [], {track.id for track in self.tracks}
        for number, who in enumerate(table["id"]):
            if who in shown:
                images = "".join(embedded_image(crop) for crop in crops.get(who, ()))
                cells = [*(_cell(table[name][number]) for name in names), *(f"{within[who, z]:.1f}" for z in zones)]
                cells = [f'<span class="crops">{images}</span>', *cells] if crops else cells
                rows.append([str(who), *cells])
        if not rows:
            return ""
        head = ["id", *(["pictures"] if crops else []), *(UNITS.get(n, n) for n in names), *(f"{z}, s" for z in zones)]
        return html_table(head, rows) + self._more_than(len(table["id"]), self._file("people"))

    def _table(self, name: str, note: str = "", plot: str = "") -> str:
        """A table, with a plot below it; nothing where it has no row."""
        table = self.answers.tables[name]
        rows = list(zip(*table.values(), strict=True))
        if not rows:
            return ""
        lines = [[str(first), *map(_cell, rest)] for first, *rest in rows[:MOST]]
        shown = html_table([one.replace("_", " ") for one in table], lines) + note
        return shown + self._more_than(len(rows), name) + (self._svg(plot) if plot else "")

    def _ways(self, name: str) -> str:
        table = self.answers.tables[name]
        if not table["count"]:
            return ""
        origins, destinations, counts = matrix(table)
        rows = [[origin, *map(str, row)] for origin, row in zip(origins, counts.tolist(), strict=True)]
        return html_table(["from, to", *destinations], rows) + self._links(name)

    def _svg(self, name: str) -> str:
        return scrolling(inline_svg(partial(FIGURES[name], self.answers), name)) + self._links(name)

    def _image(self, name: str, alt: str) -> str:
        return f"{embedded_image(self._drawn[name], alt)}<p class=note>{escape(alt)}</p>{self._links(name)}"

    def _links(self, name: str) -> str:
        links = _link(f"{self.inside}{name}.csv", "numbers"), _link(f"{self.inside}{name}.png", "picture")
        return f"<p class=note>{' '.join(links)}</p>"

    def _more_than(self, count: int, name: str) -> str:
        more = f"and {count - MOST} more; " if count > MOST else ""
        return f"<p class=note>{more}{_link(f'{self.inside}{name}.csv', 'numbers')}</p>"


def _link(place: str, text: str) -> str:
    return f'<a href="{place}">{text}</a>'


def _alone(write: Callable[[Path], object], path: Path, _: Path) -> object:
    return write(path)


def _cell(value: Any) -> str:
    return "" if value is None else escape(f"{value:g}" if isinstance(value, float) else str(value))


def write_csv(table: Callable[[], Table], path: Path) -> None:
    """Write a table with a heading."""
    with path.open("w", encoding="utf-8", newline="") as file:
        rows, columns = csv.writer(file, lineterminator="\n"), table()
        rows.writerow(columns)
        rows.writerows(zip(*columns.values(), strict=True))


def summary(answers: Answers) -> Sequence[str]:
    """A line for each line and zone."""
    table, zones = answers.tables["lines"], answers.tables["zones"]
    head = [
        f"{line} {way}: {number} ({low}-{high})" if low != high else f"{line} {way}: {number}"
        for line, way, number, low, high in zip(*table.values(), strict=True)
    ]
    names = ("zone", "people", "people_low", "people_high", "most", "stay", "stay_low", "stay_high")
    return [
        *head,
        *(
            f"{zone}: {people:g} people on average ({low:g}-{high:g}), {most} at most, "
            f"{stay:g} s ({least:g}-{longest:g})"
            for zone, people, low, high, most, stay, least, longest in zip(*(zones[n] for n in names), strict=True)
        ),
    ]
