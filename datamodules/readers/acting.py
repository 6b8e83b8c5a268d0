"""Video in which people are labelled with what they do, of any layout."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.drone_action import DRONE_ACTION_CLASSES
from tsuiseki.tracking.formats.labelled import LabelledVideo, open_labelled
from tsuiseki.tracking.formats.okutama import check_frames
from tsuiseki.tracking.types.labels import ActionLabels


@dataclass(frozen=True)
class ActionSequence:
    """A video and what everybody in it does.

    Attributes:
        name: of the video.
        files: one image a frame, by frame number; or one video file.
        labels: in pixels of the frames.
    """

    name: str
    files: tuple[Path, ...]
    labels: ActionLabels

    def digest(self) -> str:
        """A digest of labels and files, by their names and sizes."""
        rows = self.labels
        content = hashlib.sha256()
        for values in (rows.frames, rows.ids, np.round(rows.boxes, 3), rows.lost, rows.occluded, rows.actions):
            content.update(np.ascontiguousarray(values).tobytes())
        content.update(repr([(path.name, path.stat().st_size) for path in self.files]).encode())
        return content.hexdigest()[:32]


def action_sequences(folder: str | Path, multiple_actions: bool = False) -> list[ActionSequence]:
    """The videos at ``folder`` that are labelled with actions: of Okutama-Action, of Drone-Action, or generated clips.

    Args:
        folder: see `open_labelled`.
        multiple_actions: of Okutama-Action, read ``MultiActionLabels``, with all actions but ids that change every 180
            frames.

    Raises:
        RequestError: there is none, labels are broken, frames are missing, or frames and labels do not match.
    """
    found = [video for video in open_labelled(Path(folder), multiple_actions) if video.read_actions is not None]
    if not found:
        raise RequestError(f"{folder}: expected video labelled with actions, found none")
    return [_sequence(video) for video in found]


def _sequence(video: LabelledVideo) -> ActionSequence:
    if not video.files:
        place = f"Drone*/*/Extracted-Frames-1280x720/{video.name}/, or img1/ of a generated clip"
        raise RequestError(f"{video.name}: expected its frames in {place}; found none")
    if video.length is None:
        return ActionSequence(video.name, video.files, video.actions())
    first = cv2.imread(str(video.files[0]))
    if first is None:
        raise RequestError(f"{video.files[0]}: expected an image, got something unreadable")
    size = (first.shape[1], first.shape[0])
    labels = video.actions(size)
    # Drone-Action's labels are in pixels of their frames, whatever those are.
    if labels.class_names != DRONE_ACTION_CLASSES:
        check_frames(labels, video.length, size, video.name)
    return ActionSequence(video.name, video.files, labels)
