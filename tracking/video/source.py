"""Video in: files, folders of images, sequence folders, webcams and streams, one frame at a time.

OpenCV's BGR order stops here: a `Frame` is RGB.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol, TypeAlias

import cv2
import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError, RunError
from tsuiseki.tracking.formats.mot_sequence import IMAGE_SUFFIXES
from tsuiseki.tracking.types import Frame, ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.coded_size import CodedSizes, Size
from tsuiseki.tracking.video.frame_times import NotedTimes, TimedBy, container_time, stated_rate, uneven
from tsuiseki.tracking.video.image_folder import DEFAULT_FRAME_RATE, GivenFrames, ImageFolder, one_image, read_image
from tsuiseki.tracking.video.live import LiveSource

SourceLike: TypeAlias = str | Path | int | Iterable[ImageArray | Frame]
# FFmpeg draws the letters of a text file.
DRAWN_TEXT = cv2.VideoWriter.fourcc(*"ansi")
PLAYLIST_HEADERS = (b"#EXTM3U", b"ffconcat")


class Source(Protocol):
    """Somewhere frames come from.

    Attributes:
        name: for people to read.
        frame_rate: frames per second.
        timed_by: where the times of frames come from.
        times: of the frames that it gave so far.
        rate_missing: what should say the rate, such as ``seqinfo.ini``, does not, and 25 are taken.
        length: number of frames of the whole video; None where only playing it tells.
        live: it cannot be played again, and ends when the user says so.
        frames_wanted: those that `frames` gives.
        has_images: False for a sequence that is text only.
    """

    @property
    def name(self) -> str: ...
    @property
    def frame_rate(self) -> float: ...
    @property
    def timed_by(self) -> TimedBy: ...
    @property
    def times(self) -> NotedTimes: ...
    @property
    def rate_missing(self) -> bool: ...
    @property
    def length(self) -> int | None: ...
    @property
    def live(self) -> bool: ...
    @property
    def frames_wanted(self) -> FrameRange: ...
    @property
    def has_images(self) -> bool: ...

    def frames(self) -> Iterator[Frame]:
        """The wanted frames, numbered as in the whole video; one is held at a time.

        Raises:
            RunError: the video breaks off or changes its size, or an image cannot be read.
        """
        ...


def open_source(source: SourceLike, frames: FrameRange | None = None, frame_rate: float | None = None) -> Source:
    """What ``source`` names, checked before anything is read in full.

    Args:
        source: a video file, a folder of images, a sequence folder (MOTChallenge, OTB, UAV123, VOT), the number of a
            webcam, the address of a stream, or images, see `GivenFrames`.
        frames: to read; by default all.
        frame_rate: frames a second, instead of what the source says; a file's frames are then timed by it.

    Raises:
        RequestError: there is no such thing, it cannot be read, it has no frame, its images differ in size, or
            the frames lie beyond it.
    """
    opened: ImageFolder | VideoFile | LiveSource | GivenFrames
    if isinstance(source, str | Path | int):
        opened = _opened(str(source), frames or FrameRange())
    elif isinstance(source, Iterable) and not isinstance(source, Mapping):
        opened = GivenFrames.open(source, frames or FrameRange())
    else:
        raise RequestError(
            f"expected a video file, a folder of images, a webcam number, an address or images, got "
            f"{type(source).__name__}"
        )
    if frame_rate is None:
        return opened
    timed_by: TimedBy = "arrival" if opened.live else "frame rate"
    return replace(opened, frame_rate=frame_rate, rate_missing=False, timed_by=timed_by)


def _opened(source: str | Path, wanted: FrameRange) -> ImageFolder | VideoFile | LiveSource:
    text, path = str(source), Path(source)
    if path.is_dir():
        return ImageFolder.open(path, wanted)
    if path.is_file():
        return VideoFile.open(path, wanted)
    if text.isdecimal() and len(text) < 10:
        return LiveSource.open(int(text), f"webcam {text}", wanted)
    if "://" in text:
        return LiveSource.open(text, text.split("?")[0], wanted)
    raise RequestError(f"expected a video file, a folder of images, a webcam number or an address, found no {text}")


def image_size(source: Source) -> Size | None:
    """Width and height of the images of a source, pixels; None where it does not tell them."""
    size: Size | None = getattr(source, "size", None)
    return size if size and min(size) > 0 else None


def picture_size(source: Source) -> Size | None:
    """`image_size`, or the size of the first frame of a video file: to check what is given with it."""
    return image_size(source) or getattr(source, "first_size", None)


def length_of(source: Source) -> int | None:
    """How many frames the whole video has, or promises."""
    return source.length or getattr(source, "promised", None)


def frames_expected(source: Source) -> int | None:
    """How many frames of ``source`` are wanted, as far as it is known."""
    wanted, length = source.frames_wanted, length_of(source)
    last = length - 1 if wanted.last is None and length else wanted.last
    return None if last is None else last - wanted.first + 1


def address_of(source: Source) -> str:
    """What `open_source` took to open it; empty for images."""
    return str(getattr(source, "address", getattr(source, "path", "")))


def named(source: SourceLike) -> str:
    """A source that was given, for the settings of a run."""
    return str(source) if isinstance(source, str | Path | int) else "images"


def frames_of_size(source: Source, width: int, height: int) -> Iterator[Frame]:
    """The frames of ``source``, each of the size that its camera has, pixels.

    Raises:
        RequestError: one has another size.
    """
    for frame in source.frames():
        high, wide = frame.image.shape[:2]
        if (wide, high) != (width, height):
            raise RequestError(
                f"{source.name}: expected {width}x{height} pixels as in the camera file, got {wide}x{high}"
            )
        yield frame


def some_frames(source: Source, numbers: Sequence[int]) -> Iterator[Frame]:
    """The frames of these 0-based numbers, in order, as far as there are such; of a folder no other is read."""
    if isinstance(source, ImageFolder):
        for number in (one for one in numbers if one < len(source.images)):
            yield Frame(number, number / source.frame_rate, read_image(source.images[number], source.size))
    else:
        wanted = set(numbers)
        yield from (frame for frame in source.frames() if frame.index in wanted)


def endless(source: Source) -> bool:
    """Whether a source does not end by itself."""
    return source.live and source.frames_wanted.last is None and not getattr(source, "ends", False)


@dataclass(frozen=True)
class VideoFile:
    """A video file that OpenCV can decode."""

    path: Path
    name: str
    frame_rate: float
    promised: int
    duration: float
    frames_wanted: FrameRange
    live: bool = False
    length: int | None = None
    has_images: bool = True
    rate_missing: bool = False
    timed_by: TimedBy = "container"
    times: NotedTimes = field(default_factory=NotedTimes, compare=False)
    first_size: Size | None = None

    @classmethod
    def open(cls, path: Path, wanted: FrameRange) -> VideoFile:
        """The file at ``path``; raises RequestError where its first frame cannot be decoded."""
        with path.open("rb") as file:
            if file.read(16).startswith(PLAYLIST_HEADERS):
                raise RequestError(f"{path} is a playlist, which may lead anywhere; give the video itself")
        if path.suffix.lower() in IMAGE_SUFFIXES:
            one_image(path)
        capture = cv2.VideoCapture(str(path))
        try:
            readable = capture.isOpened() and int(capture.get(cv2.CAP_PROP_FOURCC)) != DRAWN_TEXT
            rate = stated_rate(capture)
            promised = int(max(0, capture.get(cv2.CAP_PROP_FRAME_COUNT))) if readable else 0
            if not readable or not capture.grab():
                found = "no frame in it" if readable else "something else"
                raise RequestError(f"{path}: expected a video that OpenCV can decode, found {found}")
            first, (sound, image) = capture.get(cv2.CAP_PROP_POS_MSEC), capture.retrieve()
            size = image.shape[1::-1] if sound else None
            # A raw stream has no times: all are 0.
            timed_by: TimedBy = "frame rate"
            if capture.grab() and capture.get(cv2.CAP_PROP_POS_MSEC) > first:
                timed_by = "container"
        finally:
            capture.release()
        if promised and max(wanted.first, wanted.last or 0) >= promised + _slack(promised):
            wanted.within(promised)
        taken = rate or DEFAULT_FRAME_RATE
        return cls(
            path,
            path.name,
            taken,
            promised,
            promised / taken,
            wanted,
            rate_missing=rate is None,
            timed_by=timed_by,
            first_size=size,
        )

    @property
    def slack(self) -> float:
        """By how many frames the header of a sound file may be wrong."""
        return _slack(self.promised)

    def frames(self) -> Iterator[Frame]:
        """See `Source.frames`."""
        capture, sizes = cv2.VideoCapture(str(self.path)), CodedSizes(self.path)
        times: list[float] = []
        stamp, first, size = 0.0, 0.0, None
        try:
            while self.frames_wanted.last is None or len(times) <= self.frames_wanted.last:
                index = len(times)
                if not capture.grab():
                    self.refuse_early_end(index, stamp)
                    break
                size = self.same_size(index, size, sizes.read())
                stamp = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
                first = first if times else stamp
                times.append(self.time_of(stamp - first, times))
                if index in self.frames_wanted:
                    image = retrieved(capture, f"{self.path}: frame {index + 1}")
                    yield self.times.note(Frame(index, times[-1], image))
        finally:
            capture.release()
            sizes.close()
        self.warn_uneven(times)

    def warn_uneven(self, times: Sequence[float]) -> None:
        """Say that frames at ``times``, seconds, lie unevenly, where they do."""
        if found := uneven(times) if self.timed_by == "container" else {}:
            warnings.warn(
                f"{self.name}: its frames are {found['shortest_step']:g} to {found['longest_step']:g} s apart, about "
                f"{found['missing']} are missing; their times are the container's",
                InputWarning,
                stacklevel=3,
            )

    def time_of(self, stated: float, before: Sequence[float]) -> float:
        """Of the frame after those ``before``."""
        if self.timed_by == "frame rate":
            return len(before) / self.frame_rate
        return container_time(stated, before, self.frame_rate)

    def same_size(self, index: int, size: Size | None, stated: Size | None) -> Size | None:
        """The size of the pictures so far; raises RunError where a coded frame states another one."""
        if size is not None and stated is not None and stated != size:
            raise RunError(
                f"{self.path}: expected {size[0]}x{size[1]} pixels throughout, got {stated[0]}x{stated[1]} from about "
                f"frame {index + 1} on; cut the file there"
            )
        return stated or size

    def refuse_early_end(self, frames: int, seconds: float) -> None:
        """Tell a truncated file from one whose header only estimates its length.

        Both the number of frames and the time of the last one have to fall short, since the first is an estimate where
        the frame rate varies.
        """
        wanted = self.frames_wanted
        if frames <= wanted.first or wanted.last is not None:
            raise RunError(f"{self.path}: expected frames {wanted}, but the video ends after frame {frames}")
        slack = self.slack
        if frames + slack < self.promised and seconds + slack * self.duration / self.promised < self.duration:
            raise RunError(
                f"{self.path}: expected {self.promised} frames, but the video breaks off after frame {frames}"
            )


def _slack(promised: int) -> float:
    return max(3.0, 0.02 * promised)


def retrieved(capture: cv2.VideoCapture, what: str) -> ImageArray:
    """The frame that was grabbed, RGB; raises RunError where it cannot be decoded."""
    decoded, image = capture.retrieve()
    if not decoded:
        raise RunError(f"{what} cannot be decoded")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)
