"""Bodies: contours move and turn with their state, and a learnt body is that of its outlines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.properties.drawn import seeds
from tsuiseki.tracking.bodies.body import Ball, Body, Goldfish, LearntBody, ellipse
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.learn_body import Outline, area_centroids, evenly_sampled, learn_body, line_up

LEARNT = LearntBody(
    "worm",
    np.column_stack([np.linspace(20, -20, 12), np.tile([4.0, -4.0], 6)]),
    np.column_stack([np.zeros(12), np.square(np.linspace(-2, 2, 12))])[None],
    np.full((1, 12, 2), 0.3),
    np.array([[-2.0, 2.0]]),
)
BODIES: list[Body] = [Goldfish(), Ball(), LEARNT]
turns = st.floats(-7, 7)


def states_of(seed: int, count: int = 6) -> FloatArray:
    return np.random.default_rng(seed).normal([100, 80, 0, 0.3], [20, 20, 2, 0.4], (count, 4))


@pytest.mark.parametrize("body", BODIES, ids=lambda body: body.name)
@given(seed=seeds, turn=turns, shift=st.floats(-50, 50))
def test_contours_move_and_turn_with_the_state(body: Body, seed: int, turn: float, shift: float) -> None:
    """A body elsewhere and turned has its contour there, turned about its centre, within its radius."""
    states = states_of(seed)
    moved = states + np.array([shift, -shift, turn, 0.0])
    away = body.contour(states) - states[:, None, :2]
    cos, sin = np.cos(turn), np.sin(turn)
    expected = away @ np.array([[cos, sin], [-sin, cos]]) + moved[:, None, :2]
    # Contours are in single precision.
    np.testing.assert_allclose(body.contour(moved), expected, atol=1e-3)
    assert np.linalg.norm(away, axis=2).max() <= body.radius + 1e-3
    assert max(stroke.last for stroke in body.strokes) == away.shape[1]


@given(seed=seeds)
def test_a_goldfish_bends_alike_to_both_sides(seed: int) -> None:
    """In a mirror a fish that heads and bends to one side heads and bends to the other."""
    fish, states = Goldfish(), states_of(seed)
    tail = fish.contour(states)[:, fish.ellipse_points :]
    mirrored = fish.contour(states * [1, -1, -1, -1])[:, fish.ellipse_points :]
    np.testing.assert_allclose(mirrored, tail * [1, -1], atol=1e-3)
    steps = np.linalg.norm(np.diff(tail, axis=1), axis=2)
    np.testing.assert_allclose(steps, fish.tail / fish.tail_points, rtol=1e-4)


@given(squash=st.floats(0, 0.9), diameter=st.floats(5, 200))
def test_a_squashed_ball_keeps_its_area(squash: float, diameter: float) -> None:
    """Whatever a ball is squashed by, up to its limit, its outline holds the area of the round one."""
    ball = Ball(diameter)
    contours = ball.contour(np.array([[0, 0, 0.3, squash], [0, 0, 0, 0.0]]))
    x, y = np.moveaxis(contours.astype(float), 2, 0)
    areas = 0.5 * (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)
    assert areas[0] == pytest.approx(areas[1], rel=1e-4)
    width = np.linalg.norm(contours[0], axis=1)
    assert width.min() == pytest.approx(diameter / 2 * (1 - min(squash, 0.6)), rel=0.02)


@given(length=st.floats(10, 100), share=st.floats(0.3, 1), points=st.integers(8, 60))
def test_points_of_an_ellipse_lie_on_it_evenly(length: float, share: float, points: int) -> None:
    """All points fulfil its equation, and neighbours stand about equally far from each other."""
    outline = ellipse(length, share * length, points).astype(float)
    np.testing.assert_allclose(np.square(outline / [length / 2, share * length / 2]).sum(axis=1), 1, atol=1e-3)
    fine = ellipse(length, share * length, 16 * points).astype(float)
    steps = np.linalg.norm(np.diff(fine, axis=0, append=fine[:1]), axis=1).reshape(points, 16).sum(axis=1)
    np.testing.assert_allclose(steps, steps.mean(), rtol=0.02)
    np.testing.assert_allclose(outline, fine[::16], atol=1e-3)


def bent_outline(bend: float, turn: float = 0.0, shift: complex = 0.0) -> FloatArray:
    """The outline of a fish, thick ahead, whose back part is bent."""
    upper = np.linspace(-30, 20, 40)
    line = np.concatenate([upper + 1j * (5 + 0.15 * upper), upper[::-1] - 1j * (5 + 0.15 * upper[::-1])])
    line = line + 1j * bend * np.square(np.minimum(line.real, 0)) / 60
    line = line * np.exp(1j * turn) + shift
    return np.column_stack([line.real, line.imag])


def outlines_of(seed: int, turn: float = 0.0, shift: complex = 0.0) -> list[Outline]:
    rng = np.random.default_rng(seed)
    bends, turns_ = rng.uniform(-1, 1, 12), rng.uniform(-3, 3, 12)
    return [
        Outline(k, 1, bent_outline(b, t + turn, shift), 400.0)
        for k, (b, t) in enumerate(zip(bends, turns_, strict=True))
    ]


@settings(max_examples=8)
@given(seed=seeds, turn=turns, shift=st.complex_numbers(max_magnitude=100))
def test_a_body_is_learnt_from_shapes_and_not_from_places(seed: int, turn: float, shift: complex) -> None:
    """Outlines that are all turned and moved give the same body; the states turn and move."""
    fit, moved = learn_body(outlines_of(seed)), learn_body(outlines_of(seed, turn, shift))
    np.testing.assert_allclose(moved.body.mean, fit.body.mean, atol=1e-3)
    np.testing.assert_allclose(moved.body.modes, fit.body.modes, atol=1e-3)
    np.testing.assert_allclose(np.exp(1j * (moved.states[:, 2] - fit.states[:, 2] - turn)), 1, atol=1e-3)
    centres = fit.states[:, 0] + 1j * fit.states[:, 1]
    np.testing.assert_allclose(
        moved.states[:, 0] + 1j * moved.states[:, 1], centres * np.exp(1j * turn) + shift, atol=1e-3
    )


@settings(max_examples=8)
@given(seed=seeds)
def test_bends_are_principal_components(seed: int) -> None:
    """Bends have mean zero and unit variance, and leave what they say; the body drawn again is the outline."""
    outlines = outlines_of(seed)
    fit = learn_body(outlines, modes=2)
    bends = fit.states[:, 3:]
    np.testing.assert_allclose(bends.mean(axis=0), 0, atol=1e-9)
    np.testing.assert_allclose(bends.T @ bends / len(bends), np.eye(2), atol=1e-9)
    assert fit.explained[0] >= fit.explained[1] >= 0
    assert fit.explained.sum() <= 1 + 1e-9
    assert fit.residual <= fit.spread * np.sqrt(1 - fit.explained.sum()) + 1e-9
    drawn = fit.body.contour(fit.states)
    for outline, contour in zip(outlines, drawn, strict=True):
        fine = evenly_sampled(outline.points, 2000)
        apart = np.abs((contour[:, 0] + 1j * contour[:, 1])[:, None] - fine).min(axis=1)
        assert apart.max() < 1.5


@given(seed=seeds, count=st.integers(20, 60), turn=st.floats(-3, 3), slide=st.integers(0, 19))
def test_lines_are_lined_up_by_their_turn_and_first_point(seed: int, count: int, turn: float, slide: int) -> None:
    """Copies of a closed line, turned and begun elsewhere, are laid onto each other, and the turns are told."""
    points = bent_outline(float(np.random.default_rng(seed).uniform(-1, 1)))
    line = evenly_sampled(points, count)
    steps = np.abs(np.diff(line, append=line[:1]))
    assert np.quantile(steps, 0.2) == pytest.approx(steps.max(), rel=0.1)
    line = line - area_centroids(line[None])[0]
    assert area_centroids(line[None])[0] == pytest.approx(0, abs=1e-9)
    copies = np.stack([line, np.roll(line, slide % count) * np.exp(1j * turn)])
    aligned, turns_ = line_up(copies)
    np.testing.assert_allclose(aligned[1], aligned[0], atol=1e-9)
    assert np.exp(1j * (turns_[1] - turns_[0] - turn)) == pytest.approx(1)
    assert replace(LEARNT, name="other").limits.shape == (4, 2)
