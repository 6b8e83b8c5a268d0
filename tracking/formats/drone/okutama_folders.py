"""Okutama-Action's folders, and generated clips with ``gt/actions.txt``: which labels belong to which frames.

The layout: ``Drone1/Morning/Extracted-Frames-1280x720/1.1.1/0.jpg …`` (and Drone2, Noon; perhaps under
``TrainSetFrames``) and ``Labels/SingleActionTrackingLabels/3840x2160/1.1.1.txt``, or ``MultiActionLabels`` where the
former are missing.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.drone.actions import OKUTAMA_ACTIONS
from tsuiseki.tracking.formats.drone.okutama import ACTIONS_FILE, LABEL_SIZE, read_okutama
from tsuiseki.tracking.formats.mot_sequence import Sequence, is_sequence, list_images, read_sequence
from tsuiseki.tracking.types.labels import ActionLabels

LABEL_FOLDERS = ("SingleActionTrackingLabels", "MultiActionLabels")
# Of the frames that come with the data.
EXTRACTED_SIZE = (1280, 720)
ADVICE = "use the frames that come with the data, Extracted-Frames-1280x720"


@dataclass(frozen=True)
class OkutamaVideo:
    """A video's files.

    Attributes:
        name: of the video.
        images: by frame number; empty where only the labels are there.
        labels: the label file.
    """

    name: str
    images: tuple[Path, ...]
    labels: Path


def is_okutama(folder: Path) -> bool:
    """Whether ``folder`` has Okutama-Action's layout; MOTChallenge sequences beside a folder Labels do not."""
    return any((folder / "Labels" / kind).is_dir() for kind in LABEL_FOLDERS)


def is_okutama_file(path: Path) -> bool:
    """Whether ``path`` is a label file: what stands in the tenth column is a word, as in no other format here."""
    with path.open(encoding="utf-8", errors="replace") as file:
        words = file.readline().split(" ")
    return len(words) > 9 and words[9].lstrip('"')[:1].isalpha()


def clip_labelled_by(path: Path) -> Sequence | None:
    """The generated clip that has its labels at ``path``, as ``gt/actions.txt``; None where that is another file.

    Raises:
        RequestError: the clip is broken, see `read_sequence`.
    """
    path = path.absolute()
    clip = path.parent.parent
    return read_sequence(clip) if path.match(f"*/{ACTIONS_FILE}") and is_sequence(clip) else None


def read_clip_labels(clip: Sequence, size: tuple[int, int] | None = None) -> ActionLabels:
    """The labels in ``gt/actions.txt`` of a generated clip, in pixels of its frames.

    Args:
        clip: the clip.
        size: width and height of the frames, where the clip does not say.

    Raises:
        RequestError: labels are missing or broken (see `read_okutama`), or nothing says how large the frames are.
    """
    size = (clip.width, clip.height) if clip.width and clip.height else size
    if size is None:
        raise RequestError(f"{clip.folder}/seqinfo.ini: expected imWidth and imHeight, to scale {ACTIONS_FILE} to them")
    return read_okutama(clip.folder / ACTIONS_FILE, size)


def find_okutama(folder: str | Path, multiple_actions: bool = False) -> list[OkutamaVideo]:
    """The videos of Okutama-Action at ``folder``, or of a generated clip, or of a folder of generated clips, by name.

    Args:
        folder: see the module.
        multiple_actions: take ``MultiActionLabels``, with all actions but ids that change every 180 frames.

    Raises:
        RequestError: the layout is another, or frames are missing between others.
    """
    folder = Path(folder)
    if not is_okutama(folder):
        clips = [folder] if (folder / ACTIONS_FILE).is_file() else sorted(folder.glob("*/"))
        clips = [clip for clip in clips if (clip / ACTIONS_FILE).is_file()]
        videos = [OkutamaVideo(clip.name, list_images(clip / "img1"), clip / ACTIONS_FILE) for clip in clips]
    else:
        # Walking through the folders takes a while where there are a hundred thousand frames: once for all videos.
        # Of frames in several sizes the 1280x720 ones come last, and stay.
        found = sorted(folder.glob("**/Extracted-Frames-*/*"), key=str, reverse=True)
        places = {place.name: place for place in found if place.is_dir()}
        files = _label_files(folder / "Labels", multiple_actions)
        videos = [_published(labels, places.get(labels.stem)) for labels in files]
    if not videos:
        raise RequestError(
            f"expected Labels/ and Drone1/…/Extracted-Frames-1280x720/ of Okutama-Action in {folder}, or generated "
            f"clips with {ACTIONS_FILE}; found neither"
        )
    return videos


def read_okutama_video(
    video: OkutamaVideo, class_names: tuple[str, ...] = OKUTAMA_ACTIONS, size: tuple[int, int] | None = None
) -> ActionLabels:
    """The labels of a video, in pixels of its frames.

    Args:
        video: see `find_okutama`.
        class_names: the actions that are known.
        size: width and height that the labels are wanted for; by default those of the frames, or where there are none
            those of `EXTRACTED_SIZE`.

    Raises:
        RequestError: labels are broken (see `read_okutama`), or frames and labels do not match.
    """
    if not video.images:
        return read_okutama(video.labels, size or EXTRACTED_SIZE, class_names)
    first = cv2.imread(str(video.images[0]))
    if first is None:
        raise RequestError(f"{video.images[0]}: expected an image, got something unreadable")
    frame_size = (first.shape[1], first.shape[0])
    labels = read_okutama(video.labels, size or frame_size, class_names)
    check_frames(labels, len(video.images), frame_size, str(video.labels))
    return labels


def check_frames(labels: ActionLabels, length: int, size: tuple[int, int], name: str) -> None:
    """Refuse a video whose frames the labels cannot belong to.

    Raises:
        RequestError: labels reach beyond the video, the aspect ratio is another, or it is one of Okutama's 4K videos,
            which its labels do not line up with.
    """
    last = int(labels.frames.max())
    if last >= length:
        raise RequestError(f"{name}: labels reach frame {last}, but the video ends with frame {length - 1}; {ADVICE}")
    if abs(size[0] * LABEL_SIZE[1] - size[1] * LABEL_SIZE[0]) > 0.01 * size[1] * LABEL_SIZE[0]:
        raise RequestError(
            f"{name}: expected frames of the aspect 16:9 of the labels, got {size[0]}x{size[1]}; {ADVICE}"
        )
    if size == LABEL_SIZE and length != last + 1:
        raise RequestError(
            f"{name}: the 3840x2160 video has {length} frames, the labels {last + 1}: Okutama's 4K videos and its "
            f"labels do not line up; {ADVICE}"
        )


def _label_files(folder: Path, multiple_actions: bool) -> list[Path]:
    for kind in reversed(LABEL_FOLDERS) if multiple_actions else LABEL_FOLDERS:
        found = sorted((folder / kind).glob("*/*.txt"))
        if found:
            return found
    return []


def _published(labels: Path, frames: Path | None) -> OkutamaVideo:
    """The video of a label file, with its frames where they are there; their names are their numbers, from 0."""
    images = () if frames is None else list_images(frames)
    for number, image in enumerate(images):
        if image.stem.isdecimal() and int(image.stem) != number:
            raise RequestError(
                f"{image.parent}: expected frames numbered 0 to {len(images) - 1}, found no frame {number}; "
                "labels would not line up"
            )
    return OkutamaVideo(labels.stem, images, labels)
