from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.figures.assets import BONES, Assets
from tsuiseki.datamodules.scenes.figures.figure import Figure
from tsuiseki.datamodules.scenes.figures.rendering import _bones, posed, shortest_turn
from tsuiseki.datamodules.scenes.people.posture import Build, PersonSkeleton, Pose


@pytest.fixture(scope="module")
def figure(assets: Assets) -> Figure:
    return Figure(np.random.default_rng(1), assets)


def test_the_shortest_turn_takes_one_direction_to_the_other() -> None:
    rng = np.random.default_rng(0)
    for a, b in [*rng.normal(size=(20, 2, 3)), (np.array([1.0, 0, 0]), np.array([-2.0, 0, 0]))]:
        turn = shortest_turn(a, b)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(turn) == pytest.approx(1)
        np.testing.assert_allclose(turn @ a / np.linalg.norm(a), b / np.linalg.norm(b), atol=1e-9)


def test_limbs_point_as_the_skeletons_and_keep_their_lengths(figure: Figure) -> None:
    pose = Pose(shoulder=(1.2, -0.3), elbow=(0.5, 0.2), hip=(0.6, -0.4), knee=(0.3, 0.8), lean=0.1, twist=0.2)
    skeleton = PersonSkeleton(Build(1.7), pose, np.zeros(2), 0.7)
    _, origins = _bones(figure, skeleton)
    for part, after, joints in (
        ("upperarm", "lowerarm", (skeleton.shoulder, skeleton.elbow)),
        ("upperleg", "lowerleg", (skeleton.hip, skeleton.knee)),
        ("lowerleg", "foot", (skeleton.knee, skeleton.ankle)),
    ):
        for k, side in enumerate("LR"):
            a, b = BONES.index(f"{part}.{side}"), BONES.index(f"{after}.{side}")
            mine = origins[b] - origins[a]
            wanted = joints[1][k] - joints[0][k]
            assert np.linalg.norm(mine) == pytest.approx(np.linalg.norm(figure.joints[b] - figure.joints[a]))
            np.testing.assert_allclose(mine / np.linalg.norm(mine), wanted / np.linalg.norm(wanted), atol=1e-9)


def test_turning_the_whole_skeleton_turns_the_figure(figure: Figure) -> None:
    pose = Pose(shoulder=(0.4, -0.3), hip=(0.3, -0.3))
    ahead, aside = (
        posed(figure, PersonSkeleton(Build(1.7), pose, np.zeros(2), heading)) for heading in (0.0, np.pi / 2)
    )
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    for a, b in zip(ahead, aside, strict=True):
        np.testing.assert_allclose(b - b.mean(axis=0), (a - a.mean(axis=0)) @ quarter.T, atol=1e-9)


def test_the_lowest_point_stands_on_the_ground(figure: Figure) -> None:
    meshes = posed(figure, PersonSkeleton(Build(1.7), Pose(hip=(0.5, -0.5)), np.zeros(2), 0.0))
    assert min(v[:, 2].min() for v in meshes) == pytest.approx(0)
