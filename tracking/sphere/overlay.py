"""The ball's estimated outline drawn into each camera's video."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import takewhile
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.cameras.outline import sphere_outlines
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.report.overlay import write_drawn
from tsuiseki.tracking.sphere.sphere_run import SphereLog
from tsuiseki.tracking.types import FloatArray, Frame, ImageArray, Position

STATUS_COLOURS = {"tracking": (40, 230, 90), "searching": (255, 190, 40), "lost": (255, 70, 60)}
POINTS, DASH = 48, 3
# Fractions of a pixel that OpenCV draws to.
SHIFT = 4
TRAIL_MOMENTS = 30
FONT, SIZE = cv2.FONT_HERSHEY_SIMPLEX, 0.45


def draw_sphere(
    image: ImageArray, camera: PinholeCamera, position: Position, radius: float, view: int, trail: FloatArray
) -> ImageArray:
    """A copy of ``image`` with the outline, its centre, the way there and the status.

    Args:
        image: ``(H, W, 3)`` uint8 RGB.
        camera: that took it.
        position: the estimate.
        radius: of the ball, m.
        view: number of the camera, from 0; a dashed outline says that it does not contribute.
        trail: ``(T, 3)`` recent positions, m.
    """
    drawn = image.copy()
    colour = STATUS_COLOURS[position.status]
    way, _ = camera.project(trail.reshape(-1, 3))
    way = way[np.isfinite(way).all(axis=1)]
    if len(way) > 1:
        cv2.polylines(drawn, [_fixed(way)], False, colour, 1, cv2.LINE_AA, SHIFT)
    outlines = sphere_outlines(camera, position.point[None], radius)
    points = outlines.points(POINTS)[0]
    used = len(position.open) <= view or position.open[view] > 0.5
    if np.isfinite(points).all() and np.abs(points).max() < 1e4:
        ring = _fixed(np.concatenate([points, points[:1]]))
        parts = [ring] if used else [ring[k : k + DASH] for k in range(0, POINTS, 2 * DASH)]
        cv2.polylines(drawn, parts, False, colour, 2, cv2.LINE_AA, SHIFT)
        cv2.drawMarker(drawn, _whole(outlines.centre[0]), colour, cv2.MARKER_CROSS, 7, 1, cv2.LINE_AA)
    x, y, z = position.point
    text = f"{position.time:6.2f} s   x {x:+.2f}  y {y:+.2f}  z {z:+.2f} m   {position.status}"
    text += "" if used else ", this camera is covered"
    width = cv2.getTextSize(text, FONT, SIZE, 1)[0][0]
    cv2.rectangle(drawn, (0, 0), (12 + width, 22), (20, 20, 20), cv2.FILLED)
    cv2.putText(drawn, text, (6, 15), FONT, SIZE, (255, 255, 255), 1, cv2.LINE_AA)
    return drawn


def _fixed(points: FloatArray) -> NDArray[np.int32]:
    # OpenCV counts from the first pixel's centre.
    return np.asarray(np.round((points - 0.5) * 2**SHIFT), dtype=np.int32)


def _whole(point: FloatArray) -> tuple[int, int]:
    return round(float(point[0] - 0.5)), round(float(point[1] - 0.5))


def write_sphere_overlay(
    path: Path,
    frames: Iterable[Frame],
    frame_rate: float,
    log: SphereLog,
    camera: PinholeCamera,
    radius: float,
    view: int,
) -> None:
    """Write the video of one camera with the ball's outline, up to the last frame that was used.

    Raises:
        RunError: the video breaks off, or cannot be written.
    """
    at = {m.frames[view]: k for k, m in enumerate(log.moments) if m.frames[view] is not None}
    points = np.array([p.point for p in log.positions])
    last = max((frame for frame in at if frame is not None), default=-1)

    def draw(frame: Frame) -> ImageArray:
        moment = at.get(frame.index)
        if moment is None:
            return frame.image
        trail = points[max(moment - TRAIL_MOMENTS, 0) : moment + 1]
        return draw_sphere(frame.image, camera, log.positions[moment], radius, view, trail)

    write_drawn(path, takewhile(lambda frame: frame.index <= last, frames), frame_rate, draw)
