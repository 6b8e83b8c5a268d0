"""When first prices are too high, and what links cost then."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.association.flow_rounds import FirstCosts, Links, with_known_velocity
from tsuiseki.tracking.association.link_cost import LinkCost


@pytest.mark.parametrize(("used", "left_out"), [(0, True), (16, True), (17, False)])
def test_first_prices_may_be_too_high_where_right_ones_are_left_out(used: int, left_out: bool) -> None:
    probability = np.where(np.arange(30) < 20, 0.9, 0.3)
    assert FirstCosts(probability, np.zeros(30)).left_out(np.arange(30) < used) == left_out


@pytest.mark.parametrize(
    ("used", "right", "others", "taken"),
    [
        # Of twenty right ones and ten others: in tracks at first, and added by lower prices.
        (12, 6, 0, True),
        (12, 6, 3, True),
        (12, 6, 4, False),
        (12, 0, 0, False),
        # Hardly any was in tracks.
        (4, 2, 10, True),
        (5, 2, 10, False),
    ],
)
def test_lower_prices_are_taken_where_they_add_right_ones(used: int, right: int, others: int, taken: bool) -> None:
    which = np.arange(30)
    costs = FirstCosts(np.where(which < 20, 0.9, 0.3), np.zeros(30))
    more = (which < used + right) | ((which >= 20) & (which < 20 + others))
    assert costs.adds_right(which < used, more) == taken


def test_few_detections_say_nothing() -> None:
    assert not FirstCosts(np.ones(9), np.zeros(9)).left_out(np.zeros(9, dtype=np.bool_))


def test_only_links_without_a_price_along_tracks_take_the_velocity_for_known() -> None:
    cost, which = LinkCost(), np.arange(2)
    links = Links(which, which + 1, np.array([6.0, 6.0]), np.array([np.nan, 6.0]), np.zeros(2))
    known = with_known_velocity(links, cost, 10.0).cost
    assert known[0] == pytest.approx(6.0 - (1 - cost.velocity_confidence) * cost.room(0.1))
    assert known[1] == 6.0
