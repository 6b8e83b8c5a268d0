"""Video in: files, folders of images, sequence folders, webcams and streams, one frame at a time.

OpenCV's BGR order stops here: a `Frame` is RGB.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.types import Frame, ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.coded_size import CodedSizes, Size
from tsuiseki.tracking.video.image_folder import DEFAULT_FRAME_RATE, ImageFolder

PLAYLIST_HEADERS = (b"#EXTM3U", b"ffconcat")


class Source(Protocol):
    """Somewhere frames come from.

    Attributes:
        name: for people to read.
        frame_rate: frames per second.
        rate_missing: what should say the rate, such as ``seqinfo.ini``, does not, and 25 are taken.
        length: number of frames of the whole video; None where only playing it tells.
        live: it cannot be played again, and ends when the user says so.
        frames_wanted: the stretch that `frames` gives.
        has_images: False for a sequence that is text only.
    """

    @property
    def name(self) -> str: ...
    @property
    def frame_rate(self) -> float: ...
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
        """The frames of the stretch, numbered as in the whole video; one is held at a time.

        Raises:
            RunError: the video breaks off or changes its size, or an image cannot be read.
        """
        ...


def open_source(source: str | Path, frames: FrameRange | None = None, frame_rate: float | None = None) -> Source:
    """What ``source`` names, checked before anything is read in full.

    Args:
        source: a video file, a folder of images, a sequence folder (MOTChallenge, OTB, UAV123, VOT), the number of a
            webcam, or the address of a stream.
        frames: the stretch to read; by default all.
        frame_rate: frames a second, instead of what the source says.

    Raises:
        RequestError: there is no such thing, it cannot be read, it has no frame, its images differ in size, or
            the stretch lies beyond it.
    """
    opened = _opened(source, frames or FrameRange())
    return opened if frame_rate is None else replace(opened, frame_rate=frame_rate, rate_missing=False)


def _opened(source: str | Path, wanted: FrameRange) -> ImageFolder | VideoFile | LiveSource:
    text, path = str(source), Path(source)
    if path.is_dir():
        return ImageFolder.open(path, wanted)
    if path.is_file():
        return VideoFile.open(path, wanted)
    if text.isdecimal():
        return LiveSource.open(int(text), f"webcam {text}", wanted)
    if "://" in text:
        return LiveSource.open(text, text.split("?")[0], wanted)
    raise RequestError(f"expected a video file, a folder of images, a webcam number or an address, found no {text}")


def image_size(source: Source) -> Size | None:
    """Width and height of the images of a source, pixels; None where it does not tell them."""
    size: Size | None = getattr(source, "size", None)
    return size if size and min(size) > 0 else None


@dataclass(frozen=True)
class VideoFile:
    """A video file that OpenCV can decode."""

    path: Path
    name: str
    frame_rate: float
    promised: int
    frames_wanted: FrameRange
    live: bool = False
    length: int | None = None
    has_images: bool = True
    rate_missing: bool = False

    @classmethod
    def open(cls, path: Path, wanted: FrameRange) -> VideoFile:
        """The file at ``path``; raises RequestError where its first frame cannot be decoded."""
        with path.open("rb") as file:
            if file.read(16).startswith(PLAYLIST_HEADERS):
                raise RequestError(f"{path} is a playlist, which may lead anywhere; give the video itself")
        capture = cv2.VideoCapture(str(path))
        try:
            readable = capture.isOpened()
            rate = _stated_rate(capture)
            promised = int(max(0, capture.get(cv2.CAP_PROP_FRAME_COUNT))) if readable else 0
            if not readable or not capture.grab():
                found = "no frame in it" if readable else "something else"
                raise RequestError(f"{path}: expected a video that OpenCV can decode, found {found}")
        finally:
            capture.release()
        if promised and max(wanted.first, wanted.last or 0) >= promised + _slack(promised):
            wanted.within(promised)
        return cls(path, path.name, rate or DEFAULT_FRAME_RATE, promised, wanted, rate_missing=rate is None)

    @property
    def slack(self) -> float:
        """By how many frames the header of a sound file may be wrong."""
        return _slack(self.promised)

    def frames(self) -> Iterator[Frame]:
        """See `Source.frames`."""
        capture, sizes = cv2.VideoCapture(str(self.path)), CodedSizes(self.path)
        index, milliseconds, size = 0, 0.0, None
        try:
            while self.frames_wanted.last is None or index <= self.frames_wanted.last:
                if not capture.grab():
                    self._refuse_early_end(index, milliseconds / 1000)
                    return
                size = self._same_size(index, size, sizes.read())
                milliseconds = capture.get(cv2.CAP_PROP_POS_MSEC)
                if index >= self.frames_wanted.first:
                    yield Frame(index, index / self.frame_rate, _retrieve(capture, f"{self.path}: frame {index + 1}"))
                index += 1
        finally:
            capture.release()
            sizes.close()

    def _same_size(self, index: int, size: Size | None, stated: Size | None) -> Size | None:
        """The size of the pictures so far; raises RunError where a coded frame states another one."""
        if size is not None and stated is not None and stated != size:
            raise RunError(
                f"{self.path}: expected {size[0]}x{size[1]} pixels throughout, got {stated[0]}x{stated[1]} from about "
                f"frame {index + 1} on; cut the file there"
            )
        return stated or size

    def _refuse_early_end(self, frames: int, seconds: float) -> None:
        """Tell a truncated file from one whose header only estimates its length.

        Both the number of frames and the time of the last one have to fall short, since the first is an estimate where
        the frame rate varies.
        """
        wanted = self.frames_wanted
        if frames <= wanted.first or wanted.last is not None:
            raise RunError(f"{self.path}: expected frames {wanted}, but the video ends after frame {frames}")
        slack = self.slack
        if frames + slack < self.promised and seconds + slack / self.frame_rate < self.promised / self.frame_rate:
            raise RunError(
                f"{self.path}: expected {self.promised} frames, but the video breaks off after frame {frames}"
            )


@dataclass(frozen=True)
class LiveSource:
    """A webcam or a stream, which ends when the user says so."""

    address: int | str
    name: str
    frame_rate: float
    frames_wanted: FrameRange
    live: bool = True
    length: int | None = None
    has_images: bool = True
    rate_missing: bool = False

    @classmethod
    def open(cls, address: int | str, name: str, wanted: FrameRange) -> LiveSource:
        """The source at ``address``; raises RequestError where nothing answers."""
        capture = cv2.VideoCapture(address)
        try:
            if not capture.isOpened():
                raise RequestError(f"expected pictures from {name}, got none; is it connected, and free?")
            return cls(address, name, _stated_rate(capture) or DEFAULT_FRAME_RATE, wanted)
        finally:
            capture.release()

    def frames(self) -> Iterator[Frame]:
        """See `Source.frames`."""
        capture = cv2.VideoCapture(self.address)
        start, index = time.monotonic(), 0
        try:
            while self.frames_wanted.last is None or index <= self.frames_wanted.last:
                if not capture.grab():
                    if index == 0:
                        raise RunError(f"{self.name} stopped before the first frame")
                    return
                if index >= self.frames_wanted.first:
                    yield Frame(index, time.monotonic() - start, _retrieve(capture, f"{self.name}: frame {index + 1}"))
                index += 1
        finally:
            capture.release()


def _slack(promised: int) -> float:
    return max(3.0, 0.02 * promised)


def _stated_rate(capture: cv2.VideoCapture) -> float | None:
    rate = float(capture.get(cv2.CAP_PROP_FPS))
    return rate if math.isfinite(rate) and 0 < rate <= 1000 else None


def _retrieve(capture: cv2.VideoCapture, what: str) -> ImageArray:
    decoded, image = capture.retrieve()
    if not decoded:
        raise RunError(f"{what} cannot be decoded")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)
