"""The Siamese tracker: shapes, which cells learn what, the loss against closed forms, and that it learns."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from tsuiseki.models.tracker import (
    BOX_WEIGHT,
    STRIDE,
    SearchPart,
    TemplatePart,
    TrackerNetwork,
    best_boxes,
    cell_centres,
    cells_of_targets,
    corner_boxes,
    tracker_loss,
)

CENTRES = cell_centres(15)


def pictures(count: int) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    return tuple(torch.randn(count, 3, side, side, generator=generator) for side in (127, 255))  # type: ignore[return-value]


@pytest.fixture(scope="module")
def network() -> TrackerNetwork:
    torch.manual_seed(0)
    return TrackerNetwork().eval()


def test_cells_lie_evenly_about_the_middle() -> None:
    x, y = CENTRES
    assert (x[0, 0], x[0, 7], x[0, 14]) == (15.5, 127.5, 239.5)
    assert torch.equal(y, x.T)
    # Those of a smaller picture are as far from its middle.
    torch.testing.assert_close(cell_centres(11) - 191 / 2, CENTRES[:, 2:-2, 2:-2] - 255 / 2)


def test_shapes_and_ranges(network: TrackerNetwork) -> None:
    template, search = pictures(2)
    features = TemplatePart(network)(template)
    scores, boxes = SearchPart(network)(features, search)
    assert (features.shape, scores.shape, boxes.shape) == ((2, 64, 7, 7), (2, 1, 15, 15), (2, 4, 15, 15))
    torch.testing.assert_close(features.norm(dim=1), torch.ones(2, 7, 7))
    assert 0 < float(scores.detach().min()) < float(scores.detach().max()) < 1
    assert float(boxes.min()) > 0


def test_a_pair_is_seen_alone(network: TrackerNetwork) -> None:
    template, search = pictures(3)
    together, alone = network(template, search), network(template[1:2], search[1:2])
    for whole, part in zip(together, alone, strict=True):
        torch.testing.assert_close(whole[1:2], part, rtol=1e-3, atol=1e-3)


def test_a_cell_in_a_box_gets_the_distances_to_its_sides() -> None:
    boxes, cell = torch.tensor([[100.0, 110.0, 150.0, 170.0]]), (8, 7)
    core, inside = cells_of_targets(CENTRES, boxes, torch.tensor([True]))
    x, y = (float(axis[cell]) for axis in CENTRES)
    assert (x, y) == (127.5, 143.5)
    distances = torch.zeros(1, 4, 15, 15)
    distances[(0, slice(None), *cell)] = torch.tensor([x - 100, y - 110, 150 - x, 170 - y])
    torch.testing.assert_close(corner_boxes(distances, CENTRES)[(0, slice(None), *cell)], boxes[0])
    # Columns at 111.5, 127.5 and 143.5 lie in the box, rows at 111.5 to 159.5; the middle half holds fewer.
    assert int(inside.sum()) == 3 * 4
    assert core.nonzero()[:, 1:].tolist() == [[7, 7], [8, 7]]


def test_the_next_cell_stands_for_a_target_smaller_than_a_cell() -> None:
    boxes = torch.tensor([[120.0, 120.0, 122.0, 122.0]])
    core, inside = cells_of_targets(CENTRES, boxes, torch.tensor([True]))
    assert core.nonzero().tolist() == [[0, 7, 7]] == inside.nonzero().tolist()


def test_no_cell_stands_for_an_absent_target() -> None:
    core, inside = cells_of_targets(CENTRES, torch.tensor([[100.0, 100.0, 160.0, 160.0]]), torch.tensor([False]))
    assert not core.any()
    assert not inside.any()


def test_loss_of_closed_form() -> None:
    """Boxes half as wide as the target: overlap 1/2; complete IoU adds the shift of the middles and the shapes."""
    boxes, present = torch.tensor([[95.5, 95.5, 159.5, 159.5]]), torch.tensor([True])
    logits, distances = torch.zeros(1, 1, 15, 15), torch.ones(1, 4, 15, 15)
    core, inside = cells_of_targets(CENTRES, boxes, present)
    left = torch.where(inside[0], CENTRES[0] - 95.5, torch.ones(15, 15))
    upper = torch.where(inside[0], CENTRES[1] - 95.5, torch.ones(15, 15))
    distances[0, 0], distances[0, 1], distances[0, 2], distances[0, 3] = left, upper, 64 - left, 32 - upper
    terms = tracker_loss(logits, distances, boxes, present)
    # Complete IoU: 1 - 1/2, the middle 16 of a diagonal of 64 sqrt 2 off, and angles of 1/2 and 1.
    shape = 4 / math.pi**2 * (math.atan(2) - math.atan(1)) ** 2
    expected = 0.5 + 16**2 / (2 * 64**2) + shape**2 / (0.5 + shape)
    assert float(terms["box_loss"]) == pytest.approx(BOX_WEIGHT * expected, rel=1e-4)
    # Scores of 1/2 are right where the overlap is 1/2; elsewhere each costs log 2 / 4.
    assert float(terms["score_loss"]) == pytest.approx((225 - int(core.sum())) * math.log(2) / 4 / int(core.sum()))


def test_right_heads_cost_nothing() -> None:
    boxes, present = torch.tensor([[100.0, 110.0, 150.0, 170.0]]), torch.tensor([True])
    corners = boxes[0, :, None, None].expand(4, 15, 15)
    distances = torch.cat((CENTRES - corners[:2], corners[2:] - CENTRES))[None]
    core, _ = cells_of_targets(CENTRES, boxes, present)
    logits = torch.where(core, 30.0, -30.0)[:, None]
    terms = tracker_loss(logits, distances, boxes, present)
    assert float(sum(terms.values())) == pytest.approx(0, abs=1e-5)
    found, score = best_boxes((logits, distances))
    torch.testing.assert_close(found, boxes)
    assert float(score) == pytest.approx(1)


def test_a_batch_without_a_target_has_a_loss() -> None:
    terms = tracker_loss(torch.zeros(2, 1, 15, 15), torch.ones(2, 4, 15, 15), torch.zeros(2, 4), torch.zeros(2).bool())
    assert float(terms["box_loss"]) == 0
    assert float(terms["score_loss"]) > 0


@pytest.mark.slow
def test_a_pair_is_learnt_by_heart() -> None:
    torch.manual_seed(0)
    network = TrackerNetwork(channels=16)
    template, search = pictures(2)
    boxes, present = torch.tensor([[60.0, 70.0, 120.0, 130.0], [140.0, 90.0, 200.0, 180.0]]), torch.ones(2).bool()
    optimiser = torch.optim.AdamW(network.parameters(), 1e-2)
    losses = []
    for _ in range(10):
        loss = torch.stack(list(network.loss(network(template, search), boxes, present).values())).sum()
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.6 * losses[0]


def test_the_stride_is_that_of_the_trunk(network: TrackerNetwork) -> None:
    assert network.card.settings == {"stride": STRIDE, "trunk": "mobilenet_v3_small", "channels": 64}
