"""A video as images: in a folder, one a frame; in a list or an array, or as they come; and one image by its file."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image, UnidentifiedImageError

from tsuiseki.tracking.errors import InputWarning, RequestError, RunError
from tsuiseki.tracking.formats.mot_sequence import (
    IMAGE_SUFFIXES,
    ORIENTATION_TAG,
    TURNED_ORIENTATIONS,
    first_number,
    is_sequence,
    left_out,
    list_images,
    quiet_about_size,
    read_sequence,
)
from tsuiseki.tracking.formats.single import IMAGE_FOLDERS, LABEL_NAMES
from tsuiseki.tracking.openers.images import decoded_image
from tsuiseki.tracking.types import Frame, ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.frame_source import DEFAULT_FRAME_RATE, Size, Source, fingerprint_of
from tsuiseki.tracking.video.levels import BYTE, SAMPLES, Levels, depth_of, eight_bits

# Kinds of images that may hold several, of which only the first would be read.
PAGED = ("TIFF", "WEBP", "PNG")
# What kinds of files that are no images here begin with, whatever their names.
MARKS = {
    b"ftyphe": "HEIC",
    b"ftypmif1": "HEIC",
    b"ftypavif": "AVIF",
    b"ftypjxl": "JPEG XL",
    b"JXL ": "JPEG XL",
    b"8BPS": "a picture of Photoshop",
    b"%PDF": "PDF",
    b"<svg": "SVG",
    b"ftyp": "a video",
    b"\x1aE\xdf\xa3": "a video",
}
# Leftovers of file managers that may lie among images.
HARMLESS_NAMES = ("thumbs.db", "desktop.ini")
# Of videos, which a message tells to give by themselves; more than any data set here holds.
HINTED_SUFFIXES = (".mp4", ".m4v", ".avi", ".mkv", ".mov", ".mpg", ".mpeg", ".webm")


@dataclass(frozen=True, kw_only=True)
class ImageFolder(Source):
    """A video as one image file a frame; a text-only sequence has none."""

    images: tuple[Path, ...]
    depth: int = BYTE

    @classmethod
    def open(cls, folder: Path, frame_range: FrameRange) -> ImageFolder:
        """The images of ``folder``, a sequence's or its own, or one image file, up to the end of what is wanted.

        Raises:
            RequestError: they are none, or differ in size, or something else lies among them.
        """
        sequence = read_sequence(folder) if is_sequence(folder) else None
        images = _images(folder) if sequence is None else sequence.images
        gap = left_out(images)
        if gap and sequence is not None:
            raise RequestError(f"{folder}: {gap}; labels and detections go by the numbers, so add them")
        if gap:
            warnings.warn(f"{folder}: {gap}; frames are counted on as if none were", InputWarning, stacklevel=3)
        if sequence is not None and images and first_number(images) > 1:
            line = f"its first image, {images[0].name}, is taken as frame 1 of labels and detections"
            warnings.warn(f"{folder}: {line}", InputWarning, stacklevel=3)
        length = len(images) or (sequence.length if sequence else 0) or None
        size = _common_size(images) if images else (sequence.width, sequence.height) if sequence else (0, 0)
        return cls(
            name=sequence.name if sequence else folder.resolve().name,
            address=str(folder),
            frames_wanted=frame_range.within(length) if length else frame_range,
            frame_rate=sequence.frame_rate if sequence else DEFAULT_FRAME_RATE,
            # A folder of images does not state it.
            rate_missing=sequence is not None and sequence.rate_missing,
            size=size if min(size) > 0 else None,
            length=length,
            has_images=bool(images),
            images=images,
            depth=_depth(images),
        )

    @property
    def fingerprint(self) -> str:
        return fingerprint_of(self.images) if self.images else ""

    def frames(self) -> Iterator[Frame]:
        if not self.images:
            raise RequestError(f"{self.name} has no images; expected them in its folder img1/")
        frame_range = self.frames_wanted.within(len(self.images))
        assert frame_range.last is not None
        yield from self.at(range(frame_range.first, frame_range.last + 1))

    def at(self, numbers: Iterable[int]) -> Iterator[Frame]:
        """The frames of these 0-based numbers; raises RunError, see `read_image`."""
        for number in numbers:
            yield Frame(number, number / self.frame_rate, read_image(self.images[number], self.size, self.depth))


def read_image(path: Path, size: Size | None = None, depth: int | None = None) -> ImageArray:
    """``(H, W, 3)`` uint8 RGB of an image file, turned as its camera says.

    Args:
        path: of the file.
        size: width and height that it must have, pixels.
        depth: how many bits a colour are in use, where it has 16; by default as many as it needs.

    Raises:
        RunError: it cannot be decoded or has another size.
    """
    levels = _levels(path)
    if size is not None and levels.shape[1::-1] != size:
        raise RunError(f"{path}: expected {size[0]}x{size[1]} pixels, got {levels.shape[1]}x{levels.shape[0]}")
    if depth is None and levels.dtype != np.uint8:
        depth = depth_of([levels], path.name)
    return eight_bits(levels, depth or BYTE)


def _levels(path: Path) -> Levels:
    """``(H, W, 3)`` uint8 or uint16 RGB; raises RunError where the file cannot be decoded."""
    decoded = decoded_image(path, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    if decoded is None:
        raise RunError(not_an_image(path))
    if decoded.dtype not in (np.uint8, np.uint16):
        raise RunError(f"{path}: expected 8 or 16 bits a colour, got {decoded.dtype}; write it as PNG")
    levels: Levels = np.asarray(cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB))
    return levels


def _depth(images: tuple[Path, ...]) -> int:
    """How many bits a colour ``images`` use, of which only some that are spread are read, where they have 16."""
    if not images or not _is_deep(images[0]):
        return BYTE
    samples = images[:: max(1, len(images) // SAMPLES)]
    try:
        return depth_of(map(_levels, samples), str(images[0].parent if len(images) > 1 else images[0]))
    except RunError as error:
        raise RequestError(str(error)) from error


def not_an_image(path: Path) -> str:
    """What to say of a file that cannot be read as an image."""
    with suppress(OSError), path.open("rb") as file:
        head = file.read(32)
        for mark, kind in MARKS.items():
            if mark in head:
                return f"{path}: expected an image, got {kind}, which is not read; write it as PNG or JPEG"
    if path.is_symlink() and not path.exists():
        return f"{path}: expected an image, got a link to {path.readlink()}, where nothing lies"
    if not path.exists():
        return f"{path}: expected an image, found none"
    return f"{path}: expected an image, got something that cannot be decoded"


def _images(place: Path) -> tuple[Path, ...]:
    """The images at a place that is no sequence of MOTChallenge."""
    return (place,) if place.is_file() else _of_one_target(place) or _images_only(place)


def _of_one_target(folder: Path) -> tuple[Path, ...]:
    """The images of a sequence of OTB, UAV123 or VOT, which lie beside its labels; none where it is something else."""
    labelled = any(LABEL_NAMES.fullmatch(path.name) for path in folder.iterdir())
    parts = [list_images(folder / name) for name in IMAGE_FOLDERS]
    return next((images for images in parts if images), list_images(folder) if labelled else ())


def _images_only(folder: Path) -> tuple[Path, ...]:
    images = list_images(folder)
    if not images:
        suffixes = ", ".join(IMAGE_SUFFIXES)
        videos = sorted(path.name for path in folder.iterdir() if path.suffix.lower() in HINTED_SUFFIXES)
        hint = f", but {videos[0]}; give a video by its own path" if videos else ""
        raise RequestError(f"{folder}: expected images ({suffixes}) or a MOTChallenge sequence, found neither{hint}")
    strange = sorted(
        path.name
        for path in set(folder.iterdir()) - set(images)
        if path.is_file() and not path.name.startswith(".") and path.name.lower() not in HARMLESS_NAMES
    )
    if strange:
        raise RequestError(f"{folder}: expected only images, found {strange[0]}; move it elsewhere")
    return images


def _common_size(images: tuple[Path, ...]) -> Size:
    """Width and height of all the images; only their headers are read."""
    first = one_image(images[0])
    for path in images[1:]:
        size = one_image(path)
        if size != first:
            raise RequestError(
                f"{path}: expected {first[0]}x{first[1]} pixels as in {images[0].name}, got {size[0]}x{size[1]}"
            )
    return first


def _is_deep(path: Path) -> bool:
    """Whether an image has 16 bits a colour, by its header."""
    with quiet_about_size(), Image.open(path) as image:
        return ";16" in str(image.tile)


def one_image(path: Path) -> Size:
    """Width and height of the image at ``path``; raises RequestError where it is none, or several in one file."""
    try:
        with quiet_about_size(), Image.open(path) as image:
            pages = getattr(image, "n_frames", 1) if image.format in PAGED else 1
            if pages > 1:
                raise RequestError(f"{path}: expected one image in a file, got {pages}; write each to its own file")
            if image.mode == "F" or (image.mode == "I" and ";16" not in str(image.tile)):
                raise RequestError(f"{path}: expected 8 or 16 bits a colour, got 32; write it as PNG of 16")
            # Asking a PNG for tags that it does not have would decode it all.
            turned = "exif" in image.info and image.getexif().get(ORIENTATION_TAG) in TURNED_ORIENTATIONS
            return (image.height, image.width) if turned else (image.width, image.height)
    except Image.DecompressionBombError as error:
        limit = 2 * (Image.MAX_IMAGE_PIXELS or 0) // 1_000_000
        raise RequestError(f"{path}: expected at most {limit} million pixels, got more; write it smaller") from error
    except (UnidentifiedImageError, OSError, SyntaxError) as error:
        raise RequestError(not_an_image(path)) from error


@dataclass(frozen=True, kw_only=True)
class GivenFrames(Source):
    """Images ``(H, W, 3)`` uint8 RGB, or `Frame` with times; see `Source`.

    A sequence and an array ``(T, H, W, 3)`` can be played again. What comes one by one is ``live``, and ``ends``.
    """

    items: Iterable[ImageArray | Frame]

    @classmethod
    def open(cls, items: Iterable[Any], frame_range: FrameRange) -> GivenFrames:
        """The images; raises RequestError where the first of several is none, or they are fewer than is wanted."""
        if not isinstance(items, Sequence | np.ndarray):
            return cls(name="images", items=items, frames_wanted=frame_range, live=True)
        if len(items) == 0:
            raise RequestError("expected images, got none")
        height, width = _image(items[0], 0).shape[:2]
        frame_range = frame_range.within(len(items))
        return cls(name="images", items=items, frames_wanted=frame_range, length=len(items), size=(width, height))

    def frames(self) -> Iterator[Frame]:
        size: tuple[int, ...] | None = None
        for index, item in enumerate(self.items):
            if self.frames_wanted.last is not None and index > self.frames_wanted.last:
                return
            image = _image(item, index)
            size = size or image.shape
            if image.shape != size:
                raise RunError(f"expected images of {size[1]}x{size[0]} throughout, got another size in image {index}")
            time = item.time if isinstance(item, Frame) else index / self.frame_rate
            if index in self.frames_wanted:
                yield self.noted(Frame(index, time, image))


def _image(item: Any, index: int) -> ImageArray:
    image = item.image if isinstance(item, Frame) else item
    if isinstance(image, np.ndarray) and image.ndim == 3 and image.shape[2] == 3 and image.dtype == np.uint8:
        return image
    kind = f"shape {image.shape} {image.dtype}" if isinstance(image, np.ndarray) else type(image).__name__
    raise RequestError(f"expected a video file, or images (H, W, 3) uint8 RGB; image {index} is of {kind}")
