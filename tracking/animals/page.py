"""What the page of animals says beside that of all tracks: speed, heading, distance from each other, contact."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from tsuiseki.tracking.report.plots import dress
from tsuiseki.tracking.report.rendering import section
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray
from tsuiseki.tracking.types.tracks import BodyTrack

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Pairs in the table, those longest in contact; the rows of more would hide them.
MOST_PAIRS = 20
# Of the page, as a template: plots of what moves, and a table of pairs.
SECTIONS = """{% import "parts.html.j2" as parts %}
{% macro links() %}<p class=note><a href="report/motion.csv">CSV</a></p>{% endmacro %}
{% call parts.section("Speed") %}{{ parts.chart_of_any_width(speed, "speed") }}{{ links() }}{% endcall %}
{% call parts.section("Heading") %}{{ parts.chart_of_any_width(heading, "heading") }}
<p class=note>0 is to the right, 90 down, -90 up.</p>{{ links() }}{% endcall %}
{% call parts.section("Distance between animals") %}
{% if pairs %}
{{ parts.chart_of_any_width(distance, "distance") }}
{{ parts.table(heads, pairs) }}
<p class=note>From middle to middle. In contact: the ellipses of both touch.</p>{{ links() }}
{% endif %}
{% endcall %}
"""


@dataclass(frozen=True)
class AnimalPair:
    """Two animals in the frames that show both.

    Attributes:
        ids: of both.
        frames: ``(T,)``.
        distances: ``(T,)`` from middle to middle, in the unit of the motion.
        contact: ``(T,)`` whether their ellipses touch.
    """

    ids: tuple[int, int]
    frames: IntArray
    distances: FloatArray
    contact: BoolArray


@dataclass(frozen=True)
class AnimalMotion:
    """How animals move.

    Attributes:
        tracks: whose states begin with a, b, theta, length, width in pixels and radians.
        seconds_of: gives ``(T,)`` seconds of ``(T,)`` frames.
        frame_rate: a second.
        scale: millimetres of a pixel; None where it is not known.
    """

    tracks: Sequence[BodyTrack]
    seconds_of: Callable[[IntArray], FloatArray]
    frame_rate: float
    scale: float | None = None

    @property
    def unit(self) -> str:
        """Of lengths: millimetres or pixels."""
        return "px" if self.scale is None else "mm"

    def places(self, track: BodyTrack) -> FloatArray:
        """``(T, 2)`` x to the right and y down, in the unit."""
        return np.asarray(track.states[:, :2] * (self.scale or 1.0))

    def speeds(self, track: BodyTrack) -> FloatArray:
        """``(T,)`` units a second, by central differences; 0 of a single frame."""
        if len(track) < 2:
            return np.zeros(len(track))
        steps = np.gradient(self.places(track), self.seconds_of(track.frames), axis=0)
        return np.asarray(np.linalg.norm(steps, axis=1))

    @cached_property
    def pairs(self) -> list[AnimalPair]:
        """All pairs that a frame shows together, those longest in contact first, then the nearest."""
        pairs = []
        for first, second in combinations(self.tracks, 2):
            frames, here, there = np.intersect1d(first.frames, second.frames, return_indices=True)
            if len(frames):
                a, b = first.states[here], second.states[there]
                away = np.linalg.norm(a[:, :2] - b[:, :2], axis=1)
                pairs.append(AnimalPair((first.id, second.id), frames, away * (self.scale or 1.0), touching(a, b)))
        return sorted(pairs, key=lambda pair: (-int(pair.contact.sum()), float(pair.distances.min())))

    def columns(self) -> dict[str, dict[int, float | None]]:
        """What the table says of each animal, by name and by id: path, speed, nearest other, contact."""
        unit, seconds = self.unit, 1.0 / (self.frame_rate or 1.0)
        columns: dict[str, dict[int, float | None]] = {f"path, {unit}": {}, f"speed, {unit}/s": {}}
        for track in self.tracks:
            speeds, times = self.speeds(track), self.seconds_of(track.frames)
            path = float(np.trapezoid(speeds, times))
            columns[f"path, {unit}"][track.id] = round(path, 3)
            span = float(times[-1] - times[0])
            columns[f"speed, {unit}/s"][track.id] = round(path / span, 3) if span > 0 else 0.0
        if self.pairs:
            nearest, contact = self._beside_others()
            columns[f"nearest other, {unit}"] = {
                n: round(float(row[np.isfinite(row)].mean()), 3) if np.isfinite(row).any() else None
                for n, row in nearest.items()
            }
            columns["in contact, s"] = {n: round(float(row.sum()) * seconds, 3) for n, row in contact.items()}
        return columns

    def table(self) -> Mapping[str, Sequence[Any]]:
        """A row for each animal in each frame, by frame and id: the columns of ``motion.csv``.

        frame (from 1), time, id, x, y, heading (radians), speed, nearest (distance of the nearest other, None alone),
        contact (0 or 1). x and y grow to the right and down; names say the unit.
        """
        nearest, contact = self._beside_others()
        rows: list[tuple[Any, ...]] = []
        for track in self.tracks:
            places, speeds, times = self.places(track), self.speeds(track), self.seconds_of(track.frames)
            away, touched = nearest.get(track.id), contact.get(track.id)
            for k, frame in enumerate(track.frames.tolist()):
                apart = None if away is None or not np.isfinite(away[k]) else round(float(away[k]), 3)
                rows.append((frame + 1, round(float(times[k]), 4), track.id, *places[k].round(3).tolist(),
                             round(float(track.states[k, 2]), 4), round(float(speeds[k]), 3), apart,
                             int(touched is not None and bool(touched[k]))))  # fmt: skip
        unit = self.unit
        names = ("frame", "time", "id", f"x_{unit}", f"y_{unit}", "heading", f"speed_{unit}_s", f"nearest_{unit}",
                 "contact")  # fmt: skip
        columns = zip(*sorted(rows, key=lambda row: (row[0], row[2])), strict=True) if rows else [()] * len(names)
        return dict(zip(names, map(list, columns), strict=True))

    def _beside_others(self) -> tuple[dict[int, FloatArray], dict[int, BoolArray]]:
        """By id the ``(T,)`` distance of the nearest other, infinite where it is alone, and whether one touches it."""
        nearest = {track.id: np.full(len(track), np.inf) for track in self.tracks}
        contact = {track.id: np.zeros(len(track), dtype=np.bool_) for track in self.tracks}
        frames = {track.id: track.frames for track in self.tracks}
        for pair in self.pairs:
            for identity in pair.ids:
                rows = np.searchsorted(frames[identity], pair.frames)
                nearest[identity][rows] = np.minimum(nearest[identity][rows], pair.distances)
                contact[identity][rows] |= pair.contact
        return nearest, contact

    def sections(self) -> list[str]:
        """HTML of speed, heading and distance over time, and of each pair; nothing without animals."""
        if not self.tracks:
            return []
        seconds = 1.0 / (self.frame_rate or 1.0)
        heads = ["Animals", f"mean distance, {self.unit}", f"least, {self.unit}", "in contact, s"]
        pairs = [
            [f"{pair.ids[0]} and {pair.ids[1]}", f"{pair.distances.mean():.3g}", f"{pair.distances.min():.3g}",
             f"{pair.contact.sum() * seconds:.2g}"]
            for pair in self.pairs[:MOST_PAIRS]
        ]  # fmt: skip
        return [
            section(
                SECTIONS,
                speed=self._speed_figure,
                heading=self._heading_figure,
                distance=self._distance_figure,
                heads=heads,
                pairs=pairs,
            )
        ]

    def _speed_figure(self, ink: str = "black") -> Figure:
        return self._figure(ink, f"speed, {self.unit}/s", [(t, self.speeds(t)) for t in self.tracks])

    def _heading_figure(self, ink: str = "black") -> Figure:
        turns = [(track, np.degrees(_apart_at_turns(track.states[:, 2]))) for track in self.tracks]
        figure = self._figure(ink, "heading, degrees", turns, (-180, 180))
        figure.axes[0].set_yticks(range(-180, 181, 90))
        return figure

    def _distance_figure(self, ink: str = "black") -> Figure:
        nearest, _ = self._beside_others()
        away = [(track, np.where(np.isfinite(nearest[track.id]), nearest[track.id], np.nan)) for track in self.tracks]
        return self._figure(ink, f"nearest other, {self.unit}", away)

    def _figure(
        self,
        ink: str,
        up: str,
        lines: Sequence[tuple[BodyTrack, FloatArray]],
        limits: tuple[float, float] | None = None,
    ) -> Figure:
        """A line over time for each animal, in the colour of its id."""
        from matplotlib.figure import Figure

        from tsuiseki.tracking.report.overlay import track_colour

        figure = Figure(figsize=(10, 3.2), dpi=110, layout="constrained")
        axes = figure.subplots()
        for track, values in lines:
            # Darker than on the video, for the ground is white.
            colour = tuple(0.8 * part / 255 for part in track_colour(track.id))
            axes.plot(self.seconds_of(track.frames), values, color=colour, linewidth=1.2, label=str(track.id))
        axes.set_ylim(*(limits or (0, None)))
        dress(axes, ink, "seconds", up)
        if lines:
            figure.legend(loc="outside lower center", ncols=8, frameon=False, labelcolor=ink)
        return figure


def _apart_at_turns(angles: FloatArray) -> FloatArray:
    """Angles ``(T,)`` with NaN before a jump from one end of the circle to the other, so that no line crosses it."""
    broken = angles.copy()
    broken[1:][np.abs(np.diff(angles)) > np.pi] = np.nan
    return broken


def touching(a: FloatArray, b: FloatArray) -> BoolArray:
    """``(T,)`` whether the ellipses of two animals reach each other along the line between their middles.

    Args:
        a: ``(T, 5+)`` states a, b, theta, length, width of the one, pixels and radians.
        b: of the other.
    """
    between = b[:, :2] - a[:, :2]
    direction = np.arctan2(between[:, 1], between[:, 0])
    return np.asarray(np.linalg.norm(between, axis=1) <= _radius(a, direction) + _radius(b, direction))


def _radius(states: FloatArray, direction: FloatArray) -> FloatArray:
    """``(T,)`` from the middle of an ellipse to its edge in a direction, pixels."""
    turn, half = direction - states[:, 2], np.maximum(states[:, 3:5], 1.0) / 2
    return np.asarray(1.0 / np.hypot(np.cos(turn) / half[:, 0], np.sin(turn) / half[:, 1]))
