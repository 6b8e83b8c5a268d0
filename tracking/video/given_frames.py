"""A video as images that the user has already: in a list, an array, or as they come."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.types import Frame, ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.frame_times import NotedTimes, TimedBy
from tsuiseki.tracking.video.image_folder import DEFAULT_FRAME_RATE


@dataclass(frozen=True)
class GivenFrames:
    """Images ``(H, W, 3)`` uint8 RGB, or `Frame` with times; see `Source`.

    A sequence and an array ``(T, H, W, 3)`` can be played again. What comes one by one is ``live``, and ``ends``.
    """

    given: Iterable[ImageArray | Frame]
    frames_wanted: FrameRange
    frame_rate: float = DEFAULT_FRAME_RATE
    live: bool = False
    length: int | None = None
    name: str = "images"
    address: str = ""
    ends: bool = True
    has_images: bool = True
    rate_missing: bool = False
    timed_by: TimedBy = "frame rate"
    times: NotedTimes = field(default_factory=NotedTimes, compare=False)

    @classmethod
    def open(cls, given: Iterable[Any], wanted: FrameRange) -> GivenFrames:
        """The images; raises RequestError where the first of several is none, or they are fewer than is wanted."""
        if not isinstance(given, Sequence | np.ndarray):
            return cls(given, wanted, live=True)
        if len(given) == 0:
            raise RequestError("expected images, got none")
        _image(given[0], 0)
        return cls(given, wanted.within(len(given)), length=len(given))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height; 0 where they are not known yet."""
        if not isinstance(self.given, Sequence | np.ndarray):
            return 0, 0
        height, width = _image(self.given[0], 0).shape[:2]
        return width, height

    def frames(self) -> Iterator[Frame]:
        """See `Source.frames`."""
        size: tuple[int, ...] | None = None
        for index, item in enumerate(self.given):
            if self.frames_wanted.last is not None and index > self.frames_wanted.last:
                return
            image = _image(item, index)
            size = size or image.shape
            if image.shape != size:
                raise RunError(f"expected images of {size[1]}x{size[0]} throughout, got another size in image {index}")
            time = item.time if isinstance(item, Frame) else index / self.frame_rate
            if index in self.frames_wanted:
                yield self.times.note(Frame(index, time, image))


def _image(item: Any, index: int) -> ImageArray:
    """The image; raises RequestError where it is none."""
    image = item.image if isinstance(item, Frame) else item
    if isinstance(image, np.ndarray) and image.ndim == 3 and image.shape[2] == 3 and image.dtype == np.uint8:
        return image
    shown = f"shape {image.shape} {image.dtype}" if isinstance(image, np.ndarray) else type(image).__name__
    raise RequestError(f"expected a video file, or images (H, W, 3) uint8 RGB; image {index} is of {shown}")
