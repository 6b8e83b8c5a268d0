"""A video in which people are labelled with what they do, whatever data set it comes from."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

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
