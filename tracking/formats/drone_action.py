"""Drone-Action: clips of one person each, who does one of 13 things.

The layout assumed: ``CLASS/CLIP.avi``, or ``CLASS/CLIP/`` with the frames as images, where CLASS is one of
`DRONE_ACTION_CLASSES`; boxes, where there are any, in ``CLASS/CLIP.txt``, a row ``x,y,width,height`` a frame, 1-based
pixels, ``nan`` where the person is out of view.

How it is evaluated: every frame's one box counts, at an IoU above 0.5, and every frame has its clip's one action.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import GroundTruth, list_images
from tsuiseki.tracking.geometry import corners_from_xywh

DRONE_ACTION_CLASSES = (
    "clapping",
    "hitting_bottle",
    "hitting_stick",
    "jogging_front_back_view",
    "jogging_sideview",
    "kicking",
    "punching",
    "running_front_back_view",
    "running_sideview",
    "stabbing",
    "walking_front_back_view",
    "walking_sideview",
    "waving_hands",
)
VIDEO_SUFFIXES = (".avi", ".mp4", ".mov", ".mkv")


@dataclass(frozen=True)
class DroneActionClip:
    """A clip.

    Attributes:
        name: without suffix.
        action: one of `DRONE_ACTION_CLASSES`.
        source: the video file or the folder of images.
        labels: the file of boxes, or None.
    """

    name: str
    action: str
    source: Path
    labels: Path | None


def find_drone_action(folder: str | Path) -> list[DroneActionClip]:
    """The clips of ``folder``, by class and name.

    Raises:
        RequestError: there is none, or a folder is named after no class.
    """
    folder = Path(folder)
    classes = (
        sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith(".")) if folder.is_dir() else []
    )
    clips = []
    for part in classes:
        if part.name not in DRONE_ACTION_CLASSES:
            raise RequestError(f"{part}: unknown action; expected a folder of {', '.join(DRONE_ACTION_CLASSES)}")
        for source in sorted(part.iterdir()):
            if source.suffix.lower() in VIDEO_SUFFIXES or (source.is_dir() and list_images(source)):
                labels = part / f"{source.stem}.txt"
                clips.append(DroneActionClip(source.stem, part.name, source, labels if labels.is_file() else None))
    if not clips:
        raise RequestError(f"expected clips of Drone-Action as CLASS/CLIP.avi in {folder}, found none")
    return clips


def read_drone_action_boxes(path: str | Path, length: int | None = None) -> GroundTruth:
    """The boxes of one clip's person, whose id is 1.

    Args:
        path: of the text file.
        length: frames of the clip, if known.

    Raises:
        RequestError: the file is malformed, or has rows for another number of frames.
    """
    path = Path(path)
    lines = path.read_text(encoding="utf-8", errors="replace").rstrip().splitlines()
    rows = np.empty((len(lines), 4))
    for k, line in enumerate(lines):
        try:
            rows[k] = [float(cell) for cell in line.replace(",", " ").split()]
        except ValueError:
            raise RequestError(f"{path}:{k + 1}: expected x,y,width,height, got {line[:80]}") from None
    if length is not None and len(rows) != length:
        raise RequestError(f"{path}: expected a row for each of {length} frames, got {len(rows)}")
    seen = np.flatnonzero(np.isfinite(rows).all(axis=1))
    if not len(seen) or (rows[seen, 2:] <= 0).any():
        k = int(seen[np.argmax((rows[seen, 2:] <= 0).any(axis=1))]) if len(seen) else 0
        raise RequestError(f"{path}:{k + 1}: expected a box with a positive width and height in some frame")
    boxes = corners_from_xywh(rows[seen] - np.array([1, 1, 0, 0]))
    everyone = np.ones(len(seen), dtype=np.bool_)
    return GroundTruth(seen, np.ones(len(seen), dtype=np.int64), boxes, everyone, ~everyone, np.ones(len(seen)))
