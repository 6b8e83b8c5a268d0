"""How a ball in space is followed and when its frames were taken: the settings of `tsuiseki track sphere`."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, NonNegativeFloat, PositiveFloat, model_validator
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS, Seconds, Share
from tsuiseki.tracking.cameras.camera_files import CameraOverFloor, PlacedCamera, read_projective_cameras
from tsuiseki.tracking.errors import InputWarning, RequestError, RunError, a_path
from tsuiseki.tracking.fields import Commas, Options
from tsuiseki.tracking.filters.base import Motion
from tsuiseki.tracking.filters.point_motion import Ballistic, ConstantVelocity3D, RandomWalk3D
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.frame_range import EVERY_FRAME
from tsuiseki.tracking.video.frame_source import uneven
from tsuiseki.tracking.video.source import Source
from tsuiseki.tracking.video.synchronise import read_timestamps

PresetName = Literal["extended", "paper"]
MotionName = Literal["constant-velocity", "random-walk", "ballistic"]
LikelihoodName = Literal["contour", "background"]
# Frames of different length at the end of two videos that are still taken for the same recording.
SLACK_FRAMES = 2
# In messages, where a file may have more.
AT_LEAST = "at least "


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class SphereSettings(Options):
    """How a ball is followed; lengths in metres.

    Attributes:
        preset: extended, or paper: the filter as printed, which needs a start and never searches.
        spread: standard deviation of the start, metres.
        particles: number of particles; more are more exact and slower.
        motion: how the ball moves; by default constant-velocity, with the preset paper random-walk.
        agitation: standard deviation of the change of velocity in a second, m/s, or of a random walk, m; by default
            1.5, random walk 0.15, ballistic 1.
        floor: height off which a ballistic ball bounces, metres.
        bounce: speed after a bounce over the speed before, 0 to 1.
        drag: drag of a ballistic ball, 1/m; a tennis ball's is 0.02.
        spin: X,Y,Z of a ballistic ball: its acceleration is the cross product of this with the velocity, 1/s.
        likelihood: what tells the ball.
        faint: the outline is faint, as out of focus: clutter is measured beside the ball; by default where the ball is
            less than 12 pixels across.
        tolerance: seconds within which frames of different videos count as taken together; by default a quarter of the
            shortest time between frames, live half of it.
    """

    preset: PresetName = "extended"
    spread: PositiveFloat = 0.05
    particles: Annotated[int, Field(ge=10, le=1_000_000)] = 500
    motion: MotionName | None = None
    agitation: PositiveFloat | None = None
    floor: float = 0.0
    bounce: Share = 0.75
    drag: NonNegativeFloat = 0.0
    spin: Commas[tuple[float, float, float]] = (0.0, 0.0, 0.0)
    likelihood: LikelihoodName = "contour"
    faint: bool | None = None
    tolerance: Seconds | None = None

    @model_validator(mode="after")
    def _faint_with_outlines(self) -> Self:
        if self.faint is not None and (self.preset == "paper" or self.likelihood == "background"):
            raise ValueError("`faint`: expected only with the outline of the preset extended; leave it out")
        return self


def cameras_of(path: str | Path, count: int, what: str, option: str = "") -> Sequence[PlacedCamera]:
    """The cameras of a file, one for each of ``count`` videos or files, as ``what`` says.

    Raises:
        RequestError: there are fewer than two, or another number of cameras; it names the ``option``.
    """
    placed = read_projective_cameras(a_path(path, "cameras"))
    if count != len(placed) or count < 2:
        raise RequestError(
            f"{option}expected at least two {what} and one camera for each, got {count} {what} and {len(placed)} "
            f"cameras in {path}; give the {what} in the order of its entries"
        )
    return placed


def as_place(start: ArrayLike) -> FloatArray:
    """``(3,)`` metres; raises RequestError where it is something else."""
    place = np.asarray(start, dtype=np.float64)
    if place.shape != (3,):
        raise RequestError(f"`start`: expected x, y, z in metres, got shape {place.shape}")
    return place


def chosen_motion(settings: SphereSettings, radius: float) -> Motion:
    """The motion that the settings name."""
    motion = settings.motion or ("random-walk" if settings.preset == "paper" else "constant-velocity")
    usual = {"random-walk": 0.15, "ballistic": 1.0, "constant-velocity": 1.5}[motion]
    agitation = usual if settings.agitation is None else settings.agitation
    if motion == "ballistic":
        how = {"restitution": settings.bounce, "drag": settings.drag}
        return Ballistic(radius, settings.floor, agitation=agitation, spin=settings.spin, **how)
    return RandomWalk3D(agitation) if motion == "random-walk" else ConstantVelocity3D(agitation)


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class FrameTimes(Options):
    """When the frames were taken, where the camera file does not say it all.

    Attributes:
        offsets: seconds of each first frame, with commas; win over cameras.yaml.
        timestamps: a text file per video with the time of each frame, with commas.
    """

    offsets: Commas[list[float] | None] = None
    timestamps: Commas[list[Path] | None] = None

    def of_videos(self, sources: Sequence[Source], placed: Sequence[CameraOverFloor]) -> list[FloatArray]:
        """``(T,)`` the time of every wanted frame of every video, seconds.

        Raises:
            RequestError: offsets, times and videos differ in number or length, or a source is live.
        """
        self._check_number(len(sources), "video")
        played = [frame_times(source) for source in sources]
        wanted = [range(f := s.frames_wanted.first, f + len(t)) for s, t in zip(sources, played, strict=True)]
        if self.timestamps is None:
            rates = [p.frame_rate or s.frame_rate for p, s in zip(placed, sources, strict=True)]
            stamps = self._even(wanted, rates, placed)
            for times, source, rate, frames, stamp in zip(played, sources, rates, wanted, stamps, strict=True):
                if uneven(times):
                    stamp += times * source.frame_rate / rate - np.array(frames) / rate
            if self.offsets is None and not any(p.offset for p in placed):
                check_lengths(stamps, [s.name for s in sources])
            return stamps
        cut = any(source.frames_wanted != EVERY_FRAME for source in sources)
        return self._read(self.timestamps, wanted, AT_LEAST if cut else "")

    def of_pixels(self, pixels: Sequence[FloatArray], placed: Sequence[CameraOverFloor]) -> list[FloatArray]:
        """Likewise of the rows of every file of measured pixels.

        Raises:
            RequestError: offsets, times and files differ in number, or a frame rate is not known.
        """
        self._check_number(len(pixels), "file")
        wanted = [range(len(rows)) for rows in pixels]
        if self.timestamps is None:
            if without := [camera.name for camera in placed if camera.frame_rate is None]:
                raise RequestError(f"`timestamps`: expected times, or a frame_rate of {without[0]} in the camera file")
            return self._even(wanted, [float(camera.frame_rate or 1.0) for camera in placed], placed)
        return self._read(self.timestamps, wanted, AT_LEAST)

    def _check_number(self, expected: int, what: str) -> None:
        for name, values in (("`offsets`", self.offsets), ("`timestamps`", self.timestamps)):
            if values is not None and len(values) != expected:
                raise RequestError(f"{name}: expected {expected} values, one a {what}, got {len(values)}")

    def _even(
        self, wanted: Sequence[range], rates: Sequence[float], placed: Sequence[CameraOverFloor]
    ) -> list[FloatArray]:
        starts = [p.offset for p in placed] if self.offsets is None else self.offsets
        return [o + np.array(frames) / r for o, frames, r in zip(starts, wanted, rates, strict=True)]

    def _read(self, files: Sequence[Path], wanted: Sequence[range], least: str) -> list[FloatArray]:
        """The times in each file of the ``wanted`` frames; it has as many as the video, or ``least`` as many."""
        stamps = []
        for path, frames, offset in zip(files, wanted, self.offsets or [0.0] * len(files), strict=True):
            stamp = read_timestamps(path)
            if len(stamp) < frames.stop or (len(stamp) > frames.stop and not least):
                raise RequestError(f"{path}: expected {least}{frames.stop} times, one a frame, got {len(stamp)}")
            stamps.append(stamp[frames.start : frames.stop] + offset)
        return stamps


def frame_times(source: Source) -> FloatArray:
    """``(T,)`` seconds of each wanted frame; a video file is decoded once for them, and for their number.

    Raises:
        RequestError: the source is live.
    """
    if source.live:
        raise RequestError(f"{source.name}: expected recorded videos beside recorded ones, got a live camera")
    if source.length is not None:
        wanted = source.frames_wanted.within(source.length)
        return np.arange(wanted.first, (wanted.last or 0) + 1) / source.frame_rate
    times: list[float] = []
    try:
        times.extend(frame.time for frame in source.frames())
    except RunError as error:
        if not times:
            raise
        warnings.warn(f"{error}; it is used up to there", InputWarning, stacklevel=2)
    return np.array(times)


def check_lengths(times: Sequence[FloatArray], names: Sequence[str]) -> None:
    """Refuse videos that cannot have been recorded side by side, frame for frame.

    Raises:
        RequestError: they end more than `SLACK_FRAMES` frames apart.
    """
    ends = np.array([t[-1] for t in times])
    step = max(float(np.median(np.diff(t))) if len(t) > 1 else 0.0 for t in times)
    first, last = int(ends.argmin()), int(ends.argmax())
    if ends[last] - ends[first] > SLACK_FRAMES * step + 1e-9:
        raise RequestError(
            f"expected videos of one length, but {names[first]} ends at {ends[first]:.2f} s and {names[last]} at "
            f"{ends[last]:.2f} s; say how they lie in time with `timestamps` or `offsets`"
        )
