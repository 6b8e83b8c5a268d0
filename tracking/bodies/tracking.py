"""Bodies that bend through a video, such as fish seen from above."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from tsuiseki.tracking.animals.tracking import video_background
from tsuiseki.tracking.bodies.body import Body
from tsuiseki.tracking.bodies.body_starts import wide_noise
from tsuiseki.tracking.bodies.choice import parse_body
from tsuiseki.tracking.bodies.contour import BodyPixels, Extraction
from tsuiseki.tracking.bodies.tracker import DeformableSettings, DeformableTracker
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.background_difference import Contrast, StandingOut
from tsuiseki.tracking.features.colour_region import parse_colour
from tsuiseki.tracking.filters.motion.bodies import BodyMotion, RandomWalk
from tsuiseki.tracking.filters.motion.learnt import read_motion
from tsuiseki.tracking.options import Shared
from tsuiseki.tracking.types import FloatArray, Frame
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.types.tracks import BodyTrack
from tsuiseki.tracking.video.source import Source, open_source

CONTRASTS: dict[str, Contrast] = {"any": "any", "bright": "bright", "dark": "dark"}
MotionPreset = Literal["learnt", "paper", "conditional", "independent", "velocity", "walk", "wide"]


@dataclass(frozen=True)
class BodyChoice(Shared):
    """Which bodies are followed, and how.

    Attributes:
        body: goldfish or ball, with its sizes in pixels where they differ, such as goldfish,length=40,width=14,tail=20,
            or a file of tsuiseki train body.
        motion: what tsuiseki train motion learnt of this body.
        preset: how the body is expected to move. With --motion: learnt draws from what was learnt of shape and motion
            together (the default), conditional also expects a bent body to turn, paper keeps equation (14) as printed,
            independent leaves out the correlation, velocity keeps the velocity in the image, walk keeps the place.
            Without --motion: wide, a random walk of 30 pixels and 45 degrees a frame, which needs some 3000 particles.
        widen: times the learnt deviations; with few particles wider noise, such as 1.6, loses fewer bodies.
        init: state of a body in the first frame, a,b,theta,phi in pixels and radians (for the ball a,b,theta,squash);
            once for each body. By default the bodies are found.
        colour: any, bright or dark: what stands out so from the background behind the bodies, learnt from the video of
            a fixed camera. Or red, orange, yellow, green, cyan, blue, magenta, black, white, or H1-H2,S1-S2,V1-V2 with
            hues in degrees.
        deformable: settings of the tracker.
    """

    body: str = "goldfish"
    motion: Path | None = None
    preset: MotionPreset | None = None
    widen: float = 1.0
    init: list[list[float]] | None = None
    colour: str = "any"
    deformable: DeformableSettings = field(default_factory=DeformableSettings)

    def pixels(self, source: Source) -> BodyPixels:
        """How bodies are told from what lies behind them; for a contrast the video is played once.

        Raises:
            RequestError: there is no such colour, or a contrast is asked of a live source.
        """
        if self.colour not in CONTRASTS:
            return Extraction(parse_colour(self.colour), self.deformable.smooth)
        if source.live:
            raise RequestError(
                f"`colour`: expected one with a live source, which cannot be played twice, got {self.colour}"
            )
        return StandingOut(video_background(source, CONTRASTS[self.colour]), self.deformable.smooth)

    def tracker(self, source: Source, seed: int = 0) -> DeformableTracker:
        """A fresh tracker for the bodies in a video.

        Raises:
            RequestError: something of this cannot be used; the message says what and why.
        """
        body = parse_body(self.body)
        moves = chosen_motion(body, self.motion, self.preset, source.frame_rate, self.widen)
        states = starting_states(self.init, body, source)
        return DeformableTracker(body, moves, self.pixels(source), self.deformable, states, seed)


def track_deformable(
    source: str | Path | int,
    body: str = "goldfish",
    *,
    colour: str = "any",
    motion: str | Path | None = None,
    preset: MotionPreset | None = None,
    init: ArrayLike | None = None,
    frames: str | None = None,
    settings: DeformableSettings | None = None,
    seed: int = 0,
) -> list[BodyTrack]:
    """Bodies that bend: place, heading and bend of each in every frame.

    Args:
        source: a video file, a folder of images, or a MOTChallenge sequence folder.
        body: ``goldfish`` or ``ball``, with its sizes in pixels where they differ, such as
            ``"goldfish,length=40,width=14,tail=20"``, or a file of `tsuiseki train body`.
        colour: theirs, by name or as ``"H1-H2,S1-S2,V1-V2"`` with hues in degrees; or ``any``, ``bright`` or ``dark``
            for what stands out in this way from a background that a fixed camera sees behind them. A live source needs
            a colour.
        motion: file of `tsuiseki train motion`, what was learnt of this body.
        preset: how the body is expected to move; by default ``learnt`` with ``motion`` and ``wide`` without.
        init: ``(K, D)`` states of the bodies in the first frame; by default they are found there.
        frames: this stretch only, counted from 1 with both ends, such as ``"301-400"``.
        settings: see `DeformableSettings`.
        seed: of the particles.

    Returns:
        The tracks by id, frames counted from 0 at the beginning of the video.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off.
    """
    opened, tracker = _prepared(source, frames, _choice(body, motion, preset, init, colour, settings), seed)
    if opened.live and opened.frames_wanted.last is None:
        raise RequestError(f"{opened.name} does not end by itself; give frames, or use follow_deformable")
    for frame in opened.frames():
        tracker.update(frame)
    return tracker.tracks()


def follow_deformable(
    source: str | Path | int,
    body: str = "goldfish",
    *,
    colour: str = "any",
    motion: str | Path | None = None,
    preset: MotionPreset | None = None,
    init: ArrayLike | None = None,
    frames: str | None = None,
    settings: DeformableSettings | None = None,
    seed: int = 0,
) -> Iterator[tuple[Frame, list[BodyTrack]]]:
    """Each frame with the bodies in it, each as a track of this one frame, while the video comes.

    Arguments and errors are those of `track_deformable`.
    """
    opened, tracker = _prepared(source, frames, _choice(body, motion, preset, init, colour, settings), seed)

    def each() -> Iterator[tuple[Frame, list[BodyTrack]]]:
        for frame in opened.frames():
            tracker.update(frame)
            yield frame, tracker.tracks()
            tracker.forget()

    return each()


def chosen_motion(
    body: Body, path: str | Path | None, preset: MotionPreset | None, frame_rate: float, widen: float = 1.0
) -> BodyMotion:
    """The motion that a preset names, at the frame rate of the video, its deviations ``widen`` times as large.

    Raises:
        RequestError: there is no such preset, it needs a file or cannot use it, or the file is of another body.
    """
    if not 0 < widen < float("inf"):
        raise RequestError(f"`widen`: expected a number above 0, got {widen:g}")
    if path is None:
        if preset not in (None, "wide"):
            raise RequestError(f"`preset` {preset} needs `motion`, a file of tsuiseki train motion")
        return RandomWalk(wide_noise(body).widened(widen))
    learnt = read_motion(Path(path), body.name, len(body.fields)).at(frame_rate).widened(widen)
    presets: dict[MotionPreset | None, Callable[[], BodyMotion]] = {
        None: learnt.proposal,
        "learnt": learnt.proposal,
        "paper": learnt.printed_proposal,
        "conditional": learnt.conditional,
        "independent": learnt.independent,
        "velocity": learnt.constant_velocity,
        "walk": learnt.random_walk,
    }
    if preset == "wide":
        raise RequestError("`preset` wide uses no `motion`; leave one out")
    if preset not in presets:
        raise RequestError(
            f"`preset`: expected one of {', '.join(map(str, list(presets)[1:]))} or wide, got {preset!r}"
        )
    return presets[preset]()


def starting_states(init: ArrayLike | None, body: Body, source: Source) -> FloatArray | None:
    """``(K, D)`` the given states, checked against the body and the image; None for none.

    Raises:
        RequestError: a state has another length, is not finite, or lies outside the image or the body's limits.
    """
    if init is None:
        return None
    states = [np.asarray(state, dtype=np.float64).reshape(-1) for state in np.atleast_2d(np.asarray(init))]
    height, width = next(iter(source.frames())).image.shape[:2]
    for state in states:
        if len(state) != len(body.fields) or not np.isfinite(state).all():
            names = ",".join(body.fields)
            raise RequestError(f"`init`: expected {names} as {len(body.fields)} finite numbers, got {state.tolist()}")
        if not (0 <= state[0] < width and 0 <= state[1] < height):
            raise RequestError(
                f"`init`: expected a place in the image of {width}x{height}, got {state[0]:g},{state[1]:g}"
            )
        for name, value, (low, high) in zip(body.fields, state, body.limits, strict=True):
            if not low <= value <= high:
                raise RequestError(f"`init`: expected {name} from {low:.3g} to {high:.3g}, got {value:g}")
    return np.array(states)


def columns_of(tracks: Sequence[BodyTrack], frames: Sequence[int]) -> dict[str, list[Any]]:
    """Frame from 1, bodies that are tracked in it, and the score of each body."""
    seen = [0] * len(frames)
    scores: dict[str, list[Any]] = {}
    for track in tracks:
        scores[f"score_{track.id}"] = [round(float(score), 4) for score in track.scores]
        for frame, tracking in zip(track.frames, track.tracking, strict=True):
            seen[int(frame) - frames[0]] += int(tracking)
    return {"frame": [index + 1 for index in frames], "tracking": list(seen), **scores}


def _prepared(
    source: str | Path | int, frames: str | None, choice: BodyChoice, seed: int
) -> tuple[Source, DeformableTracker]:
    opened = open_source(str(source), parse_frames(frames))
    if not opened.has_images:
        raise RequestError(f"{opened.name} has no images to look at; expected them in its folder img1/")
    return opened, choice.tracker(opened, seed)


def _choice(
    body: str,
    motion: str | Path | None,
    preset: MotionPreset | None,
    init: ArrayLike | None,
    colour: str,
    settings: DeformableSettings | None,
) -> BodyChoice:
    """What is asked from Python."""
    states = None if init is None else np.atleast_2d(np.asarray(init, dtype=np.float64)).tolist()
    path, chosen = None if motion is None else Path(motion), settings or DeformableSettings()
    return BodyChoice(body, path, preset, init=states, colour=colour, deformable=chosen)
