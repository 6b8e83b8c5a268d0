"""Frames of a video file from any number on: packets tell where they lie, and one is decoded from a key frame on.

A file's own counting is not relied on: every frame is known by its time, which its packet has, too. What is decoded is
the same as if the whole file were, or it is refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.types import FloatArray, Frame
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.coded_size import CodedFrames
from tsuiseki.tracking.video.image_folder import ImageFolder
from tsuiseki.tracking.video.source import VideoFile, retrieved

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
