"""Answers about people on one floor, as the page of people has them: when each was there, and how many at a time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tsuiseki.tracking.counts.answer_plots import step_figure
from tsuiseki.tracking.report.pictures import crops_of
from tsuiseki.tracking.types import FloatArray, Frame, ImageArray, Track
from tsuiseki.tracking.types.measurements import PersonOnFloor

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Crops of a person, each of another camera.
CROPS = 3
Table = Mapping[str, Sequence[Any]]
"""Columns by name, all of one length."""


def people_table(people: Sequence[PersonOnFloor], names: Sequence[str]) -> Table:
    """When each was on the floor, how far they went, and which sensors detected them.

    Columns: id; first, last, seconds; metres; speed, m/s; cameras, separated by spaces.
    """
    seconds = np.array([person.times[-1] - person.times[0] for person in people])
    metres = np.array([np.linalg.norm(np.diff(person.positions, axis=0), axis=1).sum() for person in people])
    speed = np.divide(metres, seconds, out=np.zeros_like(metres), where=seconds > 0)
    return {
        "id": [person.id for person in people],
        "first": [round(float(person.times[0]), 3) for person in people],
        "last": [round(float(person.times[-1]), 3) for person in people],
        "seconds": seconds.round(3).tolist(),
        "metres": metres.round(3).tolist(),
        "speed": speed.round(3).tolist(),
        "cameras": [" ".join(np.array(names)[person.detected.any(axis=0)]) for person in people],
    }


def counts_table(people: Sequence[PersonOnFloor], times: FloatArray) -> Table:
    """How many are on the floor in each second: time, people (the mean of its moments), most.

    Args:
        people: that were followed.
        times: ``(T,)`` seconds of the moments.
    """
    here = np.bincount(np.concatenate([np.empty(0, np.int64), *(p.scans for p in people)]), minlength=len(times))
    seconds, edges, sizes = np.unique(np.floor(times), return_index=True, return_counts=True)
    if not len(seconds):
        return {"time": [], "people": [], "most": []}
    return {
        "time": seconds.tolist(),
        "people": (np.add.reduceat(here, edges) / sizes).round(3).tolist(),
        "most": np.maximum.reduceat(here, edges).tolist(),
    }


def counts_figure(people: Sequence[PersonOnFloor], times: FloatArray, ink: str = "black") -> Figure:
    """All on the floor in each second; arguments as for `counts_table`, and the colour of text."""
    table = counts_table(people, times)
    steps = ([*table["time"], float(times[-1])], [*table["people"], table["people"][-1]]) if len(times) else ([0], [0])
    return step_figure(ink, "on the floor", [("", *steps)])


def rows_to_show(tracks: Sequence[Sequence[Track]]) -> list[list[Track]]:
    """For each camera the one row of those tracks that it shows: of each person in up to `CROPS` cameras the largest.

    Args:
        tracks: of each camera, with the ids of the floor.
    """
    largest: dict[int, list[tuple[float, int, Track]]] = {}
    for camera, of_camera in enumerate(tracks):
        for track in of_camera:
            areas = np.where(track.observed, np.prod(track.boxes[:, 2:] - track.boxes[:, :2], axis=1), -1.0)
            row = int(areas.argmax())
            if areas[row] > 0:
                at = slice(row, row + 1)
                cut = Track(track.id, track.frames[at], track.boxes[at], track.scores[at], track.observed[at])
                largest.setdefault(track.id, []).append((float(areas[row]), camera, cut))
    shown: list[list[Track]] = [[] for _ in tracks]
    for rows in largest.values():
        for _, camera, track in sorted(rows, key=lambda row: -row[0])[:CROPS]:
            shown[camera].append(track)
    return shown


def crops_of_cameras(frames: Sequence[Iterable[Frame]], rows: Sequence[Sequence[Track]]) -> dict[int, list[ImageArray]]:
    """Crops ``(H, W, 3)`` uint8 RGB of people by id; ``frames`` of each camera are those of its ``rows``."""
    crops: dict[int, list[ImageArray]] = {}
    for pictures, of_camera in zip(frames, rows, strict=True):
        for identity, images in crops_of(pictures, of_camera).items():
            crops.setdefault(identity, []).extend(images)
    return crops
