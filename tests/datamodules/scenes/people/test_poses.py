"""Poses of people who neither stand nor walk: as asked, balanced, near the ground where they lie."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.people.poses import _DRAWN, draw_pose, random_name
from tsuiseki.datamodules.scenes.people.posture import (
    Build,
    PersonSkeleton,
    Pose,
    balanced,
    mass_ahead,
    mirrored,
)

BUILD = Build(1.7)


def placed(name: str, seed: int, heading: float = 0.0) -> PersonSkeleton:
    return PersonSkeleton(BUILD, draw_pose(seed, BUILD, name), np.zeros(2), heading)


@pytest.mark.parametrize("name", _DRAWN)
def test_a_pose_is_that_of_its_seed(name: str) -> None:
    assert draw_pose(3, BUILD, name) == draw_pose(3, BUILD, name)
    assert draw_pose(3, BUILD, name) != draw_pose(4, BUILD, name)
    skeleton = placed(name, 3)
    assert np.linalg.norm(skeleton.knee - skeleton.hip, axis=1) == pytest.approx(BUILD.thigh)


def test_every_pose_is_drawn() -> None:
    rng = np.random.default_rng(0)
    assert {random_name(rng) for _ in range(300)} == set(_DRAWN)


@pytest.mark.parametrize("name", ["crouching", "bending"])
def test_feet_carry_who_crouches_or_bends(name: str) -> None:
    ahead = [abs(mass_ahead(placed(name, seed))) for seed in range(20)]
    assert np.median(ahead) < 0.01
    assert max(ahead) < 0.25
    leaning = Pose(lean=1.2, hip=(0.2, 0.2), knee=(0.2, 0.2))
    before, after = (
        mass_ahead(PersonSkeleton(BUILD, pose, np.zeros(2), 0.0)) for pose in (leaning, balanced(BUILD, leaning))
    )
    assert abs(after) < 0.01 < before


def test_who_lies_is_near_the_ground_and_longer_than_high() -> None:
    for seed in range(20):
        s = placed("lying", seed)
        joints = np.concatenate([s.pelvis[None], s.chest[None], s.head[None], s.knee, s.ankle])
        assert joints[:, 2].min() > 0
        assert max(s.pelvis[2], s.chest[2], s.head[2]) < 0.6
        assert np.ptp(joints[:, :2], axis=0).max() > 1.3 * np.ptp(joints[:, 2])


def test_heads_are_lower_than_of_who_stands() -> None:
    for name, most in (("crouching", 1.35), ("kneeling", 1.45), ("sitting", 1.4), ("bending", 1.6)):
        assert max(placed(name, seed).head[2] for seed in range(12)) < most


def test_who_cycles_has_both_feet_on_the_cranks_and_both_hands_ahead() -> None:
    for seed in range(20):
        s = placed("cycling", seed)
        # Two cranks of 0.097 of the height, opposite to each other; the legs may straddle a little.
        assert np.linalg.norm((s.ankle[0] - s.ankle[1])[[0, 2]]) == pytest.approx(2 * 0.097 * 1.7, rel=0.05)
        assert (s.fingers[:, 0] > s.pelvis[0] + 0.25).all()
        assert (s.knee[:, 0] > s.hip[:, 0]).all()


def test_the_mirror_image_swaps_the_sides() -> None:
    pose = draw_pose(5, BUILD, "falling")
    assert mirrored(mirrored(pose)) == pose
    here, there = (PersonSkeleton(BUILD, p, np.zeros(2), 0.0) for p in (pose, mirrored(pose)))
    np.testing.assert_allclose(here.wrist * [1, -1, 1], there.wrist[::-1], atol=1e-9)
    np.testing.assert_allclose(here.ankle * [1, -1, 1], there.ankle[::-1], atol=1e-9)


def test_a_pitched_body_turns_with_its_heading() -> None:
    ahead, aside = (
        PersonSkeleton(BUILD, Pose(tilt=(np.pi / 2, 0.0)), np.array([2.0, 3.0]), h) for h in (0.0, np.pi / 2)
    )
    np.testing.assert_allclose(ahead.head - ahead.pelvis, [ahead.head[0] - 2, 0, 0], atol=0.06)
    assert ahead.head[0] > 2.6
    assert aside.head[1] > 3.6
