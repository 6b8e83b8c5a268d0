"""Anchors, their box code, and anchors fitted to labels."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import torch

from tsuiseki.models.anchors import corners_from_centres, decode, encode, grid_anchors, propose_anchors, size_iou
from tsuiseki.tracking.features.exported import decode_boxes


def test_anchors_lie_on_the_middles_of_the_cells() -> None:
    anchors = grid_anchors([(2, 3)], [8], [[(10, 20), (4, 6)]])
    assert anchors.shape == (12, 4)
    assert anchors[0].tolist() == [4, 4, 10, 20]
    assert anchors[1].tolist() == [4, 4, 4, 6]
    assert anchors[2].tolist() == [12, 4, 10, 20]
    assert anchors[-1].tolist() == [20, 12, 4, 6]


def test_an_anchor_itself_has_code_zero() -> None:
    anchors = torch.tensor([[50.0, 60.0, 20.0, 40.0]])
    assert torch.equal(encode(corners_from_centres(anchors), anchors), torch.zeros(1, 4))


def test_box_code_by_hand() -> None:
    # Two pixels right of an anchor of width 20, twice as high: 2/20/0.1 = 1 and log(2)/0.2.
    code = encode(torch.tensor([[42.0, 20.0, 62.0, 100.0]]), torch.tensor([[50.0, 60.0, 20.0, 40.0]]))
    assert torch.allclose(code, torch.tensor([[1.0, 0.0, 0.0, math.log(2) / 0.2]]), atol=1e-6)


def test_decoding_inverts_encoding_here_and_in_the_tracker() -> None:
    rng = np.random.default_rng(0)
    anchors = np.column_stack([rng.uniform(0, 300, (50, 2)), rng.uniform(5, 90, (50, 2))]).astype(np.float32)
    corner = rng.uniform(0, 300, (50, 2))
    boxes = np.column_stack([corner, corner + rng.uniform(4, 100, (50, 2))])
    code = encode(torch.tensor(boxes, dtype=torch.float32), torch.from_numpy(anchors))
    # Float32 keeps seven digits of coordinates up to 400.
    assert np.allclose(decode(code, torch.from_numpy(anchors)), boxes, atol=1e-3)
    assert np.allclose(decode_boxes(code.numpy(), anchors, (0.1, 0.2)), boxes, atol=1e-3)


def test_proposed_anchors_find_the_sizes_there_are() -> None:
    rng = np.random.default_rng(1)
    true = np.array([[10.0, 25.0], [20.0, 50.0], [40.0, 110.0]])
    sizes = np.repeat(true, 40, axis=0) * np.exp(rng.normal(0, 0.03, (120, 2)))
    boxes = np.concatenate([np.zeros((120, 2)), sizes], axis=1)
    levels, fit = propose_anchors(boxes, (2, 1), rng)
    # The geometric mean of 40 draws that scatter by 3 % is within 0.5 % of the truth.
    assert np.allclose(np.concatenate(levels), true, rtol=0.02)
    assert [len(level) for level in levels] == [2, 1]
    assert fit == pytest.approx(size_iou(sizes, np.concatenate(levels)).max(axis=1).mean(), abs=0.01)


def test_more_anchors_never_fit_much_worse() -> None:
    rng = np.random.default_rng(2)
    boxes = np.concatenate([np.zeros((300, 2)), np.exp(rng.uniform(2, 5, (300, 2)))], axis=1)
    fits = [propose_anchors(boxes, (n,), np.random.default_rng(0))[1] for n in (1, 3, 6, 12)]
    assert all(b > a for a, b in itertools.pairwise(fits))


def test_too_few_boxes_for_the_anchors() -> None:
    with pytest.raises(ValueError, match="at least 3 distinct box sizes"):
        propose_anchors(np.tile([0.0, 0.0, 5.0, 9.0], (20, 1)), (2, 1), np.random.default_rng(0))
