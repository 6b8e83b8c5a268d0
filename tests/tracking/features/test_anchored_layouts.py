"""Heads beside anchors: counts and places of MediaPipe's graphs, codes there and back, and bodies in all poses."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.features.anchored_layouts import (
    SLENDERNESS,
    blazepose_anchors,
    blazepose_boxes,
    is_blazepose,
    is_ssd,
    ssd_anchors,
    ssd_boxes,
)
from tsuiseki.tracking.features.layout_recognition import possible_layouts

SIZE = (224, 224)


def test_anchors_are_as_many_as_the_published_networks_have():
    assert len(ssd_anchors(300, 300)) == 3 * 19**2 + 6 * (10**2 + 5**2 + 3**2 + 2**2 + 1)
    assert len(blazepose_anchors(*SIZE)) == 2 * 28**2 + 2 * 14**2 + 6 * 7**2


def test_the_first_and_the_last_anchors_of_an_ssd():
    anchors = ssd_anchors(300, 300)
    np.testing.assert_allclose(anchors[0], [0.5 / 19, 0.5 / 19, 0.1, 0.1])
    np.testing.assert_allclose(anchors[1], [0.5 / 19, 0.5 / 19, 0.2 * 2**0.5, 0.2 / 2**0.5])
    np.testing.assert_allclose(anchors[3, :2], [1.5 / 19, 0.5 / 19])
    np.testing.assert_allclose(anchors[-1], [0.5, 0.5, 0.95**0.5, 0.95**0.5])


def test_the_code_of_a_box_there_and_back():
    rng = np.random.default_rng(0)
    anchors = ssd_anchors(300, 300)
    middle, sides = rng.uniform(0, 1, (len(anchors), 2)), rng.uniform(0.01, 1, (len(anchors), 2))
    places = 10 * (middle - anchors[:, :2]) / anchors[:, 2:]
    logs = 5 * np.log(sides / anchors[:, 2:])
    codes = np.concatenate([places[:, ::-1], logs[:, ::-1]], axis=1)
    boxes = np.concatenate([middle - sides / 2, middle + sides / 2], axis=1) * 300
    np.testing.assert_allclose(ssd_boxes(codes, 300, 300), boxes, atol=1e-9)


@pytest.mark.parametrize(("end", "half"), [((0, -50), (50 * SLENDERNESS, 50)), ((50, 0), (50, 50 * SLENDERNESS))])
def test_the_box_of_a_body_that_stands_or_lies(end, half):
    codes = np.zeros((2254, 12))
    codes[:, 6:8] = end
    boxes = blazepose_boxes(codes, *SIZE)
    centre = blazepose_anchors(*SIZE) * 224
    np.testing.assert_allclose((boxes[:, :2] + boxes[:, 2:]) / 2, centre, atol=1e-9)
    np.testing.assert_allclose((boxes[:, 2:] - boxes[:, :2]) / 2, np.tile(half, (2254, 1)))


def test_they_are_recognised_by_the_number_of_their_rows():
    rng = np.random.default_rng(0)
    ssd = {"a": rng.normal(size=(1917, 4)), "b": rng.normal(size=(1917, 24))}
    pose = {"a": rng.normal(size=(2254, 12)), "b": rng.normal(size=(2254, 1))}
    assert possible_layouts(ssd, (300, 300)) == ["ssd"]
    assert possible_layouts(pose, SIZE) == ["blazepose"]
    assert not is_ssd([*ssd.values()], 320, 320)
    assert not is_blazepose([*pose.values()], 256, 256)
    corners = np.sort(rng.uniform(size=(1917, 2, 2)), axis=1).reshape(-1, 4)
    assert "ssd" not in possible_layouts({"a": corners, "b": ssd["b"]}, (300, 300))
