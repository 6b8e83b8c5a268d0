"""What is chosen by HOTA: the search, the shares, and the changes they are made of."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.association.evidence import DETECTION_FEATURES, LINK_FEATURES
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.end_to_end.choosing import SHARES, STEPS, best_share, pattern_search
from tsuiseki.trainers.experiments.end_to_end.given import others_of
from tsuiseki.trainers.experiments.end_to_end.simple_changes import Mixed, Scalars, Shrunk


def test_the_search_climbs_and_stops_at_its_looks() -> None:
    asked: list[Scalars] = []

    def value(scalars: Scalars) -> float:
        asked.append(scalars)
        return -((scalars.worth - 1.2) ** 2) - (scalars.join + 1.5) ** 2 - scalars.link**2

    best = pattern_search(value, 60)
    assert (best.worth, best.join, best.link) == (1.2, -1.5, 0.0)
    assert len(asked) == len(set(asked)) <= 60
    asked.clear()
    pattern_search(value, 5)
    assert len(asked) == 5
    assert asked[0] == Scalars()


def test_the_search_stays_where_nothing_is_better() -> None:
    assert pattern_search(lambda scalars: float(scalars == Scalars()), 100) == Scalars()


def test_searches_share_their_lattice() -> None:
    """So that what one group has looked at, the others need not: a coarse step there and back is exactly nothing."""
    for place, step in enumerate(STEPS):
        assert Scalars().stepped(place, step).stepped(place, -step) == Scalars()


def test_scalars_change_what_they_are_named_after() -> None:
    links, detections = np.ones((2, len(LINK_FEATURES))), np.ones((2, len(DETECTION_FEATURES)))
    none = Scalars()
    assert not none.links(links).any()
    assert not none.detections(detections).any()
    assert not none.joins(links).any()
    links[1, LINK_FEATURES.index("cost")], links[1, LINK_FEATURES.index("seconds")] = 3.0, 2.0
    detections[1, DETECTION_FEATURES.index("logit")] = -2.0
    some = Scalars(link=0.5, waiting=1.0, worth=1.0, logit=0.25, ends=-1.0, join=2.0)
    np.testing.assert_allclose(some.links(links), [1.5, 3.5])
    np.testing.assert_allclose(some.detections(detections), [[1.25, -1, -1], [0.5, -1, -1]])
    np.testing.assert_allclose(some.joins(links), [2, 2])


def test_shares_shrink_links_and_detections_apart() -> None:
    whole = Scalars(link=1.0, worth=2.0, join=4.0)
    rows = np.ones((1, len(LINK_FEATURES)))
    half = Shrunk(whole, 0.5, 0.25)
    assert half.links(rows) == 0.5 * whole.links(rows)
    assert half.joins(rows) == 0.5 * whole.joins(rows)
    np.testing.assert_allclose(half.detections(rows[:, :15]), 0.25 * whole.detections(rows[:, :15]))


def sums_at(hits: float) -> FloatArray:
    """Sums of a sequence on which so many of a hundred boxes are found, all with their right identity."""
    found = np.full(19, hits)
    return np.concatenate([found, 100 - found, 0 * found, found, [hits, 0, 100 - hits, 0], [hits, 0, 100 - hits]])


def test_links_by_one_and_detections_by_another() -> None:
    links, detections = np.ones((4, len(LINK_FEATURES))), np.ones((3, len(DETECTION_FEATURES)))
    one, other = Scalars(link=0.5, worth=2.0, join=1.0), Scalars(link=0.1, worth=-3.0, join=7.0)
    both = Mixed(one, other)
    np.testing.assert_array_equal(both.links(links), one.links(links))
    np.testing.assert_array_equal(both.joins(links), one.joins(links))
    np.testing.assert_array_equal(both.detections(detections), other.detections(detections))


@pytest.mark.parametrize("left", [0, 1, 2])
def test_a_share_is_chosen_without_the_group_that_is_scored(left: int) -> None:
    groups = [[0], [1], [2]]
    good, bad = (np.stack([sums_at(hits) for hits in range(1, len(SHARES) + 1)][:: 1 if up else -1]) for up in (1, 0))
    inner: dict[tuple[int, int], dict[int, FloatArray]] = {}
    for a, b in ((0, 1), (0, 2), (1, 2)):
        # What is found on the group that is left says the opposite, and is not to be listened to.
        inner[a, b] = {k: bad if k == left else good for k in (a, b)}
    assert best_share(others_of(inner, groups, left), sure=False) == SHARES[-1]


@pytest.mark.parametrize("sure", [False, True])
def test_with_two_groups_nothing_is_taken(sure: bool) -> None:
    assert best_share(others_of({}, [[0], [1]], 0), sure) == (0.0, 0.0)


def test_a_gain_on_one_sequence_alone_is_not_sure() -> None:
    def at(*hits: float) -> FloatArray:
        return np.stack([sums_at(one) for one in hits])

    # The last share is the best in sum, by the first sequence alone; the second gains a little on all.
    even = [at(50, 52, 50, 50), at(50, 53, 50, 50), at(50, 52, 50, 50)]
    odd = [at(50, 52, 50, 75), at(50, 53, 50, 50), at(50, 52, 50, 50)]
    assert best_share(odd, sure=False) == SHARES[3]
    assert best_share(odd, sure=True) == best_share(even, sure=True) == SHARES[1]
    assert best_share([at(50, 40, 75, 50), at(50, 60, 40, 49)], sure=True) == SHARES[0]
    assert best_share([at(50, 60, 50, 50)], sure=True) == SHARES[0]
