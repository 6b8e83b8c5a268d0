"""The observations of a whole video, from disk as far as they are there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.frame_range import FrameRange
from tsuiseki.tracking.pipelines.observation_cache import cached_observations, files_key
from tsuiseki.tracking.pipelines.observations import Observation, Observers, observe
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.video import ImageFolder, open_source


def video_observations(
    source: str | Path,
    observers: Observers,
    key: Mapping[str, Any],
    cache: Path | None = None,
    frames: FrameRange | None = None,
    times: StageTimes | None = None,
    richer: Mapping[str, Any] | None = None,
) -> Iterator[Observation]:
    """What networks and images say of every frame.

    Args:
        source: a video that can be played again, see `open_source`.
        observers: what looks at the frames.
        key: plain values that say what the observers depend on.
        cache: folder that keeps observations; None keeps none.
        frames: the stretch to look at; by default all.
        times: gets the seconds of every stage.
        richer: what other observers depend on that say all that these say and more: what they have said, and the cache
            keeps, is taken instead.

    Raises:
        RequestError: the cache is asked for a video whose length nobody knows.
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
    more = None if richer is None else {**richer, **video}
    yield from cached_observations(cache, {**key, **video}, stretch.first, stretch.last, compute, more)
