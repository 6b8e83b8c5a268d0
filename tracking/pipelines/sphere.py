"""A ball in space through the videos of two or more calibrated cameras."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from tsuiseki.tracking.cameras.files import PlacedCamera, read_cameras
from tsuiseki.tracking.cameras.volume import common_volume
from tsuiseki.tracking.errors import InputWarning, RequestError, RunError
from tsuiseki.tracking.filters.base import Motion
from tsuiseki.tracking.filters.motion.motion_3d import Ballistic, ConstantVelocity, RandomWalk
from tsuiseki.tracking.likelihoods.background import median_background
from tsuiseki.tracking.likelihoods.printed_contour import PrintedContourLikelihood
from tsuiseki.tracking.likelihoods.views import BackgroundLikelihood, ContourLikelihood, ViewLikelihood
from tsuiseki.tracking.options import Shared
from tsuiseki.tracking.synchronise import align, default_tolerance, moments_with_images, read_timestamps
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.trackers.sphere.sphere import SphereTracker
from tsuiseki.tracking.trackers.sphere.sphere_run import Seen, SphereLog, Start, check_lengths, check_start, run_sphere
from tsuiseki.tracking.trackers.sphere.sphere_search import find_ball
from tsuiseki.tracking.types import FloatArray, Frame, Position
from tsuiseki.tracking.video import Source, open_source, read_image

PresetName = Literal["extended", "paper"]
MotionName = Literal["constant-velocity", "random-walk", "ballistic"]
LikelihoodName = Literal["contour", "background"]
BACKGROUND_FRAMES = 25


@dataclass(frozen=True)
class SphereSettings(Shared):
    """How a ball is followed; lengths in metres.

    Attributes:
        preset: extended, or paper: the filter as printed, with the plain sum over the contour (section 2.2.2) or the
            background difference (2.2.1), multiplied over the cameras, and particles weighed at once. It needs a start,
            never searches, and takes no camera for covered.
        spread: standard deviation of the start, metres.
        particles: how many; more are more exact and slower.
        motion: how the ball moves: with a velocity, by random steps as in the paper, or in free flight with bounces; by
            default constant-velocity, with the preset paper random-walk.
        agitation: how restless the motion is: change of velocity in one second, m/s (random walk: of position, m); by
            default 1.5 (random walk 0.15, ballistic 1).
        floor: height of the floor off which a ballistic ball bounces, metres.
        bounce: speed after a bounce over the speed before, 0 to 1.
        drag: of a ballistic ball by the air: deceleration over the speed squared, 1/m; a tennis ball's is about 0.02.
        spin: X,Y,Z of a ballistic ball: its acceleration is the cross product of this with the velocity, 1/s.
        likelihood: the ball's outline, or the difference from the background.
        tolerance: frames of different videos within so many seconds count as taken together; by default a quarter of
            the shortest time between frames.
    """

    preset: PresetName = "extended"
    spread: float = 0.05
    particles: int = 500
    motion: MotionName | None = None
    agitation: float | None = None
    floor: float = 0.0
    bounce: float = 0.75
    drag: float = 0.0
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    likelihood: LikelihoodName = "contour"
    tolerance: float | None = None

    def __post_init__(self) -> None:
        if not self.spread > 0:
            raise RequestError(f"`spread`: expected metres above 0, got {self.spread:g}")
        if self.particles < 10:
            raise RequestError(f"`particles`: expected at least 10, got {self.particles}")
        if self.agitation is not None and not self.agitation > 0:
            raise RequestError(f"`agitation`: expected a number above 0, got {self.agitation:g}")
        if not 0 <= self.bounce <= 1:
            raise RequestError(f"`bounce`: expected 0 to 1, got {self.bounce:g}")
        if not 0 <= self.drag < np.inf:
            raise RequestError(f"`drag`: expected a number from 0, got {self.drag:g}")


def track_sphere(
    sources: Sequence[str | Path],
    cameras: str | Path,
    radius: float,
    *,
    start: ArrayLike | None = None,
    volume: ArrayLike | None = None,
    settings: SphereSettings | None = None,
    seed: int = 0,
) -> list[Position]:
    """Where a ball of known radius is in space, at every moment.

    Args:
        sources: two or more videos or folders of images, in the order of the cameras.
        cameras: ``cameras.yaml`` with one entry per video; `tsuiseki calibrate points` writes it.
        radius: of the ball, metres.
        start: ``(3,)`` the ball in the first frame, metres; by default the volume is searched.
        volume: ``(2, 3)`` two corners of the box in which the ball is searched, metres; by default where two cameras
            can see it.
        settings: see `SphereSettings`.
        seed: of all random numbers.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: a video breaks off, or no two show the same moment.
    """
    chosen = sphere_run(sources, cameras, radius, start=start, volume=volume, settings=settings)
    return chosen.run(np.random.default_rng(seed), StageTimes(), lambda items: items).positions


@dataclass(frozen=True)
class SphereRun:
    """Everything that a run needs, checked.

    Attributes:
        sources: the videos.
        placed: their cameras.
        stamps: ``(T,)`` of each video, the time of every frame, seconds.
        tolerance: frames within so many seconds count as taken together.
        tracker: the filter.
        start: where the ball is looked for first.
    """

    sources: Sequence[Source]
    placed: Sequence[PlacedCamera]
    stamps: Sequence[FloatArray]
    tolerance: float
    tracker: SphereTracker
    start: Start

    def run(
        self, rng: np.random.Generator, times: StageTimes, watch: Callable[[Iterable[Seen]], Iterable[Seen]]
    ) -> SphereLog:
        """See `run_sphere`."""
        videos = [checked_frames(source, placed) for source, placed in zip(self.sources, self.placed, strict=True)]
        moments = align(list(self.stamps), self.tolerance)
        return run_sphere(self.tracker, self.start, moments_with_images(moments, videos), rng, times, watch)


def sphere_run(
    sources: Sequence[str | Path],
    cameras: str | Path,
    radius: float,
    *,
    start: ArrayLike | None = None,
    volume: ArrayLike | None = None,
    settings: SphereSettings | None = None,
    backgrounds: Sequence[Path] | None = None,
    offsets: Sequence[float] | None = None,
    timestamps: Sequence[Path] | None = None,
) -> SphereRun:
    """A run of `track_sphere`.

    Args:
        sources, cameras, radius, start, volume, settings: see `track_sphere`.
        backgrounds: one picture of the empty scene per video; by default the median of the video.
        offsets: time of each video's first frame, seconds; wins over the camera file.
        timestamps: one text file per video with the time of each frame.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
    """
    settings = settings or SphereSettings()
    if not 0 < radius < 10:
        raise RequestError(f"`radius`: expected metres above 0 (and below 10), got {radius:g}")
    placed = read_cameras(Path(cameras))
    if len(sources) != len(placed) or len(sources) < 2:
        raise RequestError(
            f"expected at least two videos and one camera for each, got {len(sources)} videos and {len(placed)} "
            f"cameras in {cameras}; give the videos in the order of its entries"
        )
    opened = [open_source(str(source)) for source in sources]
    stamps = frame_times(opened, placed, offsets, timestamps)
    pinholes = [p.camera for p in placed]
    box = common_volume(pinholes, radius) if volume is None else _box(volume)
    place = None if start is None else np.asarray(start, dtype=np.float64)
    if place is not None:
        if place.shape != (3,):
            raise RequestError(f"`start`: expected x, y, z in metres, got shape {place.shape}")
        check_start(place, placed)
    printed = settings.preset == "paper"
    if printed and place is None:
        raise RequestError("`start`: expected x, y, z with the preset paper, which measures where the ball is at first")
    weigh = chosen_likelihood(settings, placed, opened, radius, backgrounds)
    moves = chosen_motion(settings, radius)
    # The background difference is the paper's baseline, without what goes beyond the paper.
    plain = printed or settings.likelihood == "background"
    tracker = SphereTracker(weigh, moves, covering=None, stages=1) if plain else SphereTracker(weigh, moves)
    if printed:
        tracker = replace(tracker, patience=np.inf)
    broad = weigh.broad() if isinstance(weigh, ContourLikelihood) else weigh
    search = partial(find_ball, weigh, broad, pinholes, radius, box, settings.particles)
    begin = Start(place, settings.spread, settings.particles, search)
    tolerance = default_tolerance(stamps) if settings.tolerance is None else settings.tolerance
    return SphereRun(opened, placed, stamps, tolerance, tracker, begin)


def frame_times(
    sources: Sequence[Source],
    placed: Sequence[PlacedCamera],
    offsets: Sequence[float] | None = None,
    timestamps: Sequence[Path] | None = None,
) -> list[FloatArray]:
    """``(T,)`` the time of every frame of every video, seconds.

    Raises:
        RequestError: offsets, times and videos differ in number or length, or a source is live.
    """
    for name, given in (("`offsets`", offsets), ("`timestamps`", timestamps)):
        if given is not None and len(given) != len(sources):
            raise RequestError(f"{name}: expected {len(sources)} values, one a video, got {len(given)}")
    lengths = [frame_count(source) for source in sources]
    starts = [p.offset for p in placed] if offsets is None else offsets
    if timestamps is None:
        rates = [p.frame_rate or s.frame_rate for p, s in zip(placed, sources, strict=True)]
        stamps = [o + np.arange(n) / r for o, n, r in zip(starts, lengths, rates, strict=True)]
        if offsets is None and not any(p.offset for p in placed):
            check_lengths(stamps, [s.name for s in sources])
        return stamps
    stamps = [read_timestamps(path) for path in timestamps]
    for path, stamp, length in zip(timestamps, stamps, lengths, strict=True):
        if len(stamp) != length:
            raise RequestError(f"{path}: expected {length} times, one a frame, got {len(stamp)}")
    return [stamp + (0.0 if offsets is None else o) for stamp, o in zip(stamps, starts, strict=True)]


def frame_count(source: Source) -> int:
    """Number of frames; a video file is decoded once to count, for its header only estimates.

    Raises:
        RequestError: the source is live.
    """
    if source.live:
        raise RequestError(f"{source.name}: expected recorded videos, for several live cameras share no clock")
    if source.length is not None:
        return source.length
    count = 0
    try:
        for frame in source.frames():
            count = frame.index + 1
    except RunError as error:
        if not count:
            raise
        warnings.warn(f"{error}; it is used up to there", InputWarning, stacklevel=2)
    return count


def checked_frames(source: Source, placed: PlacedCamera) -> Iterator[Frame]:
    """The frames of ``source``, each of the size that its camera has.

    Raises:
        RequestError: one has another size.
    """
    camera = placed.camera
    for frame in source.frames():
        if frame.image.shape[:2] != (camera.height, camera.width):
            height, width = frame.image.shape[:2]
            raise RequestError(
                f"{source.name}: expected {camera.width}x{camera.height} pixels as in the camera file, "
                f"got {width}x{height}"
            )
        yield frame


def chosen_motion(settings: SphereSettings, radius: float) -> Motion:
    """The motion that the settings name."""
    agitation = settings.agitation
    motion = settings.motion or ("random-walk" if settings.preset == "paper" else "constant-velocity")
    if motion == "random-walk":
        return RandomWalk(0.15 if agitation is None else agitation)
    if motion == "ballistic":
        restless = 1.0 if agitation is None else agitation
        return Ballistic(
            radius, settings.floor, restitution=settings.bounce, agitation=restless, drag=settings.drag,
            spin=settings.spin,
        )  # fmt: skip
    return ConstantVelocity(1.5 if agitation is None else agitation)


def chosen_likelihood(
    settings: SphereSettings,
    placed: Sequence[PlacedCamera],
    sources: Sequence[Source],
    radius: float,
    backgrounds: Sequence[Path] | None = None,
) -> ViewLikelihood:
    """The likelihood that the settings name.

    Raises:
        RequestError: backgrounds are given and not used, or of another number than the videos.
    """
    cameras = [p.camera for p in placed]
    if settings.likelihood == "contour":
        if backgrounds is not None:
            raise RequestError("`backgrounds`: expected only with the likelihood background; the outline needs none")
        printed = settings.preset == "paper"
        return PrintedContourLikelihood(cameras, radius) if printed else ContourLikelihood(cameras, radius)
    if backgrounds is None:
        pictures = []
        for source in sources:
            step = max(1, frame_count(source) // BACKGROUND_FRAMES)
            pictures.append(median_background([f.image for f in source.frames() if f.index % step == 0]))
        return BackgroundLikelihood(cameras, pictures)
    if len(backgrounds) != len(cameras):
        raise RequestError(f"`backgrounds`: expected {len(cameras)} pictures, one a video, got {len(backgrounds)}")
    return BackgroundLikelihood(
        cameras, [read_image(path, (c.width, c.height)) for path, c in zip(backgrounds, cameras, strict=True)]
    )


def _box(volume: ArrayLike) -> FloatArray:
    given = np.asarray(volume, dtype=np.float64)
    corners = given.reshape(2, 3) if given.size == 6 else np.zeros((2, 3))
    low, high = corners.min(axis=0), corners.max(axis=0)
    if not (high > low).all():
        raise RequestError(f"`volume`: expected two corners that differ along x, y and z, got {given.tolist()}")
    return np.stack([low, high])
