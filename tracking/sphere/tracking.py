"""A ball in space through the videos of two or more calibrated cameras."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from tsuiseki.tracking.cameras.camera_files import PlacedCamera, read_projective_cameras
from tsuiseki.tracking.cameras.volume import check_volume, common_volume
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.result import StageTimes
from tsuiseki.tracking.sphere.background import median_background
from tsuiseki.tracking.sphere.printed_contour import PrintedContourLikelihood
from tsuiseki.tracking.sphere.runs import FrameTimes, SphereRun, frame_count
from tsuiseki.tracking.sphere.settings import SphereSettings, chosen_motion
from tsuiseki.tracking.sphere.sphere_run import Seen, Start, check_start
from tsuiseki.tracking.sphere.sphere_search import find_ball
from tsuiseki.tracking.sphere.tracker import SphereTracker
from tsuiseki.tracking.sphere.views import BackgroundLikelihood, ContourLikelihood, ViewLikelihood
from tsuiseki.tracking.types import FloatArray, Frame, Position
from tsuiseki.tracking.video.image_folder import read_image
from tsuiseki.tracking.video.source import Source, open_source
from tsuiseki.tracking.video.synchronise import LatestFrames, Moment, moments_with_images

BACKGROUND_FRAMES = 25


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
    if chosen.length is None:
        raise RequestError("live cameras do not end by themselves; use follow_sphere")
    return chosen.run(np.random.default_rng(seed), StageTimes(), lambda items: items).positions


def follow_sphere(
    sources: Sequence[str | Path | int],
    cameras: str | Path,
    radius: float,
    *,
    start: ArrayLike | None = None,
    volume: ArrayLike | None = None,
    settings: SphereSettings | None = None,
    seed: int = 0,
) -> Iterator[Position]:
    """Where a ball is, while the videos come; see `track_sphere`.

    Sources may be live: numbers of webcams or addresses of streams. Their newest frames are paired by the time at which
    they came, counted from the first; a camera that stalls is left out until it delivers again.
    """
    chosen = sphere_run(sources, cameras, radius, start=start, volume=volume, settings=settings)
    return chosen.follow(np.random.default_rng(seed))


def sphere_run(
    sources: Sequence[str | Path | int],
    cameras: str | Path,
    radius: float,
    *,
    start: ArrayLike | None = None,
    volume: ArrayLike | None = None,
    settings: SphereSettings | None = None,
    backgrounds: Sequence[Path] | None = None,
    times: FrameTimes | None = None,
) -> SphereRun:
    """A run of `track_sphere`.

    Args:
        sources, cameras, radius, start, volume, settings: see `track_sphere`; all sources may be live.
        backgrounds: one picture of the empty scene per video; by default the median of the video.
        times: of the frames; by default as the camera file says.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
    """
    settings = settings or SphereSettings()
    if not 0 < radius < 10:
        raise RequestError(f"`radius`: expected metres above 0 (and below 10), got {radius:g}")
    placed = read_projective_cameras(Path(cameras))
    if len(sources) != len(placed) or len(sources) < 2:
        raise RequestError(
            f"expected at least two videos and one camera for each, got {len(sources)} videos and {len(placed)} "
            f"cameras in {cameras}; give the videos in the order of its entries"
        )
    opened = [open_source(str(source)) for source in sources]
    live = all(source.live for source in opened)
    if live and times is not None and (times.offsets or times.timestamps):
        raise RequestError("`offsets` and `timestamps`: expected only with recorded videos; live frames have their own")
    if live and settings.likelihood == "background" and backgrounds is None:
        raise RequestError("`backgrounds`: expected pictures of the empty scene with live cameras, got none")
    stamps = [] if live else (times or FrameTimes()).of_videos(opened, placed)
    pinholes = [p.camera for p in placed]
    box = common_volume(pinholes, radius) if volume is None else _box(volume)
    place = None if start is None else np.asarray(start, dtype=np.float64)
    if place is None:
        check_volume(box, pinholes, radius)
    else:
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

    def seen(moments: Sequence[Moment]) -> Iterator[Seen]:
        if live:
            frames = [partial(checked_frames, source, camera) for source, camera in zip(opened, placed, strict=True)]
            return LatestFrames(frames, live_tolerance(opened, settings.tolerance)).moments()
        videos = [checked_frames(source, camera) for source, camera in zip(opened, placed, strict=True)]
        return moments_with_images(moments, videos)

    return SphereRun(placed, stamps, settings.tolerance, tracker, begin, seen, opened)


def live_tolerance(sources: Sequence[Source], wanted: float | None) -> float:
    """Seconds within which live frames count as taken together: by default half the shortest time between frames.

    Cameras of one rate then have a frame each in every moment but the first, whatever their phases.
    """
    return 0.5 / max(source.frame_rate for source in sources) if wanted is None else wanted


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
        if printed:
            return PrintedContourLikelihood(cameras, radius)
        return ContourLikelihood(cameras, radius, faint=settings.faint)
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
