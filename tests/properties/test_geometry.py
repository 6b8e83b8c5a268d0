"""Boxes, turned boxes and polygons: symmetries, and areas by counting."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from tests.properties.drawn import boxes_of, seeds
from tsuiseki.tracking.counts.polygons import area, distance_to_border, inside
from tsuiseki.tracking.features.camera_motion import CameraStep, undone
from tsuiseki.tracking.features.camera_path import move_boxes
from tsuiseki.tracking.formats.rotated import about_bodies
from tsuiseki.tracking.geometry import (
    about_rotated,
    clip_boxes,
    corners_from_xywh,
    iou_matrix,
    iou_pairs,
    rotated_iou,
    shared_with_all,
    suppress,
    xywh_from_corners,
)
from tsuiseki.tracking.types import FloatArray

whole_boxes = arrays.arrays(np.int64, (4, 4), elements=st.integers(0, 9)).map(
    lambda rows: np.concatenate([np.minimum(rows[:, :2], rows[:, 2:]), np.maximum(rows[:, :2], rows[:, 2:])], axis=1)
)
scales = st.floats(0.01, 100)
shifts = st.floats(-1000, 1000)
turns = st.floats(-7, 7)


@given(boxes=whole_boxes)
def test_overlaps_are_those_of_counted_pixels(boxes: FloatArray) -> None:
    """Of boxes with whole corners, the intersection over union is that of the pixels that they cover."""
    pixels = [{*itertools.product(range(x1, x2), range(y1, y2))} for x1, y1, x2, y2 in boxes.tolist()]
    expected = [[len(a & b) / max(len(a | b), 1) for b in pixels] for a in pixels]
    np.testing.assert_allclose(iou_matrix(boxes.astype(float), boxes.astype(float)), expected)


@given(seed=seeds, scale=scales, shift=shifts)
def test_overlaps_are_symmetric_and_without_a_unit(seed: int, scale: float, shift: float) -> None:
    """Two boxes overlap as much both ways, elsewhere, and in another unit; each overlaps itself in full."""
    boxes = boxes_of(np.random.default_rng(seed), 5, 60)
    overlaps = iou_matrix(boxes, boxes)
    np.testing.assert_array_equal(overlaps, overlaps.T)
    np.testing.assert_array_equal(np.diag(overlaps), 1)
    np.testing.assert_allclose(iou_matrix(scale * boxes + shift, scale * boxes + shift), overlaps, atol=1e-6)
    np.testing.assert_allclose(iou_pairs(boxes, boxes[::-1]), overlaps[np.arange(5), np.arange(5)[::-1]])


@given(boxes=whole_boxes)
def test_corners_and_sizes_say_the_same(boxes: FloatArray) -> None:
    """Boxes written as place and size come back as they were."""
    np.testing.assert_array_equal(corners_from_xywh(xywh_from_corners(boxes)), boxes)


@given(boxes=whole_boxes, which=arrays.arrays(np.bool_, (4, 4)))
def test_what_several_boxes_share_with_one_lies_between_most_and_sum(boxes: FloatArray, which: np.ndarray) -> None:
    """The covered share of a box is at least that of any box that counts, and at most that of all together."""
    boxes = boxes.astype(float)
    boxes[:, 2:] += 1
    one_by_one = np.array([[shared_with_all(a[None], b[None])[0] for b in boxes] for a in boxes]) * which
    together = shared_with_all(boxes, boxes, which)
    assert (together >= one_by_one.max(axis=1) - 1e-9).all()
    assert (together <= np.minimum(one_by_one.sum(axis=1), 1) + 1e-9).all()


@given(seed=seeds, limit=st.floats(0.05, 0.95), count=st.integers(0, 8))
def test_suppression_leaves_the_best_of_those_that_overlap(seed: int, limit: float, count: int) -> None:
    """No two that stay overlap by more than the limit; who goes overlaps a better one that stays by more."""
    rng = np.random.default_rng(seed)
    boxes, scores = boxes_of(rng, count, 40), rng.normal(size=count)
    chosen = suppress(boxes, scores, limit).tolist()
    assert scores[chosen].tolist() == sorted(scores[chosen], reverse=True)
    over = iou_matrix(boxes, boxes) > limit
    assert not any(over[a, b] for a, b in itertools.combinations(chosen, 2))
    for gone in set(range(count)) - {*chosen}:
        assert any(over[gone, k] and scores[k] > scores[gone] for k in chosen)


@given(seed=seeds, width=st.integers(1, 300), height=st.integers(1, 300))
def test_clipped_boxes_are_the_part_in_the_picture(seed: int, width: int, height: int) -> None:
    """A clipped box lies in the picture, and shares with it what the whole box does."""
    boxes = boxes_of(np.random.default_rng(seed), 6) - 60
    clipped, picture = clip_boxes(boxes, width, height), np.array([0, 0, width, height])
    assert ((clipped >= 0) & (clipped <= np.tile([width, height], 2))).all()
    for box, part in zip(boxes, clipped, strict=True):
        side = np.minimum(box[2:], picture[2:]) - np.maximum(box[:2], 0)
        np.testing.assert_allclose((part[2:] - part[:2]).prod(), np.maximum(side, 0).prod(), atol=1e-9)


def turned_boxes(rng: np.random.Generator, count: int) -> FloatArray:
    sizes = rng.uniform(5, 50, (count, 2))
    return np.column_stack([rng.uniform(0, 60, (count, 2)), sizes, rng.uniform(-np.pi, np.pi, count)])


@given(seed=seeds)
def test_boxes_that_are_not_turned_overlap_as_upright_ones(seed: int) -> None:
    """At an angle of 0 and of half a turn, turned boxes overlap as upright ones do."""
    boxes = boxes_of(np.random.default_rng(seed), 4, 60)
    for angle in (0.0, np.pi):
        turned = np.column_stack([(boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2], np.full(4, angle)])
        # OpenCV takes what two boxes share for nothing where it is a sliver.
        np.testing.assert_allclose(rotated_iou(turned, turned), iou_matrix(boxes, boxes), atol=1e-3)
        np.testing.assert_allclose(about_rotated(turned), boxes)


@given(seed=seeds, turn=turns, shift=shifts)
def test_turned_boxes_overlap_the_same_after_a_turn(seed: int, turn: float, shift: float) -> None:
    """Turned boxes overlap as much both ways, and after all of them are turned about a point and moved."""
    boxes = turned_boxes(np.random.default_rng(seed), 4)
    moved = boxes.copy()
    cos, sin = np.cos(turn), np.sin(turn)
    moved[:, :2] = boxes[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + shift
    moved[:, 4] += turn
    overlaps = rotated_iou(boxes, boxes)
    # OpenCV computes in single precision.
    np.testing.assert_allclose(overlaps, overlaps.T, atol=1e-3)
    np.testing.assert_allclose(rotated_iou(moved, moved), overlaps, atol=2e-3)


@given(seed=seeds)
def test_a_box_about_a_turned_one_touches_its_outermost_corners(seed: int) -> None:
    """It reaches as far as the corners do, and the one about a body no farther, and as far as its shorter half."""
    boxes = turned_boxes(np.random.default_rng(seed), 5)
    for box, upright, body in zip(boxes, about_rotated(boxes), about_bodies(boxes), strict=True):
        cos, sin = np.cos(box[4]), np.sin(box[4])
        corners = np.array([[a, b] for a in (-0.5, 0.5) for b in (-0.5, 0.5)]) * box[2:4] @ [[cos, sin], [-sin, cos]]
        np.testing.assert_allclose(upright, [*(box[:2] + corners.min(axis=0)), *(box[:2] + corners.max(axis=0))])
        assert (body[:2] >= upright[:2] - 1e-9).all()
        assert (body[2:] - body[:2] >= box[2:4].min() - 1e-9).all()


@given(seed=seeds, scale=scales, turn=turns)
def test_a_camera_step_and_its_undoing_leave_boxes_in_place(seed: int, scale: float, turn: float) -> None:
    """Boxes moved by a similarity and back are where they were; two steps in turn are the step of both."""
    rng = np.random.default_rng(seed)
    boxes, (dx, dy) = boxes_of(rng, 4), rng.normal(0, 30, 2)
    cos, sin = scale * np.cos(turn), scale * np.sin(turn)
    step, shift = np.array([[cos, -sin, dx], [sin, cos, dy]]), np.array([[1.0, 0, dy], [0, 1, dx]])
    np.testing.assert_allclose(move_boxes(move_boxes(boxes, step), undone(step)), boxes, atol=1e-6)
    both = CameraStep(step, 3.0).and_then(CameraStep(shift, 4.0))
    np.testing.assert_allclose(move_boxes(boxes, both.similarity), move_boxes(move_boxes(boxes, step), shift))
    assert both.deviation == 5


def polygon_of(rng: np.random.Generator) -> FloatArray:
    """Corners about a point at rising angles: it does not cross itself."""
    count = int(rng.integers(3, 8))
    angles = np.sort(rng.uniform(0, 2 * np.pi, count))
    return np.column_stack([np.cos(angles), np.sin(angles)]) * rng.uniform(20, 80, (count, 1)) + 100


@given(seed=seeds)
def test_points_lie_in_a_polygon_where_the_angles_to_its_corners_go_round(seed: int) -> None:
    """The even-odd rule agrees with the winding number, whichever corner is the first and whichever way they go."""
    rng = np.random.default_rng(seed)
    corners, points = polygon_of(rng), rng.uniform(0, 200, (20, 2))
    away = corners[None] - points[:, None]
    angles = np.arctan2(away[..., 1], away[..., 0])
    steps = np.roll(angles, -1, axis=1) - angles
    winding = np.rint(((steps + np.pi) % (2 * np.pi) - np.pi).sum(axis=1) / (2 * np.pi)) != 0
    np.testing.assert_array_equal(inside(points, corners), winding)
    np.testing.assert_array_equal(inside(points, np.roll(corners[::-1], 2, axis=0)), winding)


@given(seed=seeds, shift=shifts, scale=scales)
def test_areas_and_distances_keep_their_measure(seed: int, shift: float, scale: float) -> None:
    """A polygon's area is that of its triangles, changes its sign with the direction, and grows with the square."""
    rng = np.random.default_rng(seed)
    corners, points = polygon_of(rng), rng.uniform(0, 200, (20, 2))
    first, edges = corners[0], corners[1:] - corners[0]
    triangles = [0.5 * float(a[0] * b[1] - a[1] * b[0]) for a, b in itertools.pairwise(edges)]
    assert area(corners) == pytest.approx(sum(triangles))
    assert area(corners[::-1]) == pytest.approx(-area(corners))
    assert area(scale * corners + shift) == pytest.approx(scale**2 * area(corners), rel=1e-3, abs=1e-3)
    fine = np.concatenate([np.linspace(a, b, 200) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    near = np.linalg.norm(points[:, None] - fine[None], axis=2).min(axis=1)
    # Points on the border stand up to a pixel apart.
    np.testing.assert_allclose(distance_to_border(points, corners), near, atol=0.5)
    assert distance_to_border(first[None], corners)[0] == pytest.approx(0, abs=1e-9)
