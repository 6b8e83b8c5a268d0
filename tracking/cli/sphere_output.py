"""What `tsuiseki track sphere` writes: track, plots, overlays, report and record."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.cameras.files import PlacedCamera
from tsuiseki.tracking.cli.parser import plain
from tsuiseki.tracking.cli.progress import progress
from tsuiseki.tracking.evaluation.space import distance_scores, distance_to_path, distance_to_position
from tsuiseki.tracking.formats.track3d import write_track3d
from tsuiseki.tracking.output import RunRecord
from tsuiseki.tracking.report.overlay import without_flicker
from tsuiseki.tracking.report.page import PAGE, STYLE
from tsuiseki.tracking.report.plots import inline_svg
from tsuiseki.tracking.report.space_plots import deviation_figure, path_figure
from tsuiseki.tracking.report.sphere import draw_sphere
from tsuiseki.tracking.report.webm import VideoWriter
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.trackers.sphere_run import SphereLog
from tsuiseki.tracking.types import STATUSES, ImageArray, Position
from tsuiseki.tracking.types.tracks import Path3D
from tsuiseki.tracking.video import Source

TRAIL_MOMENTS = 30


def write_sphere_run(
    folder: Path,
    log: SphereLog,
    cameras: Sequence[PlacedCamera],
    radius: float,
    overlay: Sequence[Source] | None,
    truth: Path3D | None,
    settings: Mapping[str, Any],
    seed: int,
    times: StageTimes,
    partial: bool,
) -> None:
    """Write ``track3d.csv``, ``path.png``, ``report.html``, ``run.json``, and with ``overlay`` a video per camera."""
    write_track3d(folder / "track3d.csv", log.positions)
    path_figure(log.positions, cameras, truth).savefig(folder / "path.png", dpi=120, facecolor="white")
    videos: list[Path] = []
    with times.measure("overlay"):
        for view, source in enumerate(overlay or ()):
            videos.append(folder / f"overlay{view + 1}.webm")
            _write_overlay(videos[-1], source, log, cameras[view], radius, view)
    page = _page(log, cameras, radius, truth, videos, times, settings, seed)
    (folder / "report.html").write_text(page, encoding="utf-8")
    frames: dict[str, Sequence[Any]] = {
        "time": [round(p.time, 6) for p in log.positions],
        "score": [round(p.score, 4) for p in log.positions],
        "status": [p.status for p in log.positions],
        "open": [[round(float(v), 3) for v in p.open] for p in log.positions],
        "frame_of_each_video": [[None if f is None else f + 1 for f in m.frames] for m in log.moments],
    }
    record = RunRecord(
        ("tsuiseki", "track", "sphere"),
        {name: plain(value) for name, value in settings.items()},
        seed,
        times.seconds,
        frames,
        partial,
    )
    record.write(folder)


def _write_overlay(path: Path, source: Source, log: SphereLog, placed: PlacedCamera, radius: float, view: int) -> None:
    at = {m.frames[view]: k for k, m in enumerate(log.moments) if m.frames[view] is not None}
    points = np.array([p.point for p in log.positions])
    last = max((frame for frame in at if frame is not None), default=-1)
    shown: ImageArray | None = None
    with VideoWriter(path, placed.frame_rate or source.frame_rate) as writer:
        for frame in progress(source.frames(), f"drawing {placed.name}", last + 1):
            if frame.index > last:
                break
            shown = without_flicker(frame.image, shown)
            moment = at.get(frame.index)
            if moment is None:
                writer.write(shown)
                continue
            trail = points[max(moment - TRAIL_MOMENTS, 0) : moment + 1]
            writer.write(draw_sphere(shown, placed.camera, log.positions[moment], radius, view, trail))


def _page(
    log: SphereLog,
    cameras: Sequence[PlacedCamera],
    radius: float,
    truth: Path3D | None,
    videos: Sequence[Path],
    times: StageTimes,
    settings: Mapping[str, Any],
    seed: int,
) -> str:
    positions = log.positions
    sections = [
        ("What was found", _summary(log, cameras, times) + _errors(positions, truth)),
        ("Path", inline_svg(lambda ink: path_figure(positions, cameras, truth, ink), "path") + NOTE),
        ("Uncertainty over time", inline_svg(lambda ink: deviation_figure(positions, truth, ink), "uncertainty")),
    ]
    sections += [(f"Overlay of {cameras[k].name}", _video(video)) for k, video in enumerate(videos)]
    facts = {**{name: str(plain(value)) for name, value in settings.items() if value is not None}, "seed": str(seed)}
    listing = "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in facts.items())
    sections.append(("How it was made", f"<dl>{listing}</dl>"))
    body = "\n".join(f"<section><h2>{escape(title)}</h2>{text}</section>" for title, text in sections)
    introduction = f"A ball of {100 * radius:g} cm radius followed by {len(cameras)} cameras."
    return PAGE.format(title="Ball in space", introduction=introduction, style=STYLE, sections=body)


NOTE = (
    "<p class=note>Dots are estimates, coloured by status; pale ellipses hold the ball with 95 % by the filter's own "
    "account; triangles are the cameras.</p>"
)


def _summary(log: SphereLog, cameras: Sequence[PlacedCamera], times: StageTimes) -> str:
    count = len(log.positions)
    rows = [("Moments", str(count)), ("Duration", f"{log.positions[-1].time - log.positions[0].time:.2f} s")]
    rows += [(status, f"{sum(p.status == status for p in log.positions)}") for status in STATUSES]
    rows.append(("Searches of the volume", str(len(log.searches))))
    for view, placed in enumerate(cameras):
        frames = sum(m.frames[view] is not None for m in log.moments)
        seen = sum(
            p.open[view] > 0.5 for p, m in zip(log.positions, log.moments, strict=True) if m.frames[view] is not None
        )
        rows.append((f"{placed.name}: frames, of them with the ball", f"{frames}, {seen}"))
    rows.append(("Filter, a moment", f"{1000 * times.seconds.get('filter', 0.0) / count:.1f} ms"))
    return _table(rows)


def _errors(positions: Sequence[Position], truth: Path3D | None) -> str:
    if truth is None:
        return ""
    track = Path3D(np.array([p.time for p in positions]), np.array([p.point for p in positions]))
    away = distance_to_position(track, truth)
    rows = []
    for name, values in (
        ("Distance to the true position", away[np.isfinite(away)]),
        ("Distance to the true path", distance_to_path(track.points, truth.points)),
    ):
        if len(values):
            s = distance_scores(values)
            rows.append(
                (
                    f"{name}: mean, maximum, deviation",
                    f"{100 * s.mean:.2f}, {100 * s.maximum:.2f}, {100 * s.deviation:.2f} cm",
                )
            )
    return _table(rows)


def _table(rows: Sequence[tuple[str, str]]) -> str:
    cells = "".join(f"<tr><th scope=row>{escape(k)}</th><td>{escape(v)}</td></tr>" for k, v in rows)
    return f'<div class="wide"><table><tbody>{cells}</tbody></table></div>'


def _video(path: Path) -> str:
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return f'<video controls loop muted playsinline src="data:video/webm;base64,{data}"></video>'
