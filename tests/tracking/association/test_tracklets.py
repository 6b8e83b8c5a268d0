"""Tracklets as decisions of the flow come in, and how they are joined."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.association.chain_motion import MotionNoise, beliefs_along
from tsuiseki.tracking.association.detection_tables import Measurements
from tsuiseki.tracking.association.tracklets import Tracklets, _beliefs_at_ends, cheapest_matching


def test_chains_in_parts_are_the_chains_at_once() -> None:
    looks = np.eye(8)[[0, 1, 0, 2, 1, 3, 0, 4]]
    numbers, follower = [0, 1, 2, 4, 5, 6, 7], [2, 4, 6, 7, -1, -1, -1]
    whole, parts = Tracklets(), Tracklets()
    whole.add(np.array(numbers), np.array(follower), looks[numbers])
    for part in ([0, 1], [2], [4, 5, 6], [7]):
        parts.add(np.array(part), np.array([follower[numbers.index(n)] for n in part]), looks[part])
    assert whole.labels(8).tolist() == [0, 1, 0, -1, 1, 2, 0, 1]
    assert parts.labels(8).tolist() == whole.labels(8).tolist()
    a, b = parts.appearance(), whole.appearance()
    assert a is not None
    assert b is not None
    np.testing.assert_allclose(a, b)
    np.testing.assert_allclose(b[1], (looks[1] + looks[4] + looks[7]) / np.sqrt(5))


def test_the_cheapest_matching_is_that_of_all_matchings() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        table = rng.normal(0, 1, (4, 3))
        best = min(
            sum(min(table[i, j], 0) for i, j in zip(rows, range(3), strict=True))
            for rows in np.array(np.meshgrid(*[range(4)] * 3)).reshape(3, -1).T
            if len(set(rows.tolist())) == 3
        )
        i, j = np.nonzero(np.ones_like(table))
        before, after = cheapest_matching(i, j, table[i, j])
        assert len(set(before.tolist())) == len(before)
        np.testing.assert_allclose(table[before, after].sum(), best)


def test_motion_at_the_ends_of_tracks_is_that_of_all_their_detections() -> None:
    rng, count = np.random.default_rng(3), 600
    labels = rng.integers(-1, 2, count)
    places = np.cumsum(rng.normal(0, [1, 1, 0.01, 0.01], (count, 4)), axis=0)
    seen = Measurements(np.arange(count) / 30, places, np.ones(count), np.zeros(count))
    past, future = _beliefs_at_ends(labels, seen, MotionNoise())
    all_past, all_future = beliefs_along(labels, seen, MotionNoise())
    for track in (0, 1):
        first, last = np.flatnonzero(labels == track)[[0, -1]]
        for here, whole, end in ((past, all_past, last), (future, all_future, first)):
            np.testing.assert_allclose(here.place[end], whole.place[end], atol=1e-4)
            np.testing.assert_allclose(here.velocity[end], whole.velocity[end], atol=1e-3)
            np.testing.assert_allclose(here.covariance[end], whole.covariance[end], rtol=1e-4)
