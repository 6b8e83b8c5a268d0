"""When first prices are too high, and what links cost then."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.association.flow_rounds import FirstCosts, Links, with_known_velocity
from tsuiseki.tracking.association.link_cost import LinkCost


@pytest.mark.parametrize(
    ("right", "used", "too_high"),
    [
        (20, 0, True),
        (20, 12, True),
        # Most of the right ones are in tracks.
        (20, 13, False),
        # Where a third and more of all are not likely to be right, hardly any is in tracks.
        (13, 0, True),
        (13, 2, True),
        (13, 3, False),
    ],
)
def test_first_prices_are_too_high_where_most_are_right_and_left_out(right: int, used: int, too_high: bool) -> None:
    probability = np.where(np.arange(20) < right, 0.9, 0.3)
    assert FirstCosts(probability, np.zeros(20)).left_out(np.arange(20) < used) == too_high


def test_few_detections_say_nothing() -> None:
    assert not FirstCosts(np.ones(9), np.zeros(9)).left_out(np.zeros(9, dtype=np.bool_))


def test_only_links_without_a_price_along_tracks_take_the_velocity_for_known() -> None:
    cost, which = LinkCost(), np.arange(2)
    links = Links(which, which + 1, np.array([6.0, 6.0]), np.array([np.nan, 6.0]), np.zeros(2))
    known = with_known_velocity(links, cost, 10.0).cost
    assert known[0] == pytest.approx(6.0 - (1 - cost.velocity_confidence) * cost.room(0.1))
    assert known[1] == 6.0
