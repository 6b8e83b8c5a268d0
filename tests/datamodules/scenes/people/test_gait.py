from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.people.gait import STANCE, Manner, standing, stride_length, walking
from tsuiseki.datamodules.scenes.people.outfit import random_build
from tsuiseki.datamodules.scenes.people.posture import Build, PersonSkeleton, Pose, blend, reach_for

BUILD, MANNER = Build(height=1.8), Manner()


def test_standing_straight_is_as_tall_as_the_build_says() -> None:
    skeleton = PersonSkeleton(BUILD, Pose(), np.zeros(2), 0.0)
    # The head's centre lies half a head (a fifteenth of the height) under the crown.
    assert skeleton.head[2] == pytest.approx(1.8 * (1 - 0.065), abs=0.03)
    np.testing.assert_allclose(skeleton.knee[:, 2], 1.8 * (0.039 + 0.246), atol=0.01)
    # Left is +y for somebody who faces +x.
    assert skeleton.hip[0, 1] > 0 > skeleton.hip[1, 1]
    assert (skeleton.toe[:, 0] > skeleton.ankle[:, 0]).all()


def test_heading_turns_the_body() -> None:
    ahead, turned = (PersonSkeleton(BUILD, Pose(knee=(0.3, 0.0)), np.array([2.0, 3.0]), a) for a in (0.0, np.pi / 2))
    offset = ahead.wrist - [2, 3, 0]
    np.testing.assert_allclose(
        turned.wrist, np.stack([2 - offset[:, 1], 3 + offset[:, 0], offset[:, 2]], axis=1), atol=1e-9
    )


@pytest.mark.parametrize("speed", [0.4, 1.0, 1.4, 2.0])
def test_gait_repeats_and_swaps_the_sides(speed: float) -> None:
    for phase in (0.1, 0.37, 0.8):
        now, later, half = (walking(BUILD, MANNER, phase + d, speed) for d in (0, 3, 0.5))
        np.testing.assert_allclose(now.hip, later.hip, atol=1e-9)
        np.testing.assert_allclose(now.knee, later.knee, atol=1e-9)
        np.testing.assert_allclose(now.hip, half.hip[::-1], atol=1e-9)
        np.testing.assert_allclose(now.shoulder, half.shoulder[::-1], atol=1e-9)


@pytest.mark.parametrize("speed", [0.3, 0.9, 1.4, 2.0])
def test_foot_on_the_ground_does_not_slide(speed: float) -> None:
    rng = np.random.default_rng(0)
    for build in (BUILD, random_build(rng), random_build(rng)):
        stride = stride_length(build, MANNER, speed)
        phases = np.linspace(0, 0.999 * STANCE, 30)
        ankles = np.array(
            [
                PersonSkeleton(build, walking(build, MANNER, p, speed), np.array([p * stride, 0]), 0.0).ankle[0]
                for p in phases
            ]
        )
        # Up to the thousandth of the leg by which the knee is kept from locking.
        assert np.ptp(ankles[:, 0]) < 0.002
        flat = phases < 0.5 * STANCE
        assert np.ptp(ankles[flat, 2]) < 0.01


def test_feet_never_sink() -> None:
    for phase in np.linspace(0, 1, 25):
        skeleton = PersonSkeleton(BUILD, walking(BUILD, MANNER, phase, 1.4), np.zeros(2), 0.3)
        assert min(skeleton.ankle[:, 2].min(), skeleton.toe[:, 2].min()) > 0.02


def test_reach_puts_the_ankle_where_asked() -> None:
    hip, knee = reach_for(BUILD, 0.3, 0.7)
    skeleton = PersonSkeleton(BUILD, Pose(hip=(hip, hip), knee=(knee, knee)), np.zeros(2), 0.0)
    offset = skeleton.ankle[0] - skeleton.hip[0]
    np.testing.assert_allclose(offset[[0, 2]], [0.3, -0.7], atol=1e-9)
    assert knee > 0


def test_blend_goes_from_one_pose_to_the_other() -> None:
    a, b = walking(BUILD, MANNER, 0.2, 1.4), standing(np.random.default_rng(0), MANNER)
    assert blend(a, b, 0.0) == a
    assert blend(a, b, 1.0).hip == pytest.approx(b.hip)
    assert blend(a, b, 0.5).lean == pytest.approx((a.lean + b.lean) / 2)
