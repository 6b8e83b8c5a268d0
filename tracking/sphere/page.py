"""What is drawn of a ball in space: `report.html`, plots of its path, and its outline over each camera's video."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.cameras.camera_files import PlacedCamera
from tsuiseki.tracking.cameras.outline import sphere_outlines
from tsuiseki.tracking.evaluation.space import distance_to_path, distance_to_position
from tsuiseki.tracking.formats.world_tables import write_track3d
from tsuiseki.tracking.report.plots import COLOURS, dress
from tsuiseki.tracking.report.rendering import overlay_in, render
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.runs.files import CHOSEN
from tsuiseki.tracking.runs.origin import how_made
from tsuiseki.tracking.sphere.tracker import SphereLog, SphereRun
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import STATUSES, FloatArray, Frame, ImageArray, Position
from tsuiseki.tracking.types.recording import Recording
from tsuiseki.tracking.types.tracks import Path3D
from tsuiseki.tracking.video.recording import recording_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Options where none were asked for.
NOTHING: Mapping[str, Any] = {}
# Colour of the positions of each status in plots.
STATUS_COLOURS = {"tracking": COLOURS[0], "searching": COLOURS[1], "lost": COLOURS[4]}
# An ellipse of so many standard deviations holds 95 % of a Gaussian in the plane.
ELLIPSE = 2.4477
# Ellipses in a plot at most, so that the path stays visible.
MOST_ELLIPSES = 40


def path_figure(
    positions: Sequence[Position],
    cameras: Sequence[PlacedCamera] = (),
    truth: Path3D | None = None,
    ink: str = "black",
) -> Figure:
    """The path among the cameras from above, and close up from above (x right, y up) and from the side (z up).

    The ellipses hold 95 % by the covariances; text and axes have the colour ``ink``.
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
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.12)
        axes.grid(alpha=0.2, color=ink)
        dress(axes, ink, "x, m", f"{'xyz'[pair[1]]}, m")
    handles, names = figure.axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, names, loc="outside lower center", ncols=5, frameon=False, labelcolor=ink)
    return figure


def deviation_figure(positions: Sequence[Position], truth: Path3D | None = None, ink: str = "black") -> Figure:
    """The standard deviation that the filter states over time, and the true error where it is known, cm."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 2.8), layout="constrained")
    axes = figure.subplots()
    times = np.array([p.time for p in positions])
    stated = np.array([np.sqrt(np.trace(p.covariance)) for p in positions])
    axes.plot(times, 100 * stated, color=COLOURS[1], label="stated standard deviation")
    if truth is not None:
        axes.plot(
            times, 100 * distance_to_position(_track(positions), truth), color=COLOURS[0], label="distance to the truth"
        )
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.2, color=ink)
    axes.legend(frameon=False, labelcolor=ink)
    dress(axes, ink, "time, s", "cm")
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


# Colour of the outline of each status in the overlay, RGB.
OUTLINE_COLOURS = {"tracking": (40, 230, 90), "searching": (255, 190, 40), "lost": (255, 70, 60)}
# Of an outline.
POINTS = 48
# Points of an outline in a dash, and in a gap.
DASH = 3
# Fractions of a pixel that OpenCV draws to.
SHIFT = 4
# Moments back that the drawn path goes.
TRAIL_MOMENTS = 30
# Of the status line, one of OpenCV's own.
FONT = cv2.FONT_HERSHEY_SIMPLEX
# Of that font, relative to its base size.
SIZE = 0.45


def sphere_painter(chosen: SphereRun, log: SphereLog, view: int) -> Callable[[Frame], ImageArray]:
    """What draws the ball's outline and centre, the way there and the status into the frames of camera ``view``.

    A dashed outline says that the camera does not contribute.
    """
    camera = chosen.placed[view].camera
    at = {m.frames[view]: k for k, m in enumerate(log.moments) if m.frames[view] is not None}
    points = np.array([p.point for p in log.positions])

    def draw(frame: Frame) -> ImageArray:
        moment = at.get(frame.index)
        if moment is None:
            return frame.image
        drawn, position = frame.image.copy(), log.positions[moment]
        colour = OUTLINE_COLOURS[position.status]
        way, _ = camera.project(points[max(moment - TRAIL_MOMENTS, 0) : moment + 1])
        way = way[np.isfinite(way).all(axis=1)]
        if len(way) > 1:
            cv2.polylines(drawn, [_fixed(way)], False, colour, 1, cv2.LINE_AA, SHIFT)
        outlines = sphere_outlines(camera, position.point[None], chosen.radius)
        outline = outlines.points(POINTS)[0]
        used = len(position.open) <= view or position.open[view] > 0.5
        if np.isfinite(outline).all() and np.abs(outline).max() < 1e4:
            ring = _fixed(np.concatenate([outline, outline[:1]]))
            parts = [ring] if used else [ring[k : k + DASH] for k in range(0, POINTS, 2 * DASH)]
            cv2.polylines(drawn, parts, False, colour, 2, cv2.LINE_AA, SHIFT)
            cv2.drawMarker(drawn, _fixed(outlines.centre[0], 0).tolist(), colour, cv2.MARKER_CROSS, 7, 1, cv2.LINE_AA)
        x, y, z = position.point
        text = f"{position.time:6.2f} s   x {x:+.2f}  y {y:+.2f}  z {z:+.2f} m   {position.status}"
        text += "" if used else ", this camera is covered"
        width = cv2.getTextSize(text, FONT, SIZE, 1)[0][0]
        cv2.rectangle(drawn, (0, 0), (12 + width, 22), (20, 20, 20), cv2.FILLED)
        cv2.putText(drawn, text, (6, 15), FONT, SIZE, (255, 255, 255), 1, cv2.LINE_AA)
        return drawn

    return draw


def _fixed(points: FloatArray, shift: int = SHIFT) -> NDArray[np.int32]:
    # OpenCV counts from the first pixel's centre.
    return np.asarray(np.round((points - 0.5) * 2**shift), dtype=np.int32)


def sphere_result(
    chosen: SphereRun,
    log: SphereLog,
    times: StageTimes,
    settings: Mapping[str, Any],
    truth: Path3D | None = None,
    asked: Mapping[str, Any] = NOTHING,
) -> Result[Position]:
    """The result of a run: the ball's position at each moment.

    The page compares it with a ``truth`` that is known, and lists the options that were ``asked`` for.
    """
    positions, cameras = log.positions, chosen.placed

    def plot(path: Path, _: Path) -> None:
        path_figure(positions, cameras, truth).savefig(path, dpi=120, facecolor="white")

    def page(path: Path, folder: Path) -> None:
        ball = f"A ball of {100 * chosen.radius:g} cm radius" if chosen.radius > 0 else "A point"
        drawn = {placed.name: overlay_in(folder, f"overlay{k}") for k, placed in enumerate(cameras, start=1)}
        tracked = f"{100 * np.mean([position.status == 'tracking' for position in positions]):.0f} %"
        text = render(
            "sphere.html.j2",
            title="Ball in space",
            introduction=f"{ball} followed by {len(cameras)} cameras.",
            summary=_summary(log, cameras, times.seconds),
            distances=[] if truth is None else _distances(positions, truth),
            path=partial(path_figure, positions, cameras, truth),
            uncertainty=partial(deviation_figure, positions, truth),
            overlays=drawn,
            made=how_made(settings, {CHOSEN: asked}, {"moments in which the ball was tracked": tracked}),
        )
        path.write_text(text, encoding="utf-8")

    first, camera = next(iter(chosen.sources), None), cameras[0].camera
    rate = cameras[0].frame_rate or (0.0 if first is None else first.frame_rate)
    return Result(
        positions,
        "" if first is None else first.address,
        rate or 0.0,
        (camera.width, camera.height),
        recording=Recording() if first is None else recording_of(first),
        settings=settings,
        seconds=times.seconds,
        frames={
            "time": [round(p.time, 6) for p in positions],
            "score": [round(p.score, 4) for p in positions],
            "status": [p.status for p in positions],
            "open": [[round(float(v), 3) for v in p.open] for p in positions],
            "frame_of_each_video": [list(m.frames) for m in log.moments],
        },
        files={"track3d.csv": lambda path, _: write_track3d(path, positions), "path.png": plot, "report.html": page},
        painter=sphere_painter(chosen, log, 0) if chosen.radius > 0 else None,
    )


def _summary(log: SphereLog, cameras: Sequence[PlacedCamera], seconds: Mapping[str, float]) -> list[tuple[str, str]]:
    count = len(log.positions)
    rows = [("Moments", str(count)), ("Duration", f"{log.positions[-1].time - log.positions[0].time:.2f} s")]
    rows += [(status, f"{sum(p.status == status for p in log.positions)}") for status in STATUSES]
    rows.append(("Searches of the volume", str(len(log.searches))))
    for view, placed in enumerate(cameras):
        frames = sum(m.frames[view] is not None for m in log.moments)
        detected = sum(
            p.open[view] > 0.5 for p, m in zip(log.positions, log.moments, strict=True) if m.frames[view] is not None
        )
        rows.append((f"{placed.name}: frames, of them with the ball", f"{frames}, {detected}"))
    rows.append(("Filter, a moment", f"{1000 * seconds.get('filter', 0.0) / count:.1f} ms"))
    return rows


def distances_to_truth(positions: Sequence[Position], truth: Path3D) -> FloatArray:
    """``(N,)`` distances to the true position, metres, where it is known."""
    away = distance_to_position(_track(positions), truth)
    return away[np.isfinite(away)]


def _track(positions: Sequence[Position]) -> Path3D:
    return Path3D(np.array([p.time for p in positions]), np.array([p.point for p in positions]))


def _distances(positions: Sequence[Position], truth: Path3D) -> list[list[str]]:
    """Mean, largest and deviation of the distances to the truth, a row each to its position and its path."""
    away = {
        "true position": distances_to_truth(positions, truth),
        "true path": distance_to_path(_track(positions).points, truth.points),
    }
    return [
        [name, *(f"{100 * value:.2f} cm" for value in (values.mean(), values.max(), values.std()))]
        for name, values in away.items()
        if len(values)
    ]
