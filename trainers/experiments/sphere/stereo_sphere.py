"""Section 3 of the sphere paper: a ball moved by hand before two cameras, by both likelihoods, against the exact truth.

Everything runs over one film per seed, so that all configurations see the same images. The filter's parameters are the
same for all seeds.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from tsuiseki.datamodules.scenes.ball.carried import (
    BallScene,
    BallSettings,
    backgrounds,
    covered_image,
    film,
    make_scene,
)
from tsuiseki.tracking.evaluation.space import DistanceScores, distance_scores, distance_to_path
from tsuiseki.tracking.filters.motion_3d import ConstantVelocity, Motion3D, RandomWalk
from tsuiseki.tracking.filters.views import Covering
from tsuiseki.tracking.likelihoods.sphere import ContourSettings
from tsuiseki.tracking.likelihoods.views import BackgroundLikelihood, ContourLikelihood, ViewLikelihood
from tsuiseki.tracking.output import output_file
from tsuiseki.tracking.trackers.sphere import Glance, SphereState, SphereTracker
from tsuiseki.tracking.types import FloatArray, ImageArray

# Mean, maximum and standard deviation of the distance to the path, metres (section 3).
PAPER = {"background": (0.200, 0.295, 0.0990), "contour": (0.0320, 0.0488, 0.0103)}
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
    motion: Motion3D = WALK
    particles: int = 500
    cameras: int = 2
    covered: int = 0
    notices: bool = True
    stages: int = 2


@dataclass(frozen=True)
class Outcome:
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
    settings: BallSettings,
    rows: Sequence[Configuration],
    watch: Callable[[Iterable[list[ImageArray]]], Iterable[list[ImageArray]]] = iter,
) -> list[Outcome]:
    """The outcome of every configuration on the film of ``seed``.

    Args:
        seed: of room, person, noise and particles.
        settings: of the film.
        rows: configurations.
        watch: passes the moments of the film through, for progress.
    """
    scene = make_scene(settings, seed)
    empty = backgrounds(scene, seed)
    runs = [_Run(row, scene, empty, seed) for row in rows]
    rng = np.random.default_rng((seed, 3))
    for index, images in enumerate(watch(film(scene, seed))):
        board = covered_image(scene, 0, rng) if any(index in run.hidden for run in runs) else None
        for run in runs:
            run.see(index, images, board)
    return [run.outcome() for run in runs]


def kept_film(
    folder: Path,
    seed: int,
    settings: BallSettings,
    rows: Sequence[Configuration],
    watch: Callable[[Iterable[list[ImageArray]]], Iterable[list[ImageArray]]] = iter,
) -> list[Outcome]:
    """`run_film`, read from ``folder`` when the same film was run before, else kept there."""
    what = repr((settings, rows, ContourSettings(), Covering()))
    path = folder / f"{seed}-{hashlib.sha256(what.encode()).hexdigest()[:12]}.json"
    if path.is_file():
        return [
            Outcome(DistanceScores(**row["to_position"]), DistanceScores(**row["to_path"]))
            for row in json.loads(path.read_text(encoding="utf-8"))
        ]
    found = run_film(seed, settings, rows, watch)
    folder.mkdir(parents=True, exist_ok=True)
    with output_file(path, overwrite=True) as work:
        work.write_text(json.dumps([asdict(o) for o in found]), encoding="utf-8")
    return found


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
        glance = Glance(float(self.scene.times[index]), views)
        self.state, info = self.tracker.step(self.state, glance, self.rng)
        self.points.append(info.position.point)

    def outcome(self) -> Outcome:
        points = np.array(self.points)
        away = np.sqrt(np.square(points - self.scene.truth).sum(axis=1))
        return Outcome(distance_scores(away), distance_scores(distance_to_path(points, self.scene.truth)))


def over_seeds(outcomes: Mapping[int, Sequence[Outcome]], row: int) -> tuple[DistanceScores, DistanceScores]:
    """Mean over the seeds of the mean, deviation and median, and the greatest maximum; to position and to path."""
    return _pooled([o[row].to_position for o in outcomes.values()]), _pooled(
        [o[row].to_path for o in outcomes.values()]
    )


def _pooled(scores: Sequence[DistanceScores]) -> DistanceScores:
    return DistanceScores(
        float(np.mean([s.mean for s in scores])),
        max(s.maximum for s in scores),
        float(np.mean([s.deviation for s in scores])),
        float(np.mean([s.median for s in scores])),
        sum(s.count for s in scores),
    )
