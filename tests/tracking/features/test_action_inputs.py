"""Crops and flow as the action streams see them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.features.action import (
    NO_MOTION,
    RGB_FILL,
    STREAMS,
    ActionInput,
    crop_squares,
    flow_picture,
    flow_to,
    square_boxes,
)
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.tracking.preprocessing import normalise


def test_squares_have_the_longer_side_and_keep_the_centre() -> None:
    boxes = np.array([[10, 20, 20, 50], [0, 0, 40, 10.0]])
    local, wide = square_boxes(boxes), square_boxes(boxes, 3.0)
    np.testing.assert_allclose(local, [[0, 20, 30, 50], [0, -15, 40, 25]])
    np.testing.assert_allclose((wide[:, 2:] - wide[:, :2]), [[90, 90], [120, 120]])
    np.testing.assert_allclose(wide[:, :2] + wide[:, 2:], boxes[:, :2] + boxes[:, 2:])


@pytest.mark.parametrize("channels", [2, 3, 6])
def test_crops_at_the_border_are_padded_not_squeezed(channels: int) -> None:
    image = np.full((40, 40, channels), 10, dtype=np.uint8)
    fill = np.array(RGB_FILL if channels == 3 else (NO_MOTION,) * channels)
    crops = crop_squares(image, np.array([[-10, 0, 10, 20], [100, 100, 120, 120], [0, 0, 20, 20.0]]), 20)
    assert (crops[0, :, 10:] == 10).all()
    assert (crops[0, :, :10] == fill).all()
    assert (crops[1] == fill).all()
    assert (crops[2] == 10).all()


def test_a_crop_shows_the_square_at_the_wanted_size() -> None:
    image = np.zeros((60, 60, 3), dtype=np.uint8)
    image[20:40, 20:40] = 200
    crop = crop_squares(image, np.array([[10.0, 10, 50, 50]]), 8)[0]
    assert (crop[2:6, 2:6] == 200).all()
    assert (crop[:2] == 0).all()


def test_flow_is_clipped_scaled_and_normalised_to_one() -> None:
    flow = np.array([[[0, 20], [-20, 90], [10, -500.0]]], dtype=np.float32)
    picture = flow_picture(flow)
    assert picture.dtype == np.uint8
    card = ActionInput("flow_local", 8).card("x", ("a",))
    values = normalise(picture[None], card)[0].transpose(1, 2, 0)
    # A level is 20 / 127 pixels; rounding to it moves a value by half a level at most.
    np.testing.assert_allclose(values, np.clip(flow, -20, 20) / 20, atol=0.51 / 127)


def test_flow_lies_where_the_person_is_now() -> None:
    """A patch that has moved 12 pixels to the right: the flow says so at its place in the second image."""
    rng = np.random.default_rng(0)
    ground = np.full((80, 120, 3), 90, dtype=np.uint8)
    patch = rng.integers(0, 255, (24, 24, 3)).astype(np.uint8)
    before, after = ground.copy(), ground.copy()
    before[30:54, 30:54], after[30:54, 42:66] = patch, patch
    flow = (flow_to(before, after, "dis").astype(float) - NO_MOTION) * 20 / 127
    here = flow[36:48, 48:60]
    np.testing.assert_allclose(np.median(here[..., 0]), 12, atol=0.5)
    np.testing.assert_allclose(np.median(here[..., 1]), 0, atol=0.5)


def test_the_cameras_motion_is_left_in() -> None:
    """The ground moves by (7, -3), a patch by 6 pixels more to the right."""
    rng = np.random.default_rng(0)
    ground = cv2.GaussianBlur(rng.integers(0, 255, (200, 300, 3)).astype(np.uint8), (0, 0), 2)
    patch = cv2.GaussianBlur(rng.integers(0, 255, (36, 36, 3)).astype(np.uint8), (0, 0), 1)
    before, after = ground[20:180, 20:280].copy(), ground[23:183, 13:273].copy()
    before[60:96, 60:96], after[57:93, 73:109] = patch, patch
    flow = (flow_to(before, after, "dis").astype(float) - NO_MOTION) * 20 / 127
    np.testing.assert_allclose(np.median(flow[110:150], axis=(0, 1)), [7, -3], atol=0.25)
    np.testing.assert_allclose(np.median(flow[65:85, 80:102], axis=(0, 1)), [13, -3], atol=0.5)


@pytest.mark.parametrize("stream", STREAMS)
def test_everything_is_in_the_card(stream: str) -> None:
    given = ActionInput(stream, 48, "dis_fast")  # type: ignore[arg-type]
    card = given.card("trunk", ("run", "walk"))
    assert ActionInput.from_card(ModelCard.from_json(card.to_json())) == given
    assert len(card.mean) == len(card.std) == given.channels == (2 if given.is_flow else 3)
    assert given.scale == (3.0 if stream.endswith("global") else 1.0)


def test_impossible_inputs_are_refused() -> None:
    with pytest.raises(ValueError, match="rgb_local"):
        ActionInput("rgb")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="size of 8"):
        ActionInput("rgb_local", size=7)
    card = ActionInput("flow_local").card("x", ("a",))
    with pytest.raises(ValueError, match=r"'stack': 1\}, got .*'stack': 5\}"):
        ActionInput.from_card(replace(card, settings={**card.settings, "stack": 5}))
    with pytest.raises(ValueError, match="dis"):
        ActionInput("flow_local", flow="lk")  # type: ignore[arg-type]
