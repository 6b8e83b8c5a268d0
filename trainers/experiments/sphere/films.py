"""Films of a ball moved by hand before several cameras, followed in several ways, against the exact truth.

All configurations of one kind of film see the same images, one film a seed. The filter's parameters are the same for
all seeds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tsuiseki.datamodules.scenes.sphere_clip import (
    CarriedBallSettings,
    SphereClip,
    covered_image,
    plan_sphere,
)
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.cameras.volume import common_volume
from tsuiseki.tracking.evaluation.space import DistanceScores, distance_scores, distance_to_path
from tsuiseki.tracking.filters.particles.stages import Covering
from tsuiseki.tracking.sphere.sphere_search import find_ball
from tsuiseki.tracking.sphere.tracker import (
    START_SPEED,
    SphereState,
    SphereTracker,
    TimedViews,
    with_velocities,
)
from tsuiseki.tracking.sphere.views import ContourLikelihood, ViewLikelihood, Views
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.trainers.experiments.experiment import Watch
from tsuiseki.trainers.experiments.sphere.configurations import FIRST_COVERED, LIKELIHOODS, OURS, Configuration


@dataclass(frozen=True)
class FilmErrors:
    """Errors of one configuration on one film.

    Attributes:
        to_position: distance to the true position at the same time.
        to_path: distance to the true path, the paper's error.
        points: ``(T, 3)`` the estimates, metres.
    """

    to_position: DistanceScores
    to_path: DistanceScores
    points: FloatArray


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
        rows: configurations; all of one kind of film.
        watch: is told how far it is.
    """
    scene = plan_sphere(settings, seed)
    empty = scene.backgrounds()
    runs = [_Run(row, scene, empty, seed) for row in rows]
    rng = np.random.default_rng((seed, 3))
    for index, (images, _) in enumerate(watch.over(scene.frames(), f"film {seed}", settings.frames)):
        board = covered_image(scene, 0, rng) if any(index in run.hidden for run in runs) else None
        for run in runs:
            run.see(index, images, board)
    return [run.errors() for run in runs]


class _Run:
    """One configuration on its way through a film."""

    def __init__(self, row: Configuration, scene: SphereClip, empty: Sequence[ImageArray], seed: int) -> None:
        wrong = np.random.default_rng((seed, 5))
        cameras = [turned(camera, row.camera_error, wrong) for camera in scene.cameras[: row.cameras]]
        radius = scene.settings.radius * (1 + row.radius_error)
        likelihood = LIKELIHOODS[row.likelihood](cameras, radius, empty[: row.cameras])
        self.row, self.scene = row, scene
        self.tracker = SphereTracker(likelihood, row.motion, Covering() if row.notices else None, stages=row.stages)
        self.rng = np.random.default_rng((seed, 4))
        self.search = partial(_search, likelihood, cameras, radius, row.particles, self.rng) if row.searched else None
        # The paper measures where the ball is at the start.
        self.state: SphereState = self.tracker.start_at(
            scene.truth[0], OURS.spread, row.particles, row.cameras, self.rng, float(scene.times[0])
        )
        self.hidden = range(FIRST_COVERED, FIRST_COVERED + row.covered)
        self.points: list[FloatArray] = []

    def see(self, index: int, images: Sequence[ImageArray], board: ImageArray | None) -> None:
        views = list(images[: self.row.cameras])
        if index in self.hidden and board is not None:
            views[0] = board
        if index == 0 and self.search is not None:
            found = with_velocities(self.search(views), START_SPEED, self.rng)
            self.state = self.tracker.init(found, self.row.cameras, float(self.scene.times[0]))
        observation = TimedViews(float(self.scene.times[index]), views)
        self.state, info = self.tracker.step(self.state, observation, self.rng)
        self.points.append(info.position.point)

    def errors(self) -> FilmErrors:
        points = np.array(self.points)
        away = np.sqrt(np.square(points - self.scene.truth).sum(axis=1))
        return FilmErrors(distance_scores(away), distance_scores(distance_to_path(points, self.scene.truth)), points)


def _search(
    likelihood: ViewLikelihood,
    cameras: Sequence[PinholeCamera],
    radius: float,
    count: int,
    rng: np.random.Generator,
    views: Views,
) -> FloatArray:
    """``(count, 3)`` positions where `track sphere` without a start looks first."""
    broad = likelihood.broad() if isinstance(likelihood, ContourLikelihood) else likelihood
    return find_ball(likelihood, broad, cameras, radius, common_volume(cameras, radius), count, views, rng)


def turned(camera: PinholeCamera, pixels: float, rng: np.random.Generator) -> PinholeCamera:
    """The camera turned in a random direction so far that the middle of its image moves by ``pixels``."""
    direction = rng.uniform(0, 2 * np.pi)
    angle = float(np.arctan(pixels / camera.focal.mean()))
    # Rodrigues' formula about an axis across the optical one.
    x, y = np.cos(direction), np.sin(direction)
    cross = np.array([[0.0, 0.0, y], [0.0, 0.0, -x], [-y, x, 0.0]])
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return replace(camera, rotation=turn @ camera.rotation)


def over_seeds(films: Mapping[int, FilmErrors]) -> tuple[DistanceScores, DistanceScores]:
    """Mean over the films of the mean, deviation and median, and the greatest maximum; to position and to path."""
    return _pooled([f.to_position for f in films.values()]), _pooled([f.to_path for f in films.values()])


def _pooled(scores: Sequence[DistanceScores]) -> DistanceScores:
    return DistanceScores(
        float(np.mean([s.mean for s in scores])),
        max(s.maximum for s in scores),
        float(np.mean([s.deviation for s in scores])),
        float(np.mean([s.median for s in scores])),
        sum(s.count for s in scores),
    )
