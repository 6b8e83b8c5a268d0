"""Pictures of people on one floor: plan, heat map, and a page that follows each through the cameras."""

from __future__ import annotations

import csv
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tsuiseki.tracking.counts.page import UNITS, PeopleRows, cell_text, write_csv
from tsuiseki.tracking.errors import InputWarning, RequestError, RunError
from tsuiseki.tracking.fisheye.page import dwell_figure, floor_figure
from tsuiseki.tracking.floor.answers import (
    counts_figure,
    counts_table,
    crops_of_cameras,
    people_table,
    rows_to_show,
)
from tsuiseki.tracking.floor.measured_floor import MeasuredFloor
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.formats.track_tables import table_of
from tsuiseki.tracking.report.overlay import track_colour
from tsuiseki.tracking.report.page import Bar, Timeline
from tsuiseki.tracking.report.rendering import overlay_in, render
from tsuiseki.tracking.report.track_bars import PERSON
from tsuiseki.tracking.result import Writer
from tsuiseki.tracking.runs.following import count
from tsuiseki.tracking.runs.origin import how_made
from tsuiseki.tracking.types import BoolArray, ImageArray, Track
from tsuiseki.tracking.types.measurements import PersonOnFloor
from tsuiseki.tracking.types.tracks import FloorTrack
from tsuiseki.tracking.video.source import Source, some_frames

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# People on the page at most, those followed longest.
MOST_PEOPLE = 100


@dataclass(frozen=True)
class FloorPage:
    """What a run over a floor writes.

    Attributes:
        measured: of the run.
        people: that were followed.
        tracks: the same people in each camera.
        sources: the video of each camera, for pictures of people; none where there are only detections.
        seconds: of each stage.
        settings: kept with the result.
        facts: likewise.
    """

    measured: MeasuredFloor
    people: Sequence[PersonOnFloor]
    tracks: Sequence[Sequence[Track]]
    sources: Sequence[Source]
    seconds: Mapping[str, float]
    settings: Mapping[str, Any]
    facts: Mapping[str, Any]

    @property
    def rate(self) -> float:
        """Moments a second."""
        steps = np.diff(self.measured.times)
        return float(1.0 / np.median(steps)) if len(steps) else 1.0

    @property
    def names(self) -> list[str]:
        """Of the cameras."""
        return [feed.placed.name for feed in self.measured.feeds]

    def files(self) -> dict[str, Writer]:
        """What writes each file, by name."""
        paths, dwell, counts = self._plots()
        files: dict[str, Writer] = {
            "world.csv": lambda path, _: write_places(path, self.people, self.measured.names),
            "floor.png": lambda path, _: paths("black").savefig(path, dpi=120, facecolor="white"),
            "dwell.png": lambda path, _: dwell("black").savefig(path, dpi=120, facecolor="white"),
            "report/people.csv": lambda path, _: write_csv(self._table, path),
            "report/counts.csv": lambda path, _: write_csv(
                partial(counts_table, self.people, self.measured.times), path
            ),
            "report/counts.png": lambda path, _: counts("black").savefig(path, facecolor="white"),
        }
        for name, of_camera in zip(self.names, self.tracks, strict=True):
            files[f"{name}/tracks.txt"] = partial(_write_tracks, of_camera)
        return {**files, "report.html": lambda path, folder: path.write_text(self.html(folder), encoding="utf-8")}

    def html(self, folder: Path) -> str:
        """The page, self-contained; it shows the overlays that lie in folders of ``folder``."""
        longest = sorted(self.people, key=len, reverse=True)[:MOST_PEOPLE]
        ids, times = {person.id for person in longest}, self.measured.times
        duration = float(times[-1] - times[0]) if len(times) else 0.0
        supported = np.concatenate([np.empty(0, np.bool_), *(person.detected.any(axis=1) for person in self.people)])
        quality = f"{100 * supported.mean():.0f} %" if len(supported) else None
        paths, dwell, counts = self._plots()
        return render(
            "floor.html.j2",
            title="People on one floor",
            introduction=f"{count(len(self.people), *PERSON)} before {count(len(self.names), 'camera', 'cameras')} in "
            f"{duration:.1f} seconds. Each colour and number is one person in all of them; triangles are cameras.",
            paths=paths,
            dwell=dwell,
            people=_rows(self._table(), ids),
            crops=_crops(self.sources, self.tracks, ids),
            counts=counts,
            followed=[_followed(person, self.measured, self.rate) for person in self.people if person.id in ids],
            left_out=len(self.people) - len(longest),
            overlays={name: overlay for name in self.names if (overlay := overlay_in(folder / name))},
            seconds=self.seconds,
            moments=len(times),
            made=how_made(self.settings, self.facts, {"places that a camera supports": quality}),
        )

    def _table(self) -> Mapping[str, Sequence[Any]]:
        return people_table(self.people, self.measured.names)

    def _plots(self) -> tuple[Callable[[str], Figure], Callable[[str], Figure], Callable[[str], Figure]]:
        """Paths, time spent, and how many at a time, by the colour of their text."""
        walked, plan = [_as_floor_track(person) for person in self.people], self.measured.floor
        stands = np.array([feed.placed.camera.position[:2] for feed in self.measured.feeds]).reshape(-1, 2)
        return (
            partial(floor_figure, walked, plan, stands),
            partial(dwell_figure, walked, plan, self.rate),
            partial(counts_figure, self.people, self.measured.times),
        )


def write_places(path: Path, people: Sequence[PersonOnFloor], names: Sequence[str]) -> None:
    """Write a row for each person and moment, with the names of the sensors that detected them."""
    table = table_of(people)
    fields = {"frame": table["frame"] + 1, **{name: table[name] for name in table if name != "frame"}} if people else {}
    heads = [*(fields or ("frame", "time", "id", "x", "y")), "cameras"]
    order = sorted((int(scan), person.id, k) for person in people for k, scan in enumerate(person.scans))
    by_id = {person.id: person for person in people}
    cameras = [" ".join(n for n, s in zip(names, by_id[i].detected[k], strict=True) if s) for _, i, k in order]
    columns = [
        column.tolist() if column.dtype.kind != "f" else [f"{v:.9g}" for v in column.tolist()]
        for column in fields.values()
    ]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(heads)
        writer.writerows(zip(*columns, cameras, strict=True) if people else [])


def _rows(table: Mapping[str, Sequence[Any]], ids: set[int]) -> PeopleRows:
    """The rows of `people_table` of these ``ids``, as the page shows them: how many cameras, not which."""
    table = {**table, "cameras": [len(names.split()) for names in table["cameras"]]}
    names = [name for name in table if name != "id"]
    rows = {who: [cell_text(table[name][row]) for name in names] for row, who in enumerate(table["id"]) if who in ids}
    return PeopleRows([UNITS.get(name, name) for name in names], rows, len(table["id"]), "people")


def _crops(sources: Sequence[Source], tracks: Sequence[Sequence[Track]], ids: set[int]) -> dict[int, list[ImageArray]]:
    """Crops of the people of these ``ids``; none where a camera has no pictures, or they are gone."""
    if not sources or not all(source.has_images for source in sources):
        return {}
    rows = rows_to_show([[track for track in of_camera if track.id in ids] for of_camera in tracks])
    numbers = [sorted({int(track.frames[0]) for track in of_camera}) for of_camera in rows]
    try:
        return crops_of_cameras([some_frames(s, n) for s, n in zip(sources, numbers, strict=True)], rows)
    except (RequestError, RunError) as error:
        warnings.warn(f"{error}; the page is without its pictures", InputWarning, stacklevel=2)
        return {}


def _write_tracks(tracks: Sequence[Track], path: Path, _: Path) -> None:
    write_tracks(path, tracks)


def _as_floor_track(person: PersonOnFloor) -> FloorTrack:
    boxes = np.tile([0.0, 0.0, 1.0, 1.0], (len(person), 1))
    return FloorTrack(
        Track(person.id, person.scans, boxes, person.existence), np.zeros((len(person), 5)), person.positions
    )


@dataclass(frozen=True)
class FollowedPerson:
    """A person on the page: the colour of the id, a line about them, and when each sensor detected them."""

    identity: int
    colour: str
    summary: str
    line: Timeline


def _followed(person: PersonOnFloor, measured: MeasuredFloor, rate: float) -> FollowedPerson:
    rows = [
        (name, _bars(person, cameras))
        for name, cameras in zip(measured.names, person.detected.T, strict=True)
        if cameras.any()
    ]
    metres = float(np.linalg.norm(np.diff(person.positions, axis=0), axis=1).sum())
    stay = f"{person.times[0]:.1f} to {person.times[-1]:.1f} s, {metres:.0f} m"
    return FollowedPerson(
        person.id,
        "#{:02x}{:02x}{:02x}".format(*track_colour(person.id)),
        ", ".join([stay, *(name for name, _ in rows)]),
        Timeline(rows, 0, len(measured.moments), rate),
    )


def _bars(person: PersonOnFloor, cameras: BoolArray) -> list[Bar]:
    """Segments of moments at which a sensor detected a person."""
    moments = person.scans[cameras]
    runs = np.split(moments, np.flatnonzero(np.diff(moments) > 1) + 1)
    return [Bar(int(run[0]), int(run[-1]), f"person {person.id}", person.id) for run in runs if len(run)]
