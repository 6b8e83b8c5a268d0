"""Settings of `tsuiseki track deformable`: of the tracker, which bodies are followed, and how they move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AfterValidator, Field, NonNegativeInt, PositiveFloat
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bodies.body import Body
from tsuiseki.tracking.bodies.contour import wide_noise
from tsuiseki.tracking.bounds import SETTINGS, Particles
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.background_difference import Contrast
from tsuiseki.tracking.fields import Options, Rows
from tsuiseki.tracking.filters.body_motion import BodyMotion, RandomWalk
from tsuiseki.tracking.filters.learnt_motion import read_motion
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.video.source import Source

CONTRASTS: dict[str, Contrast] = {"any": "any", "bright": "bright", "dark": "dark"}
MotionPreset = Literal["learnt", "paper", "conditional", "independent", "velocity", "walk", "wide"]


def _odd(pixels: int) -> int:
    if pixels % 2 == 0:
        raise ValueError(f"expected an odd number of pixels, got {pixels}")
    return pixels


# Side of a median filter, pixels.
Odd: TypeAlias = Annotated[int, Field(ge=1, le=99), AfterValidator(_odd)]


@dataclass(frozen=True, config=SETTINGS)
class DeformableSettings:
    """Settings of the tracker of bodies.

    Attributes:
        particles: number of particles of each body.
        spread: ``sigma_d`` of (7), the scale of squared distances to edges, pixels squared.
        patience: frames without support until a body is lost.
        smooth: side in pixels of the median filter of the extraction; 1 leaves it out.
    """

    particles: Particles = 500
    spread: PositiveFloat = 40.0
    patience: NonNegativeInt = 10
    smooth: Odd = 5


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class BodyChoice(Options):
    """Which bodies are followed, and how.

    Attributes:
        body: goldfish or ball, with its sizes in pixels where they differ, such as goldfish,length=40,width=14,tail=20,
            or a file of tsuiseki train body.
        motion: what tsuiseki train motion learnt of this body.
        preset: how the body is expected to move. With --motion: learnt draws from what was learnt of shape and motion
            together (the default), conditional also expects a bent body to turn, paper keeps equation (14) as printed,
            independent leaves out the correlation, velocity keeps the velocity in the image, walk keeps the place.
            Without --motion: wide, a random walk of 30 pixels and 45 degrees a frame, which needs some 3000 particles.
        widen: factor of the learnt deviations; with few particles a factor such as 1.6 loses fewer bodies.
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
    widen: PositiveFloat = 1.0
    init: Rows[list[list[float]] | None] = None
    colour: str = "any"
    deformable: DeformableSettings = field(default_factory=DeformableSettings)


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
