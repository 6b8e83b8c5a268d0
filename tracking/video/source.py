"""Video in: files, folders of images, sequence folders, webcams and streams, one frame at a time.

Frames of a file from any number on: packets tell where they lie, and one is decoded from a key frame on. A file's own
counting is not relied on: every frame is known by its time, which its packet has, too. What is decoded is the same as
if the whole file were, or it is refused.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError, RunError
from tsuiseki.tracking.formats.mot_sequence import IMAGE_SUFFIXES
from tsuiseki.tracking.types import FloatArray, Frame, ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.decoding import Decoder
from tsuiseki.tracking.video.frame_source import (
    DEFAULT_FRAME_RATE,
    TimedBy,
    container_time,
    fingerprint_of,
    uneven,
)
from tsuiseki.tracking.video.frame_source import Source as Source
from tsuiseki.tracking.video.image_folder import GivenFrames, ImageFolder
from tsuiseki.tracking.video.levels import BYTE, depth_of, eight_bits
from tsuiseki.tracking.video.live import LiveSource

if TYPE_CHECKING:
    from av.video.frame import VideoFrame

SourceLike: TypeAlias = str | Path | int | Iterable[ImageArray | Frame]
# An address with the number of one of its video streams, as results note it.
CHOSEN_STREAM = re.compile(r"(.+)#stream=(\d{1,4})", re.DOTALL)
PLAYLIST_HEADERS = (b"#EXTM3U", b"ffconcat")


def open_source(
    source: SourceLike, frames: FrameRange | None = None, frame_rate: float | None = None, stream: int | None = None
) -> Source:
    """What ``source`` names, checked before anything is read in full.

    Args:
        source: a video file, a folder of images, a sequence folder (MOTChallenge, OTB, UAV123, VOT), the number of a
            webcam, the address of a stream, or images, see `GivenFrames`.
        frames: to read; by default all.
        frame_rate: frames a second, instead of what the source says; a file's frames are then timed by it.
        stream: which of several video streams in a file or at an address, from 1; by default the first.

    Raises:
        RequestError: there is no such thing, it cannot be read, it has no frame, its images differ in size, or
            the frames lie beyond it.
    """
    frame_range = frames or FrameRange()
    if isinstance(source, str | Path | int):
        opened = _opened(str(source), frame_range, stream)
    elif isinstance(source, Iterable) and not isinstance(source, Mapping):
        opened = GivenFrames.open(source, frame_range)
    else:
        raise RequestError(
            f"expected a video file, a folder of images, a webcam number, an address or images, got "
            f"{type(source).__name__}"
        )
    if frame_rate is None:
        return opened
    timed_by: TimedBy = "arrival" if opened.live else "frame rate"
    return replace(opened, frame_rate=frame_rate, rate_missing=False, timed_by=timed_by)


def _opened(text: str, frame_range: FrameRange, stream: int | None) -> Source:
    text, stream = split_stream(text, stream)
    if not text.strip():
        raise RequestError(
            "expected a video file, a folder of images, a webcam number or an address, got an empty name"
        )
    path = Path(text)
    if path.is_dir():
        return ImageFolder.open(path, frame_range)
    if path.is_file():
        if path.suffix.lower() in IMAGE_SUFFIXES:
            return ImageFolder.open(path, frame_range)
        return VideoFile.open(path, frame_range, stream)
    if (name := live_name(text)) is not None:
        return LiveSource.open(text, name, frame_range, stream)
    raise RequestError(f"expected a video file, a folder of images, a webcam number or an address, found no {text}")


def split_stream(address: str, stream: int | None = None) -> tuple[str, int | None]:
    """An address without the number of a stream at its end, and ``stream`` or that number; None for the first one."""
    chosen = CHOSEN_STREAM.fullmatch(address)
    if chosen is None or stream is not None or _is_there(address):
        return address, stream
    return chosen[1], int(chosen[2])


def live_name(address: str) -> str | None:
    """What a webcam or a stream is called; None of an address that names neither."""
    if address.isdecimal() and len(address) < 10:
        return f"webcam {address}"
    return address.split("?")[0] if "://" in address else None


def is_live(address: object) -> bool:
    """Whether an address names a webcam or a stream, not a file."""
    text = str(address)
    return file_of(text) is None and live_name(split_stream(text)[0]) is not None


def file_of(address: str | Path) -> Path | None:
    """The file or folder that an address names, with or without the number of a stream; None where there is none."""
    text = str(address)
    return next((Path(name) for name in (text, split_stream(text)[0]) if name and _is_there(name)), None)


def _is_there(name: str) -> bool:
    try:
        return Path(name).exists()
    except OSError:  # a name that no file can have
        return False


def absolute(address: str) -> str:
    """An address that holds in any folder: that of a file with its whole path, others as they are."""
    path = file_of(address)
    return address if path is None else f"{path.resolve()}{address.removeprefix(str(path))}"


def named(source: SourceLike) -> str:
    """A source that was given, for the settings of a run."""
    return str(source) if isinstance(source, str | Path | int) else "images"


def check_size(name: str, image: ImageArray, width: int, height: int) -> None:
    """Refuse a picture of the source ``name`` that has not the size of its camera, pixels; raises RequestError."""
    high, wide = image.shape[:2]
    if (wide, high) != (width, height):
        raise RequestError(f"{name}: expected {width}x{height} pixels as in the camera file, got {wide}x{high}")


def frames_of_size(source: Source, width: int, height: int) -> Iterator[Frame]:
    """The frames of ``source``, each of the size that its camera has, pixels.

    Raises:
        RequestError: one has another size.
    """
    for frame in source.frames():
        check_size(source.name, frame.image, width, height)
        yield frame


def some_frames(source: Source, numbers: Sequence[int]) -> Iterator[Frame]:
    """The frames of these 0-based numbers, in order, as far as there are such; of a folder no other is read."""
    if isinstance(source, ImageFolder):
        yield from source.at(number for number in numbers if number < len(source.images))
    else:
        chosen = set(numbers)
        yield from (frame for frame in source.frames() if frame.index in chosen)


@dataclass(frozen=True, kw_only=True)
class VideoFile(Source):
    """A video file that FFmpeg can decode.

    Attributes:
        path: of the file.
        stream: number of its video stream, from 1.
        duration: seconds by its header.
        depth: how many bits a colour are in use, where a file has 16.
    """

    path: Path
    stream: int
    duration: float
    depth: int

    @classmethod
    def open(cls, path: Path, frame_range: FrameRange, stream: int | None = None) -> VideoFile:
        """The file at ``path``; raises RequestError where its first frame cannot be decoded."""
        with path.open("rb") as file:
            if file.read(16).startswith(PLAYLIST_HEADERS):
                raise RequestError(f"{path} is a playlist, which may lead anywhere; give the video itself")
        with closing(Decoder(path, stream)) as decoder:
            frames = decoder.frames()
            first, second = next(frames, None), next(frames, None)
            if first is None:
                raise RequestError(f"{path}: expected a video that FFmpeg can decode, found no frame in it")
            levels, start = decoder.levels(first), decoder.stamp(first)
            follower = None if second is None else decoder.stamp(second)
            depth = BYTE if levels.dtype == np.uint8 else depth_of([levels, *decoder.samples()], path.name)
        # A raw stream has no times.
        timed = start is not None and follower is not None and follower > start
        promised, rate = decoder.promised, decoder.rate or DEFAULT_FRAME_RATE
        opened = cls(
            name=path.name,
            path=path,
            stream=1 if stream is None else stream,
            address=str(path) if stream is None else f"{path}#stream={stream}",
            duration=promised / rate,
            depth=depth,
            frame_rate=rate,
            rate_missing=decoder.rate is None,
            timed_by="container" if timed else "frame rate",
            promised=promised,
            frames_wanted=frame_range,
            first_time=start or 0.0,
            size=(levels.shape[1], levels.shape[0]),
        )
        if promised and max(frame_range.first, frame_range.last or 0) >= promised + opened.slack:
            frame_range.within(promised)
        return opened

    @property
    def slack(self) -> float:
        """By how many frames the header of a sound file may be wrong."""
        return max(3.0, 0.02 * self.promised)

    @property
    def fingerprint(self) -> str:
        return fingerprint_of((self.path,))

    def frames(self) -> Iterator[Frame]:
        times, stamp = list[float](), None
        with closing(Decoder(self.path, self.stream)) as decoder:
            frames = decoder.frames()
            while self.frames_wanted.last is None or len(times) <= self.frames_wanted.last:
                decoded, index = next(frames, None), len(times)
                if decoded is None:
                    self.refuse_early_end(index, (stamp or 0.0) - self.first_time)
                    break
                stamp = decoder.stamp(decoded)
                times.append(self.time_of(stamp, times))
                if index in self.frames_wanted:
                    yield self.noted(Frame(index, times[-1], self.image(decoder, decoded, index)))
        self.warn_uneven(times)

    def image(self, decoder: Decoder, decoded: VideoFrame, index: int) -> ImageArray:
        """``(H, W, 3)`` uint8 RGB of a frame; raises RunError where it has another size than the first."""
        image = eight_bits(decoder.levels(decoded), self.depth)
        (height, width), size = image.shape[:2], self.size
        if size is not None and (width, height) != size:
            raise RunError(
                f"{self.path}: expected {size[0]}x{size[1]} pixels throughout, got {width}x{height} from "
                f"frame {index + 1} on; cut the file there"
            )
        return image

    def warn_uneven(self, times: Sequence[float]) -> None:
        """Say that frames at ``times``, seconds, lie unevenly, where they do."""
        if steps := uneven(times) if self.timed_by == "container" else {}:
            warnings.warn(
                f"{self.name}: its frames are {steps['shortest_step']:g} to {steps['longest_step']:g} s apart, about "
                f"{steps['missing']} are missing; their times are the container's",
                InputWarning,
                stacklevel=3,
            )

    def time_of(self, stamp: float | None, times: Sequence[float]) -> float:
        """Seconds since the first frame of the frame after those at ``times``; ``stamp`` is its container's."""
        if self.timed_by == "frame rate":
            return len(times) / self.frame_rate
        return container_time(math.nan if stamp is None else stamp - self.first_time, times, self.frame_rate)

    def refuse_early_end(self, frames: int, seconds: float) -> None:
        """Tell a truncated file from one whose header only estimates its length.

        Both the number of frames and the time of the last one, since the first, have to fall short: the number is an
        estimate where the frame rate varies.
        """
        frame_range = self.frames_wanted
        if frames <= frame_range.first or frame_range.last is not None:
            raise RunError(f"{self.path}: expected frames {frame_range}, but the video ends after frame {frames}")
        slack = self.slack
        if frames + slack < self.promised and seconds + slack * self.duration / self.promised < self.duration:
            raise RunError(
                f"{self.path}: expected {self.promised} frames, but the video breaks off after frame {frames}"
            )


# Frames before the wanted one from which a file is first asked to begin; each further attempt four times as many.
LEAD = 16


class UnfitIndexError(RunError):
    """Frames do not come as the packets say: this file has to be read from its beginning."""


@dataclass(frozen=True)
class SeekableVideo:
    """A video whose frames can be read from any number on.

    Attributes:
        video: the file, or images.
        stamps: ``(F,)`` seconds of a file's frames by its container's clock; none of images.
        times: ``(F,)`` seconds of the frames up to the end.
    """

    video: VideoFile | ImageFolder
    stamps: FloatArray
    times: FloatArray

    @classmethod
    def of(cls, video: object) -> SeekableVideo | None:
        """None where it can only be read from the beginning."""
        if isinstance(video, ImageFolder) and video.images:
            return cls(video, np.empty(0), np.arange(len(video.images)) / video.frame_rate)
        if not isinstance(video, VideoFile):
            return None
        with closing(Decoder(video.path, video.stream)) as decoder:
            stamps = np.array(decoder.stamps() or [], dtype=np.float64)
        if len(stamps) < 2 or not (np.diff(stamps) > 0).all():
            return None
        times = list[float]()
        for stamp in stamps.tolist():
            times.append(video.time_of(stamp, times))
        return cls(video, stamps, np.array(times))

    @property
    def frame_range(self) -> FrameRange:
        """The frames that the video is to give, up to its end where it is shorter."""
        frame_range, length = self.video.frames_wanted, len(self.times)
        return FrameRange(frame_range.first, min(length - 1, length if frame_range.last is None else frame_range.last))

    def frames(self, first: int, last: int) -> Iterator[Frame]:
        """Frames ``first`` to ``last``, 0-based, both included.

        Raises:
            RunError: one cannot be decoded, or see `UnfitIndexError`.
        """
        if isinstance(self.video, ImageFolder):
            yield from self.video.at(range(first, last + 1))
            return
        with ExitStack() as stack:
            decoder, frames = self._entered(stack, first)
            for number in range(first, last + 1):
                frame = next(frames, None)
                if frame is None or decoder.stamp(frame) != self.stamps[number]:
                    raise UnfitIndexError(f"{self.video.path}: frame {number + 1} does not come as its packets say")
                yield Frame(number, float(self.times[number]), self.video.image(decoder, frame, number))

    def _entered(self, stack: ExitStack, first: int) -> tuple[Decoder, Iterator[VideoFrame]]:
        """A decoder and its frames from number ``first`` on; the one before was decoded, too."""
        assert isinstance(self.video, VideoFile)
        back = LEAD
        while True:
            decoder = stack.enter_context(closing(Decoder(self.video.path, self.video.stream)))
            frames = decoder.frames()
            if first <= back or not decoder.seek(self.stamps[first - back]):
                return decoder, islice(frames, first, None)
            preceding = self.stamps[first - 1]
            if next((t for t in map(decoder.stamp, frames) if t is None or t >= preceding), None) == preceding:
                return decoder, frames
            back *= 4

    def check_end(self, last: int) -> None:
        """Say after the last frame what `VideoFile.frames` says there: it breaks off early, or its frames lie unevenly.

        Raises:
            RunError: see `VideoFile.refuse_early_end`.
        """
        if isinstance(self.video, ImageFolder):
            return
        frame_range = self.video.frames_wanted
        if frame_range.last is None or last < frame_range.last:
            self.video.refuse_early_end(last + 1, float(self.stamps[-1] - self.stamps[0]))
        self.video.warn_uneven(self.times[: last + 1].tolist())
