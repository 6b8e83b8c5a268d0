"""The contract of generated clips, and what writes any of them into a folder.

A clip is planned whole from its settings and a seed, draws its frames in order, and knows the truth of each.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Generic, TypeAlias, TypeVar

import cv2
import numpy as np
from pydantic import AfterValidator, Field, PositiveFloat, PositiveInt
from pydantic.dataclasses import dataclass as settings_dataclass

from tsuiseki.datamodules.scenes.render.composing import Sighting
from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.geometry import areas, clip_boxes
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray
from tsuiseki.tracking.types.labels import GroundTruth

QUALITY = 92
"""Of JPEG images, where a clip has no setting for it."""
IMAGES = "img1/{number:06d}.jpg"
"""Where MOTChallenge's layout keeps an image."""

T = TypeVar("T")
Truth = TypeVar("Truth")
Moment = tuple[Sequence[ImageArray], Truth]
"""The images of all views at one time, and what is true then."""


class Clip(ABC, Generic[Truth]):
    """A generated clip of one or several views.

    Attributes:
        settings: `ClipSettings`, or what has ``frames`` too.
        quality: of JPEG images, 1 to 100.
    """

    settings: Any
    quality: ClassVar[int] = QUALITY
    draw_frame: ClassVar[Callable[..., Any]]
    """The moment of one frame, of a clip whose frames depend on none before."""

    @property
    def views(self) -> tuple[str, ...]:
        """For each view the files of its images, with ``{number}`` of the frame from 1 or ``{frame}`` from 0."""
        return (IMAGES,)

    def frames(self) -> Iterator[Moment[Truth]]:
        """The clip from the start: an image of each view, ``(H, W, 3)`` uint8 RGB, before JPEG, and their truth."""
        return map(self.draw_frame, range(self.settings.frames))

    @abstractmethod
    def write_truth(self, folder: Path, name: str, truths: list[Truth]) -> None:
        """Write the truth of all frames, and whatever else belongs to the sequence ``name``, into ``folder``."""


def write_clip(
    folder: str | Path,
    clip: Clip[Truth],
    watch: Callable[[Iterator[Moment[Truth]]], Iterable[Moment[Truth]]] = iter,
) -> Path:
    """Write a clip: its images, and the files of its truth, which each kind of clip names.

    It is written beside and renamed: an interrupted run leaves nothing under the final name.

    Args:
        folder: does not exist yet or is empty; the sequence has its name.
        clip: to be drawn.
        watch: passes the frames on as they are drawn, to show how far it is.

    Raises:
        RequestError: ``folder`` is a file, holds files, or cannot be made.
    """
    folder = Path(folder).resolve()
    truths = []
    with output_folder(folder, overwrite=False) as work:
        for frame, (images, truth) in enumerate(watch(clip.frames())):
            for view, image in zip(clip.views, images, strict=True):
                write_image(work / view.format(frame=frame, number=frame + 1), image, clip.quality)
            truths.append(truth)
        clip.write_truth(work, folder.name, truths)
    return folder


def write_image(path: Path, image: ImageArray, quality: int = QUALITY) -> None:
    """Write ``(H, W, 3)`` uint8 RGB or ``(H, W)`` uint8 as the name says; ``quality`` 1 to 100 is that of JPEG."""
    path.parent.mkdir(parents=True, exist_ok=True)
    parameters = [cv2.IMWRITE_JPEG_QUALITY, quality] if path.suffix == ".jpg" else []
    # imwrite says nothing of a full disk.
    data = cv2.imencode(path.suffix, image[..., ::-1] if image.ndim == 3 else image, parameters)[1]
    path.write_bytes(data.tobytes())


def _in_order(bounds: tuple[Any, Any]) -> tuple[Any, Any]:
    if not bounds[0] <= bounds[1]:
        raise ValueError(f"expected (least, greatest), got {bounds}")
    return bounds


# (least, greatest) of what is drawn at random.
Span: TypeAlias = Annotated[tuple[T, T], AfterValidator(_in_order)]
# Of an image, pixels.
Side: TypeAlias = Annotated[int, Field(ge=32)]
# Along each side of a pixel.
Rays: TypeAlias = Annotated[int, Field(ge=1, le=8)]


@settings_dataclass(frozen=True, config=SETTINGS)
class ClipSettings:
    """Settings of any clip of one size.

    Attributes:
        width: of the images, pixels.
        height: of the images, pixels.
        frames: length of the clip.
        frame_rate: frames per second.
    """

    width: Side = 640
    height: Side = 480
    frames: PositiveInt = 150
    frame_rate: PositiveFloat = 25.0

    def write_info(self, folder: Path, name: str, truth: GroundTruth | None = None) -> None:
        """Write ``seqinfo.ini`` of the sequence ``name``, and ``gt/gt.txt`` of its ``truth``."""
        if truth is not None:
            write_ground_truth(folder / "gt" / "gt.txt", truth)
        write_sequence_info(folder, name, self.frame_rate, self.frames, self.width, self.height)


@dataclass(frozen=True)
class FrameTruth:
    """What a frame shows of people.

    Attributes:
        ids: ``(N,)`` from 1.
        boxes: ``(N, 4)`` pixels: the whole silhouette, hidden parts included, clipped to the image.
        visibility: ``(N,)`` visible share of the silhouette, what lies outside the image included, [0, 1].
        places: ``(N, 2)`` where they stand, metres, where the clip says it.
        actions: what each does, one or two names, where the clip says it.
    """

    ids: IntArray
    boxes: FloatArray
    visibility: FloatArray
    places: FloatArray | None = None
    actions: tuple[tuple[str, ...], ...] = ()


def people_in_view(
    sightings: Sequence[Sighting | None], size: tuple[int, int], least_visible: float, inside: float
) -> tuple[FrameTruth, IntArray]:
    """Who counts as visible, numbered by their rows from 1, and those rows ``(N,)`` of ``sightings`` from 0.

    Args:
        sightings: of all people, None for those out of view.
        size: width and height of the image, pixels.
        shown: share of the silhouette that shows, at least.
        inside: share of the box that lies in the image, of which there must be more.
    """
    visible = [(row, s) for row, s in enumerate(sightings) if s is not None and s.visibility >= least_visible]
    uncut = np.array([s.box for _, s in visible], dtype=np.float64).reshape(-1, 4)
    boxes = clip_boxes(uncut, *size)
    enough_inside = areas(boxes) > inside * areas(uncut)
    rows = np.array([row for row, _ in visible], dtype=np.int64)[enough_inside]
    visibility = np.array([s.visibility for _, s in visible], dtype=np.float64)[enough_inside]
    return FrameTruth(rows + 1, boxes[enough_inside], visibility), rows


def ground_truth(frames: Sequence[FrameTruth]) -> GroundTruth:
    """The labels of all frames of a clip. Every row is evaluated, and ids stay as they are."""
    numbers = np.repeat(np.arange(len(frames), dtype=np.int64), [len(labels.ids) for labels in frames])
    counted = np.ones(len(numbers), dtype=np.bool_)
    ids, boxes, visibility = (np.concatenate([getattr(f, of) for f in frames]) for of in ("ids", "boxes", "visibility"))
    return GroundTruth(numbers, ids.astype(np.int64), boxes, counted, ~counted, visibility)


def by_appearance(ids: IntArray) -> IntArray:
    """Ids ``(N,)`` of rows in the order of time, numbered anew without gaps from 1 as they appear."""
    _, first, inverse = np.unique(ids, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return np.asarray((rank[inverse] + 1).astype(np.int64))
