"""`tsuiseki track sphere`: where a ball is in space, from two or more calibrated cameras."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tsuiseki.tracking.cli.options import Drawing, SeededOutput
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.sphere.runs import FrameTimes
from tsuiseki.tracking.sphere.settings import SphereSettings

if TYPE_CHECKING:
    from tsuiseki.tracking.cli.run import Run
    from tsuiseki.tracking.sphere.runs import SphereRun
    from tsuiseki.tracking.sphere.sphere_run import SphereLog


NO_SOURCES: list[str] = []


def sphere(
    source: list[str] = NO_SOURCES,
    /,
    *,
    cameras: Path,
    output: SeededOutput,
    drawing: Drawing,
    settings: SphereSettings,
    times: FrameTimes,
    radius: float | None = None,
    points: list[Path] | None = None,
    deviation: float = 2.0,
    start: tuple[float, float, float] | None = None,
    volume: tuple[float, float, float, float, float, float] | None = None,
    backgrounds: list[Path] | None = None,
    truth: Path | None = None,
) -> int:
    """Follow a ball of known radius in space, or a point by its measured pixels.

    DIR gets track3d.csv, path.png, report.html, run.json and, with --overlay, overlay1.webm and so on with the ball's
    outline.

    Args:
        source: two or more videos or folders of images, in the order of the cameras; folders run at the frame_rate in
            cameras.yaml, else at 25 frames/s. Or numbers of webcams and addresses of streams, all live, until Ctrl-C.
        cameras: cameras.yaml with one entry per video; tsuiseki calibrate points writes it.
        radius: of the ball, metres; with --points only for its bounces.
        points: instead of videos, a CSV of measured pixels for each camera, separated by commas: frame,x,y, or as
            TrackNet writes it, Frame,Visibility,X,Y.
        deviation: with --points, standard deviation of a measured pixel.
        start: X,Y,Z of the ball in the first frame, metres; by default the volume is searched.
        volume: X1,Y1,Z1,X2,Y2,Z2 of the box in which the ball is searched, metres; by default where two cameras can
            see it.
        backgrounds: one picture of the empty scene per video, separated by commas; by default the median of the video.
        truth: CSV with the columns time, x, y, z (seconds, metres) to compare with in the report.
    """
    import numpy as np

    from tsuiseki.tracking.formats.track3d import read_path3d, write_track3d
    from tsuiseki.tracking.sphere.page import distances_to_truth, sphere_page
    from tsuiseki.tracking.sphere.points import sphere_points_run
    from tsuiseki.tracking.sphere.space_plots import path_figure
    from tsuiseki.tracking.sphere.tracking import sphere_run

    if volume is not None and not all(low < high for low, high in zip(volume[:3], volume[3:], strict=True)):
        shown = ",".join(f"{value:g}" for value in volume)
        raise RequestError(f"`volume`: expected X1,Y1,Z1,X2,Y2,Z2 with X1 < X2, Y1 < Y2 and Z1 < Z2, got {shown}")
    true_path = None if truth is None else read_path3d(truth)
    corners = None if volume is None else np.array(volume).reshape(2, 3)
    if points is not None:
        if source or drawing.overlay or backgrounds or volume:
            raise RequestError("`points`: expected no videos, `overlay`, `backgrounds` or `volume` beside it")
        chosen = sphere_points_run(
            points, cameras, start=start, settings=settings, deviation=deviation, radius=radius or 0.0, times=times
        )
    else:
        if radius is None:
            raise RequestError("`radius`: expected the ball's radius in metres, got none")
        chosen = sphere_run(
            source,
            cameras,
            radius,
            start=start,
            volume=corners,
            settings=settings,
            backgrounds=backgrounds,
            times=times,
        )
    if drawing.overlay and chosen.length is None:
        raise RequestError("`overlay`: expected recorded videos, which can be played again; got live cameras")
    rng = np.random.default_rng(output.seed)
    with output.run() as run:
        log = chosen.run(rng, run.times, lambda items: run.steps(items, total=chosen.length))
        run.columns = log.columns()
        run.write("track3d.csv", lambda path: write_track3d(path, log.positions))
        plot = path_figure(log.positions, chosen.placed, true_path)
        run.write("path.png", lambda path: plot.savefig(path, dpi=120, facecolor="white"))
        videos = _overlays(run, drawing, chosen, log, radius or 0.0) if drawing.overlay else []
        page = sphere_page(
            log, chosen.placed, radius or 0.0, true_path, videos, run.times.seconds, output.given.settings
        )
        run.write("report.html", lambda path: path.write_text(page, encoding="utf-8"))
        found = sum(p.status == "tracking" for p in log.positions)
        summary = f"ball known in {found} of {len(log.positions)} moments: {output.out / 'track3d.csv'}"
        away = np.empty(0) if true_path is None else distances_to_truth(log.positions, true_path)
        if len(away):
            summary += (
                f"\n{100 * away.mean():.2f} cm from the true position in the mean, {100 * away.max():.2f} at most"
            )
        run.done(summary)
    return run.status


def _overlays(run: Run, drawing: Drawing, chosen: SphereRun, log: SphereLog, radius: float) -> list[Path | None]:
    """A video for each camera."""
    from tsuiseki.tracking.sphere.overlay import write_sphere_overlay

    def draw(view: int, path: Path) -> None:
        source, camera = chosen.sources[view], chosen.placed[view]
        rate = camera.frame_rate or source.frame_rate
        frames = run.watched(source.frames(), f"drawing {camera.name}", source.length)
        write_sphere_overlay(path, frames, rate, log, camera.camera, radius, view)

    with run.times.measure("overlay"):
        names = [f"overlay{view + 1}.{drawing.overlay_format}" for view in range(len(chosen.sources))]
        return [run.draw(name, partial(draw, view)) for view, name in enumerate(names)]
