"""Labelled video of any layout as training samples: one labelled image a frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import TypeAlias, TypeVar

import numpy as np

from tsuiseki.datamodules.video_pictures import OpenVideo, Picture, VideoPicture
from tsuiseki.tracking.errors import RequestError, a_path
from tsuiseki.tracking.formats.label_checks import PEOPLE, NothingLabelledError
from tsuiseki.tracking.formats.labelled import LabelledVideo, open_labelled
from tsuiseki.tracking.formats.mot_sequence import IMAGE_SUFFIXES
from tsuiseki.tracking.formats.yolo import ABOUT
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.video.image_folder import one_image

# Shares of a video in [0, 1]: where a part begins, and where it ends.
Part: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class LabelledPart:
    """Labelled video, or a part of it.

    Attributes:
        folder: labels of any layout, see `open_labelled`.
        frames: first and last frame of each sequence, 1-based and both included; null for all.
        part: likewise in shares of its length, such as [0, 0.9].
    """

    folder: str
    frames: tuple[int, int] | None = None
    part: Part = (0.0, 1.0)

    @property
    def made(self) -> bool:
        """Whether the folder is filled where it is missing."""
        return False


# Folders of labelled video, or parts of them: one or several.
Labelled: TypeAlias = Sequence[LabelledPart | Path | str] | LabelledPart | Path | str
Source = TypeVar("Source", bound=LabelledPart)


def labelled_parts(labelled: Labelled | None, name: str, kind: type[Source]) -> list[Source]:
    """What ``labelled`` stands for; YOLO's ``data.yaml`` stands for its folder.

    Args:
        labelled: folders or parts, one or several.
        name: of the argument, for the error.
        kind: of the parts.

    Raises:
        RequestError: there is none, or a folder is missing.
    """
    several = list(labelled) if isinstance(labelled, list | tuple) else [] if labelled is None else [labelled]
    if not several:
        raise RequestError(f"`{name}`: expected at least one folder of labelled video, got none")
    parts = []
    for place in several:
        part = place if isinstance(place, kind) else kind(str(a_path(place, name)))
        folder = Path(part.folder)
        if folder.name == ABOUT:
            part = replace(part, folder=str(folder.parent))
        if part.folder.startswith(("[", "{")):
            fields = ", ".join(field for field in kind.__dataclass_fields__)
            raise RequestError(f"`{name}`: expected folders, or parts with some of {fields}; got {part.folder}")
        if not part.made and not folder.exists():
            raise RequestError(f"`{name}`: expected labelled video at {folder}, found none")
        parts.append(part)
    return parts


def held_out(parts: Sequence[Source], share: float) -> tuple[list[Source], list[Source]]:
    """The beginnings of all videos, and the last ``share`` of each, in (0, 1).

    Raises:
        RequestError: the share lies outside.
    """
    if not 0 < share < 1:
        raise RequestError(f"`val_share`: expected a share of each video between 0 and 1, got {share}")
    borders = [part.part[0] + (part.part[1] - part.part[0]) * (1 - share) for part in parts]
    learnt = [replace(part, part=(part.part[0], border)) for part, border in zip(parts, borders, strict=True)]
    return learnt, [replace(part, part=(border, part.part[1])) for part, border in zip(parts, borders, strict=True)]


@dataclass(frozen=True)
class LabelledFrame:
    """One image and what is labelled in it.

    Attributes:
        picture: the image file, or a frame of a video file.
        sequence: name of the sequence it belongs to.
        frame: 0-based.
        boxes: ``(N, 4)`` pixels, of evaluated and ignored objects.
        ids: ``(N,)`` one number a person within the sequence.
        ignored: ``(N,)`` boxes that are neither an example nor a counter-example.
        visibility: ``(N,)`` visible share in [0, 1].
        classes: ``(N,)`` places from 1 among the classes that were asked for; of ignored boxes it may be any.
    """

    picture: Picture
    sequence: str
    frame: int
    boxes: FloatArray
    ids: IntArray
    ignored: BoolArray
    visibility: FloatArray
    classes: IntArray


def labelled_images(
    folder: str | Path,
    frames: tuple[int, int] | None = None,
    part: Part = (0.0, 1.0),
    single: bool = True,
    classes: Sequence[str] = (PEOPLE,),
) -> list[LabelledFrame]:
    """The labelled images of every video in ``folder``.

    Args:
        folder: see `open_labelled`.
        frames: first and last frame of each video, 1-based and both included as the files count; by default all.
        part: of each video, in shares of its length.
        single: boxes need no ids, as in pictures that were labelled one by one.
        classes: names of those that count.

    Raises:
        RequestError: there is no video, one has no images or no usable label, no frame is left, or an image is none.
    """
    samples = [
        sample
        for video in open_labelled(a_path(folder, "folder"))
        for sample in _images_of(video, frames, part, single, classes)
    ]
    if not samples:
        within = f"{part[0]:.0%} to {part[1]:.0%} of a video" if frames is None else f"{frames}; frames count from 1"
        raise RequestError(f"{folder}: no frame lies within {within}")
    # By their headers alone: a data set may hold more images than can be decoded before the first batch.
    for sample in samples:
        if isinstance(sample.picture, Path):
            one_image(sample.picture)
    return samples


def _images_of(
    video: LabelledVideo, frames: tuple[int, int] | None, part: Part, single: bool, classes: Sequence[str]
) -> Iterator[LabelledFrame]:
    if video.lacks:
        raise RequestError(video.lacks)
    files = picture_files(video)
    if video.length is None or len(files) != video.length:
        raise RequestError(f"{video.name}: training needs images in img1/ or images/, found {_there(video, files)}")
    truth, kinds = _of_classes(video, single, classes)
    first, last = frames or (1, video.length)
    start, end = (round(share * video.length) for share in part)
    frames_here = np.arange(max(first - 1, start), min(last, end))
    for frame in frames_here[np.isin(frames_here, frames_here if video.listed is None else video.listed)].tolist():
        here = truth.frames == frame
        rows = truth.select(here)
        yield LabelledFrame(
            files[frame], video.name, frame, rows.boxes, rows.ids, rows.ignored, rows.visibility, kinds[here]
        )


def _there(video: LabelledVideo, files: Sequence[Picture]) -> str:
    """What there is in the place of one image a frame."""
    if len(files) == 1 and isinstance(files[0], Path) and files[0].suffix.lower() not in IMAGE_SUFFIXES:
        return f"the video {files[0]}; write its frames there"
    return f"{len(files)} for {video.length} frames" if files else "none"


def _of_classes(video: LabelledVideo, single: bool, classes: Sequence[str]) -> tuple[GroundTruth, IntArray]:
    """The boxes that count or are ignored, and the place from 1 of the class of each.

    Raises:
        RequestError: none of the classes is labelled.
    """
    labelled, missing = list[tuple[int, GroundTruth]](), list[NothingLabelledError]()
    for kind, name in enumerate(classes, start=1):
        try:
            truth = video.people(kind=name, single=single)
        except NothingLabelledError as error:
            missing.append(error)
            continue
        labelled.append((kind, truth.select(truth.evaluated | truth.ignored)))
    if not labelled:
        raise missing[0]
    kinds = np.repeat([kind for kind, _ in labelled], [len(truth) for _, truth in labelled])
    return reduce(GroundTruth.and_then, [truth for _, truth in labelled]), kinds


def picture_files(video: LabelledVideo) -> tuple[Picture, ...]:
    """The pictures of a video, one a frame; those of a video file are decoded when they are read.

    Raises:
        RequestError: the video file cannot be read, or is shorter than its labels.
    """
    if len(video.files) != 1 or video.length in (None, 1):
        return video.files
    frames = range(video.first, video.first + (video.length or 1))
    opened = OpenVideo(video.files[0], FrameRange(frames[0], frames[-1]))
    return tuple(VideoPicture(opened, number) for number in frames)
