"""A skeleton learnt from points, and fitted to points that are missing or wrong."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.animals.skeleton import learn_skeleton
from tsuiseki.tracking.errors import RequestError

NODES = ("head", "thorax", "abdomen", "left", "right")
SHAPE = np.array([[30, 0], [5, 0], [-25, 0], [0, -15], [0, 15]], dtype=float)


def drawn(count, rng, noise=0.3):
    """Points ``(N, K, 2)`` of animals of several sizes that bend sideways, and their headings."""
    theta, size = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.8, 1.3, count)
    shape = np.tile(SHAPE, (count, 1, 1))
    shape[:, 2, 1] += 8 * rng.standard_normal(count)
    shape += noise * rng.standard_normal(shape.shape)
    turn = np.stack([np.cos(theta), np.sin(theta), -np.sin(theta), np.cos(theta)], axis=1).reshape(-1, 2, 2)
    return (size[:, None, None] * shape) @ turn + rng.uniform(50, 500, (count, 1, 2)), theta


def test_missing_and_wrong_points_are_put_where_the_others_say():
    rng = np.random.default_rng(0)
    skeleton = learn_skeleton(NODES, drawn(200, rng)[0])
    points, theta = drawn(50, rng)
    given = points.copy()
    given[::2, 4] = np.nan
    given[1::2, 3] += 60
    place, turn, bends, weights = skeleton.fit(given)
    placed = skeleton.placed(place, turn, bends)
    away = np.abs(placed - (points[..., 0] + 1j * points[..., 1]))
    # Half a pixel of noise on points, and five points for four numbers and the bends.
    assert np.median(away[::2, 4]) < 2.0
    assert np.median(away[1::2, 3]) < 4.0
    assert np.median(weights[1::2, 3]) < 0.2 < np.median(weights[1::2, 0])
    assert np.median(np.abs(np.angle(turn * np.exp(-1j * theta)))) < 0.1


def test_few_labels_teach_a_stiff_skeleton():
    skeleton = learn_skeleton(NODES, drawn(4, np.random.default_rng(1))[0])
    assert len(skeleton.modes) == 0
    assert skeleton.mean[0].real > 0 > skeleton.mean[2].real


def test_front_and_back_have_to_be_known():
    points = drawn(5, np.random.default_rng(2))[0]
    with pytest.raises(RequestError, match="`line`, a point at the back"):
        learn_skeleton(tuple("abcde"), points)
    assert learn_skeleton(tuple("abcde"), points, ("c", "a")).mean[0].real > 0
    with pytest.raises(RequestError, match="two different points"):
        learn_skeleton(NODES, points, ("head", "head"))
    points[:, 3] = np.nan
    with pytest.raises(RequestError, match="left never is"):
        learn_skeleton(NODES, points)
