"""VIA's CSV of tracks, which movement reads: a row for each box, with the frame, counted from 0, and the track."""

from __future__ import annotations

import csv
import json
from pathlib import Path

from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.geometry import xywh_from_corners

HEADING = ("filename", "file_size", "file_attributes", "region_count", "region_id", "region_shape_attributes",
           "region_attributes")  # fmt: skip


def write_via_tracks(path: Path, video: TrackedVideo) -> None:
    """Write the boxes, by frame, then by id."""
    rows = video.boxes
    columns = zip(
        rows.frames.tolist(), rows.ids.tolist(), xywh_from_corners(rows.boxes).round(3).tolist(),
        rows.scores.round(4).tolist(), strict=True,
    )  # fmt: skip
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEADING)
        for frame, number, box, score in columns:
            shape = {"name": "rect", **dict(zip(("x", "y", "width", "height"), box, strict=True))}
            about = {"track": str(number), "confidence": str(score), "class": video.kind[number]}
            image = f"{video.stem}_{frame:08d}.jpg"
            writer.writerow([image, 0, json.dumps({"frame": frame}), 1, 0, json.dumps(shape), json.dumps(about)])
