"""`tsuiseki track sphere`: where a ball is in space, from two or more calibrated cameras."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tsuiseki.tracking.errors import RequestError

if TYPE_CHECKING:
    from tsuiseki.tracking.cameras.files import PlacedCamera
    from tsuiseki.tracking.filters import base as filters
    from tsuiseki.tracking.likelihoods.views import ViewLikelihood
    from tsuiseki.tracking.types import FloatArray, Frame
    from tsuiseki.tracking.video import Source

Motion = Literal["constant-velocity", "random-walk", "ballistic"]
BACKGROUND_FRAMES = 25


def sphere(
    source: list[str],
    cameras: Path,
    radius: float,
    out: Path,
    start: tuple[float, float, float] | None = None,
    spread: float = 0.05,
    volume: tuple[float, float, float, float, float, float] | None = None,
    particles: int = 500,
    motion: Motion = "constant-velocity",
    agitation: float | None = None,
    floor: float = 0.0,
    bounce: float = 0.75,
    likelihood: Literal["contour", "background"] = "contour",
    backgrounds: list[Path] | None = None,
    offsets: list[float] | None = None,
    timestamps: list[Path] | None = None,
    tolerance: float | None = None,
    truth: Path | None = None,
    overlay: bool = False,
    seed: int = 0,
    overwrite: bool = False,
) -> int:
    """Follow a ball of known radius in space.

    Args:
        source: two or more videos or folders of images, in the order of the cameras; folders run at the frame_rate in
            cameras.yaml, else at 25 frames/s.
        cameras: cameras.yaml with one entry per video; tsuiseki calibrate points writes it.
        radius: of the ball, metres.
        out: folder for track3d.csv, path.png, report.html, run.json and the overlays.
        start: X,Y,Z of the ball in the first frame, metres; by default the volume is searched.
        spread: standard deviation of the start, metres.
        volume: X1,Y1,Z1,X2,Y2,Z2 of the box in which the ball is searched, metres; by default where two cameras can
            see it.
        particles: how many; more are more exact and slower.
        motion: how the ball moves: with a velocity, by random steps as in the paper, or in free flight with bounces.
        agitation: how restless the motion is: change of velocity in one second, m/s (random walk: of position, m);
            by default 1.5 (random walk 0.15, ballistic 1).
        floor: height of the floor off which a ballistic ball bounces, metres.
        bounce: speed after a bounce over the speed before, 0 to 1.
        likelihood: the ball's outline, or the difference from the background.
        backgrounds: one picture of the empty scene per video, separated by commas; by default the median of the video.
        offsets: time of each video's first frame, seconds, separated by commas; wins over cameras.yaml.
        timestamps: one text file per video with the time of each frame, separated by commas.
        tolerance: frames of different videos within so many seconds count as taken together; by default a quarter of
            the shortest time between frames.
        truth: CSV with the columns time, x, y, z (seconds, metres) to compare with in the report.
        overlay: also write overlay1.webm and so on with the ball's outline.
        seed: of all random numbers.
        overwrite: replace what is in the folder.
    """
    import numpy as np

    from tsuiseki.tracking.cameras.files import read_cameras
    from tsuiseki.tracking.cameras.volume import common_volume
    from tsuiseki.tracking.cli.interrupt import graceful_interrupt
    from tsuiseki.tracking.cli.progress import progress
    from tsuiseki.tracking.cli.sphere_output import write_sphere_run
    from tsuiseki.tracking.formats.track3d import read_path3d
    from tsuiseki.tracking.likelihoods.views import ContourLikelihood
    from tsuiseki.tracking.output import check_output_folder, output_folder
    from tsuiseki.tracking.synchronise import align, default_tolerance
    from tsuiseki.tracking.timing import StageTimes
    from tsuiseki.tracking.trackers.sphere import SphereTracker
    from tsuiseki.tracking.trackers.sphere_run import Start, check_start, run_sphere
    from tsuiseki.tracking.trackers.sphere_search import find_ball
    from tsuiseki.tracking.video import open_source

    settings = {name: value for name, value in locals().items() if name in sphere.__annotations__}
    _check_numbers(radius, spread, particles, agitation, bounce)
    check_output_folder(out, overwrite)
    placed = read_cameras(cameras)
    if len(source) != len(placed) or len(source) < 2:
        raise RequestError(
            f"expected at least two videos and one camera for each, got {len(source)} videos and {len(placed)} cameras "
            f"in {cameras}; give the videos in the order of its entries"
        )
    sources = [open_source(s) for s in source]
    true_path = None if truth is None else read_path3d(truth)
    stamps = _times(sources, placed, offsets, timestamps)
    moments = align(stamps, default_tolerance(stamps) if tolerance is None else tolerance)
    pinholes = [p.camera for p in placed]
    box = common_volume(pinholes, radius) if volume is None else _box(volume)
    if start is not None:
        check_start(np.array(start), placed)
    weigh = _likelihood(likelihood, placed, sources, radius, backgrounds)
    moves = _motion(motion, agitation, radius, floor, bounce)
    # The background difference is the paper's baseline, without what goes beyond the paper.
    plain = likelihood == "background"
    tracker = SphereTracker(weigh, moves, covering=None, stages=1) if plain else SphereTracker(weigh, moves)
    broad = weigh.broad() if isinstance(weigh, ContourLikelihood) else weigh
    search = partial(find_ball, weigh, broad, pinholes, radius, box, particles)
    begin = Start(None if start is None else np.array(start), spread, particles, search)
    times = StageTimes()
    with graceful_interrupt() as interrupt, output_folder(out, overwrite) as work:
        videos = [_checked_frames(s, p) for s, p in zip(sources, placed, strict=True)]
        log = run_sphere(
            tracker,
            begin,
            moments,
            videos,
            np.random.default_rng(seed),
            times,
            lambda items: interrupt.until_asked(progress(items, "tracking", len(moments))),
        )
        write_sphere_run(
            work, log, placed, radius, sources if overlay else None, true_path, settings, seed, times, interrupt.asked
        )
    found = sum(p.status == "tracking" for p in log.positions)
    print(f"ball known in {found} of {len(log.positions)} moments: {out / 'track3d.csv'}")
    return 130 if interrupt.asked else 0


def _check_numbers(radius: float, spread: float, particles: int, agitation: float | None, bounce: float) -> None:
    if not 0 < radius < 10:
        raise RequestError(f"--radius: expected metres above 0 (and below 10), got {radius:g}")
    if not spread > 0:
        raise RequestError(f"--spread: expected metres above 0, got {spread:g}")
    if particles < 10:
        raise RequestError(f"--particles: expected at least 10, got {particles}")
    if agitation is not None and not agitation > 0:
        raise RequestError(f"--agitation: expected a number above 0, got {agitation:g}")
    if not 0 <= bounce <= 1:
        raise RequestError(f"--bounce: expected 0 to 1, got {bounce:g}")


def _box(volume: tuple[float, ...]) -> FloatArray:
    import numpy as np

    corners = np.array(volume).reshape(2, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    if not (high > low).all():
        raise RequestError(f"--volume: expected two corners that differ along x, y and z, got {volume}")
    return np.stack([low, high])


def _times(
    sources: list[Source],
    placed: list[PlacedCamera],
    offsets: list[float] | None,
    timestamps: list[Path] | None,
) -> list[FloatArray]:
    """The time of every frame of every video."""
    import numpy as np

    from tsuiseki.tracking.synchronise import read_timestamps
    from tsuiseki.tracking.trackers.sphere_run import check_lengths

    for name, given in (("--offsets", offsets), ("--timestamps", timestamps)):
        if given is not None and len(given) != len(sources):
            raise RequestError(f"{name}: expected {len(sources)} values, one a video, got {len(given)}")
    lengths = [_length(source) for source in sources]
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


def _length(source: Source) -> int:
    """Number of frames; a video file is decoded once to count, for its header only estimates."""
    if source.live:
        raise RequestError(f"{source.name}: expected recorded videos, for several live cameras share no clock")
    return source.length if source.length is not None else sum(1 for _ in source.frames())


def _checked_frames(source: Source, placed: PlacedCamera) -> Iterator[Frame]:
    camera = placed.camera
    for frame in source.frames():
        if frame.image.shape[:2] != (camera.height, camera.width):
            height, width = frame.image.shape[:2]
            raise RequestError(
                f"{source.name}: expected {camera.width}x{camera.height} pixels as in the camera file, "
                f"got {width}x{height}"
            )
        yield frame


def _motion(name: Motion, agitation: float | None, radius: float, floor: float, bounce: float) -> filters.Motion:
    from tsuiseki.tracking.filters.motion_3d import Ballistic, ConstantVelocity, RandomWalk

    if name == "random-walk":
        return RandomWalk(0.15 if agitation is None else agitation)
    if name == "ballistic":
        return Ballistic(radius, floor, restitution=bounce, agitation=1.0 if agitation is None else agitation)
    return ConstantVelocity(1.5 if agitation is None else agitation)


def _likelihood(
    name: Literal["contour", "background"],
    placed: list[PlacedCamera],
    sources: list[Source],
    radius: float,
    backgrounds: list[Path] | None,
) -> ViewLikelihood:
    from tsuiseki.tracking.likelihoods.background import median_background
    from tsuiseki.tracking.likelihoods.views import BackgroundLikelihood, ContourLikelihood
    from tsuiseki.tracking.video import read_image

    cameras = [p.camera for p in placed]
    if name == "contour":
        if backgrounds is not None:
            raise RequestError("--backgrounds: expected only with --likelihood background; the outline needs none")
        return ContourLikelihood(cameras, radius)
    if backgrounds is None:
        pictures = []
        for source in sources:
            step = max(1, _length(source) // BACKGROUND_FRAMES)
            pictures.append(median_background([f.image for f in source.frames() if f.index % step == 0]))
        return BackgroundLikelihood(cameras, pictures)
    if len(backgrounds) != len(cameras):
        raise RequestError(f"--backgrounds: expected {len(cameras)} pictures, one a video, got {len(backgrounds)}")
    return BackgroundLikelihood(
        cameras, [read_image(path, (c.width, c.height)) for path, c in zip(backgrounds, cameras, strict=True)]
    )
