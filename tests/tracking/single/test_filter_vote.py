"""The correlation filter beside a network: its votes, the box between both, and when it moves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.tracking.single.moving_texture import clip, overlaps, run, walk
from tests.tracking.single.tiny_siamese import LAYOUTS
from tsuiseki.tracking.single.filter_vote import REACH, FilterVote
from tsuiseki.tracking.single.response_particles import ResponseParticles
from tsuiseki.tracking.single.siamese import open_network


@pytest.fixture
def vote() -> FilterVote:
    """After a frame in which the target moved from (60, 80) to (63, 80)."""
    images, boxes = clip([(60, 80), (63, 80)], height=32, width=32)
    vote = FilterVote(images[0], boxes[0])
    vote.locate(images[1])
    return vote


def test_votes_are_a_bell_about_the_filters_place(vote: FilterVote) -> None:
    centre = vote.located.centre
    np.testing.assert_allclose(centre, [63, 80], atol=0.5)
    steps = np.array([[0.0, 0], [1, 0], [0, 2]]) * REACH * 32
    np.testing.assert_allclose(vote.votes(centre + steps, 32.0), np.exp([0, -0.5, -2]))


def test_a_box_on_which_both_agree_lies_between_theirs(vote: FilterVote) -> None:
    own = np.array([32.0, 32.0]) * vote.located.size
    centre, size = vote.box_between(vote.located.centre + 4, own * 4)
    np.testing.assert_allclose(centre, vote.located.centre + 2)
    np.testing.assert_allclose(size, own * 2)


@pytest.mark.parametrize(("away", "certain", "moves"), [(0, False, True), (45, False, False), (45, True, True)])
def test_the_filter_moves_where_it_responds_or_the_network_is_certain(away: int, certain: bool, moves: bool) -> None:
    images, boxes = clip([(60, 80), (63, 80)], height=32, width=32)
    vote = FilterVote(images[0], boxes[0])
    vote.locate(images[1])
    opinion = vote.opinion(images[1], vote.located.centre + away, np.array([32.0, 32.0]))
    assert opinion.agrees == (away == 0)
    vote.learn(images[1], opinion, certain)
    chosen = opinion.target if moves else vote.located
    np.testing.assert_array_equal(vote._target.centre, chosen.centre)


@pytest.mark.parametrize(("layout", "votes"), [("own", True), ("nanotrack", False), ("vittrack", False)])
def test_a_filter_votes_beside_a_network_of_this_toolkit(layout: str, votes: bool, tmp_path: Path) -> None:
    network = open_network(LAYOUTS[layout](tmp_path))
    assert (network.filter_share > 0) == votes
    images, boxes = clip(walk(12), height=32, width=32)
    assert overlaps(run(ResponseParticles(network), images, boxes[0]), boxes).mean() > 0.7
