"""The videos of one camera, watched once before the rounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.trainers.adapt.foreground import Foreground, foreground_of
from tsuiseki.trainers.adapt.settings import AdaptSettings
from tsuiseki.trainers.adapt.watch import Watched, refuse_other_sizes, refuse_two_cameras, watch


@dataclass(frozen=True)
class Camera:
    """The videos of a camera and how to look at them.

    Attributes:
        videos: at least one.
        foregrounds: what is not the empty view of each; None where the camera moves.
        view: tiles of a frame, see `parse_view`.
    """

    videos: tuple[Watched, ...]
    foregrounds: tuple[Foreground | None, ...]
    view: str = "auto"

    @property
    def fixed(self) -> bool:
        """Whether the camera stands still in every video."""
        return all(foreground is not None for foreground in self.foregrounds)


def open_camera(
    sources: Sequence[str], stretch: FrameRange, work: Path, settings: AdaptSettings, view: str = "auto"
) -> Camera:
    """Read the videos of a camera once, and keep pictures of them.

    Args:
        sources: see `open_source`.
        stretch: frames of each to look at.
        work: folder for the pictures.
        settings: how many.
        view: tiles of a frame.

    Raises:
        RequestError: see `watch`; or the videos are of two cameras.
        RunError: a video breaks off.
    """
    share = max(20, settings.pictures // len(sources))
    videos = [watch(source, stretch, work / f"video-{n}", share) for n, source in enumerate(sources)]
    refuse_other_sizes(videos)
    foregrounds = [foreground_of(video) if video.fixed else None for video in videos]
    fixed = [foreground for foreground in foregrounds if foreground is not None]
    if len(fixed) > 1:
        refuse_two_cameras([each.watched for each in fixed], [each.empty for each in fixed])
    return Camera(tuple(videos), tuple(foregrounds), view)
