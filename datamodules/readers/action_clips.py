"""Clips of people labelled with actions, as training samples."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tsuiseki.datamodules.identity_crops import read_image
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import find_sequences
from tsuiseki.tracking.formats.okutama import ActionLabels, read_okutama

ACTIONS_FILE = "gt/actions.txt"


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
    """The clip in ``folder``, or in each of its sub-folders: a MOTChallenge sequence with ``gt/actions.txt``.

    Raises:
        RequestError: there is none, one has no images, or its labels are not readable.
    """
    clips = []
    for sequence in find_sequences(folder):
        if not sequence.images:
            raise RequestError(f"{sequence.folder}: expected images in img1/, found none; training needs them")
        size = (sequence.width, sequence.height)
        if min(size) == 0:
            size = read_image(sequence.images[0]).shape[1::-1]
        labels = read_okutama(sequence.folder / ACTIONS_FILE, size)
        last = int(labels.frames[~labels.lost].max(initial=-1))
        if last >= len(sequence.images):
            raise RequestError(
                f"{sequence.folder}: labels reach frame {last}, but there are {len(sequence.images)} images; are these "
                "the labels of another video?"
            )
        clips.append(ActionClip(sequence.name, sequence.images, labels))
    return clips
