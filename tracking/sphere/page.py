"""`report.html` of a ball in space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.cameras.camera_files import PlacedCamera
from tsuiseki.tracking.evaluation.space import distance_scores, distance_to_path, distance_to_position
from tsuiseki.tracking.report.page import embedded_video, html_page, listing, scrolling, section
from tsuiseki.tracking.report.plots import inline_svg
from tsuiseki.tracking.sphere.space_plots import deviation_figure, path_figure
from tsuiseki.tracking.sphere.sphere_run import SphereLog
from tsuiseki.tracking.types import STATUSES, FloatArray, Position
from tsuiseki.tracking.types.tracks import Path3D


def sphere_page(
    log: SphereLog,
    cameras: Sequence[PlacedCamera],
    radius: float,
    truth: Path3D | None,
    videos: Sequence[Path | None],
    seconds: Mapping[str, float],
    settings: Mapping[str, Any],
) -> str:
    """The page as HTML, self-contained.

    Args:
        log: what was found.
        cameras: that looked.
        radius: of the ball, m; 0 where measured points were followed and none was told.
        truth: the true path, where it is known.
        videos: overlays, one a camera, where there is one.
        seconds: per stage of the run.
        settings: of the run, plain values.
    """
    positions = log.positions
    sections = [
        ("What was found", _summary(log, cameras, seconds)),
        ("Distance to the truth", "" if truth is None else _distances(positions, truth)),
        ("Path", scrolling(inline_svg(lambda ink: path_figure(positions, cameras, truth, ink), "path")) + NOTE),
        (
            "Uncertainty over time",
            scrolling(inline_svg(lambda ink: deviation_figure(positions, truth, ink), "uncertainty")),
        ),
    ]
    sections += [(f"Overlay of {cameras[k].name}", embedded_video(video)) for k, video in enumerate(videos) if video]
    facts = {name: str(value) for name, value in settings.items() if value is not None}
    sections.append(("How it was made", listing(facts)))
    ball = f"A ball of {100 * radius:g} cm radius" if radius > 0 else "A point"
    introduction = f"{ball} followed by {len(cameras)} cameras."
    return html_page("Ball in space", introduction, [section(*each) for each in sections])


NOTE = (
    "<p class=note>Dots are estimates, coloured by status; pale ellipses hold the ball with 95 % by the filter's own "
    "account; triangles are the cameras.</p>"
)


def _summary(log: SphereLog, cameras: Sequence[PlacedCamera], seconds: Mapping[str, float]) -> str:
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
    rows.append(("Filter, a moment", f"{1000 * seconds.get('filter', 0.0) / count:.1f} ms"))
    cells = "".join(f"<tr><th scope=row>{escape(k)}</th><td>{escape(v)}</td></tr>" for k, v in rows)
    return scrolling(f"<table><tbody>{cells}</tbody></table>")


def distances_to_truth(positions: Sequence[Position], truth: Path3D) -> FloatArray:
    """``(N,)`` distances to the true position, metres, where it is known."""
    away = distance_to_position(_track(positions), truth)
    return away[np.isfinite(away)]


def _track(positions: Sequence[Position]) -> Path3D:
    return Path3D(np.array([p.time for p in positions]), np.array([p.point for p in positions]))


def _distances(positions: Sequence[Position], truth: Path3D) -> str:
    """Distances of the estimates to the truth, centimetres."""
    track, away, rows = _track(positions), distances_to_truth(positions, truth), ""
    for name, values in (
        ("true position", away),
        ("true path", distance_to_path(track.points, truth.points)),
    ):
        if len(values):
            scores = distance_scores(values)
            cells = "".join(f"<td>{100 * v:.2f} cm</td>" for v in (scores.mean, scores.maximum, scores.deviation))
            rows += f"<tr><th scope=row>{name}</th>{cells}</tr>"
    heads = "".join(f"<th scope=col>{name}</th>" for name in ("To the", "Mean", "Largest", "Deviation"))
    return scrolling(f"<table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>")
