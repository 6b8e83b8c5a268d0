"""Video labelled with actions, of any layout that is known: the layout is seen from the folder."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.datamodules.readers.action_sequence import ActionSequence
from tsuiseki.datamodules.readers.okutama import okutama_sequences
from tsuiseki.tracking.formats.drone_action import (
    DroneActionClip,
    drone_action_labels,
    find_drone_action,
    has_drone_action_layout,
)
from tsuiseki.tracking.formats.mot import list_images


def action_sequences(folder: str | Path, multiple_actions: bool = False) -> list[ActionSequence]:
    """The labelled videos at ``folder``: of Okutama-Action, of Drone-Action, or generated clips.

    Args:
        folder: see `okutama_sequences` and `find_drone_action` for the layouts.
        multiple_actions: of Okutama-Action, read ``MultiActionLabels``.

    Raises:
        RequestError: the layout is another, labels are broken or missing, or frames and labels do not match.
    """
    if has_drone_action_layout(Path(folder)):
        return [_of_clip(clip) for clip in find_drone_action(folder)]
    return okutama_sequences(folder, multiple_actions=multiple_actions)


def _of_clip(clip: DroneActionClip) -> ActionSequence:
    if clip.source.is_dir():
        images = list_images(clip.source)
        return ActionSequence(clip.name, images, drone_action_labels(clip, len(images)))
    return ActionSequence(clip.name, (clip.source,), drone_action_labels(clip))
