"""Okutama-Action as training samples: its folder layout, or a generated clip with ``gt/actions.txt``."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.datamodules.readers.action_sequence import ActionSequence
from tsuiseki.datamodules.readers.mot import LabelledImage
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.actions import OKUTAMA_ACTIONS
from tsuiseki.tracking.formats.okutama import okutama_truth
from tsuiseki.tracking.formats.okutama_folders import OkutamaVideo, find_okutama, read_okutama_video


def okutama_sequences(
    folder: str | Path, class_names: tuple[str, ...] = OKUTAMA_ACTIONS, multiple_actions: bool = False
) -> list[ActionSequence]:
    """The videos at ``folder``, see `find_okutama`, with their frames.

    Args:
        folder: see the module.
        class_names: the actions that are known.
        multiple_actions: read ``MultiActionLabels``, with all actions but ids that change every 180 frames.

    Raises:
        RequestError: the layout is another, labels are broken (see `read_okutama`), frames are missing, or frames and
            labels do not match.
    """
    return [_sequence(video, class_names) for video in find_okutama(folder, multiple_actions)]


def _sequence(video: OkutamaVideo, class_names: tuple[str, ...]) -> ActionSequence:
    if not video.images:
        place = f"Drone*/*/Extracted-Frames-1280x720/{video.name}/, or img1/ of a generated clip"
        raise RequestError(f"{video.labels}: expected its frames in {place}; found none")
    return ActionSequence(video.name, video.images, read_okutama_video(video, class_names))


def okutama_images(folder: str | Path, frames: tuple[int, int] | None = None) -> list[LabelledImage]:
    """The people of `okutama_sequences` as labelled images to train a detector on; occluded ones are ignored.

    Args:
        folder: see `okutama_sequences`.
        frames: first and last frame, 1-based and both included, as in MOTChallenge folders; by default all.
    """
    samples = []
    for sequence in okutama_sequences(folder):
        truth, _ = okutama_truth(sequence.labels, "lenient")
        first, last = frames or (1, len(sequence.files))
        for frame in range(max(first, 1) - 1, min(last, len(sequence.files))):
            rows = truth.between(frame, frame)
            samples.append(
                LabelledImage(
                    sequence.files[frame], sequence.name, frame, rows.boxes, rows.ids, rows.ignored, rows.visibility
                )
            )
    return samples
