"""Pictures of a video in any order, as JPEG.

A frame has the number that it has when the video is played from the start: a file is sought by the times of its
packets, which are listed first.
"""

from __future__ import annotations

import threading
from bisect import bisect_left, bisect_right
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.formats.track_tables import needed
from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.video.image_folder import ImageFolder
from tsuiseki.tracking.video.source import VideoFile, open_source

LARGEST, QUALITY = 1280, 82
"""Pixels of the longer side of a picture, and its quality from 0 to 100."""
MOST_BYTES, AHEAD = 64_000_000, 12
"""Bytes of pictures that are kept, and frames that are decoded before they are asked for."""


class _Reader(Protocol):
    length: int

    def image(self, frame: int) -> ImageArray: ...

    def close(self) -> None: ...


class Pictures:
    """JPEG pictures by frame, for any thread.

    Attributes:
        length: number of frames.
        size: width and height of a frame, pixels.

    Raises:
        RequestError: ``source`` has no pictures that can be played again, or PyAV is not installed.
    """

    def __init__(self, source: str | Path) -> None:
        opened = open_source(source)
        if not opened.has_images or not isinstance(opened, ImageFolder | VideoFile):
            raise RequestError(f"{opened.name} has no pictures that can be played again; give a `video` that has")
        self._reader: _Reader = _Images(opened) if isinstance(opened, ImageFolder) else _Film(opened.path)
        self._kept: OrderedDict[int, bytes] = OrderedDict()
        self._lock, self._asked, self._wanted = threading.Lock(), threading.Event(), 0
        self._closed = False
        self.length = self._reader.length
        height, width = self._reader.image(0).shape[:2]
        self.size = width, height
        threading.Thread(target=self._read_ahead, daemon=True).start()

    def jpeg(self, frame: int) -> bytes:
        """The picture of a frame.

        Raises:
            RunError: it cannot be decoded.
        """
        self._wanted = frame
        with self._lock:
            picture = self._picture(frame)
        self._asked.set()
        return picture

    def close(self) -> None:
        """End what reads ahead, and free the video."""
        self._closed = True
        self._asked.set()
        with self._lock:
            self._reader.close()

    def _picture(self, frame: int) -> bytes:
        if frame in self._kept:
            self._kept.move_to_end(frame)
            return self._kept[frame]
        image = self._reader.image(frame)
        if (scale := LARGEST / max(image.shape[:2])) < 1:
            image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        picture = bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1])
        self._kept[frame] = picture
        while sum(map(len, self._kept.values())) > MOST_BYTES:
            self._kept.popitem(last=False)
        return picture

    def _read_ahead(self) -> None:
        while not self._closed:
            self._asked.wait()
            self._asked.clear()
            start = self._wanted
            for frame in range(start + 1, min(start + 1 + AHEAD, self.length)):
                with self._lock:
                    if self._closed or self._wanted != start:
                        break
                    try:
                        self._picture(frame)
                    except RunError:
                        break  # whoever asks for the frame is told


class _Images:
    """One file a frame."""

    def __init__(self, folder: ImageFolder) -> None:
        self._files = folder.images
        self.length = len(self._files)

    def image(self, frame: int) -> ImageArray:
        found = cv2.imread(str(self._files[frame]))
        if found is None:
            raise RunError(f"{self._files[frame]}: expected an image, got something else")
        return np.asarray(found, np.uint8)

    def close(self) -> None:
        """Nothing is open."""


class _Film:
    """A video file, decoded from the key frame before what is asked for."""

    def __init__(self, path: Path) -> None:
        self._path, self._av = path, needed("av", "a video in `tsuiseki review`")
        self._open()
        packets = [
            packet for packet in self._container.demux(self._stream) if packet.size and not packet.is_discard
        ]
        self._stamps = sorted(packet.pts for packet in packets if packet.pts is not None)
        # A raw stream has no times; it is played from the start.
        self._keys = sorted(packet.pts for packet in packets if packet.is_keyframe and packet.pts is not None)
        self._sought = len(self._stamps) == len(packets) == len({*self._stamps})
        self.length = len(packets)
        self._reopen()

    def image(self, frame: int) -> ImageArray:
        key = bisect_right(self._keys, self._stamps[frame]) - 1 if self._sought else -1
        if not self._next <= frame or (key >= 0 and bisect_left(self._stamps, self._keys[key]) > self._next):
            self._start_at(key)
        while True:
            # Pictures before the first key frame that is found may be broken: an earlier one is taken then.
            for number, found in self._frames:
                self._next = number + 1
                if number >= frame:
                    break
            else:
                raise RunError(f"{self._path}: frame {frame + 1} cannot be decoded")
            if number == frame:
                return _upright(found)
            if key < 0:
                raise RunError(f"{self._path}: frame {frame + 1} cannot be decoded")
            key -= 1
            self._start_at(key)

    def close(self) -> None:
        self._container.close()

    def _open(self) -> None:
        self._container: Any = self._av.open(str(self._path))
        self._stream = self._container.streams.video[0]
        self._stream.thread_type = "AUTO"

    def _reopen(self) -> None:
        self._container.close()
        self._open()
        self._next, self._frames = 0, self._decoded()

    def _start_at(self, key: int) -> None:
        """Go to the key frame of this number, or to the start."""
        if key < 0:
            self._reopen()
            return
        self._container.seek(self._keys[key], stream=self._stream)
        self._next, self._frames = 0, self._decoded()

    def _decoded(self) -> Iterator[tuple[int, Any]]:
        """Frames from here on, with their numbers."""
        try:
            for count, frame in enumerate(self._container.decode(self._stream)):
                yield (bisect_left(self._stamps, frame.pts) if self._sought else count), frame
        except self._av.FFmpegError:
            return


def _upright(frame: Any) -> ImageArray:
    """BGR, turned as a player turns it."""
    image = frame.to_ndarray(format="bgr24")
    return np.ascontiguousarray(np.rot90(image, getattr(frame, "rotation", 0) // 90))
