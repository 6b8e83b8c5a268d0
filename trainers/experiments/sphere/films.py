"""Films of a ball moved by hand before several cameras, followed by both likelihoods, against the exact truth.

Everything runs over one film per seed, so that all configurations see the same images. The filter's parameters are the
same for all seeds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tsuiseki.datamodules.scenes.ball.carried import (
    BallScene,
    CarriedBallSettings,
    backgrounds,
    covered_image,
    film,
    make_scene,
)
from tsuiseki.tracking.evaluation.space import DistanceScores, distance_scores, distance_to_path
from tsuiseki.tracking.filters.base import Motion
from tsuiseki.tracking.filters.motion.motion_3d import ConstantVelocity, RandomWalk
from tsuiseki.tracking.filters.particles.views import Covering
from tsuiseki.tracking.likelihoods.views import BackgroundLikelihood, ContourLikelihood, ViewLikelihood
from tsuiseki.tracking.trackers.sphere.sphere import SphereState, SphereTracker, TimedViews
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.trainers.experiments.experiment import Watch

WALK, FLIGHT = RandomWalk(0.12), ConstantVelocity(0.8)
PARTICLES = (50, 100, 200, 500, 1000, 2000)
CAMERAS = (2, 3, 4, 6)
COVERED = (0, 5, 10, 20, 40)
FIRST_COVERED = 30


@dataclass(frozen=True)
class Configuration:
    """One way to track the film.

    Attributes:
        group: which table it belongs to.
        name: of the row there.
        likelihood: of the two of section 2.2.
        motion: as section 2.1, or with velocity.
        particles: how many.
        cameras: the first so many.
        covered: frames from `FIRST_COVERED` on in which a board covers the first camera.
        notices: whether covered cameras are recognised.
        stages: of weighing in a step.
    """

    group: Literal["section 3", "particles", "cameras", "covered"]
    name: str
    likelihood: Literal["background", "contour"] = "contour"
    motion: Motion = WALK
    particles: int = 500
    cameras: int = 2
    covered: int = 0
    notices: bool = True
    stages: int = 2


@dataclass(frozen=True)
class FilmErrors:
    """Errors of one configuration on one film.

    Attributes:
        to_position: distance to the true position at the same time.
        to_path: distance to the true path, the paper's error.
    """

    to_position: DistanceScores
    to_path: DistanceScores


def configurations() -> list[Configuration]:
    """Everything that is compared."""
    rows = [
        Configuration("section 3", "background, random walk", "background", notices=False, stages=1),
        Configuration("section 3", "contour, random walk, weighed at once", notices=False, stages=1),
        Configuration("section 3", "contour, random walk"),
        Configuration("section 3", "contour, constant velocity", motion=FLIGHT),
    ]
    rows += [Configuration("particles", str(n), particles=n) for n in PARTICLES]
    rows += [Configuration("cameras", str(n), cameras=n) for n in CAMERAS]
    for cameras, notices in ((2, True), (3, True), (3, False)):
        kind = f"{cameras} cameras" + ("" if notices else ", every view trusted")
        rows += [
            Configuration("covered", f"{n} frames, {kind}", "contour", FLIGHT, 500, cameras, n, notices)
            for n in COVERED
        ]
    return rows


def run_film(
    seed: int,
    settings: CarriedBallSettings,
    rows: Sequence[Configuration],
    watch: Watch,
) -> list[FilmErrors]:
    """The errors of every configuration on the film of ``seed``.

    Args:
        seed: of room, person, noise and particles.
        settings: of the film.
        rows: configurations.
        watch: is told how far it is.
    """
    scene = make_scene(settings, seed)
    empty = backgrounds(scene, seed)
    runs = [_Run(row, scene, empty, seed) for row in rows]
    rng = np.random.default_rng((seed, 3))
    for index, images in enumerate(watch.over(film(scene, seed), f"film {seed}", settings.frames)):
        board = covered_image(scene, 0, rng) if any(index in run.hidden for run in runs) else None
        for run in runs:
            run.see(index, images, board)
    return [run.errors() for run in runs]


class _Run:
    """One configuration on its way through a film."""

    def __init__(self, row: Configuration, scene: BallScene, empty: Sequence[ImageArray], seed: int) -> None:
        cameras = scene.cameras[: row.cameras]
        likelihood: ViewLikelihood = (
            ContourLikelihood(cameras, scene.settings.radius)
            if row.likelihood == "contour"
            else BackgroundLikelihood(cameras, empty[: row.cameras])
        )
        self.row, self.scene = row, scene
        self.tracker = SphereTracker(likelihood, row.motion, Covering() if row.notices else None, stages=row.stages)
        self.rng = np.random.default_rng((seed, 4))
        # The paper measures where the ball is at the start.
        self.state: SphereState = self.tracker.start_at(
            scene.truth[0], 0.02, row.particles, row.cameras, self.rng, float(scene.times[0])
        )
        self.hidden = range(FIRST_COVERED, FIRST_COVERED + row.covered)
        self.points: list[FloatArray] = []

    def see(self, index: int, images: Sequence[ImageArray], board: ImageArray | None) -> None:
        views = list(images[: self.row.cameras])
        if index in self.hidden and board is not None:
            views[0] = board
        observation = TimedViews(float(self.scene.times[index]), views)
        self.state, info = self.tracker.step(self.state, observation, self.rng)
        self.points.append(info.position.point)

    def errors(self) -> FilmErrors:
        points = np.array(self.points)
        away = np.sqrt(np.square(points - self.scene.truth).sum(axis=1))
        return FilmErrors(distance_scores(away), distance_scores(distance_to_path(points, self.scene.truth)))


def over_seeds(films: Mapping[int, Sequence[FilmErrors]], row: int) -> tuple[DistanceScores, DistanceScores]:
    """Mean over the seeds of the mean, deviation and median, and the greatest maximum; to position and to path."""
    return _pooled([o[row].to_position for o in films.values()]), _pooled([o[row].to_path for o in films.values()])


def _pooled(scores: Sequence[DistanceScores]) -> DistanceScores:
    return DistanceScores(
        float(np.mean([s.mean for s in scores])),
        max(s.maximum for s in scores),
        float(np.mean([s.deviation for s in scores])),
        float(np.mean([s.median for s in scores])),
        sum(s.count for s in scores),
    )
