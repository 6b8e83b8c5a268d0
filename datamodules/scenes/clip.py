"""What generated clips of people have in common: checks of their settings, images on disk, labels of all frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Protocol, TypeVar

import cv2
import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray
from tsuiseki.tracking.types.labels import GroundTruth

QUALITY = 92
"""Of JPEG images, where a clip has no setting for it."""


class ClipSettings(Protocol):
    """Settings of any clip: width and height in pixels, number of frames, frames per second."""

    @property
    def width(self) -> int: ...

    @property
    def height(self) -> int: ...

    @property
    def frames(self) -> int: ...

    @property
    def frame_rate(self) -> float: ...


class PhotographedSettings(ClipSettings, Protocol):
    """Settings of a clip whose images are ray-traced and degraded like a camera's; units as in `StreetSettings`."""

    @property
    def people(self) -> int: ...

    @property
    def noise(self) -> float: ...

    @property
    def blur(self) -> float: ...

    @property
    def jpeg(self) -> int: ...

    @property
    def samples(self) -> int: ...


class FrameLabels(Protocol):
    """Labels of one frame: ids ``(N,)``, boxes ``(N, 4)`` in pixels, visible shares ``(N,)`` in [0, 1]."""

    @property
    def ids(self) -> IntArray: ...

    @property
    def boxes(self) -> FloatArray: ...

    @property
    def visibility(self) -> FloatArray: ...


Truth = TypeVar("Truth")
Expectation = tuple[bool, str, object]
"""Whether a setting can be used, what is expected of it, and what was given."""


def check_settings(kind: str, settings: PhotographedSettings, smallest: int, own: Iterable[Expectation]) -> None:
    """Refuse settings that no clip can be made with.

    Args:
        kind: of clip, as the message calls it.
        settings: of the clip.
        smallest: least width and height, pixels.
        own: what this kind of clip expects besides.

    Raises:
        RequestError: something expected does not hold.
    """
    size, rate = (settings.width, settings.height), settings.frame_rate
    common: tuple[Expectation, ...] = (
        (min(size) >= smallest, f"at least {smallest}x{smallest} pixels", f"{size[0]}x{size[1]}"),
        (settings.frames >= 1, "at least one frame", settings.frames),
        (bool(np.isfinite(rate)) and rate > 0, "a positive frame_rate", rate),
        (settings.people >= 1, "at least one person", settings.people),
        (min(settings.noise, settings.blur) >= 0, "no negative noise or blur", (settings.noise, settings.blur)),
        (1 <= settings.jpeg <= 100, "jpeg from 1 to 100", settings.jpeg),
        (1 <= settings.samples <= 8, "samples from 1 to 8", settings.samples),
    )
    for holds, what, got in (*common, *own):
        if not holds:
            raise RequestError(f"{kind} clip: expected {what}, got {got}")


def numbered(frame: int) -> str:
    """The name of an image in MOTChallenge's layout: the 0-based ``frame`` 0 is ``000001.jpg``."""
    return f"{frame + 1:06d}.jpg"


def write_image(path: Path, image: ImageArray, quality: int = QUALITY) -> None:
    """Write ``(H, W, 3)`` uint8 RGB as JPEG of ``quality`` 1 to 100."""
    # imwrite says nothing of a full disk.
    data = cv2.imencode(".jpg", image[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    path.write_bytes(data.tobytes())


def write_images(
    folder: Path,
    frames: Iterable[tuple[ImageArray, Truth]],
    quality: int = QUALITY,
    name: Callable[[int], str] = numbered,
) -> list[Truth]:
    """Write the image of each frame into ``folder``, and give back what the frames show.

    Args:
        folder: made here.
        frames: in order, each an image ``(H, W, 3)`` uint8 RGB and its truth.
        quality: of the JPEG, 1 to 100.
        name: of the file of a 0-based frame.
    """
    folder.mkdir(parents=True)
    truths = []
    for index, (image, truth) in enumerate(frames):
        write_image(folder / name(index), image, quality)
        truths.append(truth)
    return truths


def write_info(folder: Path, name: str, settings: ClipSettings) -> None:
    """Write ``seqinfo.ini`` of the sequence ``name``."""
    write_sequence_info(folder, name, settings.frame_rate, settings.frames, settings.width, settings.height)


def ground_truth(frames: Sequence[FrameLabels]) -> GroundTruth:
    """The labels of all frames of a clip. Every row is evaluated, and ids stay as they are."""
    ids = np.concatenate([labels.ids for labels in frames]).astype(np.int64)
    everyone = np.ones(len(ids), dtype=np.bool_)
    return GroundTruth(
        frames=np.repeat(np.arange(len(frames), dtype=np.int64), [len(labels.ids) for labels in frames]),
        ids=ids,
        boxes=np.concatenate([labels.boxes for labels in frames]),
        evaluated=everyone,
        ignored=~everyone,
        visibility=np.concatenate([labels.visibility for labels in frames]),
    )
