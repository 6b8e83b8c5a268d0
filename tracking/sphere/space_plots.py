"""Plots of a path in space: from above and from the side, with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tsuiseki.tracking.cameras.camera_files import PlacedCamera
from tsuiseki.tracking.report.plots import COLOURS
from tsuiseki.tracking.types import FloatArray, Position
from tsuiseki.tracking.types.tracks import Path3D

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STATUS_COLOURS = {"tracking": COLOURS[0], "searching": COLOURS[1], "lost": COLOURS[4]}
# An ellipse of so many standard deviations holds 95 % of a Gaussian in the plane.
ELLIPSE = 2.4477
MOST_ELLIPSES = 40


def path_figure(
    positions: Sequence[Position],
    cameras: Sequence[PlacedCamera] = (),
    truth: Path3D | None = None,
    ink: str = "black",
) -> Figure:
    """The path among the cameras from above, and close up from above (x right, y up) and from the side (z up).

    The ellipses hold 95 % by the covariances.

    Args:
        positions: the estimates.
        cameras: drawn in the first plot.
        truth: drawn below the estimates.
        ink: colour of text and axes.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 4.2), layout="constrained")
    points = np.array([p.point for p in positions]) if positions else np.empty((0, 3))
    views = (("Among the cameras, from above", (0, 1)), ("From above", (0, 1)), ("From the side", (0, 2)))
    for number, (axes, (title, pair)) in enumerate(zip(figure.subplots(1, 3), views, strict=True)):
        _view(axes, positions, points, pair, truth, ink)
        if number == 0:
            _cameras(axes, cameras, pair, points, ink)
        axes.set_title(title, loc="left", color=ink)
        axes.set_xlabel("x, m", color=ink)
        axes.set_ylabel(f"{'xyz'[pair[1]]}, m", color=ink)
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.12)
        axes.set_facecolor("none")
        axes.grid(alpha=0.2, color=ink)
        axes.tick_params(colors=ink)
        for spine in axes.spines.values():
            spine.set_color(ink)
    handles, names = figure.axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, names, loc="outside lower center", ncols=5, frameon=False, labelcolor=ink)
    return figure


def deviation_figure(positions: Sequence[Position], truth: Path3D | None = None, ink: str = "black") -> Figure:
    """The standard deviation that the filter states over time, and the true error where it is known, cm."""
    from matplotlib.figure import Figure

    from tsuiseki.tracking.evaluation.space import distance_to_position

    figure = Figure(figsize=(10, 2.8), layout="constrained")
    axes = figure.subplots()
    times = np.array([p.time for p in positions])
    stated = np.array([np.sqrt(np.trace(p.covariance)) for p in positions])
    axes.plot(times, 100 * stated, color=COLOURS[1], label="stated standard deviation")
    if truth is not None:
        track = Path3D(times, np.array([p.point for p in positions]))
        axes.plot(times, 100 * distance_to_position(track, truth), color=COLOURS[0], label="distance to the truth")
    axes.set_xlabel("time, s", color=ink)
    axes.set_ylabel("cm", color=ink)
    axes.set_ylim(bottom=0)
    axes.set_facecolor("none")
    axes.grid(alpha=0.2, color=ink)
    axes.tick_params(colors=ink)
    axes.legend(frameon=False, labelcolor=ink)
    for spine in axes.spines.values():
        spine.set_color(ink)
    return figure


def _view(
    axes: Axes,
    positions: Sequence[Position],
    points: FloatArray,
    pair: tuple[int, int],
    truth: Path3D | None,
    ink: str,
) -> None:
    from matplotlib.patches import Ellipse

    a, b = pair
    if truth is not None:
        axes.plot(truth.points[:, a], truth.points[:, b], color=ink, alpha=0.35, linewidth=4, label="truth")
    for position in positions[:: max(1, len(positions) // MOST_ELLIPSES)]:
        values, vectors = np.linalg.eigh(position.covariance[np.ix_(pair, pair)])
        size = 2 * ELLIPSE * np.sqrt(np.maximum(values, 0))
        angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
        centre = (float(position.point[a]), float(position.point[b]))
        axes.add_patch(Ellipse(centre, size[1], size[0], angle=angle, color=COLOURS[5], alpha=0.3, linewidth=0))
    axes.plot(points[:, a], points[:, b], color=COLOURS[0], linewidth=0.8, alpha=0.6)
    for status, colour in STATUS_COLOURS.items():
        which = np.array([p.status == status for p in positions], dtype=np.bool_)
        if which.any():
            axes.plot(points[which, a], points[which, b], ".", markersize=3.5, color=colour, label=status)


def _cameras(axes: Axes, cameras: Sequence[PlacedCamera], pair: tuple[int, int], points: FloatArray, ink: str) -> None:
    a, b = pair
    for placed in cameras:
        place = placed.camera.position
        axes.plot(place[a], place[b], marker="^", color=ink, markersize=7)
        axes.annotate(placed.name, (place[a], place[b]), (4, 4), textcoords="offset points", color=ink, fontsize=8)
        if len(points):
            ahead = points.mean(axis=0) - place
            axes.plot([place[a], place[a] + 0.12 * ahead[a]], [place[b], place[b] + 0.12 * ahead[b]], color=ink)
