"""The videos of a camera, watched once before the rounds: some of their pictures, and the view without people."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.datamodules.augmentation import Example
from tsuiseki.datamodules.composition import empty_view
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.openers.images import decoded_image
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.openers.text import refusing
from tsuiseki.tracking.output import whole_file
from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.image_folder import read_image
from tsuiseki.tracking.video.source import Source, open_source
from tsuiseki.trainers.adapt.foreground import CameraMotion, Difference, difference, edge_correlation, motion_of
from tsuiseki.trainers.adapt.settings import AdaptSettings

# Share of each video, its end, that nothing is learnt from and that says which round is best.
HELD_OUT = 0.15
# Share before it that no weight is learnt from and that says what scores mean.
CALIBRATED = 0.1
# Share of each video that no weight is learnt from.
KEPT_BACK = HELD_OUT + CALIBRATED

# Of a video to learn a camera from.
FEWEST_FRAMES = 100
# Of the kept JPEG images, in [0, 100].
_QUALITY = 95
# Name of the file that describes the kept pictures.
_INFO = "watched.json"
# Pictures that tell whether the camera moves, evenly spread over the video.
_COMPARED = 9
# Correlation of the edges of two empty views: over 0.7 for one camera, under 0.1 for two.
_SAME_VIEW = 0.3
# Grey level of what is as in the empty view, in a kept picture of what differs from it.
_SAME = 0
# Grey level of what differs as a shadow does.
_SHADOW = 1
# Grey level of what differs otherwise.
_BRIGHT = 2


@dataclass(frozen=True)
class Watched:
    """One video and the pictures kept of it.

    Attributes:
        source: where the video is.
        span: first and last frame to read, 0-based; last None for the end.
        folder: with the pictures as ``img1/000001.jpg …`` and ``seqinfo.ini``.
        frames: 0-based frame of each kept picture.
        length: frames read.
        frame_rate: frames a second.
        size: width and height, pixels.
        motion: of the camera.
        turned: 0-based frame at which a camera that stands still otherwise has turned; None where it has not.
        fps: frames a second that were given; None for what the source says.
        empty: ``(H, W, 3)`` uint8 RGB, the view without people; None where the camera moves.
    """

    source: str
    span: tuple[int, int | None]
    folder: str
    frames: tuple[int, ...]
    length: int
    frame_rate: float
    size: tuple[int, int]
    motion: CameraMotion
    turned: int | None = None
    fps: float | None = None
    empty: ImageArray | None = field(default=None, compare=False, repr=False)

    @property
    def fixed(self) -> bool:
        """Whether the camera stands still, as far as is known."""
        return self.motion == "still"

    def open(self) -> Source:
        """The video, to be read again."""
        return open_source(self.source, FrameRange(*self.span), self.fps)

    def picture(self, number: int) -> ImageArray:
        """The kept picture ``number``, 0-based, ``(H, W, 3)`` uint8 RGB."""
        return read_image(Path(self.folder) / "img1" / f"{number + 1:06d}.jpg")

    def difference(self, number: int) -> Difference | None:
        """What of the kept picture ``number`` is not the empty view, found once; None where there is no such view."""
        if self.empty is None:
            return None
        file = Path(self.folder) / "foreground" / f"{number + 1:06d}.png"
        levels = decoded_image(file, cv2.IMREAD_GRAYSCALE) if file.is_file() else None
        if levels is None:
            different, bright = difference(self.picture(number), self.empty)
            levels = np.where(bright, _BRIGHT, np.where(different, _SHADOW, _SAME)).astype(np.uint8)
            _, content = cv2.imencode(".png", levels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
            # Whole or not at all: a run that is stopped must not leave half a picture.
            with whole_file(file) as picture:
                picture.write(content.tobytes())
        return Difference(np.asarray(levels != _SAME), np.asarray(levels == _BRIGHT))

    def learnt(self, held_out: float) -> int:
        """How many of the kept pictures, from the first on, may be learnt from."""
        last = self.span[0] + (1 - held_out) * self.length
        return max(1, int(np.searchsorted(self.frames, last)))

    @property
    def held_out(self) -> range:
        """Frames of the end that teaches nothing."""
        first = self.span[0]
        return range(first + round((1 - HELD_OUT) * self.length), first + self.length)


def open_camera(sources: Sequence[str], span: FrameRange, work: Path, settings: AdaptSettings) -> tuple[Watched, ...]:
    """Read the videos of a camera once, and keep pictures of them.

    Args:
        sources: see `open_source`.
        span: frames of each to read.
        work: folder for the pictures.
        settings: how many.

    Raises:
        RequestError: see `watch`; or the videos are of two cameras.
        RunError: a video breaks off.
    """
    share = max(20, settings.pictures // len(sources))
    videos = [watch(source, span, work / f"video-{n}", share, settings.fps) for n, source in enumerate(sources)]
    refuse_other_sizes(videos)
    videos = [with_empty_view(video) if video.fixed else video for video in videos]
    refuse_two_cameras(videos)
    return tuple(videos)


def watch(source: str, span: FrameRange, folder: Path, frames_at_most: int, fps: float | None = None) -> Watched:
    """Keep up to ``most`` pictures of a video, evenly spread; what an earlier call finished is taken as it is.

    Args:
        source: see `open_source`.
        span: frames to read.
        folder: for the pictures.
        frames_at_most: pictures.
        fps: frames a second, where the source does not say or is wrong.

    Raises:
        RequestError: the source is live or text only, or has fewer than `FEWEST_FRAMES` frames.
        RunError: the video breaks off.
    """
    if (folder / _INFO).is_file():
        return _read(folder)
    opened = open_source(source, span, fps)
    if opened.live:
        raise RequestError(f"expected a video that can be played again, got {opened.name}; record it first")
    if not opened.has_images:
        raise RequestError(f"{opened.name} has no images to learn from; expected them in its folder img1/")
    numbers, length, size = _keep(opened, folder / "img1", frames_at_most)
    if length < FEWEST_FRAMES:
        raise RequestError(
            f"{opened.name}: expected at least {FEWEST_FRAMES} frames to learn a camera from, got {length}; "
            "give a longer video"
        )
    write_sequence_info(folder, folder.name, opened.frame_rate, len(numbers), *size)
    compared = _spread(len(numbers), _COMPARED)
    motion, turned = motion_of([read_image(folder / "img1" / f"{n + 1:06d}.jpg") for n in compared])
    last = None if span.last is None else int(span.last)
    watched = Watched(
        source,
        (span.first, last),
        str(folder),
        tuple(numbers),
        length,
        opened.frame_rate,
        size,
        motion,
        None if turned is None else numbers[compared[turned]],
        fps,
    )
    with whole_file(folder / _INFO) as file:
        file.write(json.dumps(asdict(watched)).encode())
    return watched


def _read(folder: Path) -> Watched:
    path = folder / _INFO
    facts = read_json(path, "what tsuiseki adapt watched")
    with refusing(f"{path}: expected what tsuiseki adapt watched, got something else"):
        lists = {name: tuple(facts[name]) for name in ("span", "frames", "size")}
        return Watched(**{**facts, **lists})


def _keep(opened: Source, folder: Path, frames_at_most: int) -> tuple[list[int], int, tuple[int, int]]:
    """Frames kept, frames read, and their width and height; every second is dropped whenever there are too many."""
    folder.mkdir(parents=True, exist_ok=True)
    encoded: dict[int, bytes] = {}
    step, count, size = 1, 0, (0, 0)
    for frame in opened.frames():
        if count % step == 0:
            done, data = cv2.imencode(".jpg", frame.image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
            assert done
            encoded[frame.index] = data.tobytes()
            size = (frame.image.shape[1], frame.image.shape[0])
        count += 1
        if len(encoded) >= 2 * frames_at_most:
            step *= 2
            encoded = dict(list(encoded.items())[::2])
    numbers = [list(encoded)[n] for n in _spread(len(encoded), frames_at_most)]
    for number, frame_number in enumerate(numbers):
        (folder / f"{number + 1:06d}.jpg").write_bytes(encoded[frame_number])
    return numbers, count, size


def _spread(count: int, limit: int) -> list[int]:
    """Up to ``most`` of ``count`` numbers, evenly spread, both ends included."""
    return np.unique(np.linspace(0, count - 1, min(limit, count)).round().astype(int)).tolist() if count else []


def with_empty_view(watched: Watched, frames_at_most: int = 45) -> Watched:
    """The video with its view without people: the median of each pixel over up to so many of its kept pictures."""
    none = np.empty((0, 4)), np.empty(0, dtype=np.bool_)
    examples = [Example(watched.picture(n), *none) for n in _spread(len(watched.frames), frames_at_most)]
    return replace(watched, empty=empty_view(examples, frames_at_most).image)


def refuse_other_sizes(videos: Sequence[Watched]) -> None:
    """Refuse videos of different sizes, or of which some move and some stand still.

    Raises:
        RequestError: two differ.
    """
    for video in videos[1:]:
        if video.size != videos[0].size:
            (w, h), (a, b) = video.size, videos[0].size
            raise RequestError(
                f"expected videos of one camera, got {a}x{b} pixels in {videos[0].source} and {w}x{h} in "
                f"{video.source}; adapt to one camera at a time"
            )
        if video.fixed != videos[0].fixed and "unknown" not in (video.motion, videos[0].motion):
            still, moving = (videos[0], video) if videos[0].fixed else (video, videos[0])
            raise RequestError(
                f"expected videos of one camera, but it stands still in {still.source} and moves in {moving.source}; "
                "adapt to one camera at a time"
            )


def refuse_two_cameras(videos: Sequence[Watched]) -> None:
    """Refuse videos of different cameras.

    Raises:
        RequestError: two empty views do not show the same place.
    """
    views = [(video.source, video.empty) for video in videos if video.empty is not None]
    for source, view in views[1:]:
        if edge_correlation(views[0][1], view) < _SAME_VIEW:
            raise RequestError(
                f"expected videos of one camera, but {views[0][0]} and {source} show different places; "
                "adapt to one camera at a time"
            )
