"""Learning motion: the increments (10)-(14) by hand, and motions of known parameters recovered."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.body_motion import BodyFixedVelocity, Noise
from tsuiseki.tracking.filters.learnt_motion import read_motion, write_motion
from tsuiseki.trainers.learn_motion import learn_motion, track_steps

FIELDS, ANGLES = ("a", "b", "theta", "phi"), (2, 3)
COVARIANCE = np.array(
    [[1.0, 0.1, 0.0, 0.02], [0.1, 2.0, -0.1, -0.25], [0.0, -0.1, 0.02, 0.01], [0.02, -0.25, 0.01, 0.06]]
)
MEAN = np.array([0.02, -0.01, 0.03, 0.01])


def wandering(frames=4000, seed=0, mean=MEAN, gain=None):
    """A track whose increments are drawn from `COVARIANCE` about ``mean``."""
    rng = np.random.default_rng(seed)
    motion = BodyFixedVelocity(
        Noise(mean, np.linalg.cholesky(COVARIANCE)), Noise(np.array([6.0, 0.0]), np.eye(2)), gain
    )
    particles = motion.start(np.array([[300.0, 200.0, 3.0, 0.1]]), rng)
    states = [particles[0, :4]]
    for _ in range(frames - 1):
        particles = motion(particles, 1, rng)
        states.append(particles[0, :4])
    return np.array(states)


def covariance(components):
    return components.components @ np.diag(components.variances) @ components.components.T


def learnt(*tracks, frame_rate=30.0):
    return learn_motion(tracks, "goldfish", FIELDS, ANGLES, frame_rate)


def test_increments_are_those_of_the_paper():
    states = np.array([[10.0, 20.0, 0.2, 0.1], [14.0, 21.0, 0.3, -0.1], [17.0, 25.0, 0.6, 0.3]])
    steps = track_steps(states, ANGLES)
    velocity, last = np.array([4.0, 1.0]), np.array([3.0, 4.0])

    def back(angle):
        return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])

    np.testing.assert_allclose(steps.walk, [[3.0, 4.0, 0.3, 0.4]])
    np.testing.assert_allclose(steps.image, [[-1.0, 3.0, 0.3, 0.4]])
    np.testing.assert_allclose(steps.printed[0, :2], back(0.6) @ (last - velocity))
    np.testing.assert_allclose(steps.velocity[0], back(0.6) @ last)
    np.testing.assert_allclose(steps.increments[0], [*(back(0.6) @ last - back(0.3) @ velocity), 0.3, 0.4])
    np.testing.assert_allclose(steps.changes[0], [*steps.increments[0, :2], 0.3 - 0.1, 0.4 + 0.2])
    np.testing.assert_allclose(steps.conditions[0, :2], back(0.3) @ velocity)


def test_printed_and_added_differ_exactly_in_turns():
    frames = np.arange(60)
    heading = 0.15 * frames
    circle = np.cumsum(5.0 * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
    straight = np.stack([5.0 * frames, 0.0 * frames], axis=1)
    zeros = np.zeros(60)
    turning = track_steps(np.column_stack([circle, heading, zeros]), ANGLES)
    going = track_steps(np.column_stack([straight, zeros, zeros]), ANGLES)
    # In a steady turn the body-fixed velocity never changes, and the acceleration of (14) is that of the circle.
    np.testing.assert_allclose(turning.increments[:, :2], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(turning.printed[:, :2], axis=1), 2 * 5.0 * np.sin(0.075))
    np.testing.assert_allclose(going.printed, going.increments)


def test_angles_wrap_around():
    track = wandering()
    wrapped = track.copy()
    wrapped[:, 2] = np.angle(np.exp(1j * wrapped[:, 2]))
    assert np.abs(np.diff(wrapped[:, 2])).max() > 6.0
    np.testing.assert_allclose(learnt(wrapped).increments.mean, learnt(track).increments.mean, atol=1e-12)
    np.testing.assert_allclose(covariance(learnt(wrapped).walk), covariance(learnt(track).walk), atol=1e-9)


def test_mean_and_components_of_known_increments_are_recovered():
    found = learnt(wandering(seed=1), wandering(seed=2))
    # Standard errors of means and of covariances of 7,996 normal rows, five times.
    deviation = np.sqrt(np.diag(COVARIANCE))
    assert np.all(np.abs(found.increments.mean - MEAN) < 5 * deviation / np.sqrt(found.steps))
    error = np.abs(covariance(found.increments) - COVARIANCE) / np.outer(deviation, deviation)
    assert error.max() < 5 * np.sqrt(2 / found.steps)
    assert np.all(np.diff(found.increments.variances) <= 0)
    np.testing.assert_allclose(found.increments.components.T @ found.increments.components, np.eye(4), atol=1e-12)
    wider = found.widened(1.5).proposal().noise
    np.testing.assert_allclose(wider.deviation, 1.5 * found.proposal().noise.deviation)
    printed = found.printed_proposal()
    np.testing.assert_array_equal(printed.noise.mean, 0.0)
    assert not np.allclose(covariance(found.printed), covariance(found.increments), rtol=0.05)


@pytest.mark.slow
def test_the_dependence_on_bend_and_rates_is_recovered():
    gain = np.zeros((4, 6))
    gain[0, 0], gain[1, 1] = -0.05, -0.3  # drag
    gain[2, 2], gain[3, 3], gain[3, 5] = 0.02, -0.4, 0.5
    motion = learnt(*(wandering(seed=s, gain=gain) for s in range(5))).conditional()
    assert motion.gain is not None
    np.testing.assert_allclose(motion.gain[2, 2], 0.02, atol=0.005)
    np.testing.assert_allclose(motion.gain[3, [3, 5]], [-0.4, 0.5], atol=0.05)
    np.testing.assert_allclose(np.diag(motion.gain)[:2], [-0.05, -0.3], atol=0.03)
    np.testing.assert_allclose(motion.noise.factor @ motion.noise.factor.T, COVARIANCE, atol=0.06)


def test_frame_rates_scale_smooth_motion():
    # The same smooth way, filmed at 60 and at 20 frames a second.
    def way(rate):
        time = np.arange(0, 40, 1 / rate)
        heading = 1.5 * np.sin(0.9 * time) + 0.6 * np.sin(2.1 * time)
        bend = 0.5 * np.sin(2.3 * time + 0.4)
        speed = 90 + 40 * np.sin(1.3 * time)
        side = 25 * np.sin(1.9 * time + 1.0)
        cosine, sine = np.cos(heading), np.sin(heading)
        moved = np.stack([cosine * speed - sine * side, sine * speed + cosine * side], axis=1) / rate
        return np.column_stack([np.cumsum(moved, axis=0), heading, bend])

    fast, slow = learnt(way(60.0), frame_rate=60.0), learnt(way(20.0), frame_rate=20.0)
    scaled = fast.at(20.0)
    for name in ("walk", "velocity", "image", "increments", "printed"):
        found, expected = covariance(getattr(scaled, name)), covariance(getattr(slow, name))
        deviation = np.sqrt(np.diag(expected))
        # A step at 20 frames/s is up to 0.1 rad of these oscillations, whose chords are 1 % shorter than their arcs.
        np.testing.assert_allclose(
            found / np.outer(deviation, deviation), expected / np.outer(deviation, deviation), atol=0.08
        )
    np.testing.assert_allclose(scaled.at(60.0).gain, fast.gain)
    assert fast.at(60.0) is fast


def test_the_file_keeps_everything(tmp_path):
    motion = learnt(wandering(200))
    write_motion(tmp_path / "motion.json", motion)
    again = read_motion(tmp_path / "motion.json", "goldfish", 4)
    assert (again.body, again.columns, again.frame_rate, again.steps) == ("goldfish", FIELDS, 30.0, 198)
    for name in ("walk", "velocity", "image", "increments", "printed", "residual"):
        np.testing.assert_array_equal(getattr(again, name).components, getattr(motion, name).components)
    np.testing.assert_array_equal(again.gain, motion.gain)
    assert (tmp_path / "motion.json").stat().st_size < 10_000


def no_bend():
    track = wandering(100)
    track[:, 3] = 0.0
    return track


def rigid():
    track = wandering(100)
    track[:, 3] = 0.5 * track[:, 2]
    return track


@pytest.mark.parametrize(
    ("track", "expected"),
    [
        (wandering(11), "at least 10 steps to learn from, got 9"),
        (wandering(2), "got 0"),
        (no_bend(), "phi never changes"),
        (rigid(), "singular covariance"),
    ],
)
def test_what_cannot_be_learnt_from_is_refused(track, expected):
    with pytest.raises(RequestError, match=expected):
        learnt(track)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"body": "ball"}, "expected motion of the body goldfish, got that of ball"),
        ({"columns": ["a", "b", "theta"]}, "expected motion of 4 columns, as goldfish has, got 3"),
        ({"format": "else"}, "got something else"),
        ({"frame_rate": 0}, "frame rate above 0"),
        ({"gain": [[1.0]]}, "finite numbers of shape"),
        ({"walk": {"mean": [0, 0, 0, 0]}}, "broken motion file"),
    ],
)
def test_other_files_are_refused(tmp_path, change, expected):
    path = tmp_path / "motion.json"
    write_motion(path, learnt(wandering(50)))
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(RequestError, match=expected):
        read_motion(path, "goldfish", 4)


def test_no_file_and_no_json_are_refused(tmp_path):
    with pytest.raises(RequestError, match="found no"):
        read_motion(tmp_path / "none.json", "goldfish", 4)
    (tmp_path / "text.json").write_text("not json")
    with pytest.raises(RequestError, match="got no JSON"):
        read_motion(tmp_path / "text.json", "goldfish", 4)
