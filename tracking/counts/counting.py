"""Tracks and a scene in, answers out."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.bounds import as_settings
from tsuiseki.tracking.counts.companions import with_changed_ids, with_hidden
from tsuiseki.tracking.counts.doubt import Doubt
from tsuiseki.tracking.counts.line_tables import Columns, flows, line_tables, sides, turns
from tsuiseki.tracking.counts.paths import Paths, paths_of
from tsuiseki.tracking.counts.scene import Scene, read_scene
from tsuiseki.tracking.counts.settings import CountSettings
from tsuiseki.tracking.counts.visitors import Visitors, visitors_among, with_doubt
from tsuiseki.tracking.counts.zone_tables import counts_table, gathering_table, people, zone_tables
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.label_checks import compare_with_picture
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import FloatArray, IntArray, Track
from tsuiseki.tracking.types.tracks import BodyTrack, boxes_about, frames_up_to

Table = Mapping[str, Sequence[Any]]
"""Columns by name, all of one length."""


@dataclass(frozen=True, eq=False, repr=False)
class Answers:
    """Answers about the people in a video.

    ``tables`` are, with times in seconds from the start of the video and places in the unit of the scene:

    * ``lines``: line, direction, count, low, high; the last two are the ends of an interval of 90 %.
    * ``visitors``: people (how many different ones) with low and high, tracks; of animals it has no row.
    * ``handovers``: time, frame (from 1), id, other (whom it meets there), x, y (feet, pixels), probability that the
      id is another person's afterwards.
    * ``crossings``: time, frame (from 1), id, line, direction, x, y, probability of being real, support, class
      (name, where it is known). Support is ``observed`` where a detection supports the place, ``filled`` where none
      does, and ``doubtful`` of a track that rather shows nobody.
    * ``flows``: start, end, line, direction, count: crossings by interval of time.
    * ``turns``: origin, destination, count: of people who crossed two lines or more, the first and the last of them.
    * ``zones``: zone, entries and exits with low and high, people (mean at a time) with low and high, most (at a time),
      stay (mean seconds) with low and high, longest (seconds), density (people a square metre, where metres are known).
    * ``stays``: zone, id, start, end, seconds, waited (seconds), entered and left (False where it began or ended
      unseen), changed (chance that the id was another person's by the end).
    * ``occupancy``: time, zone, people (mean over the second), low, high, most, waiting (mean).
    * ``counts``: time, people (mean over the second) and most in view.
    * ``sides``: origin, destination, count: from which side of the picture to which everybody went.
    * ``people``: id, first, last, seconds, path (length), metres and speed (m/s) where metres are known, filled
      (seconds without a detection), changed (as of a stay), nobody (probability), class.
    * ``gatherings``: start, end, people (in all), most (at a time), x, y, ids.

    Attributes:
        tables: by name.
        occupancy: by zone the ``(F,)`` number of people in each frame.
        scene: what was counted in.
        length: frames.
        frame_rate: frames a second.
        size: ``(2,)`` width and height of the picture, pixels; where it is not known, of what holds all paths.
        visitors: how many different people there were; None of animals and other targets.
    """

    tables: Mapping[str, Table]
    occupancy: Mapping[str, IntArray]
    scene: Scene
    length: int
    frame_rate: float
    size: FloatArray
    paths: Paths
    visitors: Visitors | None = None

    def __repr__(self) -> str:
        lines, zones = len(self.scene.lines), len(self.scene.zones)
        who = len(self.tables["people"]["id"])
        return f"<Answers: {self.length} frames, people {who}, lines {lines}, zones {zones}>"

    def _repr_html_(self) -> str:
        """For notebooks: what was counted at each line and in each zone."""
        counted = [(name, self.tables[name]) for name in ("lines", "zones") if self.tables[name].keys()]
        tables = [_html_of(name, table) for name, table in counted if len(next(iter(table.values())))]
        return f"<p>{escape(repr(self)[1:-1])}</p>{''.join(tables)}"

    def count(self, line: str, direction: str) -> tuple[int, int, int]:
        """Crossings of a line in a direction, and the ends of the interval of 90 %.

        Raises:
            RequestError: there is no such line or direction.
        """
        table = self.tables["lines"]
        ways = list(zip(table["line"], table["direction"], strict=True))
        if (line, direction) not in ways:
            named = ", ".join(f"{name} {way}" for name, way in ways)
            raise RequestError(f"expected a line and a direction of {named or 'none'}, got {line} {direction}")
        row = ways.index((line, direction))
        return table["count"][row], table["low"][row], table["high"][row]


def _checked_size(result: Result[Any] | Sequence[Track], scene: Scene, where: str) -> tuple[int, int] | None:
    """Width and height of the video of a result, which are those of the scene; None where it does not say them."""
    size: tuple[int, int] | None = getattr(result, "size", None)
    if size is None and scene.size is not None and getattr(result, "source", None):
        text = f"{where}: the result does not say the size of its video, so that it is not compared with the scene's"
        warnings.warn(text, InputWarning, stacklevel=3)
    scene.check_video(size, where)
    return size


def _html_of(name: str, table: Table) -> str:
    head = "".join(f"<th>{escape(column.replace('_', ' '))}</th>" for column in table)
    rows = ["".join(f"<td>{escape(_cell(value))}</td>" for value in row) for row in zip(*table.values(), strict=True)]
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    return f"<table><caption>{name}</caption><tr>{head}</tr>{body}</table>"


def _cell(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def count(
    result: Result[Any] | Sequence[Track],
    scene: Scene | str | Path,
    settings: CountSettings | None = None,
    *,
    frame_rate: float | None = None,
) -> Answers:
    """Who crossed which line, who was in which zone for how long, and how sure that is.

    Args:
        result: of a run, or tracks.
        scene: lines and zones, or the file that has them, see `read_scene`.
        settings: how people are counted.
        frame_rate: frames a second, where the result does not say.

    Raises:
        RequestError: the scene is wrong or of another video's size, an anchor does not fit it, nothing says the frame
            rate, or the result has no boxes.
    """
    settings = as_settings(settings, CountSettings)
    where = "scene" if isinstance(scene, Scene) else str(scene)
    scene = scene if isinstance(scene, Scene) else read_scene(scene)
    result_size = _checked_size(result, scene, where)
    rate: float = getattr(result, "frame_rate", 0.0) if frame_rate is None else frame_rate
    if not 0 < rate < 1e4:
        raise RequestError(f"expected a frame rate above 0, got {rate:g}; give the video's as `fps`")
    if settings.anchor == "floor":
        scene = scene.on_floor()
    tracks, bodies = boxes_about(result, getattr(result, "names", ())), any(isinstance(t, BodyTrack) for t in result)
    if settings.anchor is None and scene.unit == "pixels" and bodies:
        settings = replace(settings, anchor="centre")
    paths = paths_of(tracks, scene, settings)
    frames = getattr(result, "frames", {}).get("frame", ())
    first, length = min(frames, default=0), frames_up_to(frames, tracks)
    picture_size = scene.size or result_size
    if result_size is None and not bodies:  # one that knows its picture was tracked in it
        compare_with_picture("the result", np.concatenate([np.empty((0, 4)), *(t.boxes for t in tracks)]), picture_size)
    # Who may have been hidden counts at lines and in zones. Animals are filmed from above: none hides another.
    chains = with_changed_ids(tracks) if bodies else with_hidden(tracks, picture_size, length, rate)
    extended = paths_of(chains, scene, settings)
    size = np.asarray(picture_size or scene.pixels(paths.points).max(axis=0, initial=1.0), dtype=np.float64)
    span, doubt = (first, length), Doubt(extended, scene, rate, length)
    visitors = None if bodies else visitors_among(result, tracks, rate, picture_size, length)
    doubtful = np.empty(0, np.int64) if visitors is None else visitors.doubtful
    lines, crossings = line_tables(extended, scene, settings, doubt, doubtful)
    zones, occupancy = zone_tables(extended, scene, settings, doubt, span)
    tables = {
        "lines": lines,
        "crossings": crossings,
        "flows": flows(scene, crossings, settings.interval, length / rate),
        "turns": turns(crossings, {part.id: chain[0].id for chain in chains for part in chain}),
        **zones,
        "sides": sides(paths, scene.pixels(paths.points), size),
        "counts": counts_table(paths, span, rate),
        "people": people(paths, rate),
        "gatherings": gathering_table(paths, settings.gathering, rate),
    }
    tables |= with_doubt(_with_classes(tables, tracks), visitors, paths, rate)
    return Answers(tables, occupancy, scene, length, rate, size, paths, visitors)


def _with_classes(tables: dict[str, Columns], tracks: Sequence[Track]) -> dict[str, Columns]:
    """The tables, those of crossings and of people with the names of classes."""
    names = {track.id: track.class_name for track in tracks}
    for name in ("crossings", "people"):
        tables[name]["class"] = [names[number] for number in tables[name]["id"]]
    return tables
