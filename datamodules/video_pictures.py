"""Frames of a video file as pictures, decoded when they are asked for. Nothing is written."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.formats.mot_sequence import image_size
from tsuiseki.tracking.types import Frame, ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.image_folder import read_image as decoded
from tsuiseki.tracking.video.source import SeekableVideo, UnfitIndexError, VideoFile, open_source

# What a process before the fork was decoding. To close it here would wait for threads that only that process has.
_OF_PARENT: list[Iterator[Frame]] = []
# Frames that are decoded to come from one picture to a later one; farther on the file is entered anew.
AHEAD = 32


class OpenVideo:
    """Some frames of a video file. Rising numbers are decoded once; others enter the file where packets allow it.

    Args:
        file: to decode.
        frames: of the file, which is as long at least.

    Attributes:
        size: width and height, pixels.
        seekable: whether any frame can be read without all those before it.

    Raises:
        RequestError: the file is none that can be decoded, or is shorter.
    """

    def __init__(self, file: Path, frames: FrameRange) -> None:
        self.file, self.frames = file, frames
        video = open_source(file, frames)
        if not isinstance(video, VideoFile) or video.size is None:
            raise RequestError(f"{file}: expected a video file, got {type(video).__name__}")
        self._video, self.size = video, video.size
        self._places = SeekableVideo.of(video)
        if self._places is not None and len(self._places.times) <= (frames.last or 0):
            raise RequestError(
                f"{file}: expected {(frames.last or 0) + 1} frames as its labels say, got {len(self._places.times)}"
            )
        self._begin()

    @property
    def seekable(self) -> bool:
        return self._places is not None

    def _begin(self) -> None:
        self._running: Iterator[Frame] = iter(())
        self._next, self._process = -1, os.getpid()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_running": iter(()), "_next": -1}

    def read(self, number: int) -> ImageArray:
        """``(H, W, 3)`` uint8 RGB of the frame ``number`` of the file, from 0.

        Raises:
            RunError: it cannot be decoded.
        """
        if self._process != os.getpid():
            # A process that was forked shares the place in the file with its parent.
            _OF_PARENT.append(self._running)
            self._begin()
        if self._next < 0 or not self._next <= number < self._next + (AHEAD if self.seekable else number + 1):
            self._enter(number)
        try:
            return self._following(number)
        except UnfitIndexError:
            self._places = None
            self._enter(number)
            return self._following(number)

    def _enter(self, number: int) -> None:
        self._begin()
        last = number if self.frames.last is None else self.frames.last
        if self._places is not None:
            self._running, self._next = self._places.frames(number, last), number
        else:
            self._running, self._next = self._video.frames(), self.frames.first

    def _following(self, number: int) -> ImageArray:
        for frame in self._running:
            self._next = frame.index + 1
            if frame.index == number:
                return frame.image
        raise RunError(f"{self.file}: expected frame {number + 1}, but the video ends before it")


@dataclass(frozen=True)
class VideoPicture:
    """A frame of a video file in the place of an image file.

    Attributes:
        video: which is open.
        number: of the frame in the file, from 0.
    """

    video: OpenVideo
    number: int

    def __str__(self) -> str:
        return f"{self.video.file}, frame {self.number + 1}"


# An image file, or a frame of a video file.
Picture: TypeAlias = Path | VideoPicture


def read_image(picture: Picture) -> ImageArray:
    """``(H, W, 3)`` uint8 RGB.

    Raises:
        RequestError: the file is no image, or the frame cannot be decoded.
    """
    try:
        return picture.video.read(picture.number) if isinstance(picture, VideoPicture) else decoded(picture)
    except RunError as error:
        raise RequestError(f"{error}; replace or remove it") from error


def picture_size(picture: Picture) -> tuple[int, int]:
    """Width and height, pixels; raises RequestError where a file is no image."""
    return picture.video.size if isinstance(picture, VideoPicture) else image_size(picture)
