"""Pictures of people under a ceiling camera: floor plan, dwell map, overlay with rotated boxes, page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from tsuiseki.tracking.fisheye.view import CeilingSource
from tsuiseki.tracking.report.overlay import draw_label, track_colour
from tsuiseki.tracking.report.plots import dress
from tsuiseki.tracking.report.rendering import overlay_in, render
from tsuiseki.tracking.runs.following import count
from tsuiseki.tracking.runs.origin import how_made
from tsuiseki.tracking.types import FloatArray, Frame, ImageArray
from tsuiseki.tracking.types.tracks import FloorTrack

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Side of a cell of the dwell map, metres.
CELL = 0.1
# Standard deviation of the dwell map's blur, metres.
BLUR = 0.2
# How far back a drawn way goes.
TRAIL_SECONDS = 3.0
# Longer side of a plan of the floor, inches.
SIDE = 5.0


def floor_figure(tracks: Sequence[FloorTrack], floor: FloatArray, cameras: FloatArray, ink: str = "black") -> Figure:
    """The floor x1, y1, x2, y2 ``(4,)``, everybody's path with an id at its end, and cameras ``(C, 2)``; in metres."""
    figure, axes = _plan(floor, "Paths on the floor", ink)
    for person in tracks:
        colour = tuple(c / 255 for c in track_colour(person.track.id))
        axes.plot(*person.places.T, color=colour, linewidth=1.4, alpha=0.9)
        axes.plot(*person.places[-1], "o", color=colour, markersize=5)
        axes.annotate(
            str(person.track.id), person.places[-1], xytext=(4, 3), textcoords="offset points", color=ink, fontsize=8
        )
    axes.plot(*cameras.T, "^", color=ink, markersize=8, fillstyle="none")
    return figure


def dwell_seconds(tracks: Sequence[FloorTrack], floor: FloatArray, frame_rate: float) -> FloatArray:
    """``(rows, columns)`` seconds that people spent in each cell of the floor, row 0 at the least y, blurred."""
    columns, rows = np.maximum(np.ceil((floor[2:] - floor[:2]) / CELL).astype(int), 1)
    places = np.concatenate([np.empty((0, 2)), *(t.places for t in tracks)])
    edges = [floor[1] + CELL * np.arange(rows + 1), floor[0] + CELL * np.arange(columns + 1)]
    counts = np.histogram2d(places[:, 1], places[:, 0], bins=edges)[0]
    return np.asarray(gaussian_filter(counts / frame_rate, BLUR / CELL, mode="constant"))


def dwell_figure(tracks: Sequence[FloorTrack], floor: FloatArray, frame_rate: float, ink: str = "black") -> Figure:
    """Where people spent how long, seconds a square metre; a plain plan where no person was."""
    figure, axes = _plan(floor, "Time spent", ink)
    seconds = dwell_seconds(tracks, floor, frame_rate) / CELL**2
    if not seconds.any():
        axes.text(0.5, 0.5, "no person was here", transform=axes.transAxes, ha="center", color=ink)
        return figure
    dwell = axes.imshow(
        seconds, origin="lower", extent=(floor[0], floor[2], floor[1], floor[3]), cmap="magma", aspect="equal"
    )
    bar = figure.colorbar(dwell, ax=axes, shrink=0.7)
    bar.set_label("seconds a square metre", color=ink)
    bar.ax.tick_params(colors=ink)
    return figure


def _plan(floor: FloatArray, title: str, ink: str) -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure

    width, height = floor[2:] - floor[:2]
    scale = SIDE / max(width, height)
    figure = Figure(figsize=(max(scale * width, 2.4) + 1.6, max(scale * height, 2.4) + 0.9), layout="constrained")
    axes = figure.subplots()
    axes.set_xlim(floor[0], floor[2])
    axes.set_ylim(floor[1], floor[3])
    axes.set_aspect("equal")
    axes.set_title(title, loc="left", color=ink)
    dress(axes, ink, "x, m", "y, m")
    return figure, axes


def draw_floor_tracks(image: ImageArray, tracks: Sequence[FloorTrack], frame: int, trail: int) -> ImageArray:
    """``image`` with the rotated boxes of ``frame``, their feet ends thick, ids, and the way of the last frames."""
    drawn = image.copy()
    for person in tracks:
        row = int(np.searchsorted(person.track.frames, frame))
        if row >= len(person.track) or person.track.frames[row] != frame:
            continue
        colour = track_colour(person.track.id)
        recent = slice(int(np.searchsorted(person.track.frames, frame - trail)), row + 1)
        feet = corners(person.rotated[recent])[:, 2:].mean(axis=1)
        cv2.polylines(drawn, [np.round(feet).astype(np.int32)], isClosed=False, color=colour, lineType=cv2.LINE_AA)
        box = np.round(corners(person.rotated[row : row + 1])[0]).astype(np.int32)
        cv2.polylines(drawn, [box], isClosed=True, color=colour, thickness=2, lineType=cv2.LINE_AA)
        cv2.line(drawn, tuple(box[2].tolist()), tuple(box[3].tolist()), colour, 4, cv2.LINE_AA)
        top = box[int(box[:, 1].argmin())]
        draw_label(drawn, str(person.track.id), (int(top[0]), int(top[1]) - 3), colour)
    draw_label(drawn, f"{frame + 1}", (4, image.shape[0] - 4), (60, 60, 60))
    return drawn


def corners(rotated: FloatArray) -> FloatArray:
    """``(N, 4, 2)`` corners of ``(N, 5)`` rotated boxes: head left, head right, feet right, feet left."""
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    local = signs[None] * rotated[:, None, 2:4]
    cos, sin = np.cos(rotated[:, 4])[:, None], np.sin(rotated[:, 4])[:, None]
    x = cos * local[..., 0] - sin * local[..., 1]
    y = sin * local[..., 0] + cos * local[..., 1]
    return np.stack([x, y], axis=-1) + rotated[:, None, :2]


def floor_painter(tracks: Sequence[FloorTrack], frame_rate: float) -> Callable[[Frame], ImageArray]:
    """What draws the tracks into the frames of a video."""
    trail = max(1, round(TRAIL_SECONDS * frame_rate))
    return lambda frame: draw_floor_tracks(frame.image, tracks, frame.index, trail)


@dataclass(frozen=True)
class CameraFloor:
    """A camera on the page.

    Attributes:
        name: of the camera.
        summary: a sentence.
        paths: the plan, by the colour of its text.
        dwell: the dwell map, likewise.
        overlay: its video; None where none was drawn.
        inside: folder of the video, as seen from the page.
    """

    name: str
    summary: str
    paths: Callable[[str], Figure]
    dwell: Callable[[str], Figure]
    overlay: Path | None
    inside: str = ""


def camera_floor(ceiling: CeilingSource, tracks: Sequence[FloorTrack], folder: Path, inside: str = "") -> CameraFloor:
    """Plan, dwell map and video of a camera, for the page.

    Args:
        ceiling: the camera over the floor.
        tracks: the people under it.
        folder: where an overlay may lie.
        inside: the same folder, as seen from the page.
    """
    floor, camera = ceiling.floor, ceiling.placed.camera.position[None, :2]
    walked = sum(float(np.linalg.norm(np.diff(track.places, axis=0), axis=1).sum()) for track in tracks)
    return CameraFloor(
        ceiling.placed.name,
        f"{count(len(tracks), 'person', 'people')}, {walked:.0f} m walked in all.",
        partial(floor_figure, tracks, floor, camera),
        partial(dwell_figure, tracks, floor, ceiling.rate),
        overlay_in(folder),
        inside,
    )


def floor_page(
    cameras: Sequence[CameraFloor],
    seconds: Mapping[str, float],
    run_settings: Mapping[str, object],
    facts: Mapping[str, object],
) -> str:
    """`report.html` as text: each camera, and how it was made; see `how_made`."""
    return render(
        "ceiling.html.j2",
        title="People on the floor",
        introduction="Each colour and number is one person; the thick side of a box is the feet's. "
        "Triangles are cameras.",
        cameras=cameras,
        seconds={name: f"{1000 * spent:.0f} ms" for name, spent in seconds.items()},
        made=how_made(run_settings, facts, {}),
    )
