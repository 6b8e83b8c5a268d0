"""The folder of a MOTChallenge sequence: ``seqinfo.ini``, ``img1/000001.jpg …``, ``gt/gt.txt`` and ``det/det.txt``."""

from __future__ import annotations

import configparser
import os
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from decimal import Decimal
from itertools import pairwise
from pathlib import Path, PurePath, PurePosixPath
from typing import TypeVar

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.openers.text import read_text
from tsuiseki.tracking.types.labels import GroundTruth

AnyPath = TypeVar("AnyPath", bound=PurePath)
# A time or a frame number, as the whole of a name.
NUMBER = re.compile(r"-?\d+(?:\.\d+)?", re.ASCII)
# A minus before a number: it stands behind no letter and no digit, as a hyphen does.
MINUS = re.compile(r"(^|[^A-Za-z0-9])-$")
# A name that ends in the number of a frame, and not in a fraction of a second.
FRAME_NAME = re.compile(r"(|.*(?:\D\.|[^\d.]))(\d+)", re.DOTALL | re.ASCII)
IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")


@dataclass(frozen=True)
class MotSequence:
    """A sequence folder.

    Attributes:
        name: from ``seqinfo.ini``, or the folder's name.
        folder: where it lies.
        frame_rate: frames per second.
        length: number of frames; 0 where neither ``seqinfo.ini`` nor images tell.
        width: of the images, pixels; 0 where unknown.
        height: of the images, pixels; 0 where unknown.
        images: one path a frame, empty where the sequence is text only.
        rate_missing: ``seqinfo.ini`` does not say the frame rate, and 25 are taken.
    """

    name: str
    folder: Path
    frame_rate: float
    length: int
    width: int
    height: int
    images: tuple[Path, ...]
    rate_missing: bool = False

    @property
    def ground_truth_path(self) -> Path:
        """``gt/gt.txt``, whether it exists or not."""
        return self.folder / "gt" / "gt.txt"

    @property
    def detections_path(self) -> Path:
        """``det/det.txt``, whether it exists or not."""
        return self.folder / "det" / "det.txt"


def read_sequence(folder: str | Path) -> MotSequence:
    """The sequence in ``folder``.

    Raises:
        RequestError: no such folder, nothing of a sequence in it, a broken ``seqinfo.ini``, or an image folder
            that leads out of it.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise RequestError(f"expected a sequence folder at {folder}, found none")
    if not is_sequence(folder):
        raise RequestError(f"{folder}: expected seqinfo.ini, img1/ or gt/gt.txt of a MOTChallenge sequence, found none")
    info = _read_info(folder / "seqinfo.ini")
    image_folder = info.get("imDir", "img1")
    if PurePosixPath(image_folder).is_absolute() or ".." in PurePosixPath(image_folder).parts:
        raise RequestError(f"{folder}/seqinfo.ini: imDir = {image_folder} leads out of the sequence folder")
    images = list_images(folder / image_folder)
    length = int(_number(info, "seqLength", len(images), folder))
    if images and len(images) < length:
        warnings.warn(
            f"{folder}: seqinfo.ini promises {length} frames, but {image_folder}/ has {len(images)} images; "
            "the sequence ends with them",
            InputWarning,
            stacklevel=2,
        )
        length = len(images)
    if images and len(images) != length:
        raise RequestError(
            f"{folder}: seqinfo.ini promises {length} frames, but {image_folder}/ has {len(images)} images"
        )
    rate = _number(info, "frameRate", 25.0, folder)
    if rate == 0:
        raise RequestError(f"{folder}/seqinfo.ini: expected frameRate above 0, got {info['frameRate']!r}")
    return MotSequence(
        name=info.get("name", folder.resolve().name),
        folder=folder,
        frame_rate=rate,
        length=length,
        width=int(_number(info, "imWidth", 0, folder)),
        height=int(_number(info, "imHeight", 0, folder)),
        images=images,
        rate_missing="frameRate" not in info,
    )


def is_sequence(folder: Path) -> bool:
    """Whether anything in ``folder`` is of a MOTChallenge sequence."""
    return any((folder / part).exists() for part in ("seqinfo.ini", "img1", "gt/gt.txt"))


def find_sequences(folder: str | Path) -> list[MotSequence]:
    """The sequence that ``folder`` is, or those one level below it, by name.

    Raises:
        RequestError: there is none.
    """
    folder = Path(folder)
    if folder.is_dir() and is_sequence(folder):
        return [read_sequence(folder)]
    folders = [p for p in sorted(folder.iterdir()) if p.is_dir() and is_sequence(p)] if folder.is_dir() else []
    if not folders:
        raise RequestError(f"expected a MOTChallenge sequence or a folder of sequences at {folder}, found none")
    return [read_sequence(p) for p in folders]


def list_images(folder: Path) -> tuple[Path, ...]:
    """The image files of ``folder`` in the order of the numbers in their names; hidden files are passed over.

    A name that is all a number, but for what all begin and end with, may be a decimal fraction or negative, as times
    are: ``1.04.jpg`` comes before ``1.2.jpg``. There is none where ``folder`` is no folder.
    """
    if not folder.is_dir():
        return ()
    return in_order([p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES and not p.name.startswith(".")])


def in_order(images: Sequence[AnyPath]) -> tuple[AnyPath, ...]:
    """The paths of one folder as `list_images` orders them."""
    stems = [path.stem for path in images]
    numbers = dict(zip(images, _differing(stems), strict=True))
    if all(NUMBER.fullmatch(number) for number in numbers.values()) and not _counts_parts([*numbers.values()]):
        return tuple(sorted(images, key=lambda path: (Decimal(numbers[path]), path.name)))
    return tuple(sorted(images, key=lambda path: (name_parts(path.name), path.name)))


def _differing(stems: Sequence[str]) -> list[str]:
    """The names without what all begin and end with, but for digits, points and a minus; a decimal comma as a point."""
    begin = os.path.commonprefix(stems)  # noqa: RUF071  # letters, not folders
    start = len(MINUS.sub(r"\1", re.sub(r"[\d.,]*$", "", begin)))
    end = os.path.commonprefix([stem[start:][::-1] for stem in stems])  # noqa: RUF071
    stop = len(re.sub(r"[\d.,]*$", "", end))
    return [stem[start : len(stem) - stop].replace(",", ".") for stem in stems]


def _counts_parts(numbers: Sequence[str]) -> bool:
    """Whether what follows the points counts on, as in 1.9 and 1.10: those are no decimal fractions."""
    parts: dict[str, list[int]] = {}
    for number in numbers:
        whole, _, fraction = number.partition(".")
        parts.setdefault(whole, []).extend([int(fraction)] if fraction else [])
    runs = [sorted(part) for part in parts.values() if len(part) > 1]
    return bool(runs) and all(run == [*range(run[0], run[-1] + 1)] for run in runs)


def left_out(images: Sequence[Path]) -> str:
    """Which numbers are left out in the names of images in their order, in words; empty where none is.

    Raises:
        RequestError: two images have one number.
    """
    for image, follower in pairwise(images):
        if name_parts(image.stem) == name_parts(follower.stem):
            raise RequestError(f"{image}: expected one image a number, got {follower.name}, too")
    names = [name for image in images if (name := FRAME_NAME.fullmatch(image.stem))]
    if len(names) < max(2, len(images)) or len({name[1] for name in names}) > 1:
        return ""
    steps = np.diff([int(name[2]) for name in names])
    missing = np.maximum(np.round(steps / max(np.median(steps), 1)) - 1, 0)
    gap = int(np.argmax(missing))
    return f"{int(missing.sum())} images are left out, the first after {images[gap].name}" if missing.any() else ""


def first_number(images: Sequence[Path]) -> int:
    """The number at the end of the first image's name; 1 where there is none."""
    name = FRAME_NAME.fullmatch(images[0].stem)
    return 1 if name is None else int(name[2])


def name_parts(name: str) -> list[tuple[bool, int, str]]:
    """What orders names by the values of the numbers in them."""
    parts = re.findall(r"\d+|\D+", name)
    return [(False, int(part), "") if part.isdecimal() else (True, 0, part) for part in parts]


def write_sequence_info(
    sequence_folder: Path, name: str, frame_rate: float, length: int, width: int, height: int
) -> None:
    """Write ``seqinfo.ini`` for images ``img1/000001.jpg …``."""
    lines = ["[Sequence]", f"name={name}", "imDir=img1", f"frameRate={frame_rate:g}", f"seqLength={length}"]
    lines += [f"imWidth={width}", f"imHeight={height}", "imExt=.jpg"]
    (sequence_folder / "seqinfo.ini").write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_sequence(folder: Path, video: TrackedVideo) -> None:
    """Write tracks as labels that all count, ``gt/gt.txt``, and ``seqinfo.ini``; without images."""
    rows, (width, height) = video.boxes, video.pixels
    write_ground_truth(folder / "gt" / "gt.txt", GroundTruth.of_boxes(rows.frames, rows.ids, rows.boxes))
    write_sequence_info(folder, video.stem, video.frame_rate or 25.0, video.frame_count, width, height)


def _read_info(path: Path) -> dict[str, str]:
    if not path.is_file():
        return {}
    text = read_text(path, "a sequence's settings")
    parser = configparser.ConfigParser(interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]  # keys are written in camel case
    try:
        parser.read_string(text)
        return dict(parser["Sequence"])
    except (configparser.Error, KeyError) as error:
        raise RequestError(
            f"{path}: expected a section [Sequence] with name, seqLength, …: {' '.join(str(error).split())[:200]}"
        ) from error


def _number(info: dict[str, str], key: str, default: float, folder: Path) -> float:
    text = info.get(key)
    if text is None:
        return float(default)
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < 1e9:
        raise RequestError(f"{folder}/seqinfo.ini: expected {key} to be a number, got {text!r}")
    return value


# EXIF's tag of how a camera was held.
ORIENTATION_TAG = 0x0112
# Its values for a camera on its side: width and height change places.
TURNED_ORIENTATIONS = (5, 6, 7, 8)


@contextmanager
def quiet_about_size() -> Iterator[None]:
    """Pillow does not warn of large images, which are bounded elsewhere."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Image size .* exceeds limit")
        yield


def image_size(image: Path) -> tuple[int, int]:
    """Width and height of an image, turned as its camera says, of which no more than that is read.

    Raises:
        RequestError: it is no image.
    """
    from PIL import Image  # Here, since few runs need it.

    try:
        with quiet_about_size(), Image.open(image) as opened:
            # Asking a PNG for tags that it does not have would decode it all.
            turned = "exif" in opened.info and opened.getexif().get(ORIENTATION_TAG) in TURNED_ORIENTATIONS
            return (opened.height, opened.width) if turned else opened.size
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise RequestError(f"{image}: expected an image, got something that cannot be decoded") from error
