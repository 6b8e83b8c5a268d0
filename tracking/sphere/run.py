"""A ball in space through the videos of two or more calibrated cameras: in one call, and by `tsuiseki track sphere`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import PositiveFloat

from tsuiseki.tracking.bounds import as_settings
from tsuiseki.tracking.cameras.camera_files import PlacedCamera
from tsuiseki.tracking.cameras.volume import check_volume, common_volume, in_view
from tsuiseki.tracking.errors import RequestError, a_path
from tsuiseki.tracking.fields import Commas
from tsuiseki.tracking.formats.world_tables import read_path3d
from tsuiseki.tracking.report.overlay import write_drawn
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.runs.following import Drawing
from tsuiseki.tracking.runs.options import SeededOutput
from tsuiseki.tracking.runs.progress import progress
from tsuiseki.tracking.runs.run import Run
from tsuiseki.tracking.sphere.page import distances_to_truth, sphere_painter, sphere_result
from tsuiseki.tracking.sphere.points import sphere_points_run
from tsuiseki.tracking.sphere.search import find_ball
from tsuiseki.tracking.sphere.settings import (
    FrameTimes,
    SphereSettings,
    as_place,
    cameras_of,
    chosen_motion,
    frame_times,
)
from tsuiseki.tracking.sphere.tracker import MomentViews, SphereLog, SphereRun, SphereTracker
from tsuiseki.tracking.sphere.views import (
    BackgroundLikelihood,
    PrintedContourLikelihood,
    SphereContourLikelihood,
    ViewLikelihood,
    median_background,
)
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import FloatArray, Position
from tsuiseki.tracking.types.tracks import Path3D
from tsuiseki.tracking.video.image_folder import read_image
from tsuiseki.tracking.video.source import Source, SourceLike, frames_of_size, named, open_source
from tsuiseki.tracking.video.synchronise import LatestFrames, Moment, moments_with_images

# Frames of a video whose median is its background.
BACKGROUND_FRAMES = 25


SPHERE = SphereSettings()
TIMES = FrameTimes()


def track_sphere(
    sources: Sequence[SourceLike],
    cameras: str | Path,
    radius: float,
    *,
    start: ArrayLike | None = None,
    volume: ArrayLike | None = None,
    settings: SphereSettings = SPHERE,
    backgrounds: Sequence[str | Path] | None = None,
    times: FrameTimes = TIMES,
    seed: int = 0,
) -> Result[Position]:
    """Where a ball of known radius is in space, at every moment.

    Args:
        sources: two or more videos, folders or lists of images, in the order of the cameras.
        cameras: ``cameras.yaml`` with one entry per video; `tsuiseki calibrate points` writes it.
        radius: of the ball, metres.
        start: ``(3,)`` the ball in the first frame, metres; by default the volume is searched.
        volume: ``(2, 3)`` two corners of the box in which the ball is searched, metres; by default where two cameras
            can see it.
        settings: see `SphereSettings`.
        backgrounds: one picture of the empty scene per video; by default the median of the video.
        times: of the frames; by default as the camera file says.
        seed: of all random numbers.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: a video breaks off, or no two show the same moment.
    """
    chosen = sphere_run(
        sources, cameras, radius, start=start, volume=volume, settings=settings, backgrounds=backgrounds, times=times
    )
    if chosen.length is None:
        raise RequestError("live cameras do not end by themselves; use follow_sphere")
    stages = StageTimes()
    log = chosen.run(np.random.default_rng(seed), stages)
    return sphere_result(chosen, log, stages, {"source": [named(source) for source in sources], "seed": seed})


def follow_sphere(
    sources: Sequence[SourceLike],
    cameras: str | Path,
    radius: float,
    *,
    start: ArrayLike | None = None,
    volume: ArrayLike | None = None,
    settings: SphereSettings = SPHERE,
    backgrounds: Sequence[str | Path] | None = None,
    times: FrameTimes = TIMES,
    seed: int = 0,
) -> Iterator[Position]:
    """Where a ball is, while the videos come; see `track_sphere`.

    Sources may be live: numbers of webcams or addresses of streams. Their newest frames are paired by the time at which
    they came, counted from the first; a camera that stalls is left out until it delivers again.
    """
    chosen = sphere_run(
        sources, cameras, radius, start=start, volume=volume, settings=settings, backgrounds=backgrounds, times=times
    )
    return chosen.follow(np.random.default_rng(seed))


def sphere_run(
    sources: Sequence[SourceLike],
    cameras: str | Path,
    radius: float,
    *,
    start: ArrayLike | None = None,
    volume: ArrayLike | None = None,
    settings: SphereSettings = SPHERE,
    backgrounds: Sequence[str | Path] | None = None,
    times: FrameTimes = TIMES,
) -> SphereRun:
    """A run of `track_sphere`, which says what it raises; all sources may be live."""
    settings = as_settings(settings, SphereSettings)
    if not 0 < radius < 10:
        raise RequestError(f"`radius`: expected metres above 0 (and below 10), got {radius:g}")
    placed = cameras_of(cameras, len(sources), "videos")
    videos = [open_source(source) for source in sources]
    live = all(video.live for video in videos)
    if live and (times.offsets or times.timestamps):
        raise RequestError("`offsets` and `timestamps`: expected only with recorded videos; live frames have their own")
    if live and settings.likelihood == "background" and backgrounds is None:
        raise RequestError("`backgrounds`: expected pictures of the empty scene with live cameras, got none")
    stamps = [] if live else times.of_videos(videos, placed)
    place, box = _start(start, volume, settings, placed, radius)
    weigh = _likelihood(settings, placed, videos, radius, backgrounds)
    broad = weigh.broad() if isinstance(weigh, SphereContourLikelihood) else weigh
    search = partial(find_ball, weigh, broad, [p.camera for p in placed], radius, box, settings.particles)
    frames = [
        partial(frames_of_size, video, p.camera.width, p.camera.height) for video, p in zip(videos, placed, strict=True)
    ]

    def recorded(moments: Sequence[Moment]) -> Iterator[MomentViews]:
        return moments_with_images(moments, [begin() for begin in frames])

    def newest(_: Sequence[Moment]) -> Iterator[MomentViews]:
        # Half the shortest time between frames: cameras of one rate have a frame each in all moments but the first.
        half = 0.5 / max(video.frame_rate for video in videos)
        return LatestFrames(frames, half if settings.tolerance is None else settings.tolerance).moments()

    # The background difference is the paper's baseline, without what goes beyond the paper.
    plain = settings.preset == "paper" or settings.likelihood == "background"
    extensions: dict[str, Any] = {"covering": None, "stages": 1} if plain else {}
    extensions |= {"patience": np.inf} if settings.preset == "paper" else {}
    tracker = SphereTracker(weigh, chosen_motion(settings, radius), **extensions)
    views = newest if live else recorded
    return SphereRun(settings, placed, stamps, tracker, place, search, views, radius, videos)


def _start(
    start: ArrayLike | None,
    volume: ArrayLike | None,
    settings: SphereSettings,
    placed: Sequence[PlacedCamera],
    radius: float,
) -> tuple[FloatArray | None, FloatArray]:
    """The checked start ``(3,)``, None to search; and the box ``(2, 3)`` in which the ball is searched."""
    pinholes = [p.camera for p in placed]
    box = common_volume(pinholes, radius) if volume is None else _box(volume)
    if start is None:
        check_volume(box, pinholes, radius)
        if settings.preset == "paper":
            raise RequestError(
                "`start`: expected x, y, z with the preset paper, which measures where the ball is at first"
            )
        return None, box
    place = as_place(start)
    check_start(place, placed)
    return place, box


def check_start(position: FloatArray, cameras: Sequence[PlacedCamera]) -> None:
    """Refuse a start that no two cameras can see.

    Raises:
        RequestError: it lies behind a camera, or in fewer than two images.
    """
    depths = [float(entry.camera.to_camera(position[None])[0, 2]) for entry in cameras]
    seeing = sum(bool(in_view(entry.camera, position[None])[0]) for entry in cameras)
    place = ",".join(f"{v:g}" for v in position)
    behind = [entry.name for entry, depth in zip(cameras, depths, strict=True) if depth <= 0]
    if behind and seeing < 2:
        raise RequestError(f"expected the ball before the cameras, but {place} lies behind {behind[0]}; check `start`")
    if seeing < 2:
        raise RequestError(
            f"expected a start that two cameras see, but {place} is in {seeing} of {len(cameras)} images"
        )


def _likelihood(
    settings: SphereSettings,
    placed: Sequence[PlacedCamera],
    sources: Sequence[Source],
    radius: float,
    backgrounds: Sequence[str | Path] | None,
) -> ViewLikelihood:
    cameras = [p.camera for p in placed]
    if settings.likelihood == "contour":
        if backgrounds is not None:
            raise RequestError("`backgrounds`: expected only with the likelihood background; the outline needs none")
        if settings.preset == "paper":
            return PrintedContourLikelihood(cameras, radius)
        return SphereContourLikelihood(cameras, radius, faint=settings.faint)
    if backgrounds is None:
        pictures = []
        for source in sources:
            step = max(1, len(frame_times(source)) // BACKGROUND_FRAMES)
            pictures.append(median_background([f.image for f in source.frames() if f.index % step == 0]))
        return BackgroundLikelihood(cameras, pictures)
    if len(backgrounds) != len(cameras):
        raise RequestError(f"`backgrounds`: expected {len(cameras)} pictures, one a video, got {len(backgrounds)}")
    paths = [a_path(path, "backgrounds") for path in backgrounds]
    return BackgroundLikelihood(
        cameras, [read_image(path, (c.width, c.height)) for path, c in zip(paths, cameras, strict=True)]
    )


def _box(volume: ArrayLike) -> FloatArray:
    numbers = np.asarray(volume, dtype=np.float64)
    corners = numbers.reshape(2, 3) if numbers.size == 6 else np.zeros((2, 3))
    low, high = corners.min(axis=0), corners.max(axis=0)
    if not (high > low).all():
        raise RequestError(f"`volume`: expected two corners that differ along x, y and z, got {numbers.tolist()}")
    return np.stack([low, high])


NO_SOURCES: list[str] = []


DRAWING = Drawing()


def sphere(
    source: list[str] = NO_SOURCES,
    *,
    cameras: Path,
    output: SeededOutput,
    drawing: Drawing = DRAWING,
    settings: SphereSettings = SPHERE,
    times: FrameTimes = TIMES,
    radius: PositiveFloat | None = None,
    points: Commas[list[Path] | None] = None,
    deviation: PositiveFloat = 2.0,
    start: Commas[tuple[float, float, float] | None] = None,
    volume: Commas[tuple[float, float, float, float, float, float] | None] = None,
    backgrounds: Commas[list[Path] | None] = None,
    truth: Path | None = None,
) -> int:
    """Follow a ball of known radius in space, or a point by its measured pixels.

    DIR gets track3d.csv, path.png, report.html, run.json and, with --overlay, overlay1.webm and so on.

    Args:
        source: videos, folders of images (at frame_rate of cameras.yaml, else 25 a second), or webcams and streams, in
            the order of the cameras.
        cameras: an entry per video; tsuiseki calibrate points writes it.
        radius: of the ball, metres; with --points only for its bounces.
        points: instead of videos, a CSV of measured pixels for each camera, separated by commas: frame,x,y, or as
            TrackNet writes it, Frame,Visibility,X,Y.
        deviation: with --points, standard deviation of a measured pixel.
        start: X,Y,Z of the ball in the first frame, metres; else it is searched.
        volume: X1,Y1,Z1,X2,Y2,Z2 of the box in which it is searched, metres; by default where two cameras can see it.
        backgrounds: a picture of the empty scene per video; by default the median.
        truth: CSV of time,x,y,z (seconds, metres) to compare with.
    """
    true_path = None if truth is None else read_path3d(truth)
    if points is None:
        if radius is None:
            raise RequestError("`radius`: expected the ball's radius in metres, got none")
        chosen = sphere_run(
            source, cameras, radius, start=start, volume=volume, settings=settings, backgrounds=backgrounds, times=times
        )
    elif source or drawing.overlay or backgrounds or volume:
        raise RequestError("`points`: expected no videos, `overlay`, `backgrounds` or `volume` beside it")
    else:
        chosen = sphere_points_run(points, cameras, start, settings, deviation, radius or 0.0, times)
    if drawing.overlay and chosen.length is None:
        raise RequestError("`overlay`: expected recorded videos, which can be played again; got live cameras")
    with output.run() as run:
        run.sources += chosen.sources

        def watched(moments: Iterable[MomentViews]) -> Iterator[MomentViews]:
            return run.steps(moments if chosen.length else run.unending(moments), total=chosen.length)

        log = chosen.run(np.random.default_rng(output.seed), run.times, watched)
        result = sphere_result(chosen, log, run.times, output.settings, true_path, run.asked)
        run.save(result, partial(_draw, run, drawing, chosen, log))
        run.done(_summary(result.tracks, true_path, output.out / "track3d.csv"))
    return run.status


def _summary(positions: Sequence[Position], truth: Path3D | None, file: Path) -> str:
    """In how many moments the ball is known, and how far from the truth."""
    tracked = sum(p.status == "tracking" for p in positions)
    summary = f"ball known in {tracked} of {len(positions)} moments: {file}"
    away = np.empty(0) if truth is None else distances_to_truth(positions, truth)
    if len(away):
        summary += f"\n{100 * away.mean():.2f} cm from the true position in the mean, {100 * away.max():.2f} at most"
    return summary


def _draw(run: Run, drawing: Drawing, chosen: SphereRun, log: SphereLog) -> None:
    """A video for each camera, where that is wanted, up to the last frame that was used."""
    for view, (source, placed) in enumerate(zip(chosen.sources, chosen.placed, strict=True) if drawing.overlay else ()):
        last = max((number for m in log.moments if (number := m.frames[view]) is not None), default=-1)
        watched = progress(source.frames(), f"drawing {placed.name}", source.length)
        frames = takewhile(lambda frame, last=last: frame.index <= last, watched)  # type: ignore[misc]
        rate, painter = placed.frame_rate or source.frame_rate, sphere_painter(chosen, log, view)
        write = partial(write_drawn, frames=frames, frame_rate=rate, draw=painter)
        run.draw(f"overlay{view + 1}.{drawing.overlay_format}", write)
