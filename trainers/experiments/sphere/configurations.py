"""What `reproduce stereo-sphere` compares: the paper's method as printed, each addition to it, and what disturbs it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, TypeAlias

from tsuiseki.tracking.cameras.outline import sphere_outlines
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.filters.base import Motion
from tsuiseki.tracking.sphere.printed_contour import (
    DividedContourLikelihood,
    MinMaxWeights,
    PrintedContourLikelihood,
)
from tsuiseki.tracking.sphere.settings import SphereSettings, chosen_motion
from tsuiseki.tracking.sphere.views import BackgroundLikelihood, ContourLikelihood, ViewLikelihood
from tsuiseki.tracking.types import ImageArray

RADIUS, SMALL = 0.10, 0.02
"""Of the ball, metres; seen from 4 m it is 35 pixels across, the small one 7."""
PAPER, OURS = SphereSettings(preset="paper"), SphereSettings()
WALK, FLIGHT = chosen_motion(PAPER, RADIUS), chosen_motion(OURS, RADIUS)
"""Of `track sphere --preset paper` and of `track sphere`; with them the rows are what the command runs."""
PARTICLES = (50, 100, 200, 500, 1000, 2000)
CAMERAS = (2, 3, 4, 6)
COVERED = (0, 5, 10, 20, 40)
FIRST_COVERED = 30

Group = Literal["section 3", "particles", "cameras", "covered", "disturbed", "small"]
LikelihoodName = Literal[
    "background",
    "printed",
    "printed, scaled",
    "printed, fourth power",
    "ellipse",
    "divided",
    "contour",
    "sharp",
    "faint",
]
MakeLikelihood: TypeAlias = Callable[[Sequence[PinholeCamera], float, Sequence[ImageArray]], ViewLikelihood]


LIKELIHOODS: Mapping[LikelihoodName, MakeLikelihood] = {
    "background": lambda cameras, _, empty: BackgroundLikelihood(cameras, empty),
    "printed": lambda cameras, radius, _: PrintedContourLikelihood(cameras, radius),
    "printed, scaled": lambda cameras, radius, _: MinMaxWeights(PrintedContourLikelihood(cameras, radius)),
    "printed, fourth power": lambda cameras, radius, _: PrintedContourLikelihood(cameras, radius, power=4.0),
    "ellipse": lambda cameras, radius, _: PrintedContourLikelihood(cameras, radius, outlines_of=sphere_outlines),
    "divided": lambda cameras, radius, _: DividedContourLikelihood(cameras, radius, outlines_of=sphere_outlines),
    "contour": lambda cameras, radius, _: ContourLikelihood(cameras, radius),
    "sharp": lambda cameras, radius, _: ContourLikelihood(cameras, radius, faint=False),
    "faint": lambda cameras, radius, _: ContourLikelihood(cameras, radius, faint=True),
}
"""From C cameras, the radius in metres and C pictures of the empty scene."""


@dataclass(frozen=True)
class Configuration:
    """One way to track the film.

    Attributes:
        group: which table it belongs to.
        name: of the row there.
        likelihood: one of `LIKELIHOODS`.
        motion: as section 2.1, or with velocity.
        particles: how many.
        cameras: the first so many.
        covered: frames from `FIRST_COVERED` on in which a board covers the first camera.
        notices: whether covered cameras are recognised.
        stages: of weighing in a step.
        camera_error: turns each camera so far that the middle of its image moves by so many pixels.
        radius_error: of the radius that the tracker is told, over the true one.
        ball: radius of the film's ball, metres.
        exposure, defocus, readout: of the film, `CarriedBallSettings`.
        late: seconds by which camera 2 takes its frames later than camera 1.
        clear: of the film, `CarriedBallSettings`.
        searched: whether the ball is searched for in the first frame, where the start is told otherwise.
    """

    group: Group
    name: str
    likelihood: LikelihoodName = "contour"
    motion: Motion = WALK
    particles: int = OURS.particles
    cameras: int = 2
    covered: int = 0
    notices: bool = True
    stages: int = 2
    camera_error: float = 0.0
    radius_error: float = 0.0
    ball: float = RADIUS
    exposure: float = 0.0
    defocus: float = 0.0
    readout: float = 0.0
    late: float = 0.0
    clear: float = 0.0
    searched: bool = False

    @property
    def of_film(self) -> tuple[float, float, float, float, float, float]:
        """What the film itself depends on."""
        return self.ball, self.exposure, self.defocus, self.readout, self.late, self.clear


def configurations() -> list[Configuration]:
    """Everything that is compared."""
    return [*paper_and_additions(), *disturbed(), *small(), *varied()]


def paper_and_additions() -> list[Configuration]:
    """Section 3 of the paper as printed, and one addition after the other up to what `track sphere` does."""
    at_once = partial(Configuration, "section 3", notices=False, stages=1)
    return [
        at_once("background, as printed (2.2.1): `--preset paper --likelihood background`", "background"),
        at_once("contour, as printed (2.2.2), weights over their sum: `--preset paper`", "printed"),
        at_once("+ r0 on the true ellipse", "ellipse"),
        at_once("+ each ray divided by its sum and the contrast", "divided"),
        at_once("+ an exponential of the mean over the rays", "contour"),
        Configuration("section 3", "+ two stages of weighing", notices=False),
        Configuration("section 3", "+ covered cameras noticed"),
        Configuration("section 3", "+ a velocity: `track sphere`", motion=FLIGHT),
        at_once("contour, as printed, weights from least 0 to greatest 1", "printed, scaled"),
        at_once("(not in the paper: its sum to the fourth power)", "printed, fourth power"),
    ]


def disturbed() -> list[Configuration]:
    """What films of real cameras have and the others have not, for the whole method and the paper's."""
    kinds: list[tuple[str, dict[str, float]]] = [
        ("exact cameras and radius, no blur, one clock", {}),
        *((f"cameras turned by {p:g} px", {"camera_error": p}) for p in (1.0, 2.0, 5.0)),
        *((f"radius {100 * r:+.0f} %", {"radius_error": r}) for r in (-0.05, 0.05, 0.1)),
        *((f"out of focus, {s:g} px", {"defocus": s}) for s in (2.0, 4.0)),
        ("smeared, exposure 1/15 s", {"exposure": 1 / 15}),
        ("rolling shutter, 1/30 s", {"readout": 1 / 30}),
        *((f"camera 2 late by 1/{n} s", {"late": 1 / n}) for n in (60, 30, 15)),
    ]
    return [
        made
        for name, change in kinds
        for made in (
            Configuration("disturbed", name, motion=FLIGHT, **change),  # type: ignore[arg-type]
            Configuration("disturbed", f"{name}, as printed", "printed", notices=False, stages=1, **change),  # type: ignore[arg-type]
        )
    ]


def small() -> list[Configuration]:
    """Outlines that are faint: a ball of 7 pixels, half of it in the fist or clear of it, and a lens out of focus."""
    made = []
    for where, clear in (("half in the fist", 0.0), ("10 cm from the hand", 0.1)):
        ball = partial(Configuration, "small", ball=SMALL, clear=clear)
        made += [
            ball(f"a ball of 7 px across, {where}: `track sphere`", motion=FLIGHT),
            ball("the same, `--faint false`", "sharp", motion=FLIGHT),
            ball("the same, `--faint false`, every view trusted", "sharp", motion=FLIGHT, notices=False),
            ball("the same, as printed", "printed", notices=False, stages=1),
            ball("the same, `track sphere` without `--start`", motion=FLIGHT, searched=True),
        ]
    for blur in (2.0, 4.0):
        lens = partial(Configuration, "small", motion=FLIGHT, defocus=blur)
        made += [lens(f"out of focus, {blur:g} px: `track sphere`"), lens("the same, `--faint true`", "faint")]
    return made


def varied() -> list[Configuration]:
    """Particles, cameras and covered frames."""
    rows = [Configuration("particles", str(n), particles=n) for n in PARTICLES]
    rows += [Configuration("cameras", str(n), cameras=n) for n in CAMERAS]
    for cameras, notices in ((2, True), (3, True), (3, False)):
        kind = f"{cameras} cameras" + ("" if notices else ", every view trusted")
        rows += [
            Configuration("covered", f"{n} frames, {kind}", "contour", FLIGHT, 500, cameras, n, notices)
            for n in COVERED
        ]
    return rows
