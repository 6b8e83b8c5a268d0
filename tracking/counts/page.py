"""`report.html` of tracks, the same for all that is followed: who was where and when, in pictures, plots and tables.

Beside the page lies each plot as PNG, and its numbers as CSV.
"""

from __future__ import annotations

import csv
import json
import warnings
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import cv2
import numpy as np

from tsuiseki.tracking.counts.answer_plots import (
    FIGURES,
    heat_table,
    heat_values,
    matrix,
    path_table,
    seconds_in_cells,
)
from tsuiseki.tracking.counts.counting import Answers, Table, count
from tsuiseki.tracking.counts.scene import Scene
from tsuiseki.tracking.counts.settings import CountSettings
from tsuiseki.tracking.errors import InputWarning, RequestError, RunError
from tsuiseki.tracking.output import destination
from tsuiseki.tracking.report.local_page import address_of
from tsuiseki.tracking.report.page import BOXES_NOTE, Timeline
from tsuiseki.tracking.report.pictures import (
    Pictures,
    frames_to_show,
    heat_picture,
    part_with,
    paths_picture,
    pictures_of,
    with_axes,
)
from tsuiseki.tracking.report.rendering import overlay_in, render
from tsuiseki.tracking.report.track_bars import counted, followed
from tsuiseki.tracking.result import MotionContent, PageContent, Result, Writer
from tsuiseki.tracking.runs.origin import how_made
from tsuiseki.tracking.types import FloatArray, ImageArray, Track
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.types.tracks import boxes_about
from tsuiseki.tracking.video.source import file_of, open_source, some_frames

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tsuiseki.tracking.evaluation.quality import Quality

AnyResult = TypeVar("AnyResult", bound=Result[Any])
# Rows of a table on the page, and tracks with crops; the files have all.
MOST = 100
# Endings of the columns that hold the ends of an interval.
ENDS = ("low", "high")
HEADINGS = {
    ("zones", "people"): "people at a time", ("zones", "most"): "most at a time", ("zones", "stay"): "stay, s",
    ("zones", "longest"): "longest stay, s", ("zones", "density"): "people a square metre",
    ("gatherings", "start"): "start, s", ("gatherings", "end"): "end, s", ("gatherings", "most"): "most at a time",
}  # fmt: skip
DOUBT_NOTE = " A thin one with a question mark rather shows nobody, or somebody a second time."
UNITS = {"filled": "filled in, s", "changed": "chance of a mix-up",
         "nobody": "chance of nobody", "first": "first in view, s", "last": "last in view, s",
         "seconds": "in view, s", "path": "path, px", "metres": "path, m", "speed": "speed, m/s"}  # fmt: skip


def with_page(result: AnyResult) -> AnyResult:
    """A result that also writes ``report.html``, with its plots and numbers in ``report/``; see `PageContent`."""
    return replace(result, files={**result.files, **TrackedPage(result).files()})


@dataclass(frozen=True)
class PeopleRows:
    """The table of all that was followed, as the page shows it.

    Attributes:
        headings: of the columns behind the id.
        rows: their cells, by id.
        count: of all rows, those left out included.
        file: name of the file that has all.
    """

    headings: Sequence[str]
    rows: Mapping[int, Sequence[str]]
    count: int
    file: str


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
    def motion(self) -> MotionContent | None:
        """How the tracks move; None where the page says of them what it says of people."""
        return None if self.content.motion is None else self.content.motion(self.result.tracks)

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
        if clear or not numbers or file_of(place) is None:
            return Pictures()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                source = open_source(place, FrameRange(numbers[0], numbers[-1]))
            self.result.check_source(source, numbers[-1])
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                frames = some_frames(source, numbers) if source.has_images else iter(())
                return pictures_of(self.hide(frames) if self.hide else frames, self.tracks)
        except (RequestError, RunError) as error:
            warnings.warn(f"{error}; the page is without its pictures", InputWarning, stacklevel=2)
            return Pictures()

    @cached_property
    def _pixels(self) -> FloatArray:
        return self.answers.scene.pixels(self.answers.paths.points)

    @cached_property
    def drawn(self) -> dict[str, ImageArray]:
        """The pictures of paths and of places."""
        answers, view, ids = self.answers, self.pictures.view, self.answers.paths.ids
        edges = np.flatnonzero(np.diff(ids, prepend=-1))
        ways = dict(zip(ids[edges].tolist(), np.split(self._pixels, edges[1:]), strict=True)) if len(ids) else {}
        places = {name: answers.scene.pixels(points) for name, points in answers.scene.places()}
        part = part_with(self._pixels, answers.size) if self.motion else None
        scale = 1000 * self.content.scale if self.content.scale else None
        values = heat_values(answers, self._pixels)
        if part is not None:
            values = seconds_in_cells(answers, self._pixels), "s in a cell"
        return {
            "paths": with_axes(paths_picture(view, answers.size, ways, places), answers.size, part, scale),
            "places": heat_picture(view, answers.size, *values, places, part, scale),
        }

    def files(self) -> dict[str, Writer]:
        """What writes each file, as for `Result.files`."""
        names = self._given.tables if self._given else ("people", "counts", *(() if self.motion else ("sides",)))
        tables: dict[str, Callable[[], Table]] = {
            **{self._file(name): partial(self.table, name) for name in names},
            "paths": lambda: path_table(self.answers, self._pixels),
            "places": lambda: heat_table(self.answers, self._pixels),
            **({"motion": self.motion.table} if self.motion else {}),
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

    def sections(self) -> list[str]:
        """HTML of further sections."""
        return [*self.content.sections(), *(self.motion.sections() if self.motion else ())]

    def table(self, name: str) -> Table:
        """A table of the answers, as its file has it: with the columns of the content, and its nouns."""
        table = self.answers.tables[name]
        if name == "people" and self.motion:
            times = {column: table[column] for column in ("id", "first", "last", "seconds")}
            moving = self.motion.columns()
            return times | {_plain(head): [values[who] for who in table["id"]] for head, values in moving.items()}
        return {self.nouns[1] if column == "people" else column: values for column, values in table.items()}

    def _who(self, tracks: Sequence[Track]) -> str:
        """How many there are: of people the different ones, with an interval, and the tracks."""
        visitors, who = self.answers.visitors, counted(tracks, self.nouns)
        if visitors is None or not len(visitors.tracks) or len(visitors.tracks) < len(tracks):
            return who
        people = self.nouns[visitors.high != 1]
        return f"About {visitors} different {people}, in {len(tracks)} track{'s' * (len(tracks) != 1)},"

    def _file(self, table: str) -> str:
        return self.nouns[1] if table == "people" and self._given is None else table

    def _plot(self, name: str, path: Path) -> None:
        FIGURES[name](self.answers, "black").savefig(path, facecolor="white")

    def _picture(self, name: str, path: Path) -> None:
        path.write_bytes(cv2.imencode(".png", self.drawn[name][..., ::-1])[1].tobytes())

    def _write_json(self, path: Path) -> None:
        path.write_text(json.dumps(self.answers.tables, indent=1) + "\n", encoding="utf-8")

    def html(self, folder: Path) -> str:
        """The page, self-contained; it shows the overlay that lies in ``folder``, where one does."""
        result, rate = self.result, self.answers.frame_rate
        numbers = result.frames.get("frame", ()) or range(self.answers.length)
        first, length = (numbers[0], numbers[-1] - numbers[0] + 1) if len(numbers) else (0, 0)
        boxes = all(isinstance(getattr(track, "track", track), Track) for track in result)
        who = self._who(boxes_about(result, result.names))
        doubtful = [] if self.answers.visitors is None else self.answers.visitors.doubtful.tolist()
        return render(
            "tracked.html.j2",
            title=f"{self.nouns[1].capitalize()} in {result.name}",
            introduction=f"{who} in {len(numbers)} frames at {rate:g} a second: {len(numbers) / rate:.1f} seconds.",
            page=self,
            asked=self._given is not None,
            most=MOST,
            frames=len(numbers),
            overlay=overlay_in(folder),
            review=partial(address_of, destination(folder)),
            note=BOXES_NOTE.replace("person", self.nouns[0]) + DOUBT_NOTE * bool(doubtful) if boxes else "",
            bars=Timeline(
                [followed(track, self.nouns[0], track.id in doubtful) for track in self.tracks], first, length, rate
            ),
            made=self._made(),
        )

    def _made(self) -> dict[str, Any]:
        """How it was made: the source, what was asked for, the share of boxes that are detections, and the versions."""
        boxes = [track.observed for track in boxes_about(self.result, self.result.names)]
        share = f"{100 * np.concatenate(boxes).mean():.0f} %" if boxes else None
        return how_made(self.result.settings, self.result.facts, {"boxes that a detection supports": share})

    @cached_property
    def quality(self) -> Quality | str:
        """How good the tracks probably are, or why that is not known; empty where the page does not say it."""
        try:
            return self.result.quality() if self.content.quality else ""
        except RequestError as error:
            return f"Not known: {error}."

    def scores(self) -> list[list[str]]:
        """The estimated scores, a row each: its name, and the estimate with its interval."""
        from tsuiseki.tracking.evaluation.tables import quality_cells

        return [] if isinstance(self.quality, str) else [[*row] for row in quality_cells(self.quality).items()]

    def figure(self, name: str) -> Callable[[str], Figure]:
        """The plot of a table, by the colour of its text."""
        return partial(FIGURES[name], self.answers)

    def headings(self, name: str) -> list[str]:
        """Of the columns of a table, but the ends of intervals, which stand with their numbers."""
        names = (column for column in self._columns(name) if not column.endswith(ENDS))
        texts = (HEADINGS.get((name, column), column.replace("_", " ")) for column in names)
        return [text.replace("people", self.nouns[1]) for text in texts]

    def rows(self, name: str) -> list[list[str]]:
        """The cells of a table, row by row."""
        table = self._columns(name)
        return [_cells(dict(zip(table, row, strict=True))) for row in zip(*table.values(), strict=True)]

    def _columns(self, name: str) -> Table:
        """The columns of a table that say something."""
        table = self.answers.tables[name]
        return {column: values for column, values in table.items() if any(value not in (None, "") for value in values)}

    def ways(self, name: str) -> list[list[str]]:
        """How many went from where to where: headings, then a row for each origin; nothing where nobody did."""
        table = self.answers.tables[name]
        if not table["count"] or self.motion:
            return []
        origins, destinations, counts = matrix(table)
        rows = zip(origins, counts.tolist(), strict=True)
        return [["from / to", *destinations], *([origin, *map(str, row)] for origin, row in rows)]

    def people(self) -> PeopleRows:
        """A row for each track that is shown: times, path, and time in zones."""
        table, stays = self.answers.tables["people"], self.answers.tables["stays"]
        if self.motion:
            table = {name: table[name] for name in ("id", "first", "last", "seconds")}
            table |= {name: [values[who] for who in table["id"]] for name, values in self.motion.columns().items()}
        within = defaultdict[tuple[int, str], float](float)
        for who, zone, seconds in zip(*(stays[name] for name in ("id", "zone", "seconds")), strict=True):
            within[who, zone] += seconds
        names = [name for name in table if name not in ("id", "class") or (name == "class" and any(table[name]))]
        zones, ids = [zone.name for zone in self.answers.scene.zones], {track.id for track in self.tracks}
        rows = {
            who: [
                *(cell_text(table[name][number]) for name in names),
                *(cell_text(within[who, zone]) for zone in zones),
            ]
            for number, who in enumerate(table["id"])
            if who in ids
        }
        headings = [*(UNITS.get(name, name) for name in names), *(f"{zone}, s" for zone in zones)]
        return PeopleRows(headings, rows, len(table["id"]), self._file("people"))


def _plain(heading: str) -> str:
    """A heading as the name of a column.

    >>> _plain("speed, mm/s")
    'speed_mm_s'
    """
    return heading.replace(", ", "_").replace("/", "_").replace(" ", "_")


def _alone(write: Callable[[Path], object], path: Path, _: Path) -> object:
    return write(path)


def _cells(row: Mapping[str, Any]) -> list[str]:
    """The cells of a row; a number stands with the ends of its interval, where it has some."""
    cells = []
    for name in (name for name in row if not name.endswith(ENDS)):
        # Of `count` the ends are `low` and `high`, of `stay` they are `stay_low` and `stay_high`.
        low, high = (cell_text(row.get(end if name == "count" else f"{name}_{end}")) for end in ENDS)
        cells.append(cell_text(row[name]) if low == high else f"{cell_text(row[name])} ({low}-{high})")
    return cells


def cell_text(value: Any) -> str:
    """Two digits of a number that is none of whole ones, and all that stand before the point.

    >>> [cell_text(value) for value in (1234.5, 12.34, 1.26, 0.0421, 3, None)]
    ['1234', '12', '1.3', '0.042', '3', '']
    """
    if value is None:
        return ""
    if not isinstance(value, float):
        return str(value)
    return f"{value:.0f}" if abs(value) >= 10 else f"{value:.2g}"


def write_csv(table: Callable[[], Table], path: Path) -> None:
    """Write a table with a heading."""
    with path.open("w", encoding="utf-8", newline="") as file:
        rows, columns = csv.writer(file, lineterminator="\n"), table()
        rows.writerow(columns)
        rows.writerows(zip(*columns.values(), strict=True))


def summary(answers: Answers) -> Sequence[str]:
    """A line for all people, and for each line and zone."""
    table, zones = answers.tables["lines"], answers.tables["zones"]
    visitors = answers.visitors
    head = [f"about {visitors} different people, in {len(visitors.tracks)} tracks"] if visitors is not None else []
    head += [
        f"{line} {way}: {number} ({low}-{high})" if low != high else f"{line} {way}: {number}"
        for line, way, number, low, high in zip(*table.values(), strict=True)
    ]
    names = ("zone", "people", "people_low", "people_high", "most", "stay", "stay_low", "stay_high")
    return [
        *head,
        *(
            f"{zone}: {people} people on average ({low}-{high}), {peak} at most, {stay} s ({least}-{longest})"
            for zone, people, low, high, peak, stay, least, longest in zip(
                *(map(cell_text, zones[name]) for name in names), strict=True
            )
        ),
    ]
