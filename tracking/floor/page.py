"""Pictures of people on one floor: plan, heat map, and a page that follows each through the cameras."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.fisheye.page import dwell_figure, floor_figure
from tsuiseki.tracking.floor.measured_floor import MeasuredFloor
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.formats.track_tables import table_of
from tsuiseki.tracking.report.overlay import track_colour
from tsuiseki.tracking.report.page import Bar, embedded_overlay, html_page, listing, section, timeline
from tsuiseki.tracking.report.plots import inline_svg
from tsuiseki.tracking.result import Writer
from tsuiseki.tracking.types import BoolArray, Track
from tsuiseki.tracking.types.measurements import PersonOnFloor
from tsuiseki.tracking.types.tracks import FloorTrack

MOST_PEOPLE = 200


def floor_files(
    measured: MeasuredFloor,
    people: Sequence[PersonOnFloor],
    tracks: Sequence[Sequence[Track]],
    seconds: Mapping[str, float],
    made: Mapping[str, Any],
) -> dict[str, Writer]:
    """What a run writes, by name.

    Args:
        measured: of the run.
        people: that were followed.
        tracks: the same people in each camera.
        seconds: of each stage.
        made: settings of the run.
    """
    walked, plan = [_as_floor_track(one) for one in people], measured.floor
    stands = np.array([feed.placed.camera.position[:2] for feed in measured.feeds]).reshape(-1, 2)
    steps = np.diff(measured.times)
    rate = float(1.0 / np.median(steps)) if len(steps) else 1.0
    files: dict[str, Writer] = {
        "world.csv": lambda path, _: write_places(path, people, measured.names),
        "floor.png": lambda path, _: floor_figure(walked, plan, stands).savefig(path, dpi=120, facecolor="white"),
        "dwell.png": lambda path, _: dwell_figure(walked, plan, rate).savefig(path, dpi=120, facecolor="white"),
    }
    for feed, own in zip(measured.feeds, tracks, strict=True):
        files[f"{feed.placed.name}/tracks.txt"] = partial(_write_tracks, own)

    def page(path: Path, folder: Path) -> None:
        plots = [
            inline_svg(lambda ink: floor_figure(walked, plan, stands, ink), "paths"),
            inline_svg(lambda ink: dwell_figure(walked, plan, rate, ink), "dwell"),
        ]
        videos = [
            section(feed.placed.name, embedded_overlay(folder / feed.placed.name, inside=feed.placed.name))
            for feed in measured.feeds
            if list((folder / feed.placed.name).glob("overlay.*"))
        ]
        sections = [
            section("On the floor", f'<div class="plans">{"".join(plots)}</div>'),
            section("Through the cameras", _followed(people, measured)),
            *videos,
            section("Time in all", listing({name: f"{1000 * v:.0f} ms" for name, v in seconds.items()})),
            section("How it was made", listing({name: str(value) for name, value in made.items()})),
        ]
        introduction = "Each colour and number is one person in all cameras. Triangles are cameras."
        path.write_text(html_page("People on one floor", introduction, sections), encoding="utf-8")

    return {**files, "report.html": page}


def write_places(path: Path, people: Sequence[PersonOnFloor], names: Sequence[str]) -> None:
    """Write a row for each person and moment, with the names of the sensors that detected them."""
    table = table_of(people)
    shown = {"frame": table["frame"] + 1, **{name: table[name] for name in table if name != "frame"}} if people else {}
    heads = [*(shown or ("frame", "time", "id", "x", "y")), "cameras"]
    order = sorted((int(scan), one.id, k) for one in people for k, scan in enumerate(one.scans))
    by_id = {one.id: one for one in people}
    cameras = [" ".join(n for n, s in zip(names, by_id[i].detected[k], strict=True) if s) for _, i, k in order]
    columns = [
        column.tolist() if column.dtype.kind != "f" else [f"{v:.9g}" for v in column.tolist()]
        for column in shown.values()
    ]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(heads)
        writer.writerows(zip(*columns, cameras, strict=True) if people else [])


def _write_tracks(tracks: Sequence[Track], path: Path, _: Path) -> None:
    write_tracks(path, tracks)


def _as_floor_track(one: PersonOnFloor) -> FloorTrack:
    boxes = np.tile([0.0, 0.0, 1.0, 1.0], (len(one), 1))
    return FloorTrack(Track(one.id, one.scans, boxes, one.existence), np.zeros((len(one), 5)), one.positions)


def _followed(people: Sequence[PersonOnFloor], measured: MeasuredFloor) -> str:
    """For each person, to unfold, the times at which each sensor detected them."""
    length = len(measured.moments)
    chosen = sorted(sorted(people, key=len, reverse=True)[:MOST_PEOPLE], key=lambda one: one.id)
    parts = []
    for one in chosen:
        colour = "#{:02x}{:02x}{:02x}".format(*track_colour(one.id))
        rows = [
            (name, _bars(one, one.detected[:, k])) for k, name in enumerate(measured.names) if one.detected[:, k].any()
        ]
        lines = timeline(rows, 0, length, f"person{one.id}")
        walked = float(np.linalg.norm(np.diff(one.positions, axis=0), axis=1).sum())
        head = f"{one.times[0]:.1f} to {one.times[-1]:.1f} s, {walked:.0f} m, {', '.join(escape(n) for n, _ in rows)}"
        mark = f'<b style="color:{colour}">■</b>'
        parts.append(f"<details><summary>{mark} {one.id}: {head}</summary>{lines}</details>")
    left = len(people) - len(chosen)
    return "".join(parts) + (f"<p>The {left} shortest are left out here.</p>" if left else "")


def _bars(one: PersonOnFloor, cameras: BoolArray) -> list[Bar]:
    """Segments of moments at which a sensor detected a person."""
    moments = one.scans[cameras]
    runs = np.split(moments, np.flatnonzero(np.diff(moments) > 1) + 1)
    return [Bar(int(run[0]), int(run[-1]), f"person {one.id}", one.id) for run in runs if len(run)]
