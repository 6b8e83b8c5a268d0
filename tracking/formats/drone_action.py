"""Drone-Action: clips of one person each, who does one of 13 things.

The layout assumed: ``CLASS/CLIP.avi``, or ``CLASS/CLIP/`` with the frames as images, where CLASS is one of
`DRONE_ACTION_CLASSES` or of `OTHER_SPELLINGS`; boxes, where there are any, in ``CLASS/CLIP.txt``, a row
``x,y,width,height`` a frame, 1-based pixels, ``nan`` where the person is out of view.

How it is evaluated: every frame's one box counts, from an IoU of 0.5 on, and every frame has its clip's one action.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot_sequence import is_sequence, list_images
from tsuiseki.tracking.formats.okutama import actions_of
from tsuiseki.tracking.formats.rows import read_rows
from tsuiseki.tracking.geometry import corners_from_xywh
from tsuiseki.tracking.types.labels import ActionLabels, GroundTruth

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
OTHER_SPELLINGS = {
    f"{gait}_{short}": f"{gait}_{long}"
    for gait in ("jogging", "running", "walking")
    for short, long in (("f_b", "front_back_view"), ("side", "sideview"))
}
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

    def labelled(self) -> Path:
        """The file of boxes; raises RequestError where there is none."""
        if self.labels is None:
            place = self.source.with_name(f"{self.name}.txt")
            raise RequestError(f"{self.source}: expected its boxes in {place}, found none")
        return self.labels


def is_drone_action(folder: Path) -> bool:
    """Whether a folder in ``folder`` is named after a class; a MOTChallenge sequence of such a name does not count."""
    return any(_class_of(part.name) and not is_sequence(part) for part in _folders(folder))


def find_drone_action(folder: str | Path) -> list[DroneActionClip]:
    """The clips of ``folder``, by class and name.

    Raises:
        RequestError: there is none, a folder is named after no class, or two clips bear one name.
    """
    folder = Path(folder)
    clips = []
    for part in _folders(folder):
        action = _class_of(part.name)
        if action is None:
            raise RequestError(f"{part}: unknown action; expected a folder of {', '.join(DRONE_ACTION_CLASSES)}")
        for source in sorted(part.iterdir()):
            if source.suffix.lower() in VIDEO_SUFFIXES or list_images(source):
                name = source.name if source.is_dir() else source.stem
                labels = part / f"{name}.txt"
                clips.append(DroneActionClip(name, action, source, labels if labels.is_file() else None))
    if not clips:
        raise RequestError(f"expected clips of Drone-Action as CLASS/CLIP.avi in {folder}, found none")
    by_name = {clip.name: clip for clip in clips}
    for clip in clips:
        if by_name[clip.name] is not clip:
            raise RequestError(
                f"expected clips of different names, got {clip.source} and {by_name[clip.name].source}; results are "
                "distinguished by them"
            )
    return clips


def _folders(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(part for part in folder.iterdir() if part.is_dir() and not part.name.startswith("."))


def _class_of(name: str) -> str | None:
    spelling = OTHER_SPELLINGS.get(name, name)
    return spelling if spelling in DRONE_ACTION_CLASSES else None


def drone_action_labels(clip: DroneActionClip, length: int | None = None) -> ActionLabels:
    """What the person of a clip does, in every frame with a box.

    Raises:
        RequestError: the clip has no boxes, or see `read_drone_action_boxes`.
    """
    truth = read_drone_action_boxes(clip.labelled(), length)
    never = np.zeros(len(truth), dtype=np.bool_)
    actions = actions_of([(clip.action,)] * len(truth), DRONE_ACTION_CLASSES)
    return ActionLabels(
        truth.frames, truth.ids, truth.boxes, never, never, never, actions, class_names=DRONE_ACTION_CLASSES
    )


def read_drone_action_boxes(path: str | Path, length: int | None = None) -> GroundTruth:
    """The boxes of one clip's person, whose id is 1; the clip has ``length`` frames, if that is known.

    Raises:
        RequestError: the file is malformed, or has rows for another number of frames.
    """
    path = Path(path)
    table = read_rows(path, "boxes").without_heading(4)
    rows = table.numbers("x,y,width,height")
    if length is not None and len(rows) != length:
        raise RequestError(f"{path}: expected a row for each of {length} frames, got {len(rows)}")
    visible = np.flatnonzero(np.isfinite(rows).all(axis=1))
    if not len(visible) or (rows[visible, 2:] <= 0).any():
        k = int(visible[np.argmax((rows[visible, 2:] <= 0).any(axis=1))]) if len(visible) else 0
        raise RequestError(f"{path}:{k + 1}: expected a box with a positive width and height in some frame")
    boxes = corners_from_xywh(rows[visible] - np.array([1, 1, 0, 0]))
    return GroundTruth.of_boxes(visible, np.ones(len(visible), dtype=np.int64), boxes)
