"""`world.csv`: where people are on the floor, and their boxes in the image.

A header, then ``id, time`` (seconds), ``x, y`` (metres), ``left, top, width, height`` (the upright box as in
MOTChallenge's text, 1-based pixels) and ``rx, ry, rw, rh, degrees`` (the rotated box: centre, width across the body,
height along it, pixels, and the angle clockwise from upright, heads up, in [-180, 180)).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tsuiseki.tracking.geometry import xywh_from_corners
from tsuiseki.tracking.types.tracks import FloorTrack

HEADER = "id,time,x,y,left,top,width,height,rx,ry,rw,rh,degrees"


def write_world(path: Path, tracks: Sequence[FloorTrack], frame_rate: float) -> None:
    """Write ``tracks`` by time, then by id."""
    rows = []
    for each in tracks:
        boxes = xywh_from_corners(each.track.boxes) + np.array([1, 1, 0, 0])
        degrees = (np.degrees(each.rotated[:, 4:]) + 180) % 360 - 180
        values = np.concatenate([each.places, boxes, each.rotated[:, :4], degrees], axis=1)
        for frame, line in zip(each.track.frames.tolist(), values.tolist(), strict=True):
            x, y, *rest = line
            text = ",".join([f"{x:.4f}", f"{y:.4f}", *(f"{v:.2f}" for v in rest)])
            rows.append((frame, each.track.id, f"{each.track.id},{frame / frame_rate:.4f},{text}\n"))
    path.write_text(HEADER + "\n" + "".join(line for *_, line in sorted(rows)), encoding="utf-8")
