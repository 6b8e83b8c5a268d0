"""Okutama-Action as training samples: its folder layout, or a generated clip with ``gt/actions.txt``.

The layout: ``Drone1/Morning/Extracted-Frames-1280x720/1.1.1/0.jpg …`` (and Drone2, Noon; perhaps under
``TrainSetFrames``) and ``Labels/SingleActionTrackingLabels/3840x2160/1.1.1.txt``, or ``MultiActionLabels`` where the
former are missing.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2

from tsuiseki.datamodules.readers.mot import LabelledImage
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.actions import OKUTAMA_ACTIONS
from tsuiseki.tracking.formats.mot import list_images
from tsuiseki.tracking.formats.okutama import LABEL_SIZE, ActionLabels, okutama_truth, read_okutama

LABEL_FOLDERS = ("SingleActionTrackingLabels", "MultiActionLabels")
GENERATED_LABELS = "gt/actions.txt"


@dataclass(frozen=True)
class ActionSequence:
    """A video and what everybody in it does.

    Attributes:
        name: of the video.
        images: by frame number.
        size: their width and height, pixels.
        labels: in pixels of the images.
    """

    name: str
    images: tuple[Path, ...]
    size: tuple[int, int]
    labels: ActionLabels


def is_okutama(folder: Path) -> bool:
    """Whether ``folder`` has Okutama-Action's layout, or is a generated clip with actions."""
    return (folder / "Labels").is_dir() or (folder / GENERATED_LABELS).is_file()


def okutama_sequences(
    folder: str | Path, class_names: tuple[str, ...] = OKUTAMA_ACTIONS, multiple_actions: bool = False
) -> list[ActionSequence]:
    """The videos of Okutama-Action at ``folder``, or of a generated clip, or of a folder of generated clips.

    Args:
        folder: see the module.
        class_names: the actions that are known.
        multiple_actions: read ``MultiActionLabels``, with all actions but ids that change every 180 frames.

    Raises:
        RequestError: the layout is another, labels are broken (see `read_okutama`), or frames and labels do not match.
    """
    folder = Path(folder)
    pairs = _generated(folder) if not (folder / "Labels").is_dir() else _published(folder, multiple_actions)
    if not pairs:
        raise RequestError(
            f"expected Labels/ and Drone1/…/Extracted-Frames-1280x720/ of Okutama-Action in {folder}, or generated "
            f"clips with {GENERATED_LABELS}; found neither"
        )
    return [_sequence(name, images, labels, class_names) for name, images, labels in pairs]


def _generated(folder: Path) -> list[tuple[str, Path, Path]]:
    clips = [folder] if (folder / GENERATED_LABELS).is_file() else sorted(folder.glob("*/"))
    return [
        (clip.name, clip / "img1", clip / GENERATED_LABELS) for clip in clips if (clip / GENERATED_LABELS).is_file()
    ]


def _published(folder: Path, multiple_actions: bool) -> list[tuple[str, Path, Path]]:
    kinds = reversed(LABEL_FOLDERS) if multiple_actions else LABEL_FOLDERS
    found: list[Path] = []
    for kind in kinds:
        found = found or sorted((folder / "Labels" / kind).glob("*/*.txt"))
    pairs = []
    for labels in found:
        images = [p for p in sorted(folder.glob(f"**/Extracted-Frames-*/{labels.stem}")) if p.is_dir()]
        if not images:
            raise RequestError(f"{labels}: expected its frames in Drone*/*/Extracted-Frames-1280x720/{labels.stem}/")
        pairs.append((labels.stem, images[0], labels))
    return pairs


def _sequence(name: str, folder: Path, labels: Path, class_names: tuple[str, ...]) -> ActionSequence:
    images = _by_number(list_images(folder))
    if not images:
        raise RequestError(f"{labels}: expected its frames in {folder}, found none")
    first = cv2.imread(str(images[0]))
    if first is None:
        raise RequestError(f"{images[0]}: expected an image, got something unreadable")
    size = (first.shape[1], first.shape[0])
    found = read_okutama(labels, size, class_names)
    check_frames(found, len(images), size, str(labels))
    return ActionSequence(name, images, size, found)


def _by_number(images: tuple[Path, ...]) -> tuple[Path, ...]:
    """In the order of the numbers that are their names, which carry no leading zeros."""
    return tuple(sorted(images, key=lambda p: (int(p.stem) if p.stem.isdigit() else 0, p.name)))


def check_frames(labels: ActionLabels, length: int, size: tuple[int, int], name: str) -> None:
    """Refuse a video whose frames the labels cannot belong to.

    Raises:
        RequestError: labels reach beyond the video, the aspect ratio is another, or it is one of Okutama's 4K videos,
            which its labels do not line up with.
    """
    last = int(labels.frames.max())
    advice = "use the frames that come with the data, Extracted-Frames-1280x720"
    if last >= length:
        raise RequestError(f"{name}: labels reach frame {last}, but the video ends with frame {length - 1}; {advice}")
    if abs(size[0] * LABEL_SIZE[1] - size[1] * LABEL_SIZE[0]) > 0.01 * size[1] * LABEL_SIZE[0]:
        raise RequestError(
            f"{name}: expected frames of the aspect 16:9 of the labels, got {size[0]}x{size[1]}; {advice}"
        )
    if size == LABEL_SIZE and length != last + 1:
        raise RequestError(
            f"{name}: the 3840x2160 video has {length} frames, the labels {last + 1}: Okutama's 4K videos and its "
            f"labels do not line up; {advice}"
        )


def okutama_images(folder: str | Path, frames: tuple[int, int] | None = None) -> list[LabelledImage]:
    """The people of `okutama_sequences` as labelled images to train a detector on; occluded ones are ignored.

    Args:
        folder: see `okutama_sequences`.
        frames: first and last frame, 1-based and both included, as in MOTChallenge folders; by default all.
    """
    samples = []
    for sequence in okutama_sequences(folder):
        truth, _ = okutama_truth(sequence.labels, "lenient")
        first, last = frames or (1, len(sequence.images))
        for frame in range(max(first, 1) - 1, min(last, len(sequence.images))):
            rows = truth.between(frame, frame)
            samples.append(
                LabelledImage(
                    sequence.images[frame], sequence.name, frame, rows.boxes, rows.ids, rows.ignored, rows.visibility
                )
            )
    return samples
