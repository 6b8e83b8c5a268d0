"""The observations of every frame of a video.

With a cache folder, observations of an earlier run are read from disk. Only the missing ones are computed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tsuiseki.tracking.drone.observation_cache import cached_observations, files_key
from tsuiseki.tracking.drone.observations import Observation, Observers, observe
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.image_folder import ImageFolder
from tsuiseki.tracking.video.source import open_source


def video_observations(
    source: str | Path,
    observers: Observers,
    key: Mapping[str, Any],
    cache: Path | None = None,
    frames: FrameRange | None = None,
    times: StageTimes | None = None,
    superset_key: Mapping[str, Any] | None = None,
) -> Iterator[Observation]:
    """Observations of every frame, in order: detections, appearance features, action probabilities, camera motion.

    Args:
        source: a video that can be played again, see `open_source`.
        observers: the detector, the networks and the estimate of the camera motion.
        key: plain values that identify the observers: models and settings.
        cache: folder of the stored observations; None stores nothing.
        frames: the range to process; by default all frames.
        times: gets the seconds of every stage.
        superset_key: key of other observers whose observations include all that these give. Where the cache holds
            theirs and not these, theirs are read.

    Raises:
        RequestError: there is a cache, but the length of the video is not known.
    """
    opened = open_source(source, frames)
    if cache is None:
        yield from observe(opened.frames(), observers, times)
        return
    if opened.length is None:
        raise RequestError("`cache`: expected a video of known length, such as a folder of images; leave `cache` out")
    stretch = opened.frames_wanted.within(opened.length)
    assert stretch.last is not None
    files = opened.images if isinstance(opened, ImageFolder) else (Path(source),)

    def compute(first: int, last: int) -> Iterator[Observation]:
        # The frames before the first one are history for the optical flow.
        start = max(first - observers.history, stretch.first)
        part = open_source(source, FrameRange(start, last))
        yield from observe(part.frames(), observers, times, first)

    video = {"video": files_key(files), "start": stretch.first}
    superset = None if superset_key is None else {**superset_key, **video}
    yield from cached_observations(cache, {**key, **video}, stretch.first, stretch.last, compute, superset)
