"""Bodies: contours against closed forms, and what all bodies share."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.bodies.body import Ball, Goldfish, parse_body
from tsuiseki.tracking.errors import RequestError

BODIES = [Goldfish(), Goldfish(length=30, width=8, tail=50, tail_points=1), Ball()]


def random_states(body, count=50):
    rng = np.random.default_rng(3)
    states = rng.uniform([0, 0, -4, 0], [640, 480, 4, 1], (count, 4))
    states[:, 3] = body.limits[3, 0] + states[:, 3] * np.diff(body.limits[3])
    return states


def test_goldfish_points_lie_on_its_ellipse_and_its_tail_line():
    body = Goldfish(length=60, width=20, tail=30)
    a, b, theta, phi = state = np.array([100, 50, 0.7, 0.4])
    points = body.contour(state[None])[0].astype(float) - [a, b]
    along = points @ [np.cos(theta), np.sin(theta)]
    across = points @ [-np.sin(theta), np.cos(theta)]
    on = slice(0, body.ellipse_points)
    assert np.hypot(along[on] / 30, across[on] / 10) == pytest.approx(1.0, abs=1e-5)
    tail = points[body.ellipse_points :] + 30 * np.array([np.cos(theta), np.sin(theta)])
    reach = np.linalg.norm(tail, axis=1)
    assert reach == pytest.approx(np.arange(1, 7) * 5.0, abs=1e-4)
    direction = np.arctan2(tail[:, 1], tail[:, 0])
    assert np.angle(np.exp(1j * (direction - (theta + np.pi - phi)))) == pytest.approx(0.0, abs=1e-5)


def test_positive_bend_puts_the_tail_on_the_side_of_growing_heading():
    bent, mirrored = Goldfish().contour(np.array([[0, 0, 0, 0.5], [0, 0, 0, -0.5]]))[:, -1]
    assert bent[1] > 5
    assert mirrored[1] == pytest.approx(-bent[1])


def test_ellipse_points_are_evenly_spaced_along_the_outline():
    points = Goldfish(length=80, width=16, ellipse_points=40).contour(np.zeros((1, 4)))[0, :40]
    steps = np.linalg.norm(np.diff(np.vstack([points, points[:1]]), axis=0), axis=1)
    assert steps.min() > 0.9 * steps.max()


@pytest.mark.parametrize("squash", [0.0, 0.3, 0.5])
def test_squashed_ball_keeps_its_area(squash):
    x, y = Ball(diameter=50, points=400).contour(np.array([[5, 6, 1.2, squash]]))[0].astype(float).T
    area = 0.5 * abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    assert area == pytest.approx(np.pi * 25**2, rel=1e-3)


@pytest.mark.parametrize("body", BODIES, ids=lambda body: body.name)
def test_contours_move_and_turn_with_the_state_and_stay_within_the_radius(body):
    states = random_states(body)
    points = body.contour(states)
    assert points.dtype == np.float32
    assert np.linalg.norm(points - states[:, None, :2], axis=2).max() <= body.radius + 1e-3
    turned = states + np.array([3.0, -2.0, 0.9, 0.0])
    offset = points - states[:, None, :2]
    rotation = np.array([[np.cos(0.9), np.sin(0.9)], [-np.sin(0.9), np.cos(0.9)]])
    expected = offset @ rotation + turned[:, None, :2]
    assert body.contour(turned) == pytest.approx(expected, abs=1e-3)
    for angle in body.angles:
        full_turn = states + 2 * np.pi * np.eye(4)[angle]
        assert body.contour(full_turn) == pytest.approx(points, abs=1e-3)


@pytest.mark.parametrize("body", BODIES, ids=lambda body: body.name)
def test_one_call_for_all_states_equals_one_call_each(body):
    states = random_states(body, 7)
    one_by_one = np.concatenate([body.contour(s[None]) for s in states])
    assert body.contour(states) == pytest.approx(one_by_one, abs=1e-3)
    assert body.contour(states[:0]).shape == (0, body.strokes[-1].last, 2)
    assert len(body.fields) == len(body.limits) == states.shape[1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("whale", "expected a body of goldfish, ball"),
        ("goldfish,length", "name=number"),
        ("goldfish,span=3", "among length, width"),
        ("ball,diameter=big", "expected a number for diameter"),
        ("goldfish,length=10,width=20", "width up to the length"),
        ("ball,diameter=nan", "diameter above 0"),
    ],
)
def test_wrong_bodies_are_refused_in_one_line(text, message):
    with pytest.raises(RequestError, match=message) as error:
        parse_body(text)
    assert "\n" not in str(error.value)
