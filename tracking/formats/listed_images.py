"""Images that a label file lists: which frame each is, where its picture lies, and whether that has the right size."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.label_checks import Sieve
from tsuiseki.tracking.formats.mot_sequence import FRAME_NAME, image_size, in_order, list_images
from tsuiseki.tracking.types import IntArray
from tsuiseki.tracking.types.frame_range import LAST_FRAME


@dataclass(frozen=True)
class ListedImage:
    """An image in a label file.

    Attributes:
        name: of its file, below some folder; empty where that is not known.
        number: of its frame, as the file counts; None where the file does not say.
        size: width and height, as the file says; None where it does not.
    """

    name: str
    number: int | None = None
    size: tuple[int, int] | None = None


# Names of images that are looked for in a folder, to see whether it is theirs.
PROBES = 8
# Share of the listed images from which on a folder is theirs, and the others are missing there.
ENOUGH_PICTURES = 0.5
# Share of the frames that are listed, from which on numbers in names that begin later than 1 are still those of frames.
ENOUGH_FRAMES = 0.5


def picture_paths(path: Path, names: Sequence[str]) -> tuple[Path, ...]:
    """The pictures of ``names``, of which a few may be missing; none where most are.

    Args:
        path: of the labels' file or folder: pictures lie beside it, or in ``images``, ``data`` or a folder of its name.
        names: of their files.
    """
    if not names or not all(names):
        return ()
    folder = path if path.is_dir() else path.parent
    places = [folder, *(folder / name for name in ("images", "data"))]
    places += [folder.parent / "images", folder.parent / path.stem.removeprefix("instances_")]
    for place in places:
        if not any((place / name).is_file() for name in names[:: max(len(names) // PROBES, 1)]):
            continue
        pictures = tuple(place / name for name in names)
        if sum(picture.is_file() for picture in pictures) > ENOUGH_PICTURES * len(pictures):
            return pictures
    return ()


def frames_of_images(
    path: Path, images: Sequence[ListedImage], key: str, length: int = 0, tracked: bool = True, first: int | None = None
) -> list[int]:
    """The 0-based frame of each image.

    The numbers that the file gives decide. Without any, the pictures beside it do, else the numbers in the names, else
    the order of the names. Images that were labelled one by one have no order but that of their names.

    Args:
        path: of the file.
        images: at least one.
        key: under which the file has their numbers.
        length: number of frames of the video, as the file says; 0 where it does not.
        tracked: they are frames of one video.
        first: number of the first frame; by default what the file says of itself tells whether it is 0 or 1.

    Raises:
        RequestError: numbers are missing, negative or too large, or two images are of one frame.
    """
    numbers = [image.number for image in images if image.number is not None]
    if 0 < len(numbers) < len(images):
        name = next(image.name for image in images if image.number is None)
        raise RequestError(
            f"{path}: expected {key} of all images or of none, got it of {len(numbers)} of {len(images)}, not of {name}"
        )
    if numbers:
        first = _first_number(path, images, numbers, key, length) if first is None else first
        frames = [number - first for number in numbers]
    else:
        frames = _by_names(path, images, tracked)
    if min(frames) < 0 or max(frames) >= LAST_FRAME:
        raise RequestError(f"{path}: expected {key} from 0 to {LAST_FRAME - 1}, got {min(frames)} to {max(frames)}")
    names: dict[int, str] = {}
    for frame, image in zip(frames, images, strict=True):
        if frame in names:
            raise RequestError(f"{path}: expected one image a frame, got {names[frame]!r} and {image.name!r} of one")
        names[frame] = image.name
    return frames


def _first_number(path: Path, images: Sequence[ListedImage], numbers: Sequence[int], key: str, length: int) -> int:
    """Whether numbers of frames count from 0, as is usual, or from 1."""
    if min(numbers) <= 0:
        return 0
    places = _places_among_pictures(path, images)
    shifts = {number - place for number, place in zip(numbers, places, strict=True)} if places else set[int]()
    if len(shifts) == 1 and shifts <= {0, 1}:
        return shifts.pop()
    # Names count from 1, as FFmpeg numbers images: those that are one more than the numbers say that these are from 0.
    named = _numbers_in_names(images)
    ahead = {name - number for name, number in zip(named, numbers, strict=True)} if named else set[int]()
    if ahead == {1} or not (min(numbers) == 1 or max(numbers) == length or ahead == {0}):
        return 0
    warnings.warn(f"{path}: no image has the {key} 0; it is taken to count frames from 1", InputWarning, stacklevel=4)
    return 1


def _by_names(path: Path, images: Sequence[ListedImage], tracked: bool) -> list[int]:
    if not all(image.name for image in images):
        return list(range(len(images)))
    names = [PurePosixPath(image.name) for image in images]
    folders = sorted({name.parent for name in names})
    ordered = [name for folder in folders for name in in_order([n for n in names if n.parent == folder])]
    places = {name: place for place, name in enumerate(ordered)}
    if len(places) < len(images):
        # Names that tell no two images apart say nothing of their order.
        return list(range(len(images)))
    ranks = [places[name] for name in names]
    if not tracked:
        return ranks
    if among_pictures := _places_among_pictures(path, images):
        return among_pictures
    numbers = _numbers_in_names(images)
    if not numbers or max(numbers) >= LAST_FRAME:
        return ranks
    if min(numbers) <= 1 or max(numbers) <= len(numbers) / ENOUGH_FRAMES:
        return [number - min(*numbers, 1) for number in numbers]
    warnings.warn(
        f"{path}: {ordered[0]} is taken as the first frame, and the images as all frames from there on; give "
        "frame_id where they are not",
        InputWarning,
        stacklevel=4,
    )
    return ranks


def _numbers_in_names(images: Sequence[ListedImage]) -> list[int]:
    """The numbers in which names that are alike otherwise end; none where they are of another kind."""
    if not all(image.name for image in images):
        return []
    matches = [FRAME_NAME.fullmatch(str(PurePosixPath(image.name).with_suffix(""))) for image in images]
    parts = [(match[1], int(match[2])) for match in matches if match is not None and len(match[2]) < 10]
    if len(parts) < len(images) or len({prefix for prefix, _ in parts}) > 1:
        return []
    return [number for _, number in parts]


def _places_among_pictures(path: Path, images: Sequence[ListedImage]) -> list[int]:
    """The place of each image in the folder of the pictures; none where not all lie in one folder."""
    pictures = picture_paths(path, [image.name for image in images])
    if len({picture.parent for picture in pictures}) != 1:
        return []
    places = {picture: place for place, picture in enumerate(list_images(pictures[0].parent))}
    return [places[picture] for picture in pictures] if places.keys() >= {*pictures} else []


def listed_frames(path: Path, frames: Sequence[int], length: int) -> IntArray | None:
    """``(N,)`` the frames that a file lists, in order; None where it lists all. Says how many it does not."""
    listed = np.unique(frames)
    count = max(int(listed[-1]) + 1, length) if len(listed) else length
    if len(listed) in (0, count):
        return None
    missing = np.setdiff1d(np.arange(min(count, len(listed) + 1)), listed)
    warnings.warn(
        f"{path}: {count - len(listed)} of {count} frames have no image in it, the first is frame {missing[0] + 1}; "
        "results in them are not scored",
        InputWarning,
        stacklevel=4,
    )
    return listed


def other_sizes(path: Path, pictures: Sequence[Path], sizes: Sequence[tuple[int, int] | None]) -> set[Path]:
    """The pictures that have another width and height than the file says; warns of them.

    Args:
        path: of the label file.
        pictures: those that are missing are passed over.
        sizes: width and height of each, as the file says; None where it does not.

    Raises:
        RequestError: most of them have.
    """
    stated = [(p, size) for p, size in zip(pictures, sizes, strict=True) if size is not None and p.is_file()]
    actual = [image_size(picture) for picture, _ in stated]
    other = np.array([size != there for (_, size), there in zip(stated, actual, strict=True)], dtype=np.bool_)
    names = [
        f"{picture} of {there[0]}x{there[1]} for {size[0]}x{size[1]}"
        for (picture, size), there in zip(stated, actual, strict=True)
    ]
    sieve = Sieve(path, "images")
    sieve.usable(names, (other, "of another size than the file says"))
    sieve.tell()
    return {picture for (picture, _), differs in zip(stated, other.tolist(), strict=True) if differs}
