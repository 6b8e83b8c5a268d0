"""Clips of people labelled with actions, as training samples."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.action_labels import ActionLabels
from tsuiseki.tracking.formats.mot import find_sequences

LABELS_FILE = "labels.txt"
NAMES = ("Running", "Walking", "Lying", "Sitting", "Standing", "Handshaking", "Hugging", "Reading", "Drinking",
         "Pushing/Pulling", "Carrying", "Calling")  # fmt: skip


@dataclass(frozen=True)
class ActionClip:
    """A clip and its labels.

    Attributes:
        name: of the clip.
        images: one path a frame.
        labels: the people in it.
    """

    name: str
    images: tuple[Path, ...]
    labels: ActionLabels


def find_action_clips(folder: Path) -> list[ActionClip]:
    """The clip in ``folder``, or in each of its sub-folders."""
    return [ActionClip(s.name, s.images, _read(s.folder / LABELS_FILE)) for s in find_sequences(folder)]


def _read(path: Path) -> ActionLabels:
    rows, actions = [], []
    for line in path.read_text().splitlines():
        head, *rest = line.split('"')
        words = head.split()
        rows.append([float(w) for w in words[:9]])
        said = [r for r in rest if r.strip()][1:]
        actions.append([name in said for name in NAMES])
    table = np.array(rows)
    if not len(table):
        raise RequestError(f"{path}: no rows")
    return ActionLabels(
        NAMES,
        table[:, 5].astype(np.int64),
        table[:, 0].astype(np.int64),
        table[:, 1:5],
        np.array(actions),
        1.0 - 0.8 * table[:, 7],
    )
