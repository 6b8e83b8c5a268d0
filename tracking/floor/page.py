"""Pictures of people on one floor: plan, heat map, and a page that follows each through the cameras."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.fisheye.page import dwell_figure, floor_figure
from tsuiseki.tracking.floor.measured_floor import MeasuredFloor
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.formats.track_tables import table_of
from tsuiseki.tracking.report.overlay import track_colour
from tsuiseki.tracking.report.page import Bar, Timeline
from tsuiseki.tracking.report.rendering import overlay_in, render
from tsuiseki.tracking.result import Writer
from tsuiseki.tracking.types import BoolArray, Track
from tsuiseki.tracking.types.measurements import PersonOnFloor
from tsuiseki.tracking.types.tracks import FloorTrack

# People on the page at most, those followed longest.
MOST_PEOPLE = 200


def floor_files(
    measured: MeasuredFloor,
    people: Sequence[PersonOnFloor],
    tracks: Sequence[Sequence[Track]],
    seconds: Mapping[str, float],
    run_settings: Mapping[str, Any],
) -> dict[str, Writer]:
    """What a run writes, by name.

    Args:
        measured: of the run.
        people: that were followed.
        tracks: the same people in each camera.
        seconds: of each stage.
        run_settings: kept with the result.
    """
    walked, plan = [_as_floor_track(person) for person in people], measured.floor
    stands = np.array([feed.placed.camera.position[:2] for feed in measured.feeds]).reshape(-1, 2)
    steps = np.diff(measured.times)
    rate = float(1.0 / np.median(steps)) if len(steps) else 1.0
    files: dict[str, Writer] = {
        "world.csv": lambda path, _: write_places(path, people, measured.names),
        "floor.png": lambda path, _: floor_figure(walked, plan, stands).savefig(path, dpi=120, facecolor="white"),
        "dwell.png": lambda path, _: dwell_figure(walked, plan, rate).savefig(path, dpi=120, facecolor="white"),
    }
    for feed, camera_tracks in zip(measured.feeds, tracks, strict=True):
        files[f"{feed.placed.name}/tracks.txt"] = partial(_write_tracks, camera_tracks)

    def page(path: Path, folder: Path) -> None:
        names = [feed.placed.name for feed in measured.feeds]
        longest = sorted(people, key=len, reverse=True)[:MOST_PEOPLE]
        text = render(
            "floor.html.j2",
            title="People on one floor",
            introduction="Each colour and number is one person in all cameras. Triangles are cameras.",
            paths=partial(floor_figure, walked, plan, stands),
            dwell=partial(dwell_figure, walked, plan, rate),
            people=[_followed(person, measured, rate) for person in sorted(longest, key=lambda person: person.id)],
            left_out=len(people) - len(longest),
            overlays={name: overlay for name in names if (overlay := overlay_in(folder / name))},
            seconds={name: f"{1000 * spent:.0f} ms" for name, spent in seconds.items()},
            made=run_settings,
        )
        path.write_text(text, encoding="utf-8")

    return {**files, "report.html": page}


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
