"""Video in: files, folders of images, sequence folders, webcams and streams, one frame at a time.

OpenCV's BGR order stops here: a `Frame` is RGB.

Frames of a file from any number on: packets tell where they lie, and one is decoded from a key frame on. A file's own
counting is not relied on: every frame is known by its time, which its packet has, too. What is decoded is the same as
if the whole file were, or it is refused.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError, RunError
from tsuiseki.tracking.formats.mot_sequence import IMAGE_SUFFIXES
from tsuiseki.tracking.types import FloatArray, Frame, ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.coded_size import CodedFrames
from tsuiseki.tracking.video.frame_source import (
    DEFAULT_FRAME_RATE,
    Size,
    TimedBy,
    container_time,
    stated_rate,
    uneven,
)
from tsuiseki.tracking.video.frame_source import Source as Source
from tsuiseki.tracking.video.image_folder import GivenFrames, ImageFolder, one_image
from tsuiseki.tracking.video.live import LiveSource

SourceLike: TypeAlias = str | Path | int | Iterable[ImageArray | Frame]
# FFmpeg draws the letters of a text file.
DRAWN_TEXT = cv2.VideoWriter.fourcc(*"ansi")
PLAYLIST_HEADERS = (b"#EXTM3U", b"ffconcat")


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
    wanted = frames or FrameRange()
    if isinstance(source, str | Path | int):
        opened = _opened(str(source), wanted)
    elif isinstance(source, Iterable) and not isinstance(source, Mapping):
        opened = GivenFrames.open(source, wanted)
    else:
        raise RequestError(
            f"expected a video file, a folder of images, a webcam number, an address or images, got "
            f"{type(source).__name__}"
        )
    if frame_rate is None:
        return opened
    timed_by: TimedBy = "arrival" if opened.live else "frame rate"
    return replace(opened, frame_rate=frame_rate, rate_missing=False, timed_by=timed_by)


def _opened(text: str, wanted: FrameRange) -> Source:
    path = Path(text)
    if path.is_dir():
        return ImageFolder.open(path, wanted)
    if path.is_file():
        return VideoFile.open(path, wanted)
    if text.isdecimal() and len(text) < 10:
        return LiveSource.open(text, f"webcam {text}", wanted)
    if "://" in text:
        return LiveSource.open(text, text.split("?")[0], wanted)
    raise RequestError(f"expected a video file, a folder of images, a webcam number or an address, found no {text}")


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
        yield from source.at(one for one in numbers if one < len(source.images))
    else:
        wanted = set(numbers)
        yield from (frame for frame in source.frames() if frame.index in wanted)


@dataclass(frozen=True, kw_only=True)
class VideoFile(Source):
    """A video file that OpenCV can decode.

    Attributes:
        path: of the file.
        duration: seconds by its header.
    """

    path: Path
    duration: float

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
            name=path.name,
            path=path,
            address=str(path),
            duration=promised / taken,
            frame_rate=taken,
            rate_missing=rate is None,
            timed_by=timed_by,
            promised=promised,
            frames_wanted=wanted,
            first_size=size,
        )

    @property
    def slack(self) -> float:
        """By how many frames the header of a sound file may be wrong."""
        return _slack(self.promised)

    def frames(self) -> Iterator[Frame]:
        """See `Source.frames`."""
        capture, coded = cv2.VideoCapture(str(self.path)), CodedFrames(self.path)
        times: list[float] = []
        stamp, first, size = 0.0, 0.0, None
        try:
            while self.frames_wanted.last is None or len(times) <= self.frames_wanted.last:
                index = len(times)
                if not capture.grab():
                    self.refuse_early_end(index, stamp)
                    break
                size = self.same_size(index, size, coded.next_size())
                stamp = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
                first = first if times else stamp
                times.append(self.time_of(stamp - first, times))
                if index in self.frames_wanted:
                    image = retrieved(capture, f"{self.path}: frame {index + 1}")
                    yield self.noted(Frame(index, times[-1], image))
        finally:
            capture.release()
            coded.capture.release()
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


# Frames before the wanted one from which a file is first asked to begin; each further attempt four times as many.
LEAD = 16


class UnfitIndexError(RunError):
    """Frames do not come as the packets say: this file has to be read from its beginning."""


@dataclass(frozen=True)
class SeekableVideo:
    """A video whose frames can be read from any number on.

    Attributes:
        video: the file, or images.
        stamps: ``(F,)`` milliseconds of a file's frames; none of images.
        times: ``(F,)`` seconds of the frames up to the end.
    """

    video: VideoFile | ImageFolder
    stamps: FloatArray
    times: FloatArray

    @classmethod
    def of(cls, video: object) -> SeekableVideo | None:
        """None where it can only be read from the beginning; raises RunError where the coded size changes."""
        if isinstance(video, ImageFolder) and video.images:
            return cls(video, np.empty(0), np.arange(len(video.images)) / video.frame_rate)
        if not isinstance(video, VideoFile):
            return None
        coded, stamped, size = CodedFrames(video.path), list[float](), None
        try:
            while coded.there and coded.capture.grab():
                size = video.same_size(len(stamped), size, coded.size())
                stamped.append(coded.capture.get(cv2.CAP_PROP_POS_MSEC))
        finally:
            coded.capture.release()
        stamps, times = np.sort(np.array(stamped, dtype=np.float64)), list[float]()
        if len(stamps) < 2 or not (np.diff(stamps) > 0).all():
            return None
        for stamp in (stamps / 1000).tolist():
            times.append(video.time_of(stamp - float(stamps[0]) / 1000, times))
        return cls(video, stamps, np.array(times))

    @property
    def wanted(self) -> FrameRange:
        """The frames that the video is to give, up to its end where it is shorter."""
        wanted, length = self.video.frames_wanted, len(self.times)
        return FrameRange(wanted.first, min(length - 1, length if wanted.last is None else wanted.last))

    def frames(self, first: int, last: int) -> Iterator[Frame]:
        """Frames ``first`` to ``last``, 0-based, both included.

        Raises:
            RunError: one cannot be decoded, or see `UnfitIndexError`.
        """
        if isinstance(self.video, ImageFolder):
            yield from self.video.at(range(first, last + 1))
            return
        capture = self._at(first)
        try:
            for number in range(first, last + 1):
                if not capture.grab() or capture.get(cv2.CAP_PROP_POS_MSEC) != self.stamps[number]:
                    raise UnfitIndexError(f"{self.video.path}: frame {number + 1} does not come as its packets say")
                image = retrieved(capture, f"{self.video.path}: frame {number + 1}")
                yield Frame(number, float(self.times[number]), image)
        finally:
            capture.release()

    def _at(self, first: int) -> cv2.VideoCapture:
        """A capture whose next frame is ``first``; the one before was decoded, too."""
        assert isinstance(self.video, VideoFile)
        path, back = str(self.video.path), LEAD
        while first - back > 0:
            capture = cv2.VideoCapture(path)
            capture.set(cv2.CAP_PROP_POS_FRAMES, first - back)
            while capture.grab() and capture.get(cv2.CAP_PROP_POS_MSEC) < self.stamps[first - 1]:
                pass
            if capture.get(cv2.CAP_PROP_POS_MSEC) == self.stamps[first - 1]:
                return capture
            capture.release()
            back *= 4
        capture = cv2.VideoCapture(path)
        for _ in range(first):
            capture.grab()
        return capture

    def check_end(self, last: int) -> None:
        """Say after the last frame what `VideoFile.frames` says there: it breaks off early, or its frames lie unevenly.

        Raises:
            RunError: see `VideoFile.refuse_early_end`.
        """
        if isinstance(self.video, ImageFolder):
            return
        wanted = self.video.frames_wanted
        if wanted.last is None or last < wanted.last:
            self.video.refuse_early_end(last + 1, float(self.stamps[-1]) / 1000)
        self.video.warn_uneven(self.times[: last + 1].tolist())
