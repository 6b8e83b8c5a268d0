"""Links between views: what does not change who goes on as whom."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.properties.drawn import seeds
from tsuiseki.tracking.linking.transits import Passages, Transits, linked, people_of
from tsuiseki.tracking.types import IntArray


def passages_of(seed: int, people: int = 8) -> Passages:
    """People who leave the first view and enter the second some seconds later, and one stranger in each."""
    rng = np.random.default_rng(seed)
    left = np.sort(rng.uniform(0, 300, people))
    begin = np.concatenate([left - 5, left + rng.normal(20, 2, people), rng.uniform(0, 300, 2)])
    looks = rng.normal(0, 1, (people + 2, 6))
    features = looks[np.concatenate([np.arange(people), np.arange(people + 2)])] + rng.normal(
        0, 0.3, (2 * people + 2, 6)
    )
    features /= np.linalg.norm(features, axis=1, keepdims=True)
    view = np.repeat([0, 1, 0, 1], [people, people, 1, 1])
    places = np.where(view[:, None] == 0, [0.9, 0.5], [0.1, 0.5]) + rng.normal(0, 0.02, (len(view), 2))
    return Passages(view, begin, begin + 5, 1 - places, places, features)


def rows(passages: Passages, order: IntArray) -> Passages:
    return Passages(*(getattr(passages, column.name)[order] for column in fields(Passages)))


def pairs(links: Transits) -> set[tuple[int, int]]:
    return {*zip(links.earlier.tolist(), links.later.tolist(), strict=True)}


@given(seed=seeds)
def test_links_do_not_depend_on_the_order_of_tracks(seed: int) -> None:
    """Tracks in another order are linked alike, with the same margins."""
    passages = passages_of(seed)
    order = np.random.default_rng(seed).permutation(len(passages.view))
    found, shuffled = linked(passages), linked(rows(passages, order))
    assert {(int(order[i]), int(order[j])) for i, j in pairs(shuffled)} == pairs(found)
    np.testing.assert_allclose(np.sort(shuffled.margins), np.sort(found.margins), atol=1e-3)


@given(seed=seeds, start=st.floats(-1e4, 1e4))
def test_links_do_not_depend_on_when_the_clock_began(seed: int, start: float) -> None:
    """All times later by the same give the same links and seconds."""
    passages = passages_of(seed)
    later = replace(passages, begin=passages.begin + start, end=passages.end + start)
    found, shifted = linked(passages), linked(later)
    assert pairs(shifted) == pairs(found)
    np.testing.assert_allclose(shifted.seconds, found.seconds, atol=1e-6)


@given(seed=seeds)
def test_links_lead_to_another_view_and_on_in_time(seed: int) -> None:
    """Each track has one before and one after at most, in another view, and no later than it begins."""
    passages = passages_of(seed)
    links = linked(passages)
    assert len({*links.earlier.tolist()}) == len({*links.later.tolist()}) == len(links.earlier)
    assert (passages.view[links.earlier] != passages.view[links.later]).all()
    assert (passages.begin[links.later] - passages.end[links.earlier] > -0.5).all()
    assert (links.margins >= -1e-4).all()


@given(seed=seeds, turned=st.booleans())
def test_views_may_change_their_names(seed: int, turned: bool) -> None:
    """Views called otherwise, and features all turned alike, give the same links."""
    passages, rng = passages_of(seed), np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(6, 6)))[0] if turned else np.eye(6)
    renamed = replace(passages, view=7 - 3 * passages.view, features=passages.features @ turn)
    assert pairs(linked(renamed)) == pairs(linked(passages))


@given(seed=seeds, count=st.integers(1, 12), links=st.integers(0, 12))
def test_people_are_what_sure_links_join(seed: int, count: int, links: int) -> None:
    """Two tracks are one person where a chain of sure links leads from one to the other; ids are in order from 1."""
    rng = np.random.default_rng(seed)
    earlier, later, sure = (*rng.integers(0, count, (2, links)), rng.random(links) < 0.5)
    people = people_of(count, Transits(earlier, later, *np.zeros((3, links))), sure)
    groups = [{k} for k in range(count)]
    for i, j in zip(earlier[sure].tolist(), later[sure].tolist(), strict=True):
        joined = set().union(*(group for group in groups if group & {i, j}))
        groups = [*(group for group in groups if not group & {i, j}), joined]
    expected = {frozenset(group) for group in groups}
    assert {frozenset(np.flatnonzero(people == number).tolist()) for number in np.unique(people)} == expected
    assert np.unique(people).tolist() == list(range(1, len(expected) + 1))
