"""COCO's JSON with tracks: ``videos``, ``images`` with ``frame_id`` from 0, and ``annotations`` with ``track_id``.

A ``bbox`` is x, y, width, height in pixels from 0. ``instance_id``, as other tools call it, is read like ``track_id``.
Where annotations have neither, as in COCO itself, they are labels of single pictures; crowds are ignored there.
``detection`` is the row of the box in what the detector or the user gave for the frame, where that is known.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import read_json
from tsuiseki.tracking.formats.tracked_video import (
    BoxOfPicture,
    TrackedVideo,
    inside,
    tracks_of_rows,
    tracks_without_ids,
)
from tsuiseki.tracking.geometry import xywh_from_corners

WHAT = "COCO's JSON"


def write_coco(path: Path, video: TrackedVideo) -> None:
    """Write the tracks; images of a video file are called 000001.jpg and so on."""
    width, height = video.pixels
    # Categories count from 1.
    first = min(video.kinds.values())
    rows, kinds = video.boxes, {kind: number + max(1 - first, 0) for kind, number in video.kinds.items()}
    columns = zip(
        rows.frames.tolist(), rows.ids.tolist(), xywh_from_corners(rows.boxes).round(3).tolist(),
        rows.scores.round(4).tolist(), rows.observed.tolist(), rows.detection.tolist(), strict=True,
    )  # fmt: skip
    content = {
        "info": {"description": video.name, "frame_rate": video.frame_rate},
        "licenses": [],
        "videos": [{"id": 1, "name": video.name, "width": width, "height": height, "length": video.frame_count}],
        "categories": [{"id": number, "name": kind, "supercategory": ""} for kind, number in kinds.items()],
        "images": [
            {"id": frame + 1, "file_name": video.image(frame), "width": width, "height": height, "video_id": 1,
             "frame_id": frame}
            for frame in range(video.frame_count)
        ],
        "annotations": [
            {"id": k, "image_id": frame + 1, "video_id": 1, "track_id": number,
             "category_id": kinds[video.kind[number]], "bbox": box, "area": round(box[2] * box[3], 3),
             "iscrowd": 0, "segmentation": [], "score": score, "filled": not observed,
             **({"detection": row} if row >= 0 else {})}
            for k, (frame, number, box, score, observed, row) in enumerate(columns, start=1)
        ],
    }  # fmt: skip
    path.write_text(json.dumps(content) + "\n", encoding="utf-8")


def read_coco(path: Path) -> TrackedVideo:
    """The tracks of the only video in a file, or the boxes of its pictures where any has no id.

    Raises:
        RequestError: it is something else or broken, or has several videos.
    """
    content = read_json(path, WHAT)
    try:
        images, categories = content["images"], {one["id"]: str(one["name"]) for one in content["categories"]}
        several = {image.get("video_id", 0) for image in images}
        if len(several) > 1:
            raise RequestError(f"{path}: expected one video, got {len(several)}; keep the images of one")
        order = sorted(range(len(images)), key=lambda k: images[k].get("frame_id", k))
        counted = all("frame_id" in image for image in images)
        frames = {images[k]["id"]: int(images[k]["frame_id"]) if counted else n for n, k in enumerate(order)}
        rows, single, classes = [], list[BoxOfPicture](), dict[int, tuple[int, str]]()
        for entry in content["annotations"]:
            number = _number(entry)
            x, y, width, height = map(float, entry["bbox"])
            box = (x, y, x + width, y + height)
            observed = not entry.get("filled", False)
            score, row = float(entry.get("score", 1)), int(entry.get("detection", -1))
            frame, kind = frames[entry["image_id"]], (int(entry["category_id"]), categories[entry["category_id"]])
            rows.append((frame, number, box, score, observed, row))
            if number is not None:
                classes[number] = kind
            single.append((frame, kind, box, bool(entry.get("iscrowd"))))
        identified = all(number is not None for _, number, *_ in rows)
        names = tuple(inside(images[k].get("file_name", "")) or "" for k in order)
        sizes = {(int(image["width"]), int(image["height"])) for image in images if image.get("width")}
    except RequestError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise RequestError(
            f"{path}: expected {WHAT} with images, categories and annotations of boxes, got {error!r}"
        ) from error
    known = TrackedVideo(tracks_of_rows(path, rows, classes)) if identified else tracks_without_ids(path, single)
    info = content.get("info") if isinstance(content.get("info"), dict) else {}
    rate = info.get("frame_rate", 0.0)
    videos = content.get("videos") or [{}]
    return replace(
        known,
        name=str(videos[0].get("name") or path.stem),
        frame_rate=float(rate) if isinstance(rate, int | float) else 0.0,
        size=sizes.pop() if len(sizes) == 1 else None,
        length=max(frames.values(), default=-1) + 1,
        images=names if all(names) else (),
    )


def _number(entry: Any) -> int | None:
    for name in ("track_id", "instance_id"):
        if name in entry:
            return int(entry[name])
        if name in (entry.get("attributes") or {}):
            return int(entry["attributes"][name])
    return None
